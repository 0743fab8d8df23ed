// The script of a worker, which verifies and decodes tiles.
import {Native} from './module.js';

let native;
const kept = new Map();  // samples that tiles are predicted from, by page

function open({module, manifest, tables}) {
  native = new Native(module);
  native.fill(manifest);
  native.check(native.calls.slf_manifest());
  tables.forEach((bytes, layer) => {
    if (!bytes) return;
    native.fill(bytes);
    native.check(native.calls.slf_codec(layer));
  });
}

// Copies a payload into the module's buffer and verifies it.
function receivePayload({layer, level, entry, exit, checksum, payload}) {
  native.fill(payload);
  native.check(native.calls.slf_check(layer, level, entry, exit, ...checksum));
}

// The tiles of the next coarser level that a payload is predicted from: [[entry, exit], …].
function references(message) {
  const {layer, level, entry, exit} = message;
  receivePayload(message);
  const at = native.calls.slf_references(layer, level, entry, exit);
  const all = new Uint32Array(native.calls.memory.buffer, at,
                              2 * native.calls.slf_reference_count());
  return Array.from({length: all.length / 2}, (_, i) => [all[2 * i], all[2 * i + 1]]);
}

function decode(message) {
  const {layer, level, entry, exit, references, forget} = message;
  for (const page of forget) kept.delete(page);
  for (const {page, samples} of references) if (samples) kept.set(page, samples);
  for (const reference of references) {
    native.fill(kept.get(reference.page));
    native.check(
      native.calls.slf_add_reference(layer, level - 1, reference.entry, reference.exit));
  }
  receivePayload(message);
  native.check(native.calls.slf_decode(layer, level, entry, exit));
  return native.bytes(native.calls.slf_samples(), native.calls.slf_sample_bytes()).slice();
}

const actions = {open, references, decode};

self.onmessage = ({data}) => {
  try {
    const result = actions[data.action](data);
    const transfer = result instanceof Uint8Array ? [result.buffer] : [];
    self.postMessage({id: data.id, result}, transfer);
  } catch (error) {
    self.postMessage({id: data.id, error: String(error.message ?? error)});
  }
};
