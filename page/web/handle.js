// The handles of planes in a picture: a disc and an arrow each. Dragging the arrow moves a plane
// along its normal, dragging the rim of the disc tilts it. Keys do the same.

import {add, dot} from './camera.js';
import {unit} from './cut.js';
import {speaker} from './text.js';

const kDisc = 0.55, kArrow = 0.3;   // radii
const kPoints = 40;                 // of the rim
const kNearAxis = Math.cos(4 * Math.PI / 180);  // a tilted plane snaps to an axis so near
const kTilt = 150;                  // pixels that the rim is dragged for a radian
const kKey = 0.02, kKeyTilt = 0.05; // radii and radians of a press of a key
export const kAxes = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];

export const kHandleStyle = `
.planes {
  position: absolute; inset: 0; width: 100%; height: 100%; pointer-events: none; overflow: hidden;
}
.planes :is(path, line) { fill: none; stroke: var(--ink); stroke-width: 1.5; opacity: 0.5; }
.planes .chosen :is(path, line) { stroke: var(--accent); stroke-width: 2.5; opacity: 0.9; }
.planes .wide.rim { stroke-width: 24; opacity: 0; pointer-events: stroke; }
.planes circle { fill: var(--accent); stroke: #000; pointer-events: all; }
.planes :is(.wide, circle) { cursor: move; touch-action: none; }
.planes circle:focus-visible { outline: 2px solid var(--ink); outline-offset: 2px; }
`;

const cross = ([a, b, c], [x, y, z]) => [b * z - c * y, c * x - a * z, a * y - b * x];
// The axis, either way, that a direction is nearest to.
export function nearestAxis(normal, among = kAxes) {
  const axis = among.reduce((a, b) => Math.abs(dot(normal, b)) > Math.abs(dot(normal, a)) ? b : a);
  return axis.map((v) => v && Math.sign(dot(normal, axis)) * v);
}

// What shows planes says which: `planes`, as {point, normal} of length 1; `set(planes, moving)`;
// `sphere`, {center, radius}; `camera`; and `canvas`, the picture.
export class Handles {
  // `box`: an <svg class="planes"> over the picture.
  constructor(box) {
    Object.assign(this, {box, chosen: 0});
    box.onpointerdown = (event) => this.grab(event);
    box.onpointermove = (event) => this.drag(event);
    box.onpointerup = box.onpointercancel = (event) => this.drop(event);
    box.onkeydown = (event) => this.press(event);
  }

  // Changes the plane that is chosen.
  change(how, moving) {
    this.set(this.planes.map((plane, k) =>
      k === this.chosen ? {...plane, ...how(plane)} : plane), moving);
  }
  flip() { this.change(({normal}) => ({normal: normal.map((v) => v && -v)})); }
  snap() { this.change(({normal}) => ({normal: nearestAxis(normal)})); }
  remove() {
    const left = this.planes.filter((_, k) => k !== this.chosen);
    this.chosen = Math.min(this.chosen, Math.max(0, left.length - 1));
    this.set(left);
  }
  // Where a point is in the picture, as Camera.project() has it.
  seen(point) {
    return this.camera.project(point, this.canvas.clientWidth, this.canvas.clientHeight);
  }

  // Where the handle of a plane is, in radii: the foot of the sphere's centre on the plane.
  foot({point, normal}) {
    const {center, radius} = this.sphere;
    return normal.map((v) => v * dot(normal, add(point, center, -1)) / radius);
  }
  rim(plane) {
    const {normal} = plane, u = unit(cross(normal, kAxes[Math.abs(normal[2]) < 0.9 ? 2 : 0]));
    const v = cross(normal, u), foot = this.foot(plane);
    return Array.from({length: kPoints}, (_, k) => {
      const t = 2 * Math.PI * k / kPoints;
      return add(add(foot, u, kDisc * Math.cos(t)), v, kDisc * Math.sin(t));
    });
  }
  // Draws the handles.
  place() {
    const {box, planes} = this;
    const at = (point) => {
      const {x, y, far} = this.seen(point);
      return far > 0 ? [x.toFixed(1), y.toFixed(1)] : [-99, -99];
    };
    while (box.children.length > planes.length) box.lastChild.remove();
    planes.forEach((plane, k) => {
      if (!box.children[k]) {
        const group = document.createElementNS('http://www.w3.org/2000/svg', 'g');
        group.innerHTML = '<path class="rim"/><path class="rim wide"/><line/>' +
          '<circle r="12" tabindex="0" role="slider"/>';
        box.append(group);
      }
      const [rim, wide, line, knob] = box.children[k].children, foot = this.foot(plane);
      const [x1, y1] = at(foot), [x2, y2] = at(add(foot, plane.normal, kArrow));
      for (const path of [rim, wide]) path.setAttribute('d', `M${this.rim(plane).map(at)}Z`);
      for (const [name, value] of Object.entries({x1, y1, x2, y2})) line.setAttribute(name, value);
      const height = dot(foot, plane.normal).toFixed(3);
      for (const [name, value] of Object.entries({
        cx: x2, cy: y2, 'aria-valuenow': height, 'aria-valuemin': -1, 'aria-valuemax': 1,
        'aria-label': (this.t ??= speaker('en'))('plane', k + 1)}))
        knob.setAttribute(name, value);
      box.children[k].classList.toggle('chosen', k === this.chosen);
    });
  }

  grab(event) {
    const {target} = event, group = target.closest('g');
    if (!group) return;
    this.chosen = [...group.parentNode.children].indexOf(group);
    event.preventDefault();
    event.stopPropagation();
    group.lastChild.focus({preventScroll: true});
    target.setPointerCapture(event.pointerId);
    const {left, top} = this.canvas.getBoundingClientRect();
    const plane = this.planes[this.chosen], away = (point) => {
      const {x, y} = this.seen(point);
      return Math.hypot(x - event.clientX + left, y - event.clientY + top);
    };
    const held = this.rim(plane).reduce((a, b) => away(b) < away(a) ? b : a);
    const {distance} = this.seen(this.foot(plane));
    this.held = {x: event.clientX, y: event.clientY, tilts: target.classList.contains('rim'),
                 turns: this.seen(held).distance < distance ? 1 : -1};
  }
  drag(event) {
    if (!this.held) return;
    const dx = event.clientX - this.held.x, dy = event.clientY - this.held.y;
    Object.assign(this.held, {x: event.clientX, y: event.clientY});
    if (this.held.tilts)
      this.tilt(this.held.turns * dx / kTilt, this.held.turns * dy / kTilt, true);
    else this.move(this.along(dx, dy), true);
  }
  drop({shiftKey}) {
    if (!this.held) return;
    const {tilts} = this.held, {normal} = this.planes[this.chosen] ?? {};
    this.held = undefined;
    if (tilts && normal && !shiftKey && Math.abs(dot(normal, nearestAxis(normal))) > kNearAxis)
      this.snap();
    else this.set(this.planes);
  }
  // How far along its normal a drag moves a plane, in radii.
  along(dx, dy) {
    const plane = this.planes[this.chosen], foot = this.foot(plane);
    const a = this.seen(foot), b = this.seen(add(foot, plane.normal, 0.01));
    const [u, v] = [(b.x - a.x) / 0.01, (b.y - a.y) / 0.01], size = Math.hypot(u, v);
    const least = this.canvas.clientHeight / 8;  // pixels a radius, if it points to the eye
    return size > least ? (dx * u + dy * v) / size ** 2 : -dy / least / 4;
  }
  move(by, moving) {
    this.change((plane) => {
      const foot = this.foot(plane), now = dot(foot, plane.normal);
      const to = Math.min(1, Math.max(-1, now + by)), {center, radius} = this.sphere;
      return {point: add(center, plane.normal, radius * to)};
    }, moving);
  }
  // Turns the plane about its handle, by so many radians to the right and down in the picture.
  tilt(x, y, moving) {
    const {forward, right, down} = this.camera.axes(1, 1);
    this.change((plane) => {
      const {center, radius} = this.sphere, out = forward.map((v) => -v);
      const point = add(center, this.foot(plane), radius), {normal} = plane;
      // As if a ball were turned whose front moves that way.
      const axis = add(cross(out, right).map((v) => v * x), cross(out, down), y);
      return {point, normal: unit(add(normal, cross(axis, normal)))};
    }, moving);
  }
  press(event) {
    const knob = event.target.closest('g');
    const arrow = {ArrowUp: [0, 1], ArrowDown: [0, -1], ArrowRight: [1, 0], ArrowLeft: [-1, 0]};
    const [x, y] = arrow[event.key] ?? [0, 0];
    const act = {Home: 'snap', Enter: 'flip', Delete: 'remove', Backspace: 'remove'}[event.key];
    if (!knob || event.ctrlKey || event.metaKey || event.altKey || !(x || y || act)) return;
    this.chosen = [...knob.parentNode.children].indexOf(knob);
    event.preventDefault();
    event.stopPropagation();
    if (act) this[act]();
    else if (event.shiftKey) this.tilt(x * kKeyTilt, -y * kKeyTilt);
    else this.move((x + y) * kKey);
  }
}
