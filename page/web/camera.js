// The camera orbits a point at a distance. Lengths are in radii of the plenoptic sphere, angles in
// degrees, as in slf's --orbit azimuth,elevation,distance.

const kRadians = Math.PI / 180;
export const kFirst = {azimuth: 30, elevation: 20, distance: 3, target: [0, 0, 0]};
// What bounds turning, zooming and moving; views that are given may be beyond.
export const kLimits = {minDistance: 1.02, maxDistance: 20, minElevation: -90, maxElevation: 90,
                        disableZoom: false, disablePan: false};
const kClose = 0.05;  // as near as zooming gets to a point away from the centre
const kMaxOrbit = 1e6;          // of a view that is given, as slf takes it

export const add = (a, b, t = 1) => a.map((v, i) => v + t * b[i]);
export const dot = (a, b) => a.reduce((sum, v, i) => sum + v * b[i], 0);
const clamp = (v, low, high) => Math.min(Math.max(v, low), high);

export class Camera {
  #limits = kLimits;

  constructor(text) {
    this.reset();
    this.fromText(text);
  }

  reset() {
    Object.assign(this, structuredClone(kFirst));
    this.rest();
  }
  // `limits`: as kLimits.
  obey(limits) { this.#limits = limits; }
  rest() {
    this.speed = [0, 0];  // degrees a second
    this.spins = false;
  }
  // Goes to a place between two others; s from 0 to 1. Turns the shorter way.
  between(from, to, s) {
    const mix = (a, b) => a + s * (b - a);
    const turn = ((to.azimuth - from.azimuth) % 360 + 540) % 360 - 180;
    this.azimuth = ((from.azimuth + s * turn) % 360 + 360) % 360;
    this.elevation = mix(from.elevation, to.elevation);
    this.distance = from.distance * (to.distance / from.distance) ** s;
    this.target = from.target.map((v, i) => mix(v, to.target[i]));
  }

  turn(azimuth, elevation) {
    this.azimuth = ((this.azimuth + azimuth) % 360 + 360) % 360;
    const {elevation: now} = this, {minElevation, maxElevation} = this.#limits;
    this.elevation =
      clamp(now + elevation, Math.min(minElevation, now), Math.max(maxElevation, now));
  }
  zoom(factor) {
    const {distance} = this, {minDistance, maxDistance, disableZoom} = this.#limits;
    const near = Math.max(kClose, minDistance - Math.hypot(...this.target));
    this.distance = disableZoom ? distance : clamp(
      distance * factor, Math.min(near, distance), Math.max(maxDistance, distance));
  }
  // Moves the point that the camera orbits, by fractions of the picture's height.
  pan(x, y) {
    if (this.#limits.disablePan) return;
    const {right, down, half} = this.axes(1, 1);
    const scale = 2 * half * this.distance;
    this.target = add(add(this.target, right, -x * scale), down, -y * scale)
      .map((v) => clamp(v, -1, 1));
  }

  // Turns the camera further after a drag, more and more slowly, or by so many degrees a second by
  // itself. Returns whether it moved.
  advance(seconds, rate = 0) {
    const before = [this.azimuth, this.elevation];
    this.turn((this.spins ? 20 : rate) * seconds, 0);
    this.turn(this.speed[0] * seconds, this.speed[1] * seconds);
    this.speed = this.speed.map((v) => Math.abs(v) < 1 ? 0 : v * Math.exp(-4 * seconds));
    return before[0] !== this.azimuth || before[1] !== this.elevation;
  }

  // The eye and the picture's axes, as in doc/drawing.md, "Camera". `half` is tan(φ/2), chosen so
  // that the sphere fits the picture at the initial distance.
  axes(width, height) {
    const az = this.azimuth * kRadians, el = this.elevation * kRadians;
    const out = [Math.sin(az) * Math.cos(el), -Math.cos(az) * Math.cos(el), Math.sin(el)];
    const right = [Math.cos(az), Math.sin(az), 0];
    const forward = out.map((v) => -v);
    const up = [-Math.sin(az) * Math.sin(el), Math.cos(az) * Math.sin(el), Math.cos(el)];
    const half = Math.tan(Math.asin(1 / kFirst.distance)) * Math.max(1, height / width);
    const eye = add(this.target, out, this.distance);
    return {eye, forward, right, down: up.map((v) => -v), half};
  }

  // Where a point, in radii from the sphere's centre, is in a picture of that size: x to the right
  // and y down, how far in front of the eye, and how far from it.
  project(point, width, height) {
    const {eye, forward, right, down, half} = this.axes(width, height);
    const to = add(point, eye, -1), far = dot(to, forward), scale = height / 2 / half / far;
    return {x: width / 2 + scale * dot(to, right), y: height / 2 + scale * dot(to, down), far,
            distance: Math.hypot(...to)};
  }

  // Looks from the side that a point is on.
  face([x, y, z]) {
    const {minElevation, maxElevation} = this.#limits;
    this.azimuth = Math.atan2(x, 0 - y) / kRadians;  // 0 from above and from below
    this.elevation = clamp(Math.atan2(z, Math.hypot(x, y)) / kRadians, minElevation, maxElevation);
  }

  toText() {
    const n = (v) => String(Math.round(v * 1e4) / 1e4);
    const parts = [this.azimuth, this.elevation, this.distance];
    return [...parts, ...(this.target.some((v) => v !== 0) ? this.target : [])].map(n).join(',');
  }
  // Changes nothing if the text is none that toText() could return.
  fromText(text) {
    const v = String(text).split(',').map(Number);
    if (![3, 6].includes(v.length) || !v.every(Number.isFinite)) return;
    if (v[2] <= 0 || v[2] > kMaxOrbit) return;
    this.reset();
    this.azimuth = (v[0] % 360 + 360) % 360;
    this.elevation = clamp(v[1], -90, 90);
    this.distance = v[2];
    if (v.length === 6) this.target = v.slice(3).map((t) => clamp(t, -1, 1));
  }
}
