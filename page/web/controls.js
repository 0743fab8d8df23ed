// Lets mouse, touch, pen and keys move the camera.

import {calm} from './media.js';

const kTurn = 180;   // degrees for a drag across the smaller side of the picture
const kStep = 6;     // degrees for one press of a key
export const kNearer = 0.6;  // of the distance, by a double click
const kDoubleTap = 300, kTapMoves = 6, kTapApart = 24;  // milliseconds, pixels, pixels

// `over` lies on the canvas: the wheel zooms there, too, unless it scrolls a text, and a drag that
// begins there turns the camera, but on a <nav>, which is swiped. `wheeled` lies there as well, for
// the wheel alone. Calls `moved` after each change, `tap(x, y)` when the canvas is clicked, and
// `nearer(x, y)` when it is clicked twice; without that, the camera then goes nearer. `wheels()`:
// whether the wheel zooms. `hears` is what keys are pressed in; `keys` maps further ones to
// functions: {r: function, …}; one that returns false leaves the key to the page. `signal` ends it.
export function attach(canvas, camera, {
  over = [], wheeled = [], moved, tap, nearer = () => { camera.zoom(kNearer); moved(); }, wheels,
  hears, keys, signal}) {
  const pointers = new Map();
  let last = 0, tapped = {}, travelled = 0;

  const middle = () => {
    const all = [...pointers.values()], n = all.length;
    const x = all.reduce((s, p) => s + p.x, 0) / n, y = all.reduce((s, p) => s + p.y, 0) / n;
    return {x, y, spread: n > 1 ? Math.hypot(all[0].x - all[1].x, all[0].y - all[1].y) : 0};
  };
  const drag = (dx, dy, pans) => {
    if (pans) return camera.pan(dx / canvas.clientHeight, dy / canvas.clientHeight);
    // Close to the sphere, the same drag turns the camera less.
    const close = (camera.distance - 0.9 + Math.hypot(...camera.target)) / 2;
    const scale = kTurn / Math.min(canvas.clientWidth, canvas.clientHeight) *
                  Math.min(1, Math.max(0.06, close));
    const now = performance.now(), seconds = Math.max(now - last, 4) / 1000;
    last = now;
    const turn = [-dx * scale, dy * scale];
    camera.turn(...turn);
    camera.speed = calm.matches ? [0, 0]
      : camera.speed.map((v, i) => 0.6 * v + 0.4 * turn[i] / seconds);
  };

  canvas.addEventListener('pointerdown', (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, {x: event.clientX, y: event.clientY});
    camera.speed = [0, 0];
    last = performance.now();
    travelled = 0;
  });
  canvas.addEventListener('pointermove', (event) => {
    if (!pointers.has(event.pointerId)) return;
    const before = middle();
    pointers.set(event.pointerId, {x: event.clientX, y: event.clientY});
    const after = middle();
    travelled += Math.abs(after.x - before.x) + Math.abs(after.y - before.y);
    const two = pointers.size > 1;
    const moves = two || event.shiftKey || (event.buttons & 6) !== 0;
    drag(after.x - before.x, after.y - before.y, moves);
    if (two && before.spread > 0 && after.spread > 0) camera.zoom(before.spread / after.spread);
    moved();
  });
  const end = (event) => {
    if (!pointers.delete(event.pointerId)) return;
    const now = performance.now();
    if (now - last > 60) camera.speed = [0, 0];  // the pointer rested before its release
    if (travelled < kTapMoves) {
      const {offsetX: x, offsetY: y} = event;
      camera.speed = [0, 0];
      if (now - tapped.now < kDoubleTap && Math.hypot(x - tapped.x, y - tapped.y) < kTapApart) {
        tapped = {};
        moved();
        return nearer(x, y);
      }
      tapped = {now, x, y};
      if (event.type === 'pointerup') tap(x, y);
      moved();  // which ends what moves by itself; the end of a drag changes nothing
    }
  };
  canvas.addEventListener('pointerup', end);
  canvas.addEventListener('pointercancel', end);
  canvas.addEventListener('contextmenu', (event) => event.preventDefault());
  for (const it of over) {
    let from;
    it.addEventListener('pointerdown', (event) => {
      from = event.target.closest('nav') ? undefined : event;
    });
    it.addEventListener('pointerup', () => { from = undefined; });
    it.addEventListener('pointermove', (event) => {
      if (!from || Math.hypot(event.clientX - from.clientX, event.clientY - from.clientY) <
                   kTapMoves) return;
      from = undefined;
      canvas.dispatchEvent(new PointerEvent('pointerdown', event));
    });
  }
  for (const it of [canvas, ...over, ...wheeled]) it.addEventListener('wheel', (event) => {
    const text = event.target.closest('nav div, [role=status]');
    if (!wheels() || text?.scrollHeight > text?.clientHeight) return;
    const pixels = event.deltaY * (event.deltaMode === 1 ? 33 : event.deltaMode === 2 ? 400 : 1);
    const before = camera.distance;
    camera.zoom(Math.exp(Math.min(Math.max(pixels, -300), 300) * 0.0015));
    if (camera.distance === before) return;  // the page scrolls
    event.preventDefault();
    moved();
  }, {passive: false});

  const arrows = {ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1]};
  const zooms = {'+': 0.9, '=': 0.9, '-': 1 / 0.9};
  hears.addEventListener('keydown', (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.composedPath()[0].closest?.('a, button, select, input, dialog')) return;
    const arrow = arrows[event.key], zoom = zooms[event.key];
    const act = keys[event.key.toLowerCase()] ?? (() => arrow || zoom ? moved() : false);
    if (arrow && event.shiftKey) camera.pan(-arrow[0] * 0.04, arrow[1] * 0.04);
    else if (arrow) camera.turn(arrow[0] * kStep, arrow[1] * kStep);
    else if (zoom) camera.zoom(zoom);
    if (act() !== false) event.preventDefault();
  }, {signal});
}
