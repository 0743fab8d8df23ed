// Explain: saved views, notes on the surface, the ruler and the scale bar.

import {add, Camera} from './camera.js';
import {make} from './look.js';
import {sleep} from './media.js';

const kTour = 6;        // seconds that a tour shows each view, once it is complete
const kSwipe = 40;      // pixels that a swipe moves at least
const kProbe = 120;     // milliseconds between looks at what is behind notes and the scale bar
const kBehind = 0.03;   // radii that a note may lie below the surface
const kBar = 120;       // pixels: the longest scale bar
const kCorners = [[0, 0], [1, 1], [0, 1], [1, 0]];  // of a label, that may be at its point

// Shows plain text, with its addresses as links.
function fill(element, text = '') {
  element.replaceChildren(...text.split(/(https?:\/\/[^\s<>]*[^\s<>.,;:!?)])/).map((part, i) =>
    i % 2 === 0 ? part
      : make('a', {href: part, textContent: part, target: '_blank', rel: 'noopener'})));
}

export class Explain {
  // `element`: the <slf-field>; `byId` finds its parts.
  constructor(element, byId) {
    Object.assign(this, {element, byId, viewer: element.viewer, t: element.t, views: [], notes: [],
                         marks: [], at: -1});
    this.tool = undefined;  // 'ruler' or 'mark': what a click on the surface does
    byId('previous').onclick = () => this.go(this.at - 1);
    byId('next').onclick = () => this.go(this.at + 1);
    byId('tour').onclick = () => this.tour();
    byId('ruler').onclick = () => this.use('ruler');
    byId('mark').onclick = () => this.use('mark');
    byId('copy').onclick = () => this.copy(JSON.stringify(this.currentView()), 'viewCopied');
    const bar = byId('views');
    let from;
    bar.onpointerdown = ({clientX}) => { from = clientX; };
    bar.onpointerup = ({clientX}) => {
      if (Math.abs(clientX - from) > kSwipe) this.go(this.at + (clientX < from ? 1 : -1));
    };
    bar.onkeydown = ({key}) => {
      const by = {ArrowLeft: -1, ArrowRight: 1}[key];
      if (by) this.go(this.at + by);
    };
  }
  get sphere() { return this.viewer.field.manifest.sphere; }
  // Of world coordinates, after a space, if it is known.
  get unit() {
    const {unit} = this.viewer.field.manifest.provenance ?? {};
    return unit ? ` ${unit}` : '';
  }
  // From world units to radii from the sphere's centre, and back.
  inward(point) { return point.map((v, i) => (v - this.sphere.center[i]) / this.sphere.radius); }
  outward(point) { return point.map((v, i) => this.sphere.center[i] + v * this.sphere.radius); }

  // Takes the content of views.json (schemas/views.json), which slf has checked.
  take({views = [], notes = []}) {
    this.views = views.map((view) => ({
      ...view, camera: [...view.orbit, ...(view.target ? this.inward(view.target) : [])].join()}));
    this.byId('views').hidden = views.length === 0;
    this.byId('tour').hidden = views.length < 2;
    if (views.length > 0) this.tell(0);
    this.notes = notes.map(({label, text, point}) => {
      const element = make('div', {className: 'note'}), more = make('p', {hidden: true});
      const button = make('button', {textContent: label, ariaExpanded: text ? 'false' : null});
      const note = {element, point: this.inward(point)};
      fill(more, text);
      button.onclick = () => {
        if (text) button.ariaExpanded = String(!(more.hidden = !more.hidden));
      };
      button.onfocus = () => note.behind && button.matches(':focus-visible') && this.face(note);
      element.append(button, more);
      this.byId('notes').append(element);
      return note;
    });
    this.place();
  }
  // Turns the camera so that it sees a note.
  face({point}) {
    const camera = new Camera(this.viewer.camera.toText());
    camera.face(point);
    this.viewer.flyTo(camera.toText());
  }

  // Flies to the saved view that the page's address names, from 1.
  open(number) {
    if (this.views[number - 1]) this.go(number - 1);
    else this.element.hint(this.t('noView', number));
  }
  // Flies to a saved view; after the last one comes the first. Returns whether there are any.
  go(number) {
    if (this.views.length === 0) return false;
    const at = (number + this.views.length) % this.views.length;
    this.tell(at);
    this.viewer.flyTo(this.views[at].camera);
    const {state, structures, clip = [], cap = ''} = this.views[at];
    if (state !== undefined) this.element.state = state;
    if (structures) this.element.structures = structures;
    Object.assign(this.element, {cap, clip});
    return true;
  }
  // Shows the saved views one after another, from `first` on, or ends that.
  async tour(tours = !this.tours, first = this.at + 1) {
    const {viewer} = this, seconds = parseFloat(this.element.tour) || kTour;
    this.tours = tours && this.views.length > 1;
    this.byId('tour').setAttribute('aria-pressed', String(this.tours));
    const current = this.touring = {};
    const goesOn = () => this.tours && this.touring === current && !viewer.ended;
    for (let at = first; goesOn(); at = this.at + 1) {
      this.go(at);
      for (let since; goesOn() && !(performance.now() - since > 1000 * seconds); await sleep(50))
        if (viewer.state === 'settled') since ??= performance.now();
    }
  }
  tell(at) {
    this.at = at;
    const {title, text} = this.views[at], link = this.byId('title');
    link.textContent = title;
    if (this.element.whole) link.href = `#saved=${at + 1}`;
    this.byId('count').textContent = this.t('of', at + 1, this.views.length);
    fill(this.byId('text'), text);
  }
  currentView() {
    const {field, camera: {azimuth, elevation, distance, target}} = this.viewer;
    const round = (v) => Math.round(v * 1e3) / 1e3;
    return {title: this.t('title'), text: '', orbit: [azimuth, elevation, distance].map(round),
            ...(target.some((v) => v !== 0) && {target: this.outward(target).map(round)}),
            ...(field.states.length > 1 && {state: field.states[field.state]}),
            ...(field.structures.length > 0 &&
                {structures: this.element.structures}),
            ...(this.element.clip.length > 0 &&
                {clip: this.element.clip.map((text) => text.split(',').map(Number))}),
            ...(this.element.cap && {cap: this.element.cap})};
  }
  async copy(text, said) {
    try {
      await navigator.clipboard.writeText(text);
      this.element.hint(this.t(said));
    } catch {
      this.element.say(text);
    }
  }

  // ---- picking and measuring --------------------------------------------------------------------

  // Begins to use a tool, or ends it.
  use(tool) {
    this.tool = this.tool === tool ? undefined : tool;
    for (const name of ['ruler', 'mark'])
      this.byId(name).setAttribute('aria-pressed', String(this.tool === name));
    this.byId('picture').classList.toggle('picks', this.tool !== undefined);
    this.byId('cross').hidden = !this.tool;
    this.show([]);
    this.element.say(this.tool ? this.t(tool) : '');
  }
  // A click on the surface, at a result of Viewer.pick().
  picked(found) {
    if (!this.tool) return;
    if (!found) return this.element.say(this.t('nothing'));
    if (this.tool === 'mark')
      return this.copy(JSON.stringify({
        label: this.t('label'), text: '', point: found.point.map((v) => +v.toFixed(3))}),
                       'noteCopied');
    this.show([...this.marks.slice(this.marks.length === 2 ? 2 : 0), found]);
    if (this.marks.length === 2) this.element.say(this.length().text);
  }
  // Marks points, results of Viewer.pick().
  show(marks) {
    this.marks = marks;
    this.place();
  }
  // A number with as many digits as its error leaves.
  rounded(value, error) {
    const digits = Math.max(0, Math.min(6, Math.ceil(-Math.log10(error || 1e-6))));
    return `${this.t.written(value, digits)} ± ${this.t.written(error, digits)}`;
  }
  // Between the two points of the ruler, in world units.
  length() {
    const [a, b] = this.marks, length = Math.hypot(...add(a.point, b.point, -1));
    const error = Math.hypot(a.uncertainty, b.uncertainty);
    return {length, error, text: this.t('distance', this.rounded(length, error) + this.unit)};
  }

  // Puts notes, ruler and scale bar where they belong in the view.
  place() {
    const {viewer} = this;
    if (!viewer.field?.shape) return;
    this.placeNotes();
    this.byId('lines').innerHTML = this.ruler();
    const now = performance.now();
    if (now - (this.probed ?? 0) > kProbe) this.probe();
    else this.later ??= setTimeout(() => this.probe(), kProbe);
  }
  // Puts each label beside its point where it covers none of a nearer note, or else only a dot.
  placeNotes() {
    const {clientWidth, clientHeight} = this.viewer.canvas, taken = [];
    for (const note of this.notes) Object.assign(note, this.viewer.project(note.point));
    for (const note of [...this.notes].sort((a, b) => a.distance - b.distance)) {
      const {element, x, y} = note, {offsetWidth: width, offsetHeight: height} = element;
      const box = ([u, v]) => [x - u * width, y - v * height];
      const free = (corner) => {
        const [left, top] = box(corner);
        return left >= 0 && top >= 0 && left + width <= clientWidth &&
          top + height <= clientHeight && taken.every(([l, t, w, h]) =>
            left >= l + w || l >= left + width || top >= t + h || t >= top + height);
      };
      if (note.far <= 0) this.hide(note, true);
      const corner = [note.corner ?? kCorners[0], ...kCorners].find(free);
      const [u, v] = note.corner = corner ?? kCorners[0], [left, top] = box(note.corner);
      if (corner && !note.behind) taken.push([left, top, width, height]);
      element.style.transform = `translate(${left.toFixed(1)}px, ${top.toFixed(1)}px)`;
      for (const [name, on] of Object.entries({left: u, above: v, crowded: !corner}))
        element.classList.toggle(name, Boolean(on));
    }
  }
  // Says where on the surface the pointer is, at a place of the canvas, or that it is nowhere.
  point(place) {
    this.under = place;
    if (place) this.later ??= setTimeout(() => this.probe(), kProbe);
    else this.byId('under').hidden = true;
  }
  async coordinates(found) {
    const {radius} = this.sphere, digits = Math.max(0, 3 - Math.ceil(Math.log10(radius)));
    const at = found && this.outward(found.point).map((v) => this.t.written(v, digits))
      .join(this.t.language === 'en' ? ', ' : '; ') + this.unit, {under} = this;
    const name = found && await this.viewer.structureAt(found).catch(() => '');
    if (under !== this.under) return;
    Object.assign(this.byId('under'), {hidden: !at, textContent: name ? `${name} · ${at}` : at});
  }
  // Hides the notes that have matter in front of them. Finds the distance that the scale bar is of.
  probe() {
    clearTimeout(this.later);
    this.later = undefined;
    const {viewer} = this, notes = this.notes.filter(({far}) => far > 0);
    if (!viewer.first || !viewer.draws || !viewer.field.shape.hasDepth) return;
    this.probed = performance.now();
    const {clientWidth, clientHeight} = viewer.canvas;
    const middle = [clientWidth / 2, clientHeight / 2], {under} = this;
    const [at, pointed, ...found] =
      viewer.probe([middle, under ?? middle, ...notes.map(({x, y}) => [x, y])]);
    notes.forEach((note, i) => this.hide(note, viewer.cut.removes(this.outward(note.point)) ||
                                               found[i]?.distance < note.distance - kBehind));
    this.placeNotes();
    this.scale(at?.distance);
    if (under) this.coordinates(pointed);
  }
  hide(note, behind) {
    note.element.classList.toggle('behind', note.behind = behind);
  }
  ruler() {
    const ends = this.marks.map(({point}) => this.viewer.project(this.inward(point)));
    const [a, b] = ends;
    return (b ? `<line x1="${a.x}" y1="${a.y}" x2="${b.x}" y2="${b.y}"/>` : '') +
           ends.map(({x, y}) => `<circle cx="${x}" cy="${y}" r="5"/>`).join('');
  }
  // A bar of a round length, as it appears on the surface in the middle of the picture, at so many
  // radii from the eye; none if there is no surface.
  scale(distance) {
    const {camera, canvas} = this.viewer, {clientWidth, clientHeight} = canvas;
    const bar = this.byId('scale'), line = make('i');
    bar.hidden = !(distance > 0 && clientWidth > 0 && clientHeight > 0);
    if (bar.hidden) return;
    const {half} = camera.axes(clientWidth, clientHeight);
    const unit = clientHeight / (2 * half * distance * this.sphere.radius);  // in pixels
    const ten = 10 ** Math.floor(Math.log10(kBar / unit));
    const length = [5, 2, 1].map((n) => n * ten).find((v) => v * unit <= kBar);
    bar.textContent = this.t.written(Number(length.toPrecision(3))) + this.unit;
    const said = bar.textContent + (this.unit ? '' : this.t('units'));
    bar.setAttribute('aria-label', this.t('scale', said));
    bar.title = this.t('scaleAt', said);
    line.style.width = `${length * unit}px`;
    bar.append(line);
  }
}
