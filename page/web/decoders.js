// Decoders: decodes tiles in a few workers. Workers share no memory, so each has copies of the
// tiles that others are predicted from. They are sent to it once, and the cache counts them.

import {Cache} from './cache.js';
import {Told} from './text.js';

const kAtOnce = 2;  // messages that a worker has: it answers one while the other waits there

export class Decoders {
  // `count` workers start at once; open() tells them about the field. If a worker does not start,
  // what makeStandIn(), if there is one, returns takes its place.
  constructor(makeWorker, makeStandIn,
              count = Math.max(2, Math.min(4, (navigator.hardwareConcurrency ?? 2) - 1))) {
    this.cache = new Cache();
    this.next = 0;
    this.waiting = new Map();  // messages without an answer: {worker, message, done, failed}, by id
    this.queue = [];           // messages that no worker has yet
    this.workers = Array.from({length: count}, (_, number) => {
      const worker = {number, busy: 0, dropped: new Set()};  // dropped: pages of copies
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
      left.forEach(({failed}) => failed(new Told('worker')));
    } else {
      this.connect(worker, makeStandIn());
      left.forEach(({message}) => worker.port.postMessage(message));
    }
  }
  open({module, manifestBytes: manifest, tables}) {
    for (const worker of this.workers)
      this.post(worker, {action: 'open', module, manifest, tables}).catch(() => {});
  }

  // Ends the workers. What waits for them has no answer.
  dispose() { for (const {port} of this.workers) port.terminate?.(); }

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
      const {message, done, failed, wanted} = this.queue.shift();
      if (wanted?.() === false) {
        done();
        continue;
      }
      const forget = [...worker.dropped];
      worker.dropped.clear();
      const references = message.references.map((tile) => this.copied(worker, tile));
      this.post(worker, {...message, forget, references}).then(done, failed);
    }
  }
  // What a worker needs to predict from a tile: not the samples, if it has a copy.
  copied(worker, {page, level, entry, exit, samples}) {
    const copy = `${page} in ${worker.number}`, has = this.cache.get(copy);
    if (!has) {
      worker.dropped.delete(page);  // another tile of this message may have displaced it
      this.cache.set(copy, true, samples.byteLength, () => worker.dropped.add(page));
    }
    this.cache.get(page);  // last, so that copies are dropped first
    return {page, level, entry, exit, samples: has ? undefined : samples};
  }

  // Resolves to the samples of a tile, whose payload Field.references() has verified. `references`:
  // the Tiles that it is predicted from. Fails if the payload is damaged.
  decode({level, entry, exit}, payload, references) {
    return this.enqueue('push', {action: 'decode', level, entry, exit, payload, references});
  }
  // Resolves to the samples of a tile that layers, {samples, opacity, tint} each, compose; to
  // undefined if that is no longer wanted once it is its turn. It takes turns before decoding,
  // because pictures wait for it.
  compose(layers, linear, wanted) {
    return this.enqueue('unshift', {action: 'compose', layers, linear, references: []}, wanted);
  }
  enqueue(how, message, wanted) {
    return new Promise((done, failed) => {
      this.queue[how]({message, done, failed, wanted});
      this.send();
    });
  }
}
