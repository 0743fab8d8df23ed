// The panel of cuts: its buttons and sliders, and the handles of the planes that are shown.

import {kMostShown} from './cut.js';
import {Handles, kAxes, nearestAxis} from './handle.js';

export class CutPanel extends Handles {
  // `element`: the <slf-field>; `byId` finds its parts.
  constructor(element, byId) {
    super(byId('planes'));
    Object.assign(this, {element, byId, viewer: element.viewer, t: element.t});
    byId('cut').onclick = () => this.toggle();
    byId('cap').onchange = () => { this.element.cap = byId('cap').value; };
    for (const name of ['flip', 'snap', 'remove']) byId(name).onclick = () => this[name]();
    byId('more').onclick = () => this.add();
    for (const name of ['grey', 'span']) byId(name).oninput = () => this.window();
  }
  get planes() { return this.viewer.cut?.planes ?? []; }
  set(planes) { this.element.clip = planes.map(({point, normal}) => [...point, ...normal]); }
  get sphere() { return this.viewer.field.manifest.sphere; }
  get camera() { return this.viewer.camera; }
  get canvas() { return this.viewer.canvas; }

  // A plane through the middle, across the axis nearest to the view that has none.
  add() {
    const used = this.planes.map(({normal}) => nearestAxis(normal).map(Math.abs).join());
    const free = kAxes.filter((axis) => !used.includes(axis.join()));
    const {forward} = this.camera.axes(1, 1);
    if (this.planes.length >= kMostShown) return;
    this.chosen = this.planes.length;
    this.set([...this.planes, {point: this.sphere.center, normal: nearestAxis(
      forward.map((v) => -v), free.length > 0 ? free : kAxes)}]);
  }
  toggle() {
    if (this.planes.length > 0) this.set([]);
    else this.add();
    const {element, viewer} = this;
    element.showCut().then(() => viewer.cut.why && element.hint(element.told(viewer.cut.why)));
  }
  // Takes the greys of a slice from the sliders.
  window() {
    const [middle, width] = ['grey', 'span'].map((name) => Number(this.byId(name).value));
    this.element.cap =
      `slice:${[middle - width / 2, middle + width / 2].map((v) => +v.toPrecision(4))}`;
  }

  // Draws the handles, and says what is shown in the panel.
  place() {
    const {byId, planes} = this, {cut} = this.viewer;
    if (!cut) return;
    byId('cut').setAttribute('aria-pressed', String(planes.length > 0));
    byId('cuts').hidden = planes.length === 0;
    const slices = cut.cap.startsWith('slice') && !cut.hollow;
    byId('greys').hidden = !slices;
    byId('cap').value = cut.hollow ? 'hollow' : slices ? 'slice' : 'shaded';
    Object.assign(byId('cap'), {disabled: cut.hollow && Boolean(cut.why),
                                title: cut.why ? this.element.told(cut.why) : ''});
    byId('more').disabled = planes.length >= kMostShown;
    if (slices) {
      const [low, high] = cut.window, [least, most] = cut.of.range;
      Object.assign(byId('grey'), {min: least, max: most, step: 'any', value: (low + high) / 2});
      Object.assign(byId('span'), {min: (most - least) / 100, max: most - least, step: 'any',
                                   value: high - low});
    }
    super.place();
  }
}
