// The WebAssembly module (view/wasm/module.cc): calls, and the memory behind them.

export const kDone = 0, kWants = 1;

export class Native {
  // `module`: a WebAssembly.Module. Of its imports only proc_exit is implemented, which it calls
  // when it is out of memory.
  constructor(module) {
    const imports = {};
    for (const {module: from, name} of WebAssembly.Module.imports(module)) {
      imports[from] ??= {};
      imports[from][name] = name === 'proc_exit' ? () => { throw new Error('out of memory'); }
                                                 : () => 52;  // not supported
    }
    this.calls = new WebAssembly.Instance(module, imports).exports;
    this.calls._initialize?.();
  }

  // Copies bytes into the module's buffer.
  fill(bytes) {
    const at = this.calls.slf_buffer(bytes.byteLength);
    new Uint8Array(this.calls.memory.buffer, at, bytes.byteLength).set(bytes);
  }
  bytes(at, size) { return new Uint8Array(this.calls.memory.buffer, at, size); }
  // The text result of the last call: a message, or a description.
  textBytes() { return this.bytes(this.calls.slf_text(), this.calls.slf_text_size()).slice(); }
  text() { return new TextDecoder().decode(this.textBytes()); }
  // Throws the message of a call that failed.
  check(status) {
    if (status !== kDone) throw new Error(this.text());
  }
  // The ranges of bytes that the last call lacked: [[begin, end], …].
  ranges() {
    const all = new Float64Array(this.calls.memory.buffer, this.calls.slf_ranges(),
                                 2 * this.calls.slf_range_count());
    return Array.from({length: all.length / 2}, (_, i) => [all[2 * i], all[2 * i + 1]]);
  }
}
