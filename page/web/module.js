// Native: an instance of the WebAssembly module (page/wasm/module.cc), its calls and its memory.

export const kDone = 0, kNeedsBytes = 1;

export class Native {
  // `module` is a WebAssembly.Module. The only import implemented here is proc_exit, which the
  // module calls when it runs out of memory.
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
  // The text that the last call stored: a message or a result.
  textBytes() { return this.bytes(this.calls.slf_text(), this.calls.slf_text_size()).slice(); }
  text() { return new TextDecoder().decode(this.textBytes()); }
  // Throws the stored message if a call has failed.
  check(status) {
    if (status !== kDone) throw new Error(this.text());
  }
  // The ranges of bytes that the last call still needs: [[begin, end], …].
  ranges() {
    const all = new Float64Array(this.calls.memory.buffer, this.calls.slf_ranges(),
                                 2 * this.calls.slf_range_count());
    return Array.from({length: all.length / 2}, (_, i) => [all[2 * i], all[2 * i + 1]]);
  }
}
