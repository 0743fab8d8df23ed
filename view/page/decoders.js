// Decoders: decodes tiles in a few workers.

export class Decoders {
  constructor(field, makeWorker) {
    this.next = 0;
    this.waiting = new Map();
    const count = Math.max(1, Math.min(4, (navigator.hardwareConcurrency ?? 2) - 1));
    this.workers = Array.from({length: count}, makeWorker);
    this.busy = this.workers.map(() => 0);
    this.workers.forEach((worker, i) => {
      worker.onmessage = ({data}) => {
        --this.busy[i];
        const {done, failed} = this.waiting.get(data.id);
        this.waiting.delete(data.id);
        if (data.error) failed(new Error(data.error));
        else done(data.result);
      };
      worker.onerror = (event) => {
        const error = new Error('A worker failed: ' + (event.message ?? ''));
        for (const {failed} of this.waiting.values()) failed(error);
        this.waiting.clear();
      };
    });
    const {module, manifestBytes: manifest, tables} = field;
    this.ready = Promise.all(
      this.workers.map((_, i) => this.send(i, {action: 'open', module, manifest, tables})));
  }

  send(i, message) {
    const id = this.next++;
    ++this.busy[i];
    return new Promise((done, failed) => {
      this.waiting.set(id, {done, failed});
      this.workers[i].postMessage({...message, id});
    });
  }
  async ask(message) {
    await this.ready;
    return this.send(this.busy.indexOf(Math.min(...this.busy)), message);
  }

  // In both calls, `part` is {layer, level, entry, exit, checksum, payload}. The calls fail if the
  // payload is damaged.

  // Resolves to the tiles of the next coarser level that the part is predicted from:
  // [[entry, exit], …].
  references(part) { return this.ask({...part, action: 'references'}); }
  // Resolves to the part's samples. Each of `references` is {entry, exit, samples}; an empty tile
  // has samples of length 0.
  decode(part, references) { return this.ask({...part, references, action: 'decode'}); }
}
