// The script of a worker, which decodes tiles. The page has it as text, and imports serve() for
// hosts that forbid workers.
import {Native} from './module.js';

// Answers the messages of a port.
export function serve(port) {
  let native;
  const copies = new Map();  // of samples that tiles are predicted from, by page
  const samples = () =>
    native.bytes(native.calls.slf_samples(), native.calls.slf_sample_bytes()).slice();
  const part = (number) => {
    const at = native.calls.slf_part(number);
    return native.bytes(at, native.calls.slf_part_bytes()).slice();
  };
  const actions = {
    open({module, manifest, tables}) {
      native = new Native(module);
      native.fill(manifest);
      native.check(native.calls.slf_manifest());
      native.fill(tables);
      native.check(native.calls.slf_codec());
    },
    decode({level, entry, exit, payload, references, forget}) {
      for (const page of forget) copies.delete(page);
      for (const {page, samples} of references) if (samples) copies.set(page, samples);
      for (const reference of references) {
        native.fill(copies.get(reference.page));
        native.check(
          native.calls.slf_add_reference(reference.level, reference.entry, reference.exit));
      }
      native.fill(payload);
      native.check(native.calls.slf_decode(level, entry, exit));
      return samples();
    },
    compose({layers, linear}) {
      for (const {samples: own, opacity, tint} of layers) {
        native.fill(own);
        const color = [1, 3, 5].map((i) => parseInt(tint.slice(i, i + 2), 16) / 255);
        native.calls.slf_add_layer(opacity, ...color, linear);
      }
      native.calls.slf_compose();
      return samples();
    },
    // Those of cuts (cut.js), which have a module of their own.
    reveal({module, code}) {
      native = new Native(module);
      native.fill(code);
      native.check(native.calls.slf_reveal());
    },
    show({provenance}) {
      native.fill(provenance);
      native.check(native.calls.slf_show());
      return {of: JSON.parse(native.text()), parts: [0, 1, 2, 3].map(part)};
    },
    light({clip, coarse}) {
      native.fill(new Uint8Array(clip.buffer));
      native.check(native.calls.slf_light(coarse));
    },
    rays({rays, last}) {
      native.fill(new Uint8Array(rays.buffer));
      native.check(native.calls.slf_light_rays());
      return last && {of: JSON.parse(native.text()), light: part(4)};
    },
  };
  port.onmessage = ({data}) => {
    try {
      const result = actions[data.action](data);
      const transfer = result instanceof Uint8Array ? [result.buffer] : [];
      port.postMessage({id: data.id, result}, transfer);
    } catch (error) {
      port.postMessage({id: data.id, error: String(error.message ?? error)});
    }
  };
}

if (globalThis.WorkerGlobalScope) serve(globalThis);
