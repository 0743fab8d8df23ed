// The page: puts field, renderer, loader and controls together.
//
// Two loops run: drawing, which never waits for tiles, and following, which asks the GPU for the
// tiles of the view and has them loaded.

import {Camera} from './camera.js';
import {attach} from './controls.js';
import {Renderer} from './renderer.js';
import {Decoders} from './decoders.js';
import {Field} from './field.js';
import {Loader} from './loader.js';
import {embeddedSource, fileSource, HttpSource} from './source.js';

const kTileBytes = 192 << 20;  // of textures
const kFrame = 40;             // milliseconds: slower frames of a moving camera have fewer pixels,
const kMinScale = 0.2;         // but at least this share along each edge
const kPause = 6;              // while tiles come, frames pause so many times as long as one takes
const kAhead = 0.4;            // seconds that loading looks ahead of a moving camera
const kLevel0 = 2 << 20;       // bytes: a level 0 of at most this size is loaded whole

// What an exported page has (view/bundle.h): `worker`, the script of the workers as a function, and
// in one file also the module and the field.
const inside = globalThis.slfInside;
const byId = (id) => document.getElementById(id);
const canvas = byId('picture');
const sleep = (ms) => new Promise((done) => setTimeout(done, ms));
const human = (n) =>
  n < 1 << 20 ? `${(n / 1024).toFixed(0)} KiB` : `${(n / (1 << 20)).toFixed(1)} MiB`;

const camera = new Camera();
const settings = {
  mode: 'depth', level: 'auto', background: '#000000', curve: 'neutral', exposure: 0};
let source, field, renderer, loader;
let version = 0;       // counts changes of the view
let dirty = true;      // the picture is not what the canvas shows
let sharp = false;     // what the canvas shows was drawn in full resolution
let movedAt = -1e9, lost = false, failed = false, ceiling = 99;
let begun = false;     // the first tiles are loaded
let first, complete;   // traffic() until the first picture, and until the first complete one

// The interface for tests and scripts.
const page = globalThis.slf = {
  state: 'opening',  // then 'loading', 'settled', or 'failed'
  statistics: () => ({...traffic(), first, complete, busy: loader?.busy ?? true,
                      tiles: loader?.tiles ?? 0, slots: renderer?.slots ?? 0,
                      tileBytes: renderer?.tileBytes ?? 0, damaged: loader?.damaged ?? 0}),
  camera,
  settings,
  changed,
  pages: () => field.shape.pages,
  read: (pages) => loader.reader.read(pages),
  frameTimes,
};

// What came from the host since the page began, and the milliseconds since then.
function traffic() {
  const {bytes, requests, roundTrips} = source ?? {};
  return {bytes, requests, roundTrips, milliseconds: performance.now()};
}
function say(text, wrong = false) {
  byId('status').textContent = text;
  byId('status').className = wrong ? 'wrong' : '';
}
function fail(error) {
  failed = true;
  page.state = 'failed';
  page.message = String(error?.message ?? error);
  byId('name').textContent = document.title;
  say(page.message, true);
}

// ---- the view -----------------------------------------------------------------------------------

// The coarsest level that is as fine as the pixels (slf render --level auto).
function matchingLevel() {
  const {entrySide, exitSide, levels} = field.shape;
  const pixel = 2 * camera.axes(canvas.width, canvas.height).half / canvas.height * camera.distance;
  let spacing = Math.PI / 4 / Math.min(exitSide, (settings.mode === 'depth' ? 2 : 1) * entrySide);
  let level = 0;
  for (; level < levels && spacing > pixel; ++level) spacing /= 2;
  return level;
}

function currentView() {
  const chosen = settings.level === 'auto' ? matchingLevel() : Number(settings.level);
  const background = [1, 3, 5].map((i) => parseInt(settings.background.slice(i, i + 2), 16) / 255);
  const level = Math.min(chosen, ceiling, field.shape.levels);
  return {camera, mode: settings.mode, background, exposure: Number(settings.exposure),
          curve: field.radiance ? settings.curve : 'none', level, stamp: `${version} ${level}`};
}

function changed() {
  ++version;
  dirty = true;
  pausedUntil = 0;
  ceiling = 99;
  if (page.state === 'settled') page.state = 'loading';
}
function moved() {
  movedAt = performance.now();
  changed();
}

let linkTimer;
function keepLink() {
  clearTimeout(linkTimer);
  linkTimer = setTimeout(() => history.replaceState(null, '', fragment()), 400);
}
function fragment() {
  return `#view=${camera.toText()}&mode=${settings.mode}&level=${settings.level}` +
         `&background=${settings.background.slice(1)}` +
         (field.radiance ? `&curve=${settings.curve}&exposure=${settings.exposure}` : '');
}
function readFragment() {
  const given = new URLSearchParams(location.hash.slice(1));
  if (given.has('view')) camera.fromText(given.get('view'));
  if (['depth', 'bitri'].includes(given.get('mode'))) settings.mode = given.get('mode');
  if (/^(auto|\d{1,2})$/.test(given.get('level') ?? '')) settings.level = given.get('level');
  if (/^[0-9a-f]{6}$/i.test(given.get('background') ?? ''))
    settings.background = '#' + given.get('background').toLowerCase();
  if (['neutral', 'srgb', 'none'].includes(given.get('curve'))) settings.curve = given.get('curve');
  const exposure = parseFloat(given.get('exposure'));
  if (Math.abs(exposure) <= 6) settings.exposure = exposure;
}

function resize() {
  const ratio = globalThis.devicePixelRatio || 1;
  const width = Math.max(1, Math.round(canvas.clientWidth * ratio));
  const height = Math.max(1, Math.round(canvas.clientHeight * ratio));
  if (canvas.width === width && canvas.height === height) return;
  canvas.width = width;
  canvas.height = height;
  changed();
}

// ---- drawing ------------------------------------------------------------------------------------

let before = 0, shown = 0, rateFrom = 0;
let drawing = false, pausedUntil = 0, countedAt = 0;
function frame(now) {
  requestAnimationFrame(frame);
  const elapsed = Math.min(now - before, 200);
  before = now;
  if (!begun || lost || failed) return;
  if (camera.advance(elapsed / 1000)) moved();
  if (now - countedAt > 200) {
    countedAt = now;
    showCounts();
  }
  const moving = now - movedAt < 200;
  if (now - rateFrom > 500) {
    byId('rate').textContent = moving ? (shown * 1000 / (now - rateFrom)).toFixed(0) : '–';
    shown = 0;
    rateFrom = now;
  }
  if (!dirty || drawing || (!moving && now < pausedUntil)) return;
  draw(moving).catch(fail);
}

// Draws a frame. While the picture changes, slow graphics draw fewer pixels.
async function draw(moving) {
  const view = currentView(), pixels = canvas.width * canvas.height;
  const scale = Math.sqrt(kFrame / (renderer.cost * pixels || kFrame / kMinScale ** 2));
  const whole = !moving && (scale >= 1 || renderer.keeps(view) || page.state === 'settled');
  drawMarks();
  if (whole) {
    await sharpen(view);
  } else {
    drawing = true;
    dirty = sharp = false;
    const begin = performance.now();
    await renderer.draw(view, Math.min(1, Math.max(kMinScale, scale)));
    pause(begin);
    drawing = false;
  }
  ++shown;
  first ??= traffic();
}
function pause(begin) {
  const now = performance.now();
  pausedUntil = now + kPause * (now - begin);
}

// Draws the pixels of the view that are not final, in full resolution. Resolves to false if the
// view changes meanwhile.
async function sharpen(view) {
  const asked = version;
  while (drawing) await sleep(2);
  drawing = true;
  dirty = sharp = false;
  const begin = performance.now(), done = await renderer.sharpen(view, () => version === asked);
  pause(begin);
  drawing = false;
  sharp = done;
  return done;
}

// Draws the view `count` times in full. Resolves to the milliseconds that each picture took.
async function frameTimes(count) {
  const times = [];
  while (drawing) await sleep(2);
  drawing = true;
  for (let i = 0; i < count; ++i) {
    const begin = performance.now();
    await renderer.draw(currentView(), 1);
    times.push(performance.now() - begin);
  }
  drawing = false;
  return times;
}

// A compass of the axes of LPS; letters on the far side are dim.
const kMarks = {
  L: [1, 0, 0], R: [-1, 0, 0], P: [0, 1, 0], A: [0, -1, 0], S: [0, 0, 1], I: [0, 0, -1]};
function drawMarks() {
  const box = byId('compass');
  box.hidden = !byId('marks').checked;
  if (box.hidden) return;
  const {forward, right, down} = camera.axes(1, 1);
  const dot = (a, b) => a.reduce((sum, v, i) => sum + v * b[i], 0);
  for (const [letter, axis] of Object.entries(kMarks)) {
    let mark = box.querySelector(`[data-axis=${letter}]`);
    if (!mark) {
      mark = document.createElement('span');
      mark.dataset.axis = mark.textContent = letter;
      box.append(mark);
    }
    const near = -dot(axis, forward);
    mark.style.left = `${50 + 40 * dot(axis, right)}%`;
    mark.style.top = `${50 + 40 * dot(axis, down)}%`;
    mark.style.opacity = String(0.65 + 0.35 * near);
    mark.style.zIndex = String(Math.round(10 * near) + 10);
  }
}

// ---- following ----------------------------------------------------------------------------------

// Finds the tiles of the view and has them loaded, again and again.
async function follow() {
  let seen, needed = new Set(), thorough = false, level0;
  await begin();
  while (!failed) {
    if (lost) {
      await sleep(50);
      continue;
    }
    const view = currentView(), asked = version, moving = performance.now() - movedAt < 200;
    if (view.stamp !== seen) {
      seen = view.stamp;
      needed = new Set();
      thorough = false;
    }
    // A few rays find nearly all tiles. Once these are there, the rays of all pixels that are not
    // final find the last ones.
    if (thorough && !await sharpen(view)) continue;
    const [pages] = await Promise.all([thorough ? renderer.askAll(view) : renderer.ask(view),
                                       field.prepare(view.level)]);
    if (failed || lost) continue;
    for (const at of pages) needed.add(at);
    const absent = loader.want([...needed], !moving);
    if (loader.full) {  // not all tiles of this level fit: draw a coarser one
      loader.full = false;
      ceiling = Math.max(0, view.level - 1);
    } else if (moving) {
      page.state = 'loading';
      if (absent === 0) await lookAhead(view, needed);
      await sleep(absent > 0 ? 15 : 0);
    } else if (absent > 0 || version !== asked || dirty || !sharp) {
      page.state = 'loading';
      thorough = true;
      await arrived(asked);
    } else {
      complete ??= traffic();
      level0 ??= await allOfLevel0();
      if (version !== asked) continue;  // the view has changed meanwhile
      loader.want([...needed, ...level0]);
      page.state = 'settled';
      keepLink();
      while (version === asked && !lost && !failed) await sleep(20);
    }
  }
}

// Loads the tiles of level 0 that matter most, so that something is seen soon.
async function begin() {
  const pages = field.firstTiles(camera, canvas.width, canvas.height);
  loader.want(pages, true);
  field.prepare(currentView().level).catch(fail);
  await Promise.all([arrived(version), renderer.ready]);
  begun = dirty = true;
  pausedUntil = 0;
}

// Waits until all tiles that are on their way have come, or the view changes.
async function arrived(asked) {
  while (loader.busy && version === asked && !lost && !failed) await sleep(5);
}

// Loads what the view will need soon.
async function lookAhead(view, needed) {
  const ahead = new Camera();
  Object.assign(ahead, structuredClone({...camera}));
  ahead.advance(kAhead);
  const pages = await renderer.ask({...view, camera: ahead, stamp: undefined});
  if (!failed && !lost) loader.want([...needed, ...pages]);
}

// Resolves to the pages of level 0 if it is small: then a camera that turns always has something to
// draw, and many tiles are predicted from it.
async function allOfLevel0() {
  const count = field.shape.pageBase[1] || field.shape.pages;
  if (count > renderer.slots / 2) return [];
  const pages = [...Array(count).keys()];
  return await field.payloadBytes(pages) <= kLevel0 ? pages : [];
}

// ---- the panel ----------------------------------------------------------------------------------

function showCounts() {
  byId('bytes').textContent =
    inside?.size ? human(source.size)
                 : `${human(source.bytes)} (${(100 * source.bytes / source.size).toFixed(0)} %)`;
  byId('tiles').textContent = String(loader.tiles);
  if (loader.damaged > 0)
    say(`${loader.damaged} damaged tiles: coarser ones stand in. slf verify says more.`);
}

const kProjections = {
  mip: 'maximum intensity projection',
  minip: 'minimum intensity projection',
  mean: 'mean intensity projection',
};

function showFacts() {
  const m = field.manifest, p = m.provenance ?? {}, list = byId('facts-list');
  const fine = m.levels, name = (path) => String(path).split('/').pop();
  const facts = {
    Source: p.source ? name(p.source) : p.name,
    Kind: p.kind,
    Voxels: p.dims?.join(' × '),
    Colours: p.transfer?.[0]?.Name,
    Shows: kProjections[p.projection],
    Lattice: `${m.entry_side << fine} entry, ${m.exit_side << fine} exit`,
    Levels: m.levels + 1,
    Samples: `${m.format} (${m.codec})`,
    Sphere: `radius ${Number(m.sphere.radius.toPrecision(4))}`,
    File: human(source.size),
  };
  list.replaceChildren(...Object.entries(facts).filter(([, v]) => v !== undefined)
    .flatMap(([k, v]) => {
      const term = document.createElement('dt'), fact = document.createElement('dd');
      term.textContent = k;
      fact.textContent = String(v);
      return [term, fact];
    }));
  byId('facts').showModal();
}

function actions() {
  const fold = () => {
    const hidden = byId('settings').hidden = !byId('settings').hidden;
    byId('fold').textContent = hidden ? '+' : '–';
    byId('fold').setAttribute('aria-expanded', String(!hidden));
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
    byId('spin').checked = false;
    moved();
  };
  const fill = () => document.fullscreenElement ? document.exitFullscreen()
                                                : document.documentElement.requestFullscreen?.();
  const choose = (id, name) => byId(id).addEventListener('input', ({target}) => {
    settings[name] = target.value;
    changed();
    keepLink();
  });
  kChoices.forEach((name) => choose(name, name));
  byId('fold').onclick = fold;
  byId('spin').onchange = spin;
  byId('marks').onchange = () => { dirty = true; };
  byId('reset').onclick = reset;
  byId('full').onclick = fill;
  byId('about').onclick = showFacts;
  byId('save').onclick = () => canvas.toBlob((blob) => {
    const link = document.createElement('a');
    link.href = URL.createObjectURL(blob);
    link.download = 'view.png';
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  });
  byId('link').onclick = async () => {
    history.replaceState(null, '', fragment());
    try {
      await navigator.clipboard.writeText(location.href);
      say('The link is on the clipboard.');
    } catch {
      say('The address of this page is the link.');
    }
    setTimeout(() => say(''), 2500);
  };
  attach(canvas, camera, moved, {r: reset, f: fill, h: fold, ' ': toggleSpin});
  if (matchMedia('(max-width: 520px)').matches) fold();
}

const kChoices = ['mode', 'level', 'background', 'curve', 'exposure'];
function showChoices() {
  for (const name of kChoices) byId(name).value = settings[name];
}

function fillPanel() {
  const {manifest: m, shape} = field, p = m.provenance ?? {};
  const name = String(p.source ?? p.name ?? 'Sphere light field').split('/').pop();
  byId('name').textContent = document.title = name;
  for (let level = 0; level <= shape.levels; ++level)
    byId('level').append(
      new Option(`${level}: ${m.entry_side << level}/${m.exit_side << level}`, level));
  if (!shape.hasDepth) {
    settings.mode = 'bitri';
    byId('mode').querySelector('[value=depth]').remove();
  }
  if (Number(settings.level) > shape.levels) settings.level = 'auto';
  showChoices();
  byId('tones').hidden = !field.radiance;
  byId('marks').checked = p.kind === 'volume';
  if (shape.levels < m.levels)
    say(`Levels above ${shape.levels} of this field are too fine for the page.`);
}

// ---- start --------------------------------------------------------------------------------------

// Where the field is: inside the page; where ?field=ADDRESS says; or beside the page.
async function findField() {
  if (inside?.size) {
    const pieces = [...document.querySelectorAll('script.piece')].map((s) => s.textContent);
    return embeddedSource(pieces, inside.pieceBytes, inside.size);
  }
  const given = new URLSearchParams(location.search).get('field');
  if (given && !inside)
    throw new Error('slf view shows only its own fields; the page of slf export shows others.');
  let url;
  try {
    url = new URL(given ?? 'field.slf', document.baseURI);
  } catch {
    throw new Error(`?field=${given}: not an address`);
  }
  if (url.protocol === 'file:') return fileSource(await chosenFile());
  return new HttpSource(url, (done, total) => say('This host serves only whole files. Fetched ' +
    human(done) + (total ? ` of ${human(total)}` : '')), fail);
}
// Resolves to a file of this machine that the reader chooses.
function chosenFile() {
  page.state = 'asking';
  byId('choose').hidden = false;
  return new Promise((done) => {
    byId('file').onchange = ({target}) => {
      byId('choose').hidden = true;
      done(target.files[0]);
    };
  });
}

const fromBase64 = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
// Resolves to the bytes of the module. From disk and in a sandbox only scripts can be loaded.
async function packedModule() {
  const answer = inside?.module ? undefined : await fetch('module.bin').catch(() => {});
  if (answer?.ok) return answer.arrayBuffer();
  if (inside && !inside.module)
    await new Promise((done) => document.head.append(Object.assign(
      document.createElement('script'), {src: 'module.bin.js', onload: done, onerror: done})));
  if (inside?.module) return fromBase64(inside.module);
  throw new Error('A part of this page cannot be loaded: module.bin.');
}
async function loadModule() {
  for (const name of ['WebAssembly', 'DecompressionStream'])
    if (!globalThis[name])
      throw new Error(`This browser is too old or locked down: it lacks ${name}.`);
  const packed = new Response(await packedModule());
  const bytes = packed.body.pipeThrough(new DecompressionStream('gzip'));
  try {
    return await WebAssembly.compile(await new Response(bytes).arrayBuffer());
  } catch (error) {
    if (!/policy|unsafe|disallowed/i.test(error.message)) throw error;
    throw new Error('The host of this page forbids WebAssembly. Its Content-Security-Policy must ' +
                    "have 'wasm-unsafe-eval' in script-src.");
  }
}

// A worker, and what stands in for one where the host of the page forbids workers.
function makeWorker() {
  if (!inside) return new Worker('worker.js', {type: 'module'});
  return new Worker(URL.createObjectURL(new Blob([`(${inside.worker})(self)`])));
}
function makeStandIn() {
  const port = {postMessage: (data) => setTimeout(() => self.onmessage({data}))};
  const self = {postMessage: (data) => port.onmessage({data})};
  inside.worker(self);
  return port;
}

async function start() {
  say('');
  readFragment();
  const coming = loadModule();
  coming.catch(() => {});  // reported below
  source = await findField();
  source.open().catch(() => {});  // beside the module; opening the field reports it
  const decoders = new Decoders(makeWorker, inside && makeStandIn);
  renderer = new Renderer(canvas);
  field = new Field(source, await coming);
  await field.open();
  say('');
  decoders.open(field);
  resize();
  renderer.open(field.shape, kTileBytes);
  fillPanel();
  loader = new Loader(field, renderer, decoders, () => { dirty = true; }, fail);
  canvas.addEventListener('webglcontextlost', (event) => {
    event.preventDefault();
    lost = true;
    say('The graphics card was reset; waiting for it.');
  });
  canvas.addEventListener('webglcontextrestored', () => {
    renderer = new Renderer(canvas);
    renderer.open(field.shape, kTileBytes);
    loader.restart(renderer);
    renderer.ready.then(() => {
      lost = false;
      say('');
      changed();
    }).catch(fail);
  });
  new ResizeObserver(resize).observe(canvas);
  addEventListener('hashchange', () => {
    readFragment();
    showChoices();
    changed();
  });
  actions();
  page.state = 'loading';
  requestAnimationFrame(frame);
  follow().catch(fail);
}

start().catch(fail);
