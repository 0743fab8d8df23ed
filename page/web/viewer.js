// Viewer: shows a field on a canvas.
//
// Two loops run: drawing, which never waits for tiles, and following, which asks the GPU for the
// tiles of the view and has them loaded.

import {Camera} from './camera.js';
import {kNearer} from './controls.js';
import {Cut, planesOf} from './cut.js';
import {Field} from './field.js';
import {Loader} from './loader.js';
import {calm, media, sleep} from './media.js';
import {Renderer} from './renderer.js';
import {layersOf, looksOf} from './structures.js';

const kTileBytes = 192 << 20;  // of textures
const kFrame = 40;             // milliseconds: slower frames of a moving camera have fewer pixels,
const kMinScale = 0.2;         // but at least this share along each edge;
const kStill = 250;            // the same for levels that others will replace
const kWorth = 1.25;           // more pixels or fewer: so many times along each edge
const kFade = 3;               // frames until a finer picture has replaced a coarser one
const kRise = 4;               // levels a second that a part of a moving picture gets finer by
const kLook = 250;             // milliseconds between looks at whether a level is complete
const kPasses = 8;             // of rays that ask for tiles, at most, before these are requested
const kAhead = 0.4;            // seconds that loading looks ahead of a moving camera
const kSmall = 1 << 20;        // bytes: a level 0 of at most this size is loaded whole,
const kTiny = 128 << 10;       // and of at most this size first of all
const kMaxSmall = 4096;        // tiles of level 0 that may be loaded whole
const kFlight = 1200;          // milliseconds that the camera takes from one view to another

export class Viewer {
  // All work ends when `signal` is aborted. `on` is the <slf-field>, with its habits, and functions:
  // shown() after each picture, moved(), settled(), lost(), say(text), failed(error). `state`:
  //
  //   opening ── begin() ──> loading <──────> settled       asking: for a file, while opening
  //     ^                       └──> lost <──────┘          failed: for good; `message` says why
  //     └─ another graphics context ──┘                     disposed: at the end
  constructor(canvas, camera, settings, signal, on) {
    Object.assign(this, {canvas, camera, settings, signal, on});
    this.state = 'opening';
    signal.addEventListener('abort', () => this.dispose());
    this.version = 0;        // counts changes of the view
    this.movedAt = -1e9;
    this.touchedAt = performance.now();
    this.ceiling = 99;
    this.reached = -1;       // the finest level of the view that was shown
    this.fading = 0;         // frames until the canvas shows what was drawn beside it
    this.rate = 0;           // frames a second
    this.seen = true;        // whether the canvas is in sight
    // first, complete: traffic() until the first picture, and until the first complete one
    // stuck: the view and the tiles with which level 0 was incomplete, if it is
    // again: whether the view is loaded again, as before
    // stale: an object while the canvas shows another state, other structures, or nothing; each
    //   such change has its own
    // maskOf: the view that the renderer's mask is of
  }

  // What came from the host since the page began, and the milliseconds since then.
  traffic() {
    const {bytes, requests, roundTrips} = this.source ?? {};
    return {bytes, requests, roundTrips, milliseconds: performance.now()};
  }
  statistics() {
    const {first, complete, loader, renderer} = this;
    return {...this.traffic(), first, complete, busy: loader?.busy ?? true,
            tiles: loader?.tiles ?? 0, slots: renderer?.slots ?? 0,
            tileBytes: renderer?.tileBytes ?? 0, damaged: loader?.damaged ?? 0};
  }

  fail(error) {
    if (this.signal.aborted) return;
    this.source?.store?.clear();
    this.state = 'failed';
    this.message = String(error?.message ?? error);
    this.on.failed(error);
  }
  get draws() { return this.state === 'loading' || this.state === 'settled'; }
  get ended() { return this.state === 'failed' || this.state === 'disposed'; }

  // Shows the field of a source. `module` is a promise of the compiled WebAssembly module.
  // `cutter`: makes the worker of cuts, as Cut has it.
  async open(source, module, decoders, cutter) {
    const {canvas, signal} = this, fail = (error) => this.fail(error);
    this.source = source;
    source.open().catch(() => {});  // beside the module; opening the field reports it
    this.resize();  // a canvas with a context takes long
    this.renderer = new Renderer(canvas);
    const field = this.field = new Field(source, await module);
    await field.open();
    signal.throwIfAborted();
    field.state = field.stateNumber(this.settings.state);
    field.layers = layersOf(looksOf(field, this.settings.structures).looks);
    decoders.open(field);
    this.cut = new Cut(field, cutter, () => this.changed());
    if (field.shape.hasDepth) await this.showCut(this.settings.clip, this.settings.cap);
    this.loader = new Loader(field, decoders, fail);
    // The tiles that matter most come while the graphics card makes room.
    await this.wantFirst();
    // The tiles of the first picture need the whole network.
    Promise.allSettled(source.early?.values() ?? [])
      .then(() => field.prepare(this.view().level)).catch(fail);
    await sleep(4);
    signal.throwIfAborted();
    this.renderer.open(field.shape, kTileBytes);
    this.loader.restart(this.renderer);
    canvas.addEventListener('webglcontextlost', (event) => {
      event.preventDefault();
      if (this.ended) return;
      this.state = 'lost';
      this.stale = {};
      this.changed();
      this.on.lost();
    }, {signal});
    canvas.addEventListener('webglcontextrestored', () => {
      if (this.ended) return;
      this.renderer = new Renderer(canvas);
      this.renderer.open(field.shape, kTileBytes);
      this.cut.upload();
      this.loader.restart(this.renderer);
      this.wantFirst().then(() => {
        if (this.state !== 'lost') return;
        this.state = 'opening';
        this.on.say('');
      }).catch(fail);
    }, {signal});
    this.sizes = new ResizeObserver(() => {  // paper shows the picture that is there
      if (!media('print').matches) this.resize();
    });
    this.sizes.observe(canvas);
    requestAnimationFrame((now) => this.frame(now));
    this.follow().catch(fail);
  }

  // Has the tiles of level 0 loaded that the view needs first.
  async wantFirst() {
    const {camera, canvas, field} = this;
    let first = await this.allOfLevel0(kTiny);
    if (first.length === 0) first = await field.early(this.pagesOfLevel0());
    if (first.length === 0) first = field.firstTiles(camera, canvas.width, canvas.height);
    this.loader.want(first, true);
  }

  // ---- the view ---------------------------------------------------------------------------------

  // The coarsest level that is as fine as the pixels at the sphere's centre (--level auto).
  matchingLevel() {
    const {camera, canvas, settings} = this, {calls} = this.field.native;
    const {half, eye} = camera.axes(canvas.width, canvas.height);
    return calls.slf_matching_level(2 * half / canvas.height * Math.hypot(...eye),
                                    settings.mode === 'depth');
  }
  view() {
    const {camera, field, settings, version} = this;
    const chosen = settings.level === 'auto' ? this.matchingLevel() : Number(settings.level);
    const background =
      [1, 3, 5].map((i) => parseInt(settings.background.slice(i, i + 2), 16) / 255);
    const level = Math.min(chosen, this.ceiling, field.shape.levels);
    const cut = this.cut?.active ? this.cut.uniforms(this.renderer) : undefined;
    return {camera, mode: cut ? 'depth' : settings.mode, cut, background,
            exposure: Number(settings.exposure),
            curve: field.radiance ? settings.curve : 'none', level, stamp: `${version} ${level}`};
  }

  changed() {
    ++this.version;
    this.ceiling = 99;
    this.fading = 0;
    if (this.state === 'settled') this.state = 'loading';
  }
  moved() {
    this.movedAt = performance.now();
    this.changed();
    this.on.moved();
  }
  moves(now) { return now - this.movedAt < 200; }

  // Shows what planes leave, and a cap on the faces: texts, as Cut has them. Until that can be
  // drawn, the canvas keeps the picture.
  async showCut(clip, cap = '') {
    const planes = planesOf(clip), wanted = this.wanted = {}, opens = this.state === 'opening';
    if (planes.length > 0 && cap !== 'hollow') await this.cut.load();
    if (planes.length > 0 && !opens) await this.renderer.cuts;
    if (this.wanted !== wanted || this.ended) return;  // others by now
    Object.assign(this.cut, {planes, cap});
    if (!opens) this.moved();
  }
  // Shows another state of the field. Until its level 0 is there, the canvas keeps the picture.
  showState(state) {
    if (state === this.field.state) return;
    this.field.state = state;
    if (this.cut.active) this.cut.load().then(() => this.changed());
    this.reload();
    this.moved();
  }
  // The same for structures, by their looks.
  showStructures(looks) {
    const layers = layersOf(looks);
    if (JSON.stringify(layers) === JSON.stringify(this.field.layers)) return;
    this.field.layers = layers;
    this.again = true;
    this.reload();
    this.changed();
  }
  reload() {
    this.loader.show();
    this.stale = {};
    this.stuck = undefined;
    this.reached = -1;
  }

  // Turns the camera to another place, given as Camera.toText() says, in an eased flight.
  flyTo(text) {
    const {camera} = this, from = new Camera(camera.toText()), to = new Camera(camera.toText());
    to.fromText(text);
    camera.rest();
    this.halt();
    this.flight = {from, to, begin: performance.now() - (calm.matches ? kFlight : 0)};
    return new Promise((done) => { this.flight.done = done; });
  }
  // Flies nearer to what is shown at a place, about which the camera turns from then on.
  approach(x, y) {
    const [found] = this.probe([[x, y]]), to = new Camera(this.camera.toText()), {on} = this;
    if (on.disableZoom) return;
    to.obey(on);
    if (found && !on.disablePan) Object.assign(to, {target: found.point, distance: found.distance});
    to.zoom(kNearer);
    this.flyTo(to.toText());
  }
  // Ends a flight where it is.
  halt() {
    this.touchedAt = performance.now();
    this.flight?.done();
    this.flight = undefined;
  }
  // Frees all memory, here and on the graphics card.
  dispose() {
    this.state = 'disposed';
    this.halt();
    this.sizes?.disconnect();
    this.renderer?.gl.getExtension('WEBGL_lose_context')?.loseContext();
    this.source = this.field = this.loader = this.renderer = undefined;
  }
  fly(now) {
    const {from, to, begin} = this.flight;
    const t = Math.min(1, Math.max(0, now - begin) / kFlight);
    this.camera.between(from, to, t * t * (3 - 2 * t));
    this.moved();
    if (t === 1) this.halt();
  }

  resize() {
    const {canvas} = this, ratio = globalThis.devicePixelRatio || 1;
    const width = Math.max(1, Math.round(canvas.clientWidth * ratio));
    const height = Math.max(1, Math.round(canvas.clientHeight * ratio));
    if (canvas.width === width && canvas.height === height) return;
    canvas.width = width;
    canvas.height = height;
    this.moved();
  }

  // Where a point, in radii from the sphere's centre, appears on the canvas, in CSS pixels, and how
  // far it is: along the axis of the view (`far`), and from the eye.
  project(point) {
    return this.camera.project(point, this.canvas.clientWidth, this.canvas.clientHeight);
  }
  // What the picture shows at places on the canvas, in CSS pixels: points of the surface, in radii
  // from the sphere's centre, with their distance from the eye, or undefined.
  probe(places) {
    const {canvas} = this, ratio = canvas.width / canvas.clientWidth;
    return this.renderer.probe(this.view(), places.map(([x, y]) => [x * ratio, y * ratio]));
  }
  // Resolves to the name of the structure that is first at a result of probe().
  async structureAt({point}) {
    const {field, camera, loader} = this, {layers, structures, shape} = field, {level} = this.view();
    if (structures.length === 0) return '';
    const {page, number} = field.sampleAt(level, camera.axes(1, 1).eye, point);
    const tiles = await Promise.all(loader.reader.read(field.inFile([page])));
    const opaque = ({color}) =>  // half floats from 0.5 on have this high byte
      shape.half ? color?.[8 * number + 7] >= 0x38 : color?.[4 * number + 3] >= 128;
    const depths = tiles.map((tile) => opaque(tile) ? tile.depth[number] : Infinity);
    const first = Math.min(...depths);
    return first < Infinity ? structures[layers[depths.indexOf(first)].state] : '';
  }
  // As slf pick: {point, depth, uncertainty} in world units, or null where nothing opaque is shown.
  pick(x, y) {
    const {canvas, camera, field} = this, {center, radius} = field.manifest.sphere, {shape} = field;
    if (!shape.hasDepth) return null;
    const {half, eye} = camera.axes(canvas.clientWidth, canvas.clientHeight);
    const spacing = Math.PI / 4 / (shape.exitSide << shape.levels);
    const step = spacing / Math.max(1, Math.hypot(...eye)) / (2 * half / canvas.clientHeight);
    const around = [-1, 0, 1].flatMap((v) => [-1, 0, 1].map((u) => [x + u * step, y + v * step]));
    const found = this.probe(around), middle = found[4];
    if (!middle) return null;
    const hits = found.filter((hit) => hit);
    const squares = hits.reduce((sum, hit) => sum + (hit.distance - middle.distance) ** 2, 0);
    return {point: middle.point.map((v, i) => center[i] + radius * v),
            depth: radius * middle.distance,
            uncertainty: radius * Math.sqrt((2 / 255) ** 2 / 12 + squares / hits.length)};
  }

  // ---- drawing ----------------------------------------------------------------------------------

  frame(now) {
    if (this.ended) return;
    requestAnimationFrame((next) => this.frame(next));
    const elapsed = Math.min(now - (this.before ?? now), 200);
    this.before = now;
    if (!this.draws) return;
    if (this.flight) this.fly(now);
    if (!this.seen) return;
    const idle = this.complete && this.on.autoRotate && !calm.matches && !this.on.explain.tours &&
      now - this.touchedAt > this.on.autoRotateDelay;
    if (!this.flight && this.camera.advance(elapsed / 1000, idle ? this.on.rotationPerSecond : 0))
      this.moved();
    if (now - (this.rateFrom ?? 0) > 500) {
      this.rate = this.moves(now) ? this.frames * 1000 / (now - this.rateFrom) : 0;
      this.frames = 0;
      this.rateFrom = now;
    }
    if (this.drawing) return;
    if (this.fading > 0) {
      this.put(1 / this.fading--);
    } else if (this.first && this.moves(now)) {
      this.draw(elapsed / 1000).catch((error) => this.fail(error));
    }
  }

  // Draws a frame of a moving camera. While level 0 lacks tiles, the canvas keeps the last frame.
  async draw(seconds) {
    const view = this.view(), state = `${this.version} ${this.loader.arrivals}`;
    if (state === this.stuck) return;
    const again = this.maskOf === this.version;
    this.stuck = this.renderer.showMoving(view, kRise * seconds, again) ? undefined : state;
    if (this.stuck) return;
    this.maskOf = this.version;
    const {stale} = this, current = () => this.draws && this.stale === stale;
    let done = await this.quickly(view, kFrame);
    if (stale && !done && current()) {  // some pixels would show another state
      this.renderer.show(0, []);
      done = await this.quickly(view, kFrame);
    }
    if (stale && !done) this.stuck = state;
    else if (current()) this.put(1);
    ++this.frames;
  }

  // Draws a picture, which has fewer pixels where it would take longer. Other pixels lie elsewhere,
  // which may look worse for a moment: so their number changes only where that is worth it, and
  // grows for a view that is shown only once it rests. Resolves to whether no pixel lacks a tile.
  quickly(view, milliseconds) {
    const {canvas, renderer, version} = this, time = renderer.cost * canvas.width * canvas.height;
    const {scale: before = 0, version: last} = this.scaled ?? {};
    const fits = Math.sqrt(milliseconds / (time || 4 * milliseconds));
    const keeps = last === version ? milliseconds === kFrame || fits < kWorth * before
      : fits < kWorth * before && kWorth * fits > before;
    const scale = keeps ? before : Math.min(1, Math.max(kMinScale, fits));
    this.scaled = {version, scale};
    return this.drawn(renderer.draw({...view, stamp: undefined}, scale));
  }
  // Waits for what is being drawn. Nothing else may be drawn meanwhile.
  drawn(work) {
    this.drawing = true;
    return work.finally(() => { this.drawing = false; });
  }

  // Draws the pixels of the view that are not final, in full resolution, beside what is shown.
  // Resolves to the pages that they still need; to undefined if the view changes meanwhile.
  async sharpen(view) {
    const asked = this.version, {renderer} = this;
    if (!await this.idle(asked)) return undefined;
    const drawn = await this.drawn(renderer.sharpen(view, () => this.version === asked));
    const pages = drawn && await renderer.askAll(view);
    return this.current(asked) && !renderer.gl.isContextLost() ? pages : undefined;
  }
  current(asked) { return this.version === asked && this.draws; }
  // Waits for the picture that is being drawn or faded in: the next one is drawn in its place.
  // Resolves to whether the view is the same.
  async idle(asked) {
    while ((this.drawing || this.fading > 0) && this.current(asked)) await sleep(2);
    return this.current(asked);
  }

  // Fades in the picture that was drawn; at once, if two states would be mixed.
  show() {
    this.fading = calm.matches || !this.first || this.stale ? 0 : kFade;
    if (this.fading === 0) this.put(1);
  }
  put(opacity) {
    this.renderer.fade(opacity);
    this.first ??= this.traffic();
    this.stale = undefined;
    if (this.fading === 0) this.on.shown();
  }

  // Shows a level that another one will replace, if no pixel lacks a tile of it.
  async showCoarse(view, level) {
    const asked = this.version;
    if (!await this.idle(asked)) return false;
    this.renderer.show(level, this.maskOf === this.version ? undefined : []);
    this.maskOf = this.version;
    const done = await this.quickly({...view, level}, kStill) && this.current(asked);
    if (done) this.show();
    return done;
  }

  // ---- following --------------------------------------------------------------------------------

  // Begins to draw, with level 0, at first and on another graphics context. Resolves to the view's
  // stamp.
  async begin() {
    const {loader, renderer} = this;
    while (loader.busy && this.state === 'opening') await sleep(5);
    await renderer.ready;
    if (this.cut.active) await renderer.cuts;
    if (this.state !== 'opening' || renderer !== this.renderer) return undefined;
    this.state = 'loading';
    const view = this.view();
    this.reached = await this.showCoarse(view, 0) ? 0 : -1;
    await renderer.asks;
    return view.stamp;
  }

  // Finds the tiles of the view and has them loaded, again and again. While the camera stands
  // still, a level is shown once it is complete: nobody sees a tile.
  async follow() {
    const {loader, field} = this;
    let needed = new Set(), thorough = false, seen;
    while (!this.ended) {
      if (this.state === 'opening') seen = await this.begin();
      if (!this.draws || !this.seen) {
        seen = undefined;
        await sleep(50);
        continue;
      }
      const view = this.view(), asked = this.version;
      const moving = this.first && this.moves(performance.now());
      // Other structures need nearly the same tiles.
      const again = this.again && needed.size > 0 && !moving;
      this.again = false;
      if (view.stamp !== seen) {
        seen = view.stamp;
        if (!again) needed = new Set();
        thorough = false;
        this.reached = -1;
      }
      // A few rays find nearly all tiles. Once these are there, the rays of all pixels that are not
      // final find the last ones.
      const [pages] = await Promise.all(
        [again ? [] : thorough ? this.sharpen(view) : this.askFew(view, moving),
         field.prepare(view.level)]);
      if (!this.draws || !pages) continue;
      if (thorough && pages.size === 0) {
        await this.settle(view, needed);
        continue;
      }
      for (const at of pages) needed.add(at);
      const absent = loader.want([...needed], !moving);
      this.state = 'loading';
      if (loader.full) {  // not all tiles of this level fit: draw a coarser one
        loader.full = false;
        this.ceiling = Math.max(0, view.level - 1);
      } else if (moving) {
        if (absent === 0) await this.lookAhead(view, needed);
        await sleep(absent > 0 ? 15 : 0);
      } else {
        await this.arrived(view, !thorough);
        thorough = true;
        for (let level = view.level; again && level >= 0 && this.stale && this.current(asked);)
          await this.showCoarse(view, level--);
      }
    }
  }
  // Shows the picture that was drawn, of all tiles that the view needs, until the view changes.
  async settle(view, needed) {
    const asked = this.version, current = () => this.current(asked);
    this.renderer.show(view.level, []);
    this.complete ??= this.traffic();
    this.show();
    this.loader.want([...needed, ...await this.allOfLevel0(kSmall)]);
    if (!await this.idle(asked)) return;
    this.state = 'settled';
    this.on.settled();
    const {camera, canvas: {width, height}} = this;
    this.cut.lightUp({camera, width, height}, current)
      .catch((error) => this.on.say(this.on.told(error)));
    while (current()) await sleep(20);
  }
  // The pages that some rays need, of the view's level and of those that are shown before it. Asks
  // with more rays while the lists of references come.
  async askFew(view, moving) {
    const pages = new Set(), asked = this.version;
    let waits = !moving, passes = 0;
    this.field.prepare(view.level).finally(() => { waits = false; }).catch(() => {});
    do {
      for (let level = moving && !this.stuck ? view.level : 0; level <= view.level; ++level) {
        for (const page of await this.renderer.ask({...view, level})) pages.add(page);
        // Nothing is shown before level 0 is complete.
        if (level > 0 || this.reached >= 0 || moving) continue;
        if (await this.showCoarse(view, 0)) this.reached = 0;
        else this.loader.want([...pages], true);
      }
    } while (waits && ++passes < kPasses && this.current(asked));
    return pages;
  }

  // Waits until all tiles that are on their way have come, or the view changes. Meanwhile, if
  // `many` tiles are on their way, shows coarser levels, each once it is complete.
  async arrived(view, many) {
    const asked = this.version;
    for (let next = 0, seen = -1; this.loader.busy && this.current(asked);) {
      await sleep(5);
      const begin = performance.now(), {arrivals} = this.loader;
      if (!many || begin < next || this.drawing || arrivals === seen) continue;
      seen = arrivals;
      const reach = Math.min(view.level - 1, ...this.renderer.survey(view));
      if (reach > this.reached && await this.showCoarse(view, reach)) this.reached = reach;
      const now = performance.now();
      next = this.first ? now + Math.max(kLook, now - begin) : now;
    }
  }

  // Loads what the view will need soon.
  async lookAhead(view, needed) {
    const ahead = Object.assign(new Camera(), structuredClone({...this.camera}));
    ahead.advance(kAhead);
    const pages = await this.renderer.ask({...view, camera: ahead, stamp: undefined});
    if (this.draws) this.loader.want([...needed, ...pages]);
  }

  // The pages of level 0, if they are few.
  pagesOfLevel0() {
    const {pageBase, pages} = this.field.shape, count = pageBase[1] || pages;
    return count <= kMaxSmall ? [...Array(count).keys()] : [];
  }
  // Resolves to the pages of level 0 if these have at most so many bytes: then a camera that turns
  // always has something to draw, and many tiles are predicted from it.
  async allOfLevel0(most) {
    const all = this.pagesOfLevel0(), inFile = this.field.inFile(all);
    return inFile.length <= kMaxSmall && await this.field.payloadBytes(inFile) <= most ? all : [];
  }
}
