// Decoders: decodes tiles in a few workers. A worker keeps the samples of the tiles that others are
// predicted from, so they are sent to it once.

const kAtOnce = 2;       // messages that a worker has: it answers one while the other waits there
const kKept = 48 << 20;  // bytes of samples that a worker keeps

export class Decoders {
  // Workers start at once; open() tells them about the field. If a worker does not start, what
  // makeStandIn(), if there is one, returns takes its place.
  constructor(makeWorker, makeStandIn) {
    this.next = 0;
    this.waiting = new Map();  // messages without an answer: {worker, message, done, failed}, by id
    this.queue = [];           // messages that no worker has yet
    const count = Math.max(2, Math.min(4, (navigator.hardwareConcurrency ?? 2) - 1));
    this.workers = Array.from({length: count}, () => {
      const worker = {busy: 0, kept: new Map(), bytes: 0};  // kept: bytes by page
      try {
        this.connect(worker, makeWorker());
        worker.port.onerror = () => this.replace(worker, makeStandIn);
      } catch {
        this.connect(worker, makeStandIn());
      }
      return worker;
    });
  }
  connect(worker, port) {
    worker.port = port;
    port.onmessage = ({data}) => {
      worker.works = true;
      --worker.busy;
      const {done, failed} = this.waiting.get(data.id);
      this.waiting.delete(data.id);
      if (data.error) failed(new Error(data.error));
      else done(data.result);
      this.send();
    };
  }
  replace(worker, makeStandIn) {
    const left = [...this.waiting.values()].filter((waiting) => waiting.worker === worker);
    if (worker.works || !makeStandIn) {
      left.forEach(({failed}) => failed(new Error('A worker failed.')));
    } else {
      this.connect(worker, makeStandIn());
      left.forEach(({message}) => worker.port.postMessage(message));
    }
  }
  open({module, manifestBytes: manifest, tables}) {
    for (const worker of this.workers)
      this.post(worker, {action: 'open', module, manifest, tables}).catch(() => {});
  }

  post(worker, message) {
    const sent = {...message, id: this.next++};
    ++worker.busy;
    return new Promise((done, failed) => {
      this.waiting.set(sent.id, {worker, message: sent, done, failed});
      worker.port.postMessage(sent);
    });
  }
  // Gives messages to the workers that have the least to do.
  send() {
    while (this.queue.length > 0) {
      const worker = this.workers.reduce((a, b) => b.busy < a.busy ? b : a);
      if (worker.busy >= kAtOnce) return;
      const {message, done, failed} = this.queue.shift();
      this.post(worker, this.prepared(worker, message)).then(done, failed);
    }
  }
  // Leaves out what the worker has, and says what it no longer needs to keep.
  prepared(worker, message) {
    const keep = (page, bytes) => {
      worker.bytes += bytes - (worker.kept.get(page) ?? 0);
      worker.kept.delete(page);
      worker.kept.set(page, bytes);
    };
    const references = message.references.map(({page, entry, exit, samples}) => {
      const has = worker.kept.has(page);
      keep(page, samples.byteLength);
      return has ? {page, entry, exit} : {page, entry, exit, samples};
    });
    const forget = [];
    for (const [page, bytes] of worker.kept) {
      if (worker.bytes <= kKept) break;
      if (message.references.some((reference) => reference.page === page)) break;
      worker.kept.delete(page);
      worker.bytes -= bytes;
      forget.push(page);
    }
    return {...message, references, forget};
  }

  // Resolves to the samples of a tile. `part` is {level, entry, exit, payload};
  // Field.references() has verified the payload. Each of `references` is {page, entry, exit,
  // samples}; an empty tile has samples of length 0. Fails if the payload is damaged.
  decode(part, references) {
    return new Promise((done, failed) => {
      this.queue.push({message: {...part, references, action: 'decode'}, done, failed});
      this.send();
    });
  }
}
