// Cache: the tiles that are kept, and the workers' copies of them, in one order and one budget. The
// least recently used are dropped.

export class Cache {
  constructor() {
    this.budget = 144 << 20;   // bytes of samples
    this.bytes = 0;            // of all that is kept
    this.entries = new Map();  // by key; the least recently used first
  }

  // What is kept under a key, if anything. This is a use.
  get(key) {
    const entry = this.entries.get(key);
    if (this.entries.delete(key)) this.entries.set(key, entry);
    return entry?.value;
  }
  // Calls `dropped` if the value is dropped for others. Values of 0 bytes never are.
  set(key, value, bytes, dropped = () => {}) {
    this.remove(key);
    this.entries.set(key, {value, bytes, dropped});
    this.bytes += bytes;
    for (const [other, entry] of this.entries) {
      if (this.bytes <= this.budget) break;
      if (entry.bytes === 0) continue;
      this.remove(other);
      entry.dropped();
    }
  }
  remove(key) {
    this.bytes -= this.entries.get(key)?.bytes ?? 0;
    this.entries.delete(key);
  }
}
