// Where the bytes of a field come from: a host of static files, a file on this machine, or the page
// itself.

import {Told} from './text.js';

const kStart = 8 << 10;          // bytes of the file's start that a reader needs: two pages
const kFooter = 48;               // bytes of the footer of an index
const kEnd = 64 << 10;           // bytes of its end, where an index may be
const kSmallFile = 'style.css';  // of the page, on the same host as the field
const kRetries = 4;               // of a request before the field is open; then there is no limit
const kLongPause = 5000;          // milliseconds: the longest time before the next try
const kSilent = 20000;            // an answer of which nothing comes for so long is given up
const kMaxWhole = 64 << 20;      // bytes of a field that is fetched whole, without ranges

const kAtOnce = 32;              // requests under way

// Requests for single ranges
const kPerMinute = 40;           // some archives refuse more than 60,
const kShare = 0.75;             // of what is left of these, for what is asked for together,
const kRangesPerRequest = 12;    // but no more than one for so many ranges
const kThrough = 2;              // bytes of gaps that are fetched for each byte that is asked for,
const kThroughAny = 128 << 10;   // and so many more
const kKept = 16 << 20;          // bytes of answers that are kept, because they have gaps in them
const kStored = 256 << 20;       // bytes of answers that the browser stores for later visits

// These, and requests for several ranges
const kPartHead = 160;           // bytes that each range costs in the head of an answer
const kMaxParts = 80;            // ranges of one request; hosts refuse more than 200
const kAnswerBytes = 1 << 20;    // in one answer, about
const kMaxReserved = 1 << 26;    // reserved at once for an answer, whatever length it states

const kMixed = /^multipart\/byteranges/i;

// Ends early when the browser is online again.
const pause = (ms) => new Promise((done) => {
  setTimeout(done, ms);
  addEventListener('online', done, {once: true, signal: AbortSignal.timeout(ms)});
});

// A file on a host of static files, read by ranges. Without ranges, a small file is fetched whole.
// With several hosts, a request that fails at one goes to the next, if that has the same file.
export class HttpSource {
  // `url` may be several addresses with blanks between: those after the first begin with http.
  // Requests end once `signal` is aborted. `small`: style.css is on the same host. `stores`: the
  // browser stores what was read for later visits. `first`: the ranges that readAll() will be asked
  // for first. `onProgress(done, total)` is called while a file is fetched whole; NaN: the total is
  // unknown. `onError(error)`: the file has changed after parts of it were read. `onWait(waits)`:
  // the host is silent, or answers again.
  constructor(url, {signal, small = true, stores = true, first = [], onProgress, onError,
                    onWait} = {}) {
    // Each host has its `url` and, once they are known, `tag`; `same`: whether it has the file that
    // was opened; and `resumes`: when it wants to be asked again.
    this.hosts = new URL(url, document.baseURI).href.split(/(?:%20)+(?=https?:)/i)
      .map((address) => ({url: new URL(address), resumes: 0}));
    this.host = this.hosts[0];  // the one to ask
    Object.assign(this, {signal, small, stores, first, onProgress, onError, onWait});
    this.bytes = this.requests = 0;
    this.roundTrips = 0;  // the longest chain of answers, each before the next request
    this.times = [];      // of the requests of the last minute
    this.kept = [];       // answers with bytes that were not asked for, the oldest first
    this.wants = [];      // the ranges that load() will request
    this.early = new Map();  // promises of the bytes of `first`, by range
    this.several = false;  // whether the host serves several ranges in one answer
    this.underWay = new Set();  // promises of requests
  }
  get url() { return this.host.url; }
  // Whether the field is on the host of the page.
  get beside() { return this.url.origin === globalThis.origin; }

  // Resolves to the start and the end of the file: [{begin, bytes}, …].
  open() { return this.opened ??= this.readAnyEnds(); }
  async readAnyEnds() {
    const {hosts} = this;
    for (let attempt = 1;; ++attempt)
      try {
        return await this.readEnds();
      } catch (error) {
        if (hosts.length === 1 || attempt > kRetries * hosts.length || this.signal?.aborted)
          throw error;
        this.host = hosts[attempt % hosts.length];
        if (this.host === hosts[0]) await pause(this.lengthOfPause(attempt / hosts.length));
      }
  }
  async readEnds() {
    this.kept = [];  // what another host sent may be of another file
    this.early.clear();
    const came = (answer) => answer.whole && this.onProgress?.(answer.have, answer.length);
    const ending = this.request(`-${kEnd}`, {retries: 0}).catch(() => {});
    const [several, start] = await Promise.all([
      servesSeveral(this.small && this.beside ? kSmallFile : this.url),
      this.request(`0-${kStart - 1}`, {
        orWhole: true, came, retries: this.hosts.length > 1 ? 0 : kRetries})]);
    if (start.parts.length === 0) throw new Told('empty');
    this.several = several && !start.whole;
    if (start.whole) {
      start.parts[0].total = start.have;
      this.kept.push(start);  // it has all that readAll() will be asked for
    }
    this.size = start.parts[0].total ?? await this.length();
    const strong = this.host.tag?.startsWith('"');
    if (strong && this.stores) this.store = new Store(this.url, this.host.tag);
    // Without several ranges in an answer, these would cost many requests.
    const first = this.several ? this.first.filter(([, end]) => end <= this.size) : [];
    this.readAll(first).forEach((bytes, i) => this.early.set(String(first[i]), bytes));
    const tail = await ending;
    const from = Math.max(0, this.size - kEnd);
    // Some hosts do not serve the end of a file unless they are told where it begins.
    const end = [start, tail].find((answer) => answer?.read(from, this.size)) ??
                await this.ask(asText([[from, this.size]]));
    const ends = [[start, 0, Math.min(kStart, this.size)], [end, from, this.size]].map(
      ([answer, begin, end]) => {
        const bytes = answer.read(begin, end);
        if (!bytes) throw new Told('cutShort');
        return {begin, bytes};
      });
    // Where no ETag tells versions apart, parts that change with the file do: the meta pages have
    // the transaction, and the footer of the index has a checksum of all tables.
    this.marks = ends.map(({begin, bytes}) => {
      const was = bytes.slice(begin ? -kFooter : -kStart), end = begin + bytes.length;
      return {was, begin: end - was.length, end};
    });
    this.check = () => start.whole || this.host.tag?.startsWith('"') ||
                       Promise.all(this.marks.map((mark) => this.compare(mark)));
    return ends;
  }
  async compare({was, begin, end}) {
    const answer = await this.ask(asText([[begin, end]])).catch(() => {});
    if (answer?.read(begin, end)?.some((byte, i) => byte !== was[i]))
      this.onError?.(new Told('changed'));
  }
  // Asks another host from now on, after a request to `host` failed. Resolves to whether there is
  // one. Before the file is open, open() chooses.
  async leave(host) {
    const {hosts} = this, at = hosts.indexOf(host);
    for (const other of this.marks ? [...hosts.slice(at + 1), ...hosts.slice(0, at)] : []) {
      if (this.host !== host) return true;
      if (other.resumes > Date.now() || !await this.hasSame(other)) continue;
      if (this.host === host) this.host = other;
      return true;
    }
    return false;
  }
  // Whether a host has the file that was opened. If it does not answer, that is not known.
  async hasSame(host) {
    try {
      host.same ??= (await Promise.all(this.marks.map(async ({was, begin, end}) => {
        ++this.requests;
        const response = await fetch(host.url, {
          headers: {Range: 'bytes=' + asText([[begin, end]])}, cache: 'no-store',
          signal: AbortSignal.timeout(kSilent)});
        if (response.status !== 206) throw new Error();
        const bytes = new Uint8Array(await response.arrayBuffer());
        this.bytes += bytes.length;
        const {total} = place(response.headers.get('Content-Range') ?? '') ?? {};
        return (total ?? this.size) === this.size && bytes.length === was.length &&
               bytes.every((byte, i) => byte === was[i]);
      }))).every((same) => same);
    } catch {
      return false;
    }
    return host.same;
  }
  lengthOfPause(attempt) { return Math.min(200 * 2 ** attempt, kLongPause); }
  // The length of a file whose host hides it in answers with ranges.
  async length() {
    const answer = await fetch(this.url, {method: 'HEAD', cache: 'no-store'}).catch(() => {});
    const length = Number(answer?.headers.get('Content-Length'));
    if (length > 0) return length;
    throw new Told('noLength');
  }

  // Starts to read ranges [begin, end), in any order, in few requests. Returns a promise of the
  // bytes of each range. It is fulfilled once these have come, before the rest of their answer.
  readAll(ranges) {
    return ranges.map((range) => {
      const early = this.early.get(String(range));
      if (early) return early;
      if (this.wants.length === 0) setTimeout(() => this.load());
      const want = new Want(...range);
      this.wants.push(want);
      return want.bytes;
    });
  }
  // Fetches together what several calls of readAll() have asked for.
  async load() {
    const wants = this.wants.sort((a, b) => a.begin - b.begin);
    this.wants = [];
    try {
      await this.store?.take(wants);
      const absent = wants.filter((want) => !want.came);
      if (absent.length === 0) return;
      await (this.several ? this.readSeveral(absent) : this.readSingly(absent));
      this.check?.();
    } catch (error) {
      wants.forEach((want) => want.failed(error));
    }
  }
  async readSeveral(wants) {
    await Promise.all(grouped(wants).map(async (group) => {
      await this.request(asText(merged(group, kPartHead)),
                         {came: (answer) => settle(group, answer)});
      const left = group.filter((want) => !want.came);
      if (left.length === 0) return;
      this.several = false;
      await this.readSingly(left);
    }));
  }
  async readSingly(wants) {
    for (const answer of this.kept) settle(wants, answer);
    const absent = wants.filter((want) => !want.came);
    const ranges = inFewRequests(absent, this.allowed(absent.length));
    await Promise.all(ranges.map(async ([begin, end]) => {
      const within = absent.filter((want) => want.begin >= begin && want.end <= end);
      const answer = await this.ask(asText([[begin, end]]), (answer) => settle(within, answer));
      if (within.some((want) => !want.came)) throw new Told('cutShort');
      if (within.length > 1) this.keep(answer);
    }));
  }
  // How many requests may fetch so many ranges, more or less.
  allowed(ranges) {
    const now = performance.now();
    this.times = this.times.filter((time) => now - time < 60000);
    const left = kShare * (kPerMinute - this.times.length);
    return Math.max(2, Math.min(Math.ceil(ranges / kRangesPerRequest), Math.floor(left)));
  }
  // Keeps an answer: later calls may ask for bytes in the gaps that it fills.
  keep(answer) {
    this.kept.push(answer);
    let bytes = this.kept.reduce((sum, a) => sum + a.have, 0);
    for (; bytes > kKept; bytes -= this.kept.shift().have) continue;
  }

  // Requests one range, written as in the header Range, and resolves to the answer. Calls `came`
  // each time that more of it has come.
  async ask(range, came) {
    const answer = await this.request(range, {came});
    if (answer.parts.length === 0) throw new Told('noRanges');
    return answer;
  }

  // Requests ranges once few enough requests are under way.
  async request(ranges, options = {}) {
    const trip = this.roundTrips + 1;
    while (this.underWay.size >= kAtOnce) await Promise.race(this.underWay);
    const answer = this.repeat(ranges, trip, options);
    const ended = answer.catch(() => {}).then(() => this.underWay.delete(ended));
    this.underWay.add(ended);
    return answer;
  }
  // Repeats a request that may succeed later. Refuses an answer with the whole file, unless it may
  // be that (`orWhole`); then the result has no parts.
  async repeat(ranges, trip, {orWhole = false, came = () => {}, retries}) {
    retries ??= this.check ? Infinity : kRetries;
    for (let attempt = 0;; ++attempt) {
      for (let left; (left = this.host.resumes - Date.now()) > 0;)
        if (!await this.leave(this.host)) await pause(Math.min(left, kLongPause));
      const {host} = this;
      const stop = new AbortController(), end = () => stop.abort();
      this.signal?.throwIfAborted();
      this.signal?.addEventListener('abort', end);
      let wrong, refusal, timer;
      const awaited = (promise) => {
        clearTimeout(timer);
        timer = setTimeout(() => stop.abort(), kSilent);
        return promise;
      };
      const refuse = (...said) => { throw refusal = new Told(...said); };
      try {
        ++this.requests;
        this.times.push(performance.now());
        // A browser's cache would split a range around the parts of it that it has. See Store.
        const response = await awaited(fetch(host.url, {
          headers: {Range: 'bytes=' + ranges}, cache: 'no-store', signal: stop.signal}));
        const {status, headers} = response, answer = new Answer(response, ranges, orWhole);
        if (status === 206) {
          const tag = headers.get('ETag') ?? headers.get('Last-Modified');
          if ((host.tag ??= tag) !== tag) {
            host.same = false;
            refuse('changed');
          }
        }
        this.stores &&= !/no-store/i.test(headers.get('Cache-Control') ?? '');
        for (const reader = answer.taken ? response.body.getReader() : undefined; reader;) {
          if (answer.whole && Math.max(answer.have, answer.length || 0) > kMaxWhole) {
            stop.abort();
            refuse('tooLarge');
          }
          const {value, done} = await awaited(reader.read());
          if (done) {
            this.store?.add(answer);
            return answer;
          }
          if (this.waits) this.onWait?.(this.waits = false);
          this.bytes += value.length;
          this.roundTrips = Math.max(this.roundTrips, trip);
          answer.add(value);
          came(answer);
        }
        stop.abort();  // else the whole file may come
        if (response.ok || status === 416) return answer;
        wrong = status === 404 ? ['notThere'] : ['answered', status];
        if (status < 500 && status !== 429) refuse(...wrong);
        const after = headers.get('Retry-After') ?? '';  // seconds, or a date
        const resumes = /^\d+$/.test(after) ? Date.now() + 1000 * after : Date.parse(after);
        host.resumes = Math.max(host.resumes, resumes || 0);
      } catch (error) {
        if (error === refusal) {
          if (await this.leave(host)) continue;
          throw error;
        }
        wrong = this.silence();
      } finally {
        this.signal?.removeEventListener('abort', end);
        clearTimeout(timer);
      }
      if (attempt === retries) throw new Told(...wrong);
      if ((attempt + 1) % this.hosts.length && await this.leave(host)) continue;
      const waits = attempt > 0 || host.resumes > Date.now();
      if (waits && !this.waits) this.onWait?.(this.waits = true);
      await pause(this.lengthOfPause(attempt));
    }
  }
  // Why there may be no answer, as a text's name and values; browsers do not tell.
  silence() {
    const {protocol, host} = this.url;
    if (this.beside) return ['silent'];
    if (location.protocol === 'https:' && protocol === 'http:')
      return ['insecure', host];
    const {origin} = globalThis;
    return ['noCors', host, origin === 'null' ? '*' : origin,
            [location.host === host ? 'inSandbox' : 'otherHost']];
  }
}

// Whether the host of a file serves several ranges in one answer. Hosts that do not answer with the
// whole file, so a small one is asked for where its name is known: much of a field would be on its
// way before it could be refused.
async function servesSeveral(url) {
  const stop = new AbortController();
  try {
    const {status, headers} = await fetch(url, {
      headers: {Range: 'bytes=0-0,200-200'}, cache: 'no-store', signal: stop.signal});
    return status === 206 && kMixed.test(headers.get('Content-Type') ?? '');
  } catch {
    return false;
  } finally {
    stop.abort();
  }
}

// A range that is asked for, and the promise of its bytes.
class Want {
  constructor(begin, end) {
    Object.assign(this, {begin, end, came: false});
    this.bytes = new Promise((done, failed) => Object.assign(this, {done, failed}));
    this.bytes.catch(() => {});
  }
}

// Fulfils the promises of those ranges that an answer has.
function settle(wants, answer) {
  for (const want of wants) {
    const bytes = want.came ? undefined : answer.read(want.begin, want.end);
    if (!bytes) continue;
    want.came = true;
    want.done(bytes);
  }
}

// An answer while it comes. Each of its `parts` is {begin, size, total, at}: a part of the file,
// the file's size if known, and the offset of the part's bytes in the body. The last part may be
// incomplete. A part is undefined if the answer does not say where it belongs.
class Answer {
  constructor({status, headers}, asked, orWhole) {
    const header = (name) => headers.get(name) ?? '';
    this.whole = status === 200 && orWhole;  // it has the whole file
    this.taken = status === 206 || this.whole;
    this.mixed = kMixed.test(header('Content-Type'));
    this.length = Number(headers.get('Content-Length') ?? NaN);
    this.bytes = new Uint8Array(
      this.taken ? Math.min(this.length || 1 << 16, kMaxReserved) : 0);
    this.have = 0;
    this.next = 0;  // where the head of the next part begins, in a body with several
    this.parts = [];
    if (this.whole) this.parts = [{begin: 0, size: kMaxWhole, at: 0}];
    else if (this.taken && !this.mixed)
      this.parts = [place(header('Content-Range'), 0) ?? this.presumed(asked)];
  }
  // Hosts hide Content-Range from pages of other hosts, unless they expose it (CORS). Checksums
  // reveal an answer that is not what was asked for.
  presumed(asked) {
    const found = /^(\d+)-(\d+)$/.exec(asked)?.slice(1).map(Number);
    return found && {begin: found[0], size: found[1] + 1 - found[0], at: 0};
  }

  add(piece) {
    if (this.have + piece.length > this.bytes.length) {
      const longer = new Uint8Array(Math.max(2 * this.bytes.length, this.have + piece.length));
      longer.set(this.bytes);
      this.bytes = longer;
    }
    this.bytes.set(piece, this.have);
    this.have += piece.length;
    while (this.mixed && this.takeHead()) continue;
  }
  // Reads the head of a part, which ends with a blank line. Returns false if it has not come yet.
  takeHead() {
    const {bytes, have, next} = this;
    for (let blank = next; (blank = bytes.indexOf(13, blank)) >= 0 && blank + 4 <= have; ++blank) {
      if (bytes[blank + 1] !== 10 || bytes[blank + 2] !== 13 || bytes[blank + 3] !== 10) continue;
      const head = new TextDecoder('latin1').decode(bytes.subarray(next, blank));
      const part = place(/^content-range:(.*)$/im.exec(head)?.[1] ?? '', blank + 4);
      this.parts.push(part);
      this.next = part ? part.at + part.size : Infinity;
      return part !== undefined;
    }
    return false;
  }

  // The part that has a range.
  part(begin, end) {
    return this.parts.find((p) => p && begin >= p.begin && end <= p.begin + p.size);
  }
  // A copy of bytes of the file, if all have come.
  read(begin, end) {
    const part = this.part(begin, end), from = part?.at + begin - part?.begin;
    return from + end - begin <= this.have ? this.bytes.slice(from, from + end - begin) : undefined;
  }
}

// The answers that the browser keeps of one version of a field, in its Cache Storage, which pages
// of https have. The address of each names its parts, so that these are known without reading it.
class Store {
  constructor(url, tag) {
    Object.assign(this, {url, field: `slf ${url} `, tag, left: kStored});
    this.answers = this.open().catch(() => []);
  }
  async open() {
    for (const name of await caches.keys())
      if (name.startsWith(this.field) && name !== this.field + this.tag) caches.delete(name);
    this.cache = await caches.open(this.field + this.tag);
    return (await this.cache.keys()).map((key) => {
      const answer = Object.create(Answer.prototype);
      answer.parts = new URL(key.url).search.slice(1).split(',').map((text) => {
        const [begin, size, at] = text.split('-').map(Number);
        this.left -= size;
        return {begin, size, at};
      });
      return {key, answer};
    });
  }
  // Fulfils the promises of those ranges that it has.
  async take(wants) {
    const found = (await this.answers).filter(
      ({answer}) => wants.some(({begin, end}) => answer.part(begin, end)));
    await Promise.all(found.map(async ({key, answer}) => {
      const bytes = new Uint8Array(await (await this.cache.match(key)).arrayBuffer());
      settle(wants, Object.assign(Object.create(answer), {bytes, have: bytes.length}));
    })).catch(() => {});  // the user may have cleared it
  }
  add({parts, bytes, have}) {
    this.left -= have;
    if (!this.cache || this.left < 0 || !parts.every((part) => part)) return;
    const key = new URL(this.url);
    key.search = parts.map(({begin, size, at}) => `${begin}-${size}-${at}`).join(',');
    this.cache.put(key, new Response(bytes.slice(0, have))).catch(() => {});  // no more room
  }
  // Called when something is damaged: perhaps it is so only here.
  clear() { if (this.cache) caches.delete(this.field + this.tag).catch(() => {}); }
}

// The part that a header Content-Range describes.
function place(header, at) {
  const found = /bytes (\d+)-(\d+)\/(\d+)/i.exec(header)?.slice(1).map(Number);
  return found && {begin: found[0], size: found[1] + 1 - found[0], total: found[2], at};
}

// As a header names ranges.
const asText = (ranges) => ranges.map(([begin, end]) => `${begin}-${end - 1}`).join(',');

// Ascending ranges with gaps up to `gap` filled.
function merged(ranges, gap) {
  const result = [];
  for (const {begin, end} of ranges) {
    const last = result.at(-1);
    if (last && begin - last[1] <= gap) last[1] = Math.max(last[1], end);
    else result.push([begin, end]);
  }
  return result;
}

const bytesOf = (ranges) => ranges.reduce((sum, {begin, end}) => sum + end - begin, 0);

// Fills the smallest gaps between ascending ranges until few enough requests are left, or the gaps
// have too many bytes.
function inFewRequests(ranges, most) {
  const all = merged(ranges, kPartHead);
  const gaps = all.slice(1).map(([begin], i) => begin - all[i][1]).sort((a, b) => a - b);
  let gap = kPartHead, left = kThrough * bytesOf(ranges) + kThroughAny;
  for (const next of gaps.slice(0, Math.max(0, all.length - most))) {
    if ((left -= next) < 0) break;
    gap = next;
  }
  return merged(ranges, gap);
}

// Deals ascending ranges out to requests for several. All answers come side by side, so each begins
// with coarse levels, which are first in the file.
function grouped(ranges) {
  const parts = [];
  for (const range of ranges) {
    const last = parts.at(-1);
    if (last && range.begin - last.at(-1).end <= kPartHead) last.push(range);
    else parts.push([range]);
  }
  const count = Math.ceil(Math.max(parts.length / kMaxParts, bytesOf(ranges) / kAnswerBytes));
  return Array.from({length: count}, (_, i) => parts.filter((_, k) => k % count === i).flat());
}

// A file at hand. `read(begin, end)` returns bytes, or a promise of them.
export class LocalSource {
  constructor(size, read) {
    Object.assign(this, {size, read, bytes: 0, requests: 0, roundTrips: 0});
  }
  async open() {
    const ranges = [[0, Math.min(kStart, this.size)], [Math.max(0, this.size - kEnd), this.size]];
    const parts = await Promise.all(this.readAll(ranges));
    return parts.map((bytes, i) => ({begin: ranges[i][0], bytes}));
  }
  readAll(ranges) {
    return ranges.map(async ([begin, end]) => {
      this.bytes += end - begin;
      return this.read(begin, end);
    });
  }
}

// A file on this machine.
export const fileSource = (file) => new LocalSource(file.size, async (begin, end) =>
  new Uint8Array(await file.slice(begin, end).arrayBuffer()));

// A file inside the page, as pieces of base64. All but the last are equally long, without padding.
export function embeddedSource(pieces) {
  const sizes = pieces.map((piece) => piece.length / 4 * 3 - piece.match(/=*$/)[0].length);
  const size = sizes.reduce((sum, count) => sum + count);
  return new LocalSource(size, (begin, end) => {
    const bytes = new Uint8Array(end - begin);
    for (let at = begin; at < end;) {
      const piece = Math.floor(at / sizes[0]), from = at - piece * sizes[0];
      const to = Math.min(from + end - at, sizes[0]), first = Math.floor(from / 3);
      const text = atob(pieces[piece].slice(first * 4, Math.ceil(to / 3) * 4));
      for (let i = from; i < to; ++i) bytes[at - begin + i - from] = text.charCodeAt(i - first * 3);
      at += to - from;
    }
    return bytes;
  });
}
