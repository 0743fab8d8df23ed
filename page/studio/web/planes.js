// Planes that cut the object: their list, and their handles in the picture.

import {add, dot} from '../../web/camera.js';
import {planesOf} from '../../web/cut.js';
import {Handles, kHandleStyle} from '../../web/handle.js';
import {camera, picture, view} from './picture.js';
import {merged, model, set} from './recipe.js';
import {byId, make} from './server.js';

const rounded = (v) => Number(v.toPrecision(7));
const planes = () => (merged().clip ?? []).map((plane) => [...plane]);
const setPlanes = (all, moving) => set('clip', all.length > 0 ? all : undefined, moving);
// The sphere around the volume, which no cut changes, unlike that around what is shown.
const around = () => {
  const {box} = model.server;
  if (!box) return view.sphere;
  const size = box.slice(3);
  return [...add(box.slice(0, 3), size, 0.5), Math.hypot(...size) / 2];
};
// The place of a plane on its way through it, from -1 to 1; the same for its other side.
const sideOf = (plane) => Math.sign(plane.slice(3).find((v) => v !== 0) ?? 1);
const along = (plane) => sideOf(plane) / around()[3] *
  dot(add(plane.slice(0, 3), around(), -1), plane.slice(3));
const shifted = (plane, to) => [
  ...add(around().slice(0, 3), plane.slice(3), sideOf(plane) * to * around()[3]),
  ...plane.slice(3)].map(rounded);
for (const button of document.querySelectorAll('[data-axis]'))
  button.onclick = () => {
    const normal = [0, 0, 0], {axis} = button.dataset;
    normal[axis] = camera.axes(1, 1).eye[axis] < 0 ? -1 : 1;  // the nearer half goes
    setPlanes([...planes(), [...view.sphere.slice(0, 3), ...normal].map(rounded)]);
    showPlanes();
  };
export function showPlanes() {
  byId('planes').replaceChildren(...planes().map((plane, k) => {
    const edit = (change, moving) => {
      const all = planes();
      all[k] = change(all[k]);
      setPlanes(all, moving);
      numbers.value = all[k].join(', ');
      handles.place();
    };
    const slider = make('input', {
      type: 'range', min: -1, max: 1, step: 0.005, value: along(plane)});
    slider.setAttribute('aria-label', `Place of plane ${k + 1}`);
    slider.oninput = () => edit((p) => shifted(p, Number(slider.value)), true);
    slider.onchange = () => edit((p) => shifted(p, Number(slider.value)), false);
    const numbers = make('input', {type: 'text', value: plane.join(', ')});
    numbers.setAttribute('aria-label', `Point and normal of plane ${k + 1}`);
    numbers.onchange = () => {
      const v = numbers.value.split(',').map(Number);
      if (v.length === 6 && v.every(Number.isFinite)) edit(() => v);
      showPlanes();
    };
    const flip = make('button', {textContent: 'Flip', onclick: () => {
      edit((p) => [...p.slice(0, 3), ...p.slice(3).map((v) => v === 0 ? 0 : -v)]);
      showPlanes();
    }});
    const remove = make('button', {textContent: 'Remove', onclick: () => {
      setPlanes(planes().filter((_, i) => i !== k));
      showPlanes();
    }});
    return make('div', {}, slider, numbers, make('p', {className: 'row'}, flip, remove));
  }));
  handles.place();
}
// Their handles in the picture.
class PlaneHandles extends Handles {
  get planes() { return planesOf(planes()); }
  set(all, moving) {
    setPlanes(all.map(({point, normal}) => [...point, ...normal].map(rounded)), moving);
    if (moving) this.place();
    else showPlanes();
  }
  get sphere() { return {center: view.sphere.slice(0, 3), radius: view.sphere[3]}; }
  get camera() { return camera; }
  get canvas() { return picture; }
  place() { if (view.sphere[3] > 0) super.place(); }
}
export const handles = new PlaneHandles(byId('handles'));
const handleSheet = new CSSStyleSheet();
handleSheet.replaceSync(kHandleStyle);
document.adoptedStyleSheets = [handleSheet];
