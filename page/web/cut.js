// Cuts: planes through the object, and what they lay open (doc/cut.md). What a plane removes is on
// the side that its normal points to. Points are in world units, as in slf render --clip.

import {dot} from './camera.js';
import {kCaps, kMaxPlanes} from './march.js';
import {kCurves} from './shader.js';
import {Told} from './text.js';

const kMostPlanes = 6;    // as slf render takes them
export const kMostShown = 3;  // that the page makes
const kLightRays = 160;   // across the picture, that the light is computed for
const kChunk = 2048;      // of these, that a worker computes at a time
const kTexels = 256;      // across the texture of the table
export const kCapForm = /^(shaded|coarse|hollow|slice(:-?[\d.e+-]+,-?[\d.e+-]+)?)$/i;

export const unit = (v) => v.map((one) => one / Math.hypot(...v));
const short = (v) => Number(v.toPrecision(6));

// Planes as texts, as slf takes them: 'X,Y,Z,NX,NY,NZ' each, with semicolons in between; and back.
// Also takes lists of six numbers.
export const textOf = (planes) =>
  planes.map(({point, normal}) => [...point, ...normal].map(short).join()).join(';');
export function planesOf(given) {
  const texts = Array.isArray(given) ? given.map(String) : String(given ?? '').split(/[;\s]+/);
  return texts.map((text) => text.split(',').map(Number))
    .filter((v) => v.length === 6 && v.every(Number.isFinite) && Math.hypot(...v.slice(3)) > 0)
    .slice(0, kMostPlanes).map((v) => ({point: v.slice(0, 3), normal: unit(v.slice(3))}));
}

const luminance = ([r, g, b]) => 0.2126 * r + 0.7152 * g + 0.0722 * b;
// The columns of a matrix times a vector.
const times = (columns, [x, y, z]) =>
  [0, 1, 2].map((k) => columns[k] * x + columns[3 + k] * y + columns[6 + k] * z);

export class Cut {
  // `begin` starts the worker of cuts and resolves to {post(message), module} for it. Calls
  // `changed` when other planes, or what they lay open, can be drawn.
  constructor(field, begin, changed) {
    Object.assign(this, {field, begin, changed, planes: [], cap: ''});
    // of: what the worker says of the reveal; none: cuts are hollow
    // shown: the state that it is of; why: the cause if cuts are hollow
    // light: that of a view, with its planes
    // textures: of the renderer; fresh: those that it has not yet
  }
  get active() { return this.planes.length > 0; }
  get hollow() { return this.cap === 'hollow' || !this.of; }
  // From black to white, of a slice.
  get window() {
    return this.cap.split(':')[1]?.split(',').map(Number) ?? this.of?.greys ?? [0, 1];
  }

  // Loads the reveal, once, and what the state that is shown makes of it. Without one, or if the
  // page cannot show it, cuts are hollow.
  load() {
    if (this.shown !== this.field.state) this.loading = this.show(this.shown = this.field.state);
    return this.loading;
  }
  async show(state) {
    const {field} = this;
    try {
      if (field.structures.length > 0) throw new Told('hollowParts');
      this.worker ??= this.begun();
      const worker = await this.worker;
      const {of, parts} = await worker({action: 'show', provenance: field.provenance()});
      if (this.shown === state) this.take(of, parts);
    } catch (error) {
      this.of = undefined;
      this.why = error;
    }
  }
  async begun() {
    const code = await this.field.reveal();
    if (code.length === 0) throw new Told('noReveal');
    const {post, module} = await this.begin();
    await post({action: 'reveal', code, module: await module});
    return post;
  }
  take(of, [voxels, rows, leaps, table]) {
    const texels = new Float32Array(table.buffer, table.byteOffset, table.byteLength / 4);
    const height = Math.ceil(texels.length / 4 / kTexels), deep = Math.ceil(height / kTexels);
    const dims = [kTexels, Math.min(height, kTexels), deep];
    const data = new Float32Array(4 * dims[0] * dims[1] * dims[2]);
    data.set(texels);
    this.upload({uVoxels: {dims: of.dims, data: voxels, smooth: true},
                 uLeaps: {dims: of.leaps, data: leaps}, uMatters: {dims, data},
                 ...(of.rows && {uRows: {dims: of.dims, data: rows}})});
    this.of = of;
    this.light = undefined;
  }
  // Gives the renderer textures with the next view; without any, all of them again.
  upload(textures = this.textures) {
    this.textures = {...this.textures, ...textures};
    this.fresh = {...this.fresh, ...textures};
  }

  // The uniforms of the shaders, as [name, type, value]; the renderer has the textures then.
  uniforms(renderer) {
    const {of, planes} = this, {center, radius} = this.field.manifest.sphere;
    const built = planesOf(of?.clip ?? []), all = [...planes, ...built].slice(0, kMaxPlanes);
    const from = (point) => point.map((v, k) => v - center[k]);
    const cap = this.hollow ? 0 : kCaps.indexOf(this.cap.startsWith('slice') ? 'slice' : 'shaded');
    const list = [
      ['uViewPlanes', '1i', planes.length], ['uPlanes', '1i', all.length], ['uCap', '1i', cap],
      ['uPlane', '4fv', all.flatMap(({point, normal}) =>
        [...normal.map((v) => -v), dot(normal, from(point)) / radius])]];
    if (cap === 0) return list;
    renderer.setCutTextures(this.fresh);
    this.fresh = {};
    const value = (v) => (v - of.range[0]) / (of.range[1] - of.range[0]);
    const lights = of.lit ? of.lights : [], three = (name) => lights.flatMap((one) => one[name]);
    const open = this.openLight(all), light = this.light?.clip === textOf(planes) && this.light;
    list.push(
      ['uVoxelsAway', '1fv', all.map(({normal}) => radius / Math.hypot(
        ...[0, 3, 6].map((k) => dot(of.axes.slice(k, k + 3), normal))))],
      ['uWindow', '2fv', this.window.map(value)], ['uMatter', '1f', value(of.greys[0])],
      ['uDims', '3fv', of.dims],
      ['uToIndex', 'Matrix3fv', false, of.toIndex.map((v) => radius * v)],
      ['uIndexOrigin', '3fv', times(of.toIndex, center.map((v, k) => v - of.origin[k]))],
      ['uGradient', 'Matrix3fv', false, of.gradient], ['uUnits', '1f', radius / of.unit],
      ['uSurface', '1f', of.surface], ['uHasRows', '1i', of.rows], ['uLabels', '1i', of.labels],
      ['uMarchedCurve', '1i', kCurves.indexOf(of.curve)],
      ['uMarchedGain', '1f', 2 ** of.exposure],
      ['uShade', '1i', of.shade], ['uLinear', '1i', of.linear],
      ['uEntries', '1i', of.entries], ['uToEntry', '2fv', [255 * of.scale, -of.low * of.scale]],
      ['uAmbient', '1f', of.ambient], ['uToLight', '3fv', of.toLight],
      ['uLightCount', '1i', of.lit ? lights.length : -1], ['uLights', '1i', Boolean(light)]);
    if (lights.length > 0)
      list.push(['uIrradiance', '3fv', three('irradiance')],
                ['uDirection', '3fv', three('direction')],
                ['uPlace', '3fv', lights.flatMap(({place}) => from(place).map((v) => v / radius))],
                ['uNear', '1fv', lights.map(({distance}) => distance / radius)]);
    for (const [name, v] of Object.entries(open)) list.push([name, '3fv', v]);
    if (light)
      list.push(['uLightLow', '3fv', light.low], ['uLightDims', '3fv', light.dims],
                ['uLightSpacing', '1f', light.spacing]);
    return list;
  }
  // The light until a worker has computed it: of faces, all that comes from the removed side of a
  // plane; of what is far from planes, all.
  openLight(planes) {
    const {sky, lights} = this.of;
    const lists = {uOpenMean: [], uOpenChange: [], uOpenTint: [], uOpenArrives: []};
    const beyond = (to) => planes.some(({normal}) => dot(normal, to) > 0);
    for (const sees of [beyond, () => true]) {
      const mean = [0, 0, 0], change = [0, 0, 0];
      for (const [x, y, z, ...rgb] of sky) {
        if (!sees([x, y, z])) continue;
        const part = 2 * luminance(rgb) / sky.length;
        [x, y, z].forEach((v, k) => {
          mean[k] += rgb[k] / sky.length;
          change[k] += part * v;
        });
      }
      lists.uOpenMean.push(...mean);
      lists.uOpenChange.push(...change);
      lists.uOpenTint.push(...mean.map((v) => v / (luminance(mean) || 1)));
      lists.uOpenArrives.push(
        ...[0, 1, 2].map((k) => lights[k] && sees(lights[k].direction) ? 1 : 0));
    }
    return lists;
  }

  // Has the light computed of what a view lays open: of new planes coarse, then fine, then of other
  // views of them. Ends early once `current()` is false.
  async lightUp({camera, width, height}, current) {
    const {of, planes} = this, clip = textOf(planes), view = camera.toText();
    if (!this.active || this.hollow || !of.lit) return;
    const before = this.light?.clip === clip ? this.light : undefined;
    const fine = before !== undefined && this.cap !== 'coarse';
    if (before && before.fine === fine && before.view === view) return;
    const {center, radius} = this.field.manifest.sphere, worker = await this.worker;
    const numbers = Float64Array.from(this.rays(camera, width, height).flat(2),
                                      (v, k) => center[k % 3] + radius * v);
    const begins = `${this.shown} ${clip} ${fine}`;
    if (this.begins !== begins)
      await worker({action: 'light', coarse: !fine,
                    clip: new Float64Array(planes.flatMap((p) => [...p.point, ...p.normal]))});
    this.begins = begins;
    let found;
    for (let at = 0; at < numbers.length && current(); at += 6 * kChunk)
      found = await worker({action: 'rays', last: at + 6 * kChunk >= numbers.length,
                            rays: numbers.slice(at, at + 6 * kChunk)});
    if (!found || !current()) return;
    const data = new Uint16Array(found.light.buffer), size = data.length / 3;
    this.upload(Object.fromEntries(['uMean', 'uChange', 'uTint'].map((name, k) => [
      name, {dims: found.of.dims, smooth: true, data: data.subarray(k * size, (k + 1) * size)}])));
    this.light = {...found.of, clip, view, fine};
    this.changed();
  }
  // Rays of a view that begin where a plane has removed all, from the sphere to the sphere.
  rays(camera, width, height) {
    const {eye, forward, right, down, half} = camera.axes(width, height), rays = [];
    const {center, radius} = this.field.manifest.sphere, wide = half * width / height;
    for (let y = 0; y < kLightRays; ++y)
      for (let x = 0; x < kLightRays; ++x) {
        const u = (2 * x + 1) / kLightRays - 1, v = (2 * y + 1) / kLightRays - 1;
        const d = forward.map((f, k) => f + u * wide * right[k] + v * half * down[k]);
        const d2 = dot(d, d), near = -dot(eye, d) / d2, off = eye.map((e, k) => e + near * d[k]);
        const rest = 1 - dot(off, off), long = Math.sqrt(Math.max(rest, 0) / d2);
        if (rest <= 0 || near + long <= 0) continue;
        const at = (t) => off.map((o, k) => o + t * d[k]), begin = at(Math.max(-long, -near));
        if (this.removes(begin.map((b, k) => center[k] + radius * b)))
          rays.push([begin, at(long)]);
      }
    return rays;
  }
  // Whether a plane removes a point.
  removes(point) {
    return this.planes.some((plane) =>
      dot(plane.normal, point.map((v, k) => v - plane.point[k])) > 0);
  }
}
