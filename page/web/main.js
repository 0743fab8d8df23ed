// <slf-field src="field.slf" poster="poster.jpg" views="views.json" view="30,20,3" address>: an
// element that shows a field (doc/web.md). With `address`, as in the page of slf view and of
// exports, the page belongs to it: its address has the view, and all keys are for it. With `own`,
// as in slf view, it may not show fields of other hosts.

import {dot} from './camera.js';
import {attach} from './controls.js';
import {Decoders} from './decoders.js';
import {Explain} from './explain.js';
import {ownColors, StructureList} from './list.js';
import {kMarkup, kStyle} from './look.js';
import {embeddedSource, fileSource, HttpSource} from './source.js';
import {joined, looksOf, split, textsOf} from './structures.js';
import {sleep, Viewer} from './viewer.js';
import {serve} from './worker.js';
import workerScript from 'worker-script';  // worker.js as the build bundles it

const kCounts = 200;     // milliseconds between updates of the panel
const kStep = 100;       // milliseconds that each state is shown at least while states play
const kMaxPanel = 0.1;   // of the element that the panel covers; a larger one starts folded,
const kMaxList = 0.16;   // and so does a larger list of structures,
const kNarrow = 640;     // or any in an element of at most so many pixels, as in look.js

const base = document.currentScript?.src || document.baseURI;
// The field, where it is inside the page.
const pieces = [...document.querySelectorAll('script.piece')].map((script) => script.textContent);
const human = (n) =>
  n < 1 << 20 ? `${(n / 1024).toFixed(0)} KiB` : `${(n / (1 << 20)).toFixed(1)} MiB`;
const light = matchMedia('(prefers-color-scheme: light)');
const sheet = new CSSStyleSheet();
sheet.replaceSync(kStyle);

// ---- the parts that all elements share ----------------------------------------------------------

const fromBase64 = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
// Resolves to the module, as an answer. From disk and in a sandbox only scripts can be loaded;
// those of exports define slfModule.
async function packedModule() {
  if (!globalThis.slfModule) {
    const answer = await fetch(new URL('module.bin', base)).catch(() => {});
    if (answer?.ok) return answer;
    await new Promise((done) => document.head.append(Object.assign(
      document.createElement('script'),
      {src: new URL('module.bin.js', base), onload: done, onerror: done})));
  }
  if (globalThis.slfModule) return new Response(fromBase64(globalThis.slfModule));
  throw new Error('A part of this page cannot be loaded: module.bin.');
}
async function compileModule() {
  for (const name of ['WebAssembly', 'DecompressionStream'])
    if (!globalThis[name])
      throw new Error(`This browser is too old or locked down: it lacks ${name}.`);
  const bytes = (await packedModule()).body.pipeThrough(new DecompressionStream('gzip'));
  try {
    return await WebAssembly.compileStreaming(
      new Response(bytes, {headers: {'Content-Type': 'application/wasm'}}));
  } catch (error) {
    // A policy forbids the smallest module, too. Browsers word that in different ways.
    const smallest = Uint8Array.of(0, 97, 115, 109, 1, 0, 0, 0);
    if (await WebAssembly.compile(smallest).catch(() => {})) throw error;
    throw new Error('The host of this page forbids WebAssembly. Its Content-Security-Policy must ' +
                    "have 'wasm-unsafe-eval' in script-src.");
  }
}
let compiled;
const loadModule = () => {
  compiled ??= compileModule();
  compiled.catch(() => {});  // reported by those who use it
  return compiled;
};

// A worker, and what stands in for one where the host of the page forbids workers.
const makeWorker = () => new Worker(URL.createObjectURL(new Blob([workerScript])));
function makeStandIn() {
  const port = {postMessage: (data) => setTimeout(() => self.onmessage({data}))};
  const self = {postMessage: (data) => port.onmessage({data})};
  serve(self);
  return port;
}

const kChoices = ['mode', 'level', 'background', 'curve', 'exposure'];
const kProjections = {
  mip: 'maximum intensity projection',
  minip: 'minimum intensity projection',
  mean: 'mean intensity projection',
};
const kAxes = {x: [1, 0, 0], y: [0, 1, 0], z: [0, 0, 1]};
const kPatientAxes = {  // LPS
  L: [1, 0, 0], R: [-1, 0, 0], P: [0, 1, 0], A: [0, -1, 0], S: [0, 0, 1], I: [0, 0, -1]};

// ---- the element --------------------------------------------------------------------------------

export class SlfField extends HTMLElement {
  connectedCallback() {
    const root = this.shadowRoot ?? this.attachShadow({mode: 'open'});
    root.adoptedStyleSheets = [sheet];
    root.innerHTML = kMarkup;
    this.byId = (id) => root.getElementById(id);
    this.whole = this.hasAttribute('address');
    this.settings = {mode: 'depth', level: 'auto', curve: 'neutral', exposure: 0,
                     background: light.matches ? '#f4f5f7' : '#000000'};
    const viewer = this.viewer = new Viewer(this.byId('picture'), this.settings, {
      shown: () => this.shown(),
      moved: () => this.moved(),
      settled: () => this.keepLink(),
      say: (text) => this.say(text),
      failed: (error) => this.failed(error),
    });
    viewer.root = root;
    if (this.whole) globalThis.slf = viewer;  // for tests and scripts
    const poster = this.getAttribute('poster');
    if (poster)
      this.byId('picture').before(Object.assign(new Image(), {src: poster, alt: '', id: 'poster'}));
    this.byId('fold').onclick = () => this.fold();
    this.byId('unroll').onclick = () => this.unroll();
    this.explain = new Explain(this, this.byId);
    this.list = new StructureList(this.byId, (looks) => this.showLooks(looks));
    const structures = this.getAttribute('structures');
    if (structures !== null) this.settings.structures = split(structures);
    viewer.camera.fromText(this.getAttribute('view'));
    this.settings.state = this.getAttribute('state');
    if (this.whole) this.readFragment();
    const {offsetWidth, offsetHeight} = this.byId('panel');
    if (offsetWidth * offsetHeight > kMaxPanel * this.offsetWidth * this.offsetHeight) this.fold();
    let begin = () => {
      begin = () => {};
      this.start().catch((error) => viewer.fail(error));
    };
    if (this.whole) return begin();
    // An element that is never in sight loads nothing.
    this.sight = new IntersectionObserver((entries) => {
      viewer.seen = entries.at(-1).isIntersecting;
      if (viewer.seen) begin();
    });
    this.sight.observe(this);
  }
  disconnectedCallback() {
    this.sight?.disconnect();
    clearInterval(this.counts);
    this.viewer.close();
  }

  // Turns the camera to a view, "azimuth,elevation,distance" and perhaps a target in radii, as the
  // page's address has it. Resolves when it is there.
  flyTo(view) { return this.viewer.flyTo(view); }
  // Resolves to what is shown, as a file.
  picture(type = 'image/png') {
    return new Promise((done) => this.byId('picture').toBlob(done, type));
  }
  // What the surface is at a place of the element, in CSS pixels: {point, depth, uncertainty} in
  // world units, or null.
  pick(x, y) { return this.viewer.pick(x, y); }

  // The structures that are shown, and how: texts as slf render --structure takes them.
  get structures() { return this.settings?.structures ?? ['*']; }
  // Also takes one text, as the page's address has it.
  set structures(given) {
    if (!this.settings) return this.setAttribute('structures', joined(split(given)));
    this.settings.structures = split(given);
    if (!this.list.names) return;  // later
    const {looks, unknown} = looksOf(this.viewer.field, this.settings.structures);
    if (unknown.length > 0) this.hint(`This field has no structure named ${unknown.join(', ')}.`);
    this.list.show(looks);
    this.showLooks(looks);
  }
  static observedAttributes = ['structures'];
  attributeChangedCallback(name, before, value) {
    if (this.settings) this.structures = value ?? '*';
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
  failed(error) {
    if (this.whole) this.byId('name').textContent = document.title;
    this.say(this.viewer.message, true);
    this.tell('error', {message: this.viewer.message, error});
  }

  async start() {
    const {viewer} = this, coming = loadModule();
    this.source = await this.findField();
    const decoders = new Decoders(makeWorker, makeStandIn);
    await viewer.open(this.source, coming, decoders);
    this.say('');
    this.fillPanel();
    this.actions();
    this.drawMarks();
    this.explain.place();
    this.explain.take(await this.findViews());
    const saved = this.whole && new URLSearchParams(location.hash.slice(1)).get('saved');
    if (saved) this.explain.go(saved - 1);
    addEventListener('hashchange', () => {
      if (!this.whole) return;
      this.readFragment();
      this.showChoices();
      viewer.changed();
      this.moved();
    });
    this.counts = setInterval(() => this.showCounts(), kCounts);
    this.tell('ready');
  }

  // Where the field is: inside the page; where ?field=ADDRESS says; or where `src` does.
  async findField() {
    const src = this.getAttribute('src');
    if (pieces.length > 0 && !src) return embeddedSource(pieces);
    const given = this.whole ? new URLSearchParams(location.search).get('field') : undefined;
    if (given && this.hasAttribute('own'))
      throw new Error('slf view shows only its own fields; the page of slf export shows others.');
    let url;
    try {
      url = new URL(given ?? src ?? 'field.slf', document.baseURI);
    } catch {
      throw new Error(`${given ? '?field=' : 'src='}${given ?? src}: not an address`);
    }
    if (url.protocol === 'file:') return fileSource(await this.chosenFile());
    return new HttpSource(url, {
      small: this.whole,
      // The tiles of the first picture, as the exporter found them.
      first: given || this.turned ? [] : (this.getAttribute('first') ?? '').split(' ')
        .filter(Boolean).map((range) => range.split('-').map(Number)),
      onProgress: (done, total) => this.say('This host serves only whole files. Fetched ' +
        human(done) + (total ? ` of ${human(total)}` : '')),
      onError: (error) => this.viewer.fail(error),
      onWait: (waits) => this.say(waits ? 'Waiting for the network…' : ''),
    });
  }
  // Resolves to a file of this machine that the reader chooses.
  chosenFile() {
    this.viewer.state = 'asking';
    this.byId('choose').hidden = false;
    return new Promise((done) => {
      this.byId('file').onchange = ({target}) => {
        this.byId('choose').hidden = true;
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
    this.say(`${address} cannot be loaded.`);
    return {};
  }

  // ---- the view ---------------------------------------------------------------------------------

  shown() {
    // A poster is finer than the first levels of its view.
    const poster = this.byId('poster') || this.querySelector('[slot=poster]');
    if (this.turned || this.viewer.complete || !poster)
      this.byId('picture').classList.add('shown');
    this.explain.place();
  }
  moved() {
    this.turned ||= this.viewer.begun;
    this.byId('spin').checked = this.viewer.camera.spins;
    this.drawMarks();
    this.explain.place();
    this.tell('camera', {view: this.viewer.camera.toText()});
  }
  keepLink() {
    if (this.whole && location.protocol !== 'about:')  // not that of a notebook
      history.replaceState(null, '', this.fragment());
  }
  fragment() {
    const {settings} = this;
    const {states, state, structures} = this.viewer.field;
    return `#view=${this.viewer.camera.toText()}&mode=${settings.mode}&level=${settings.level}` +
           (states.length > 1 ? `&state=${encodeURIComponent(states[state])}` : '') +
           (structures.length > 0 ? `&structures=${joined(this.structures)}` : '') +
           `&background=${settings.background.slice(1)}` + (this.viewer.field.radiance
             ? `&curve=${settings.curve}&exposure=${settings.exposure}` : '');
  }
  readFragment() {
    const given = new URLSearchParams(location.hash.slice(1)), {settings} = this;
    if (given.has('view')) {
      this.viewer.camera.fromText(given.get('view'));
      this.shadowRoot.querySelector('slot').hidden = this.turned = true;  // not of this view
    }
    if (given.has('state')) settings.state = given.get('state');
    // Of structures, a state is one of them.
    const parts = /[#&]structures=([^&]*)/.exec(location.hash);  // with its commas as they are
    if (parts) settings.structures = split(parts[1]);
    else if (given.has('state')) settings.structures = [given.get('state')];
    if (parts) this.shadowRoot.querySelector('slot').hidden = this.turned = true;
    if (given.has('saved')) this.explain.go(given.get('saved') - 1);
    if (['depth', 'bitri'].includes(given.get('mode'))) settings.mode = given.get('mode');
    if (/^(auto|\d{1,2})$/.test(given.get('level') ?? '')) settings.level = given.get('level');
    if (/^[0-9a-f]{6}$/i.test(given.get('background') ?? ''))
      settings.background = '#' + given.get('background').toLowerCase();
    const curve = given.get('curve');
    if (['neutral', 'srgb', 'none'].includes(curve)) settings.curve = curve;
    const exposure = parseFloat(given.get('exposure'));
    if (Math.abs(exposure) <= 6) settings.exposure = exposure;
  }

  // A compass of the axes, those of the patient if the source states them; letters on the far side
  // are dim.
  drawMarks() {
    const box = this.byId('compass');
    box.hidden = !this.byId('marks').checked;
    if (box.hidden) return;
    const {forward, right, down} = this.viewer.camera.axes(1, 1);
    const marks = this.viewer.field.manifest.provenance?.space ? kPatientAxes : kAxes;
    box.replaceChildren(...Object.entries(marks).map(([letter, axis]) => {
      const mark = document.createElement('span'), near = -dot(axis, forward);
      mark.textContent = letter;
      mark.style.left = `${50 + 40 * dot(axis, right)}%`;
      mark.style.top = `${50 + 40 * dot(axis, down)}%`;
      mark.style.opacity = String(0.65 + 0.35 * near);
      mark.style.zIndex = String(Math.round(10 * near) + 10);
      return mark;
    }));
  }

  // ---- the panel --------------------------------------------------------------------------------

  showCounts() {
    const {source, loader, rate} = this.viewer;
    this.byId('rate').textContent = rate ? rate.toFixed(0) : '–';
    this.byId('bytes').textContent =
      `${human(source.bytes)} (${(100 * source.bytes / source.size).toFixed(0)} %)`;
    this.byId('tiles').textContent = String(loader.tiles);
    if (loader.damaged > 0)
      this.say(`${loader.damaged} damaged tiles: coarser ones stand in. slf verify says more.`);
  }

  showFacts() {
    const {manifest: m} = this.viewer.field, p = m.provenance ?? {};
    const fine = m.levels, name = (path) => String(path).split('/').pop();
    const facts = {
      Source: p.source ? name(p.source) : p.name,
      State: this.settings.state,
      Structures: this.list.names?.length,
      Kind: p.kind,
      Voxels: p.dims?.join(' × '),
      Colours: p.transfer?.[0]?.Name,
      Shows: kProjections[p.projection],
      Lattice: `${m.entry_side << fine} entry, ${m.exit_side << fine} exit`,
      Levels: m.levels + 1,
      Samples: `${m.format} (${m.codec})`,
      Sphere: `radius ${Number(m.sphere.radius.toPrecision(4))}`,
      File: human(this.source.size),
    };
    this.byId('facts-list').replaceChildren(...Object.entries(facts)
      .filter(([, v]) => v !== undefined).flatMap(([k, v]) => {
        const term = document.createElement('dt'), fact = document.createElement('dd');
        term.textContent = k;
        fact.textContent = String(v);
        return [term, fact];
      }));
    this.byId('facts').showModal();
  }

  actions() {
    const {byId, viewer, explain} = this, {camera, canvas} = viewer;
    const moved = () => {
      viewer.halt();
      viewer.moved();
    };
    const spin = () => {
      camera.spins = byId('spin').checked;
      moved();
    };
    const toggleSpin = () => {
      byId('spin').checked = !byId('spin').checked;
      spin();
    };
    const reset = () => {
      camera.reset();
      moved();
    };
    const fill = () =>
      document.fullscreenElement ? document.exitFullscreen() : this.requestFullscreen?.();
    for (const name of kChoices)
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
      const link = document.createElement('a');
      link.href = URL.createObjectURL(await this.picture());
      link.download = 'view.png';
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 1000);
    };
    byId('link').hidden = !this.whole;
    byId('link').onclick = async () => {
      this.keepLink();
      try {
        await navigator.clipboard.writeText(location.href);
        this.hint('The link is on the clipboard.');
      } catch {
        this.hint('The address of this page is the link.');
      }
    };
    const tap = (x, y) => {
      const found = viewer.pick(x, y);
      explain.picked(found);
      if (found) this.tell('pick', found);
    };
    attach(canvas, camera, {
      moved, tap,
      hears: this.whole ? globalThis : this,
      wheels: () => this.whole || this.shadowRoot.activeElement,
      keys: {r: reset, f: fill, h: () => this.fold(), l: () => this.unroll(), ' ': toggleSpin,
             m: () => explain.use('ruler'), p: () => this.play(),
             ',': () => this.showState(viewer.field.state - 1),
             '.': () => this.showState(viewer.field.state + 1),
             pageup: () => explain.go(explain.at - 1), pagedown: () => explain.go(explain.at + 1),
             enter: () => explain.tool && tap(canvas.clientWidth / 2, canvas.clientHeight / 2)},
    });
  }
  // Hides or shows the settings.
  fold() { this.toggle('settings', 'fold'); }

  // Hides or shows the list of structures.
  unroll() { this.toggle('parts', 'unroll'); }
  toggle(id, by) {
    const hidden = this.byId(id).hidden = !this.byId(id).hidden;
    this.byId(by).textContent = hidden ? '+' : '–';
    this.byId(by).setAttribute('aria-expanded', String(!hidden));
    const [other, otherBy] = id === 'parts' ? ['settings', 'fold'] : ['parts', 'unroll'];
    if (!hidden && this.offsetWidth <= kNarrow && !this.byId(other).hidden)
      this.toggle(other, otherBy);
  }

  showChoices() {
    for (const name of kChoices) this.byId(name).value = this.settings[name];
    this.showState(this.viewer.field.stateNumber(this.settings.state));
    if (this.list.names) this.structures = this.structures;
  }
  // Shows a state of the field, by its number; from the last one, the next is the first.
  showState(number) {
    const {field} = this.viewer, count = Math.max(1, field.states.length);
    const state = (number + count) % count;
    this.settings.state = field.states[state];
    this.byId('state').value = state;
    this.viewer.showState(state);
  }
  // Shows structures. While a picture of others is on its way, only the last looks wait for it.
  async showLooks(looks) {
    const {viewer} = this, waits = this.looks !== undefined;
    this.settings.structures = textsOf(viewer.field.structures, looks);
    this.looks = looks;
    while (!waits && this.looks && !viewer.failed) {
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
    while (this.plays && !viewer.failed) {
      this.showState(viewer.field.state + 1);
      const begin = performance.now();
      while (this.plays && (performance.now() - begin < kStep ||
                            (viewer.stuck && viewer.state !== 'settled'))) await sleep(5);
    }
  }
  fillPanel() {
    const {byId, settings, viewer} = this, {manifest: m, shape} = viewer.field;
    const p = m.provenance ?? {};
    const name = String(p.source ?? p.name ?? 'Sphere light field').split('/').pop();
    byId('name').textContent = name;
    if (this.whole) document.title = name;
    for (let level = 0; level <= shape.levels; ++level)
      byId('level').append(
        new Option(`${level}: ${m.entry_side << level}/${m.exit_side << level}`, level));
    if (!shape.hasDepth) {
      settings.mode = 'bitri';
      byId('mode').querySelector('[value=depth]').remove();
      byId('ruler').hidden = byId('mark').hidden = true;
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
        this.unroll();
    }
    this.showChoices();
    byId('tones').hidden = !viewer.field.radiance;
    byId('marks').checked = p.kind === 'volume';
    if (shape.levels < m.levels)
      this.say(`Levels above ${shape.levels} of this field are too fine for the page.`);
  }
}

if (!customElements.get('slf-field')) customElements.define('slf-field', SlfField);
