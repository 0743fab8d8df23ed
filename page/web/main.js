// <slf-field src="field.slf" poster="poster.jpg" views="views.json" view="30,20,3" address>: an
// element that shows a field (doc/web.md). With `address`, as in the page of slf view and of
// exports, the page belongs to it: its address has the view, and all keys are for it. With `own`,
// as in slf view, it may not show fields of other hosts.

import {Camera, dot, kLimits} from './camera.js';
import {attach} from './controls.js';
import {kCapForm, planesOf, textOf} from './cut.js';
import {Decoders} from './decoders.js';
import {Explain} from './explain.js';
import {CutPanel} from './cutpanel.js';
import {ownColors, StructureList} from './list.js';
import {kStyle, make, markup} from './look.js';
import {embeddedSource, fileSource, HttpSource, LocalSource} from './source.js';
import {joined, looksOf, split, textsOf} from './structures.js';
import {calm, media, sleep} from './media.js';
import {speaker, Told} from './text.js';
import {Viewer} from './viewer.js';
import {serve} from './worker.js';
import workerScript from 'worker-script';  // worker.js as the build bundles it

const kCounts = 200;     // milliseconds between updates of the panel
const kStep = 100;       // milliseconds that each state is shown at least while states play
const kMaxPanel = 0.1;   // of the element that the panel covers; a larger one starts folded,
const kMaxList = 0.16;   // and so does a larger list of structures,
const kNarrow = 640;     // or any in an element of at most so many pixels, as in look.js

const {document} = globalThis;  // none in Node, which may import this
const base = document?.currentScript?.src || document?.baseURI;
// The field, where it is inside the page.
const pieces =
  [...document?.querySelectorAll('script.piece') ?? []].map((script) => script.textContent);
const light = media('(prefers-color-scheme: light)');
const backgroundOf = ({matches}) => matches ? '#f4f5f7' : '#000000';
const firstSettings = () => ({mode: 'depth', level: 'auto', curve: 'neutral', exposure: 0,
                              background: backgroundOf(light)});
const sheet = document && new CSSStyleSheet();
sheet?.replaceSync(kStyle);

// ---- the parts that all elements share ----------------------------------------------------------

const fromBase64 = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
// Resolves to a module, as an answer. From disk and in a sandbox only scripts can be loaded; those
// of exports define slfModules. In the package for npm, a function loads one; in Python's widget,
// it resolves to the bytes.
async function packed(name) {
  const held = globalThis.slfModules?.[name];
  const bytes = typeof held === 'function' && await held();
  if (bytes instanceof Uint8Array) return new Response(bytes);
  if (!globalThis.slfModules?.[name]) {
    const answer = await fetch(new URL(name, base)).catch(() => {});
    if (answer?.ok) return answer;
    await new Promise((done) => document.head.append(
      make('script', {src: new URL(`${name}.js`, base), onload: done, onerror: done})));
  }
  const text = globalThis.slfModules?.[name];
  if (text) return new Response(fromBase64(text));
  throw new Told('noPart', name);
}
async function compileModule(name) {
  for (const needed of ['WebAssembly', 'DecompressionStream'])
    if (!globalThis[needed]) throw new Told('tooOld', needed);
  const bytes = (await packed(name)).body.pipeThrough(new DecompressionStream('gzip'));
  try {
    return await WebAssembly.compileStreaming(
      new Response(bytes, {headers: {'Content-Type': 'application/wasm'}}));
  } catch (error) {
    // A policy forbids the smallest module, too. Browsers word that in different ways.
    const smallest = Uint8Array.of(0, 97, 115, 109, 1, 0, 0, 0);
    if (await WebAssembly.compile(smallest).catch(() => {})) throw error;
    throw new Told('noWasm');
  }
}
const compiled = {};
const loadModule = (name) => {
  compiled[name] ??= compileModule(name);
  compiled[name].catch(() => {});  // reported by those who use it
  return compiled[name];
};

// A worker, and what stands in for one where the host of the page forbids workers.
let workerAddress;
const makeWorker = () =>
  new Worker(workerAddress ??= URL.createObjectURL(new Blob([workerScript])));
function makeStandIn() {
  const port = {postMessage: (data) => setTimeout(() => self.onmessage({data}))};
  const self = {postMessage: (data) => port.onmessage({data})};
  serve(self);
  return port;
}

const kChoices = {  // in the panel and, in these forms, in the page's address
  mode: /^(depth|bitri)$/, level: /^(auto|\d{1,2})$/, background: /^#[0-9a-f]{6}$/i,
  curve: /^(neutral|srgb|none)$/, exposure: /^-?([0-5](\.\d+)?|6)$/};
const kProjections = ['mip', 'minip', 'mean'];
const kAxes = {x: [1, 0, 0], y: [0, 1, 0], z: [0, 0, 1]};
const kPatientAxes = {  // LPS
  L: [1, 0, 0], R: [-1, 0, 0], P: [0, 1, 0], A: [0, -1, 0], S: [0, 0, 1], I: [0, 0, -1]};

// Attributes that are read when they matter, by the names of their properties, with what they are
// without. Names are those of <model-viewer>, angles degrees, distances radii.
const kHabits = {...kLimits, autoRotate: false, autoRotateDelay: 3000, rotationPerSecond: 8,
                 controls: '', interactionPrompt: 'auto', tour: ''};

// ---- the element --------------------------------------------------------------------------------

export class SlfField extends (globalThis.HTMLElement ?? Object) {
  constructor() {
    super();
    this.camera = new Camera();
    this.camera.obey(this);
    this.turned = false;  // whether a poster is not of what is shown
    this.settings = firstSettings();
  }
  connectedCallback() {
    if (this.stop) return;  // it was moved within the page
    for (const [name, value] of Object.entries(this)) {
      if (!(name in SlfField.prototype)) continue;
      delete this[name];  // it was set before the element was defined
      this[name] = value;
    }
    this.mount();
  }
  disconnectedCallback() { queueMicrotask(() => this.isConnected || this.dispose()); }

  // Begins to show the field. dispose() ends all that began here; camera and settings stay.
  mount() {
    const {signal} = this.stop = new AbortController();
    const root = this.shadowRoot ?? this.attachShadow({mode: 'open'});
    root.adoptedStyleSheets = [sheet];
    const t = this.t = speaker(this.lang);
    root.innerHTML = markup(t);
    this.byId = (id) => root.getElementById(id);
    this.whole = this.hasAttribute('address');
    if (this.whole) document.documentElement.lang = t.language;
    for (const link of this.querySelectorAll('[slot="about"] a')) link.textContent = t('source');
    this.alone = this.whole && parent === globalThis;  // nothing around it scrolls
    if (this.alone) this.byId('picture').style.touchAction = 'none';
    else if (this.whole) parent.postMessage('slf-field', '*');  // to a notebook around it: it runs
    const viewer = this.viewer =
      new Viewer(this.byId('picture'), this.camera, this.settings, signal, this);
    viewer.root = root;
    if (this.whole) globalThis.slf = viewer;  // for tests and scripts
    this.byId('fold').onclick = () => this.toggle('settings');
    this.byId('unroll').onclick = () => this.toggle('parts');
    this.explain = new Explain(this, this.byId);
    this.handles = new CutPanel(this, this.byId);
    this.list = new StructureList(this.byId, t, (looks) => this.showLooks(looks));
    if (this.whole) this.readFragment();
    const poster = this.getAttribute('poster');
    if (poster)
      this.byId('picture').before(make('img', {src: poster, alt: '', id: 'poster'}));
    this.dropPoster();
    const {offsetWidth, offsetHeight} = this.byId('panel');
    if (offsetWidth * offsetHeight > kMaxPanel * this.offsetWidth * this.offsetHeight)
      this.toggle('settings');
    light.addEventListener?.('change', () => {
      const {settings} = this, before = backgroundOf({matches: !light.matches});
      if (settings.background !== before) return;  // it was chosen
      settings.background = this.byId('background').value = backgroundOf(light);
      viewer.changed();
    }, {signal});
    let begun;
    const begin = () => { begun ??= this.start(signal).catch((error) => viewer.fail(error)); };
    if (this.whole) return begin();
    // An element that is never in sight loads nothing.
    const sight = new IntersectionObserver((entries) => {
      viewer.seen = entries.at(-1).isIntersecting;
      if (viewer.seen) begin();
    });
    sight.observe(this);
    signal.addEventListener('abort', () => sight.disconnect());
  }
  dispose() {
    this.stop?.abort();
    this.stop = this.looks = undefined;
    this.filled = this.plays = this.progress = false;
  }

  // Turns the camera to a view, "azimuth,elevation,distance" and perhaps a target in radii, as the
  // page's address has it. Resolves when it is there.
  async flyTo(view) {
    if (this.filled) await this.viewer.flyTo(view);
    else this.view = view;
  }
  // Resolves to what is shown, as a file.
  picture(type = 'image/png') {
    return new Promise((done) => this.byId('picture').toBlob(done, type));
  }
  // Marks a point, in world units; null: none.
  set mark(point) { this.explain?.show(point ? [{point}] : []); }
  // What the surface is at a place of the element, in CSS pixels: {point, depth, uncertainty} in
  // world units, or null.
  pick(x, y) { return this.viewer?.draws ? this.viewer.pick(x, y) : null; }

  get src() { return this.getAttribute('src'); }
  set src(address) { this.setAttribute('src', address); }
  // The view that is shown, as flyTo() takes it. Set, it is shown at once.
  get view() { return this.camera.toText(); }
  set view(text) {
    if (text === this.view) return;
    this.viewer?.halt();
    this.camera.fromText(text);
    if (this.filled) this.viewer.moved();
  }
  // The state of the object that is shown. Also takes its number.
  get state() { return this.settings.state; }
  set state(text) {
    this.settings.state = text;
    if (this.filled) this.showState(this.viewer.field.stateNumber(text));
  }
  // The planes that cut the object, 'X,Y,Z,NX,NY,NZ' each, as slf render --clip takes them; also
  // takes one text, with semicolons in between, and lists of numbers.
  get clip() { return textOf(planesOf(this.settings.clip)).split(';').filter(Boolean); }
  set clip(given) {
    this.settings.clip = textOf(planesOf(given));
    this.showCut();
  }
  // What their faces show, as slf render --cap takes it; empty: shaded, or else hollow.
  get cap() { return this.settings.cap ?? ''; }
  set cap(text) {
    this.settings.cap = kCapForm.test(text) ? String(text) : '';
    this.showCut();
  }
  async showCut() {
    const {settings, viewer} = this;
    if (!this.filled) return;
    this.tell('change', {names: ['clip', 'cap']});
    await viewer.showCut(settings.clip, settings.cap).catch((error) => this.say(this.told(error)));
  }
  // The structures that are shown, and how: texts as slf render --structure takes them.
  get structures() { return this.settings.structures ?? ['*']; }
  // Also takes one text, as the page's address has it.
  set structures(given) {
    this.settings.structures = split(given);
    if (!this.filled || !this.list.names) return;
    const {looks, unknown} = looksOf(this.viewer.field, this.settings.structures);
    if (unknown.length > 0) this.hint(this.t('noStructure', unknown.join(', ')));
    this.list.show(looks);
    this.showLooks(looks);
  }
  static observedAttributes = ['src', 'lang', 'tour', 'view', 'state', 'structures', 'clip', 'cap'];
  attributeChangedCallback(name, before, value) {
    if (name === 'lang') {
      if (!this.stop || before === value) return;
      this.dispose();
      this.mount();
    } else if (name === 'tour') {
      if (this.filled) this.explain.tour(value !== null);
    } else if (name !== 'src') {
      this[name] = value ?? {view: '30,20,3', structures: '*'}[name];
    } else if (this.stop && before !== value) {  // another field, as if the element were new
      this.dispose();
      this.turned = true;
      this.settings = firstSettings();
      for (const other of SlfField.observedAttributes.slice(3))
        this.attributeChangedCallback(other, undefined, this.getAttribute(other));
      this.mount();
    }
  }

  tell(name, detail) {
    this.dispatchEvent(new CustomEvent(name, {detail, bubbles: true, composed: true}));
  }
  say(text, wrong = false) {
    const status = this.byId('status');
    status.textContent = text;
    status.className = wrong ? 'wrong' : '';
  }
  // Says something for a moment.
  hint(text) {
    this.say(text);
    setTimeout(() => this.byId('status').textContent === text && this.say(''), 4000);
  }
  told(error) { return error.said ? this.t(...error.said) : String(error?.message ?? error); }
  failed(error) {
    if (this.whole) this.byId('name').textContent = document.title;
    this.say(this.told(error), true);
    this.tell('error', {message: this.told(error), error});
  }

  async start(signal) {
    const {viewer} = this, coming = loadModule('module.bin'), source = await this.findField(signal);
    signal.throwIfAborted();
    const decoders = new Decoders(makeWorker, makeStandIn);
    signal.addEventListener('abort', () => decoders.dispose());
    const cutter = async () => {
      const one = new Decoders(makeWorker, makeStandIn, 1);
      signal.addEventListener('abort', () => one.dispose());
      return {module: loadModule('cut.bin'),
              post: (message) => one.post(one.workers[0], message)};
    };
    await viewer.open(source, coming, decoders, cutter);
    this.say('');
    this.fillPanel();
    this.actions(signal);
    this.drawMarks();
    this.explain.place();
    const views = await this.findViews();
    signal.throwIfAborted();
    this.explain.take(views);
    if (this.saved) this.explain.open(this.saved);
    addEventListener('hashchange', () => {
      if (!this.whole) return;
      this.readFragment();
      this.showChoices();
      viewer.changed();
      this.moved();
      if (this.saved) this.explain.open(this.saved);
    }, {signal});
    if (this.hasAttribute('tour') && !calm.matches) this.explain.tour(true, this.explain.at);
    this.prompt();
    const counts = setInterval(() => {
      this.showCounts();
      this.advance(viewer.complete ? 1 : 0.99 * viewer.loader.share);
    }, kCounts);
    signal.addEventListener('abort', () => clearInterval(counts));
    this.tell('ready');
  }

  // Where the field is: what `source` reads; inside the page; where ?field=ADDRESS says; or where
  // `src` does.
  async findField(signal) {
    if (this.source) return new LocalSource(this.source.size, this.source.read);
    const src = this.getAttribute('src');
    if (pieces.length > 0 && !src) return embeddedSource(pieces);
    const given = this.whole ? new URLSearchParams(location.search).get('field') : undefined;
    if (given && this.hasAttribute('own'))
      throw new Told('ownOnly');
    if (!given && !src && !this.whole) throw new Told('noSrc');
    let url;
    try {
      url = new URL(given ?? src ?? 'field.slf', document.baseURI);
    } catch {
      throw new Told('noAddress', `${given ? '?field=' : 'src='}${given ?? src}`);
    }
    if (url.protocol === 'file:') return fileSource(await this.chosenFile());
    return new HttpSource(url, {
      signal, small: this.whole, stores: !this.hasAttribute('own'),
      // The tiles of the first picture, as the exporter found them.
      first: given || this.turned ? [] : (this.getAttribute('first') ?? '').split(' ')
        .filter(Boolean).map((range) => range.split('-').map(Number)),
      onProgress: (done, total) => this.say(this.t(
        'whole', total ? ['of', this.human(done), this.human(total)] : this.human(done))),
      onError: (error) => this.viewer.fail(error),
      onWait: (waits) => this.say(waits ? this.t('waiting') : ''),
    });
  }
  // Resolves to a file of this machine that the reader chooses.
  chosenFile() {
    this.viewer.state = 'asking';
    this.byId('choose').hidden = false;
    return new Promise((done) => {
      this.byId('file').onchange = ({target}) => {
        this.byId('choose').hidden = true;
        this.viewer.state = 'opening';
        done(target.files[0]);
      };
    });
  }
  // Resolves to the content of views.json, if there is one.
  async findViews() {
    const address = this.getAttribute('views'), text = document.querySelector('script.views');
    if (!address) return this.whole && text ? JSON.parse(text.textContent) : {};
    const answer = await fetch(new URL(address, document.baseURI)).catch(() => {});
    if (answer?.ok) return answer.json();
    this.say(this.t('noViews', address));
    return {};
  }

  // Says how much has come of the first view, from 0 to 1.
  advance(share) {
    if (share <= this.progress) return;
    this.progress = share;
    this.tell('progress', {totalProgress: share});
  }
  // Tells a first visitor how to move the picture.
  prompt() {
    if (this.interactionPrompt === 'none') return;
    try {
      if (localStorage.slfPrompted) return;
      localStorage.slfPrompted = 1;
    } catch {  // a sandbox has none
      return;
    }
    const text = this.t(media('(pointer: coarse)').matches ? 'touch' : 'drag');
    Object.assign(this.byId('hint'), {textContent: text, hidden: false});
  }
  // Ends what the element does by itself: somebody uses it.
  touched(event) {
    this.byId('hint').hidden = true;
    this.viewer.touchedAt = performance.now();
    if (event.key !== 't' && event.composedPath()[0] !== this.byId('tour'))
      this.explain.tour(false);
  }

  // ---- the view ---------------------------------------------------------------------------------

  // The graphics card was reset.
  lost() {
    this.byId('picture').classList.remove('shown');
    this.dropPoster();
    this.say(this.t('lost'));
  }
  // Drops a poster that is not of what is shown.
  dropPoster() {
    if (this.turned) this.shadowRoot.querySelectorAll('slot, #poster').forEach((it) => it.remove());
  }
  shown() {
    // A poster is finer than the first levels of its view.
    const poster = this.byId('poster') || this.querySelector('[slot=poster]');
    if (this.turned || this.viewer.complete || !poster)
      this.byId('picture').classList.add('shown');
    this.explain.place();
    this.handles.place();
  }
  moved() {
    this.turned ||= this.viewer.draws;
    this.byId('spin').checked = this.camera.spins;
    this.drawMarks();
    this.explain.place();
    this.handles.place();
    this.tell('camera', {view: this.view});
  }
  settled() {
    const {azimuth, elevation, distance} = this.camera, {states, structures} = this.viewer.field;
    const text = [
      this.t('seen', this.byId('name').textContent, azimuth.toFixed(), elevation.toFixed(),
             Number(distance.toFixed(1))),
      ...(states.length > 1 ? [this.t('seenState', this.state)] : []),
      ...(structures.length > 0 ? [this.t('seenParts', this.structures.join(', '))] : [])]
      .join('; ');
    this.byId('picture').ariaLabel = this.byId('seen').textContent = text;
    this.keepLink();
  }
  keepLink() {
    if (this.whole && location.protocol !== 'about:')  // not that of a notebook
      history.replaceState(null, '', this.fragment());
  }
  fragment() {
    const {settings} = this;
    const {states, state, structures} = this.viewer.field;
    return `#view=${this.view}` +
           (states.length > 1 ? `&state=${encodeURIComponent(states[state])}` : '') +
           (structures.length > 0 ? `&structures=${joined(this.structures)}` : '') +
           (this.clip.length > 0 ? `&clip=${this.clip.join(';')}` : '') +
           (this.cap ? `&cap=${this.cap}` : '') +
           `&level=${settings.level}&mode=${settings.mode}` +
           (settings.background === backgroundOf(light) ? ''
             : `&background=${settings.background.slice(1)}`) + (this.viewer.field.radiance
             ? `&curve=${settings.curve}&exposure=${settings.exposure}` : '');
  }
  readFragment() {
    const given = new URLSearchParams(location.hash.slice(1)), {settings} = this;
    this.camera.fromText(given.get('view'));
    if (given.has('state')) settings.state = given.get('state');
    // Of structures, a state is one of them.
    const parts = /[#&]structures=([^&]*)/.exec(location.hash);  // with its commas as they are
    if (parts) settings.structures = split(parts[1]);
    else if (given.has('state')) settings.structures = [given.get('state')];
    for (const name of ['clip', 'cap'])
      if (given.has(name)) settings[name] = given.getAll(name).join(';');
    this.turned ||= given.has('clip') || given.has('view') || parts !== null;
    this.saved = given.get('saved');  // the number of a saved view
    for (const [name, form] of Object.entries(kChoices)) {
      const text = (name === 'background' ? '#' : '') + given.get(name);
      if (form.test(text)) settings[name] = text.toLowerCase();
    }
  }

  // A compass of the axes, those of the patient if the source states them; letters on the far side
  // are dim.
  drawMarks() {
    const box = this.byId('compass');
    box.hidden = !this.byId('marks').checked;
    if (box.hidden) return;
    const {forward, right, down} = this.camera.axes(1, 1);
    box.replaceChildren(...Object.entries(this.sides).map(([letter, axis], k) => {
      const mark = make('span', {textContent: letter, title: this.t('side', letter, k + 1),
                                 onpointerdown: () => this.lookFrom(axis)});
      const near = -dot(axis, forward);
      const [left, top] = [right, down].map((v) => `${50 + 40 * dot(axis, v)}%`);
      const zIndex = Math.round(10 * near) + 10;
      Object.assign(mark.style, {left, top, opacity: 0.65 + 0.35 * near, zIndex});
      return mark;
    }));
  }

  get sides() { return this.viewer.field.manifest.provenance?.space ? kPatientAxes : kAxes; }
  // Flies to where the object is seen from a side.
  lookFrom(axis) {
    const to = new Camera(this.view);
    to.obey(this);
    to.face(axis);
    this.viewer.flyTo(to.toText());
  }

  // ---- the panel --------------------------------------------------------------------------------

  human(bytes) {
    const {written} = this.t, kib = bytes / 1024;
    return kib < 1024 ? `${written(kib, 0)} KiB` : `${written(kib / 1024, 1)} MiB`;
  }
  showCounts() {
    const {source, loader, rate} = this.viewer;
    this.byId('rate').textContent = rate ? rate.toFixed(0) : '–';
    this.byId('bytes').textContent =
      `${this.human(source.bytes)} (${(100 * source.bytes / source.size).toFixed(0)} %)`;
    this.byId('tiles').textContent = String(loader.tiles);
    if (loader.damaged > 0)
      this.say(this.t('damaged', loader.damaged));
  }

  showFacts() {
    const {t} = this, {manifest: m} = this.viewer.field, p = m.provenance ?? {}, fine = m.levels;
    const facts = {
      source: this.byId('name').textContent,
      state: this.settings.state,
      structures: this.list.names?.length,
      kind: p.kind,
      voxels: p.dims?.join(' × '),
      colours: p.transfer?.[0]?.Name,
      shows: kProjections.includes(p.projection) ? t(p.projection) : undefined,
      lattice: t('sides', m.entry_side << fine, m.exit_side << fine),
      levels: m.levels + 1,
      samples: `${m.format} (${m.codec})`,
      sphere: t('radius', Number(m.sphere.radius.toPrecision(4))),
      file: this.human(this.viewer.source.size),
    };
    this.byId('facts-list').replaceChildren(...Object.entries(facts)
      .filter(([, v]) => v !== undefined)
      .flatMap(([k, v]) => [make('dt', {textContent: t(k)}), make('dd', {textContent: v})]));
    this.byId('facts').showModal();
  }

  actions(signal) {
    const {byId, viewer, explain} = this, {camera, canvas} = viewer;
    const moved = () => {
      viewer.halt();
      viewer.moved();
    };
    const spin = () => {
      camera.spins = !camera.spins;
      moved();
    };
    const reset = () => {
      camera.reset();
      moved();
    };
    const fill = () =>
      document.fullscreenElement ? document.exitFullscreen() : this.requestFullscreen?.();
    for (const name in kChoices)
      byId(name).addEventListener('input', ({target}) => {
        this.settings[name] = target.value;
        viewer.changed();
      });
    byId('state').onchange = ({target}) => this.showState(Number(target.value));
    byId('play').onclick = () => this.play();
    byId('spin').onchange = spin;
    byId('marks').onchange = () => this.drawMarks();
    byId('reset').onclick = reset;
    byId('full').onclick = fill;
    byId('about').onclick = () => this.showFacts();
    byId('save').onclick = async () => {
      const href = URL.createObjectURL(await this.picture());
      make('a', {href, download: 'view.png'}).click();
      setTimeout(() => URL.revokeObjectURL(href), 1000);
    };
    byId('link').hidden = !this.whole;
    byId('link').onclick = () => {
      this.keepLink();
      explain.copy(location.href, 'linkCopied');
    };
    const tap = (x, y) => {
      const found = viewer.pick(x, y);
      explain.picked(found);
      if (found) this.tell('pick', found);
    };
    const hears = this.whole ? globalThis : this, sides = Object.values(this.sides);
    for (const kind of ['pointerdown', 'wheel', 'keydown'])
      hears.addEventListener(kind, (event) => this.touched(event), {signal, passive: true});
    canvas.onpointermove = ({offsetX, offsetY, buttons, pointerType}) =>
      explain.point(buttons || pointerType === 'touch' ? undefined : [offsetX, offsetY]);
    canvas.onpointerleave = () => explain.point();
    attach(canvas, camera, {
      over: [byId('notes'), byId('views')],
      wheeled: ['planes', 'compass', 'status'].map(byId), moved, tap, signal,
      nearer: (x, y) => viewer.approach(x, y),
      hears,
      wheels: () => this.alone || this.shadowRoot.activeElement && document.hasFocus(),
      keys: {r: reset, f: fill, h: () => this.toggle('settings'), l: () => this.toggle('parts'),
             ...Object.fromEntries(sides.map((axis, k) => [k + 1, () => this.lookFrom(axis)])),
             t: () => explain.tour(), ' ': spin,
             c: () => viewer.field.shape.hasDepth && this.handles.toggle(),
             m: () => explain.use('ruler'), p: () => this.play(),
             ',': () => this.showState(viewer.field.state - 1),
             '.': () => this.showState(viewer.field.state + 1),
             pageup: () => explain.go(explain.at - 1), pagedown: () => explain.go(explain.at + 1),
             enter: () => explain.tool && tap(canvas.clientWidth / 2, canvas.clientHeight / 2)},
    });
  }
  // Hides or shows the settings, or the parts: the list of structures.
  toggle(id) {
    const hidden = this.byId(id).hidden = !this.byId(id).hidden;
    const button = this.shadowRoot.querySelector(`[aria-controls=${id}]`);
    Object.assign(button, {textContent: hidden ? '+' : '–', ariaExpanded: String(!hidden)});
    const other = id === 'parts' ? 'settings' : 'parts';
    if (!hidden && this.offsetWidth <= kNarrow && !this.byId(other).hidden) this.toggle(other);
  }

  showChoices() {
    for (const name in kChoices) this.byId(name).value = this.settings[name];
    this.showState(this.viewer.field.stateNumber(this.settings.state));
    if (this.list.names) this.structures = this.structures;
    this.showCut();
  }
  // Shows a state of the field, by its number; from the last one, the next is the first.
  showState(number) {
    const {field} = this.viewer, count = Math.max(1, field.states.length);
    const state = (number + count) % count;
    this.settings.state = field.states[state];
    this.byId('state').value = state;
    this.viewer.showState(state);
    if (field.states.length > 0) this.tell('change', {names: ['state']});
  }
  // Shows structures. While a picture of others is on its way, only the last looks wait for it.
  async showLooks(looks) {
    const {viewer} = this, waits = this.looks !== undefined;
    this.settings.structures = textsOf(viewer.field.structures, looks);
    this.tell('change', {names: ['structures']});
    this.looks = looks;
    while (!waits && this.looks && !viewer.ended) {
      if (!viewer.stale) {
        viewer.showStructures(this.looks);
        this.looks = undefined;
      }
      await sleep(5);
    }
  }
  // Shows the states one after another, or stops that.
  async play() {
    const button = this.byId('play'), {viewer} = this;
    this.plays = !this.plays && viewer.field.states.length > 1;
    button.setAttribute('aria-pressed', String(this.plays));
    while (this.plays && !viewer.ended) {
      this.showState(viewer.field.state + 1);
      const begin = performance.now();
      while (this.plays && (performance.now() - begin < kStep ||
                            (viewer.stale && viewer.state !== 'settled'))) await sleep(5);
    }
  }
  fillPanel() {
    const {byId, settings, viewer} = this, {manifest: m, shape} = viewer.field;
    const p = m.provenance ?? {};
    const file = this.hasAttribute('own') && String(p.source ?? p.name ?? '').split('/').pop();
    const name = this.querySelector('[slot="about"]')?.dataset.title || file || document.title;
    byId('name').textContent = name;
    if (this.whole) document.title = name;
    for (let level = 0; level <= shape.levels; ++level)
      byId('level').append(
        new Option(`${level}: ${m.entry_side << level}/${m.exit_side << level}`, level));
    if (!shape.hasDepth) {
      settings.mode = 'bitri';
      byId('mode').querySelector('[value=depth]').remove();
      byId('ruler').hidden = byId('mark').hidden = byId('cut').hidden = true;
    }
    if (Number(settings.level) > shape.levels) settings.level = 'auto';
    viewer.field.states.forEach((state, number) => byId('state').append(new Option(state, number)));
    byId('states').hidden = viewer.field.states.length < 2;
    if (viewer.field.structures.length > 0) {
      this.list.fill(viewer.field.structures, ownColors(m));
      byId('structures').hidden = false;
      const {offsetWidth, offsetHeight} = byId('structures');
      if (this.offsetWidth <= kNarrow ||
          offsetWidth * offsetHeight > kMaxList * this.offsetWidth * this.offsetHeight)
        this.toggle('parts');
    }
    this.filled = true;
    this.showChoices();
    this.handles.place();
    byId('tones').hidden = !viewer.field.radiance;
    byId('marks').checked = p.kind === 'volume';
    if (shape.levels < m.levels)
      this.say(this.t('tooFine', shape.levels));
  }
}

for (const [name, usual] of Object.entries(kHabits)) {
  const attribute = name.replace(/[A-Z]/g, (letter) => `-${letter.toLowerCase()}`);
  Object.defineProperty(SlfField.prototype, name, {
    get() {
      const text = this.getAttribute(attribute), number = parseFloat(text);
      return typeof usual === 'boolean' ? text !== null && text !== 'false'
        : typeof usual === 'string' ? text ?? usual : Number.isNaN(number) ? usual : number;
    },
    set(value) {
      if ([false, null, undefined].includes(value)) this.removeAttribute(attribute);
      else this.setAttribute(attribute, value === true ? '' : value);
    },
  });
}
if (document && !customElements.get('slf-field')) customElements.define('slf-field', SlfField);
