// Where the bytes of a field come from: a host of static files, or the page itself.

const kStart = 8 << 10;       // bytes of the file's start that a reader needs
export const kEnd = 64 << 10; // and of its end, where an index may be
const kGap = 64 << 10;        // ranges nearer than this are one request
const kMostRequest = 2 << 20; // bytes
const kRetries = 4;

const sleep = (ms) => new Promise((done) => setTimeout(done, ms));

// A file on a host of static files, read by ranges.
export class HttpSource {
  constructor(url) {
    this.url = url;
    this.bytes = this.requests = 0;
  }

  async open() {
    const response = await this.request(0, kStart);
    const total = /\/(\d+)$/.exec(response.headers.get('Content-Range') ?? '')?.[1];
    if (response.status === 206 && !total)
      throw new Error('The host hides the header Content-Range; it must allow it (CORS).');
    if (response.status !== 206)
      throw new Error('The host of this field does not serve parts of files (HTTP ranges). ' +
                      'Use another host, slf view, or an export to one .html file.');
    this.tag = response.headers.get('ETag');
    this.size = Number(total);
    return (this.start = new Uint8Array(await this.body(response)));
  }

  async read(begin, end) {
    if (end <= this.start.length) return this.start.slice(begin, end);
    const response = await this.request(begin, end);
    if (response.status !== 206) throw new Error('The host ended to serve parts of the field.');
    const tag = response.headers.get('ETag');
    if (tag !== this.tag) throw new Error('The field has changed on its host. Reload the page.');
    const body = await this.body(response);
    if (body.byteLength !== end - begin) throw new Error('The host cut an answer short.');
    return new Uint8Array(body);
  }

  async body(response) {
    const body = await response.arrayBuffer();
    this.bytes += body.byteLength;
    return body;
  }

  // Tries again what may succeed later.
  async request(begin, end) {
    for (let attempt = 0;; ++attempt) {
      let wrong;
      try {
        ++this.requests;
        const response = await fetch(this.url, {headers: {Range: `bytes=${begin}-${end - 1}`}});
        if (response.ok) return response;
        wrong = response.status === 404 ? 'The field is not there (404).'
                                        : `The host answered ${response.status}.`;
        if (response.status < 500 && response.status !== 429) throw new Error(wrong);
      } catch (error) {
        if (error.message === wrong) throw error;
        wrong = 'The host does not answer.';
      }
      if (attempt === kRetries) throw new Error(wrong);
      await sleep(200 * 2 ** attempt);
    }
  }
}

// A file inside the page, as pieces of base64. Each piece but the last has a multiple of 3 bytes.
export class EmbeddedSource {
  constructor(pieces, pieceBytes, size) {
    Object.assign(this, {pieces, pieceBytes, size, bytes: 0, requests: 0});
  }
  async open() { return this.read(0, Math.min(kStart, this.size)); }
  async read(begin, end) {
    const bytes = new Uint8Array(end - begin);
    for (let at = begin; at < end;) {
      const piece = Math.floor(at / this.pieceBytes), from = at - piece * this.pieceBytes;
      const to = Math.min(from + end - at, this.pieceBytes), first = Math.floor(from / 3);
      const text = atob(this.pieces[piece].slice(first * 4, Math.ceil(to / 3) * 4));
      for (let i = from; i < to; ++i) bytes[at - begin + i - from] = text.charCodeAt(i - first * 3);
      at += to - from;
    }
    this.bytes += bytes.length;
    return bytes;
  }
}

// Ranges in ascending order, with small gaps filled.
export function merged(ranges) {
  const result = [];
  for (const [begin, end] of [...ranges].sort((a, b) => a[0] - b[0])) {
    const last = result.at(-1);
    if (last && begin - last[1] <= kGap && end - last[0] <= kMostRequest)
      last[1] = Math.max(last[1], end);
    else result.push([begin, end]);
  }
  return result;
}
