// Where the bytes of a field come from: a host of static files, or the page itself.

const kStart = 8 << 10;         // bytes of the file's start that a reader needs: two pages,
const kMetaBytes = 152;         // of each of which so many are in use
const kEnd = 64 << 10;          // and of its end, where an index may be
const kCheapGap = 4 << 10;      // bytes that a request is not worth
const kWidestGap = 256 << 10;   // bytes that no request saved is worth
const kLeastRanges = 40;        // of one call, that another request is worth
const kPartHead = 160;          // bytes that a range costs in an answer with several
const kMostParts = 80;          // ranges of one request; hosts refuse more than 200
const kMostAnswer = 512 << 10;  // bytes of an answer with several ranges, about
const kKept = 16 << 20;         // bytes of answers to single ranges
const kRetries = 4;

const sleep = (ms) => new Promise((done) => setTimeout(done, ms));

const kNoRanges = 'The host of this field does not serve parts of files (HTTP ranges). ' +
                  'Use another host, slf view, or an export to one .html file.';

// A file on a host of static files, read by ranges.
export class HttpSource {
  constructor(url) {
    this.url = url;
    this.bytes = this.requests = 0;
    this.roundTrips = 0;   // the longest chain of answers, each before the next request
    this.kept = [];       // answers with more than was asked for, the oldest first
    this.several = false;  // whether the host serves several ranges in one answer
  }

  // Resolves to the start and the end of the file: [{begin, bytes}, …].
  open() {
    return this.opened ??= (async () => {
      const [start, [end]] = await Promise.all([this.openStart(), this.ask(`-${kEnd}`)]);
      this.size = end.total;
      return end.begin > 0 ? [start, end] : [end];
    })();
  }
  // Asks for two ranges of the start. A host that does not serve several sends the whole file,
  // which begins with them, so finding out costs no request.
  async openStart() {
    const second = kStart / 2, ranges = [[0, kMetaBytes], [second, second + kMetaBytes]];
    const {response, body} = await this.request(asText(ranges), kStart);
    const parts = response.status === 206 ? await this.partsOf(response, body, true) : [];
    const found = ranges.map(([begin, end]) => slice(parts, begin, end));
    if (found.every((bytes) => bytes)) {
      this.several = parts.length > 1;
      const bytes = new Uint8Array(kStart);
      found.forEach((part, i) => bytes.set(part, ranges[i][0]));
      return {begin: 0, bytes};
    }
    if (response.status === 200 && body) return {begin: 0, bytes: body};
    return (await this.ask(`0-${kStart - 1}`))[0];
  }

  // Starts to read ranges [begin, end] in any order, in few requests. A promise of the bytes each.
  readAll(ranges) {
    const loaded = this.load([...ranges].sort((a, b) => a[0] - b[0]));
    return ranges.map(async (range) => (await loaded)(...range));
  }

  // These resolve to a function that takes a range to its bytes.
  async load(ranges) {
    if (!this.several) return this.readSingly(ranges);
    const groups = grouped(ranges), loads = groups.map((group) => this.readSeveral(group));
    return async (begin, end) => {
      const load = await loads[groups.findIndex((group) => group.at(-1)[1] >= end)];
      return load(begin, end);
    };
  }
  async readSeveral(ranges) {
    const parts = await this.ask(asText(merged(ranges, kPartHead)));
    this.several = ranges.every(([begin, end]) => slice(parts, begin, end));
    return this.several ? (begin, end) => slice(parts, begin, end) : this.readSingly(ranges);
  }
  async readSingly(ranges) {
    const absent = ranges.filter(([begin, end]) => !slice(this.kept, begin, end));
    const loads = inFewRequests(absent).map(([begin, end]) => ({
      begin, end, parts: this.ask(asText([[begin, end]]))}));
    for (const {parts} of loads)
      parts.then(([part]) => this.keep(part), () => {});  // each range reports what fails
    return async (begin, end) => {
      const load = loads.find((l) => begin >= l.begin && end <= l.end);
      const bytes = slice(load ? await load.parts : this.kept, begin, end);
      if (!bytes) throw new Error('The host cut an answer short.');
      return bytes;
    };
  }
  // What fills gaps may soon be asked for.
  keep(part) {
    this.kept.push(part);
    let bytes = this.kept.reduce((sum, p) => sum + p.bytes.length, 0);
    for (; bytes > kKept; bytes -= this.kept.shift().bytes.length) continue;
  }

  // Asks for ranges as a header names them, and resolves to the parts that came: {begin, bytes,
  // total} each. None: the host refused several ranges.
  async ask(ranges) {
    const several = ranges.includes(','), {response, body} = await this.request(ranges);
    if (response.status === 206) return this.partsOf(response, body, several);
    if (several) return [];
    throw new Error(kNoRanges);
  }
  async partsOf(response, body, several) {
    const tag = response.headers.get('ETag');
    if ((this.tag ??= tag) !== tag)
      throw new Error('The field has changed on its host. Reload the page.');
    const mixed = /^multipart\/byteranges/i.test(response.headers.get('Content-Type') ?? '');
    const range = response.headers.get('Content-Range') ?? '';
    const parts = mixed ? divided(body) : [place(range, body)];
    if (parts.every((part) => part)) return parts;
    if (several) return [];
    throw new Error('The host hides the header Content-Range; it must allow it (CORS).');
  }

  // Tries again what may succeed later. Of an answer with the whole file, the body has the first
  // `wanted` bytes only; the rest is refused.
  async request(ranges, wanted = 0) {
    const trip = this.roundTrips + 1;
    for (let attempt = 0;; ++attempt) {
      const stop = new AbortController();
      let wrong;
      try {
        ++this.requests;
        // A browser's cache would split a range around the parts of it that it has.
        const response = await fetch(this.url, {headers: {Range: 'bytes=' + ranges},
                                                cache: 'no-store', signal: stop.signal});
        if (response.status === 206) {
          const body = new Uint8Array(await response.arrayBuffer());
          this.bytes += body.length;
          this.roundTrips = Math.max(this.roundTrips, trip);
          return {response, body};
        }
        const whole = response.status === 200 && wanted > 0;
        const body = whole ? await firstBytes(response, wanted) : undefined;
        stop.abort();  // else the whole file may come
        this.bytes += body?.length ?? 0;
        if (whole) this.roundTrips = Math.max(this.roundTrips, trip);
        if (response.ok || response.status === 416) return {response, body};
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

// Where a part belongs, after its Content-Range.
function place(header, body) {
  const found = /bytes (\d+)-(\d+)\/(\d+)/i.exec(header)?.slice(1).map(Number);
  const bytes = found && body.subarray(0, found[1] + 1 - found[0]);
  return bytes?.length === found?.[1] + 1 - found?.[0] ? {begin: found[0], bytes, total: found[2]}
                                                       : undefined;
}

// The first bytes of a body, or all, if it has fewer.
async function firstBytes(response, count) {
  const bytes = new Uint8Array(count), reader = response.body.getReader();
  let have = 0;
  for (let piece; have < count && !(piece = await reader.read()).done;) {
    const some = piece.value.subarray(0, count - have);
    bytes.set(some, have);
    have += some.length;
  }
  return bytes.subarray(0, have);
}

// The parts of a body of type multipart/byteranges: each follows a blank line.
function divided(body) {
  const parts = [], text = new TextDecoder('latin1');
  for (let at = 0;;) {
    let blank = body.indexOf(13, at);
    const ends = (b) => body[b + 1] === 10 && body[b + 2] === 13 && body[b + 3] === 10;
    while (blank >= 0 && !ends(blank))
      blank = body.indexOf(13, blank + 1);
    if (blank < 0) return parts;
    const part = place(text.decode(body.subarray(at, blank)), body.subarray(blank + 4));
    parts.push(part);
    if (!part) return parts;
    at = blank + 4 + part.bytes.length;
  }
}

function slice(parts, begin, end) {
  const part = parts.find((p) => begin >= p.begin && end <= p.begin + p.bytes.length);
  return part?.bytes.slice(begin - part.begin, end - part.begin);
}

// As a header names ranges.
const asText = (ranges) => ranges.map(([begin, end]) => `${begin}-${end - 1}`).join(',');

// Ascending ranges with gaps up to `gap` filled.
function merged(ranges, gap) {
  const result = [];
  for (const [begin, end] of ranges) {
    const last = result.at(-1);
    if (last && begin - last[1] <= gap) last[1] = Math.max(last[1], end);
    else result.push([begin, end]);
  }
  return result;
}

// Ascending ranges with the smallest gaps filled, until the requests are few enough or far apart.
function inFewRequests(ranges) {
  const most = Math.ceil(ranges.length / kLeastRanges);
  const all = merged(ranges, kCheapGap);
  const gaps = all.slice(1).map(([begin], i) => begin - all[i][1]).sort((a, b) => b - a);
  return gaps.length < most ? all : merged(all, Math.min(gaps[most - 1], kWidestGap));
}

// Ascending ranges, divided among requests for several.
function grouped(ranges) {
  const groups = [];
  let bytes = 0, parts = 0, end = -1;
  for (const range of ranges) {
    if (range[0] - end > kPartHead) ++parts;
    if (groups.length === 0 || parts > kMostParts || bytes > kMostAnswer) {
      groups.push([]);
      bytes = 0;
      parts = 1;
    }
    groups.at(-1).push(range);
    bytes += range[1] - range[0];
    end = range[1];
  }
  return groups;
}

// A file inside the page, as pieces of base64. Each piece but the last has a multiple of 3 bytes.
export class EmbeddedSource {
  constructor(pieces, pieceBytes, size) {
    Object.assign(this, {pieces, pieceBytes, size, bytes: 0, requests: 0, roundTrips: 0});
  }
  async open() {
    const at = Math.max(0, this.size - kEnd);
    return [[0, Math.min(kStart, this.size)], [at, this.size]].map(
      ([begin, end]) => ({begin, bytes: this.read(begin, end)}));
  }
  readAll(ranges) { return ranges.map(async ([begin, end]) => this.read(begin, end)); }
  read(begin, end) {
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
