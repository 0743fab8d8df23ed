// Renderer: the state on the GPU. It has the textures of decoded tiles and the page table, draws
// views, and runs the passes that find out which tiles a view needs. After the graphics context is
// lost, a new Renderer can replace it.

import {add} from './camera.js';
import {kCutTextures} from './march.js';
import {drawShader, feedbackShader, kCurves, kFade, kVertex} from './shader.js';
import {kMaskScale, kTableBits, kTasks} from './shader.js';
import {Told} from './text.js';

const kUnits = ['uTables', 'uPages', 'uColor', 'uDepth', 'uKept', 'uPicture', 'uMask',
                ...kCutTextures];  // of textures
const kTableWidth = 1 << kTableBits;
const kFeedbackSize = 512;  // rays along an edge of a pass that finds the tiles of a view, at most
const kFewRays = 128;       // the same for a quick pass, which finds nearly all of them
const kCells = 64;          // across the picture, that may show different levels
const kSlope = 1 / 6;       // of a level: the most that two adjacent cells differ by
const kStrip = 60;          // milliseconds that drawing a strip may take

function program(gl, fragment) {
  const result = gl.createProgram();
  for (const [type, text] of [[gl.VERTEX_SHADER, kVertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(type);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(result, shader);
  }
  gl.linkProgram(result);
  const places = {};
  const at = (name) => places[name] ??= gl.getUniformLocation(result, name);
  return {result, at, checked: false};
}
// Resolves when a program is compiled, without blocking the page where the browser can say so.
// Throws what is wrong with it.
async function compiled(gl, program_) {
  if (program_.checked) return;
  const {result} = program_, parallel = gl.getExtension('KHR_parallel_shader_compile');
  while (parallel && !gl.isContextLost() &&
         !gl.getProgramParameter(result, parallel.COMPLETION_STATUS_KHR))
    await new Promise((done) => setTimeout(done, 8));
  if (!gl.getProgramParameter(result, gl.LINK_STATUS) && !gl.isContextLost())
    throw new Error('WebGL: ' + gl.getAttachedShaders(result).map((s) => gl.getShaderInfoLog(s))
      .join(' ') + gl.getProgramInfoLog(result));
  program_.checked = true;
}

export class Renderer {
  // Begins to compile the shaders.
  constructor(canvas) {
    const gl = canvas.getContext('webgl2', {alpha: false, antialias: false, depth: false,
                                            preserveDrawingBuffer: true,
                                            powerPreference: 'high-performance'});
    if (!gl) throw new Told('noWebGl');
    this.gl = gl;
    this.canvas = canvas;
    this.drawProgram = program(gl, drawShader(false));
    this.fadeProgram = program(gl, kFade);
    this.feedbackProgram = program(gl, feedbackShader(false));
    this.pass = 0;
    this.cost = 0;         // milliseconds a pixel, as the last picture took them; 0: not known
    this.kept = undefined; // of which view the final pixels are kept: its stamp
    this.mask = undefined; // the level that each cell shows
    this.cutTextures = {};
    this.makeTargets();
  }
  // Draws a pixel with a program: some drivers finish their work on it only then, for the textures
  // that it has.
  async warm(program_, bind) {
    const {gl} = this;
    await compiled(gl, program_);
    bind();
    gl.viewport(0, 0, 1, 1);
    gl.useProgram(program_.result);
    this.setSamplers(program_);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.flush();  // or else the work waits until there is more
  }
  setSamplers({at}) {
    kUnits.forEach((name, i) => this.gl.uniform1i(at(name), i));
  }
  bindFeedback() { this.gl.bindFramebuffer(this.gl.FRAMEBUFFER, this.feedbackTarget); }
  // `shape`: of the field, as Field.shape; `budget`: bytes of textures for tiles. `ready` resolves
  // when pictures can be drawn at once.
  open(shape, budget) {
    this.shape = shape;
    this.makeTiles(budget);
    this.makeTables();
    this.ready = this.warm(this.drawProgram, () => this.bindPicture())
      .then(() => compiled(this.gl, this.fadeProgram));
  }
  // Resolves when views through planes can be drawn: with programs of their own, made when needed.
  get cuts() {
    const {gl} = this;
    this.cutPrograms ??=
      {draw: program(gl, drawShader(true)), feedback: program(gl, feedbackShader(true))};
    const {draw, feedback} = this.cutPrograms;
    return this.cutsReady ??= this.warm(draw, () => this.bindPicture())
      .then(() => this.warm(feedback, () => this.bindFeedback()));
  }
  drawing({cut}) { return cut ? this.cutPrograms.draw : this.drawProgram; }
  asking({cut}) { return cut ? this.cutPrograms.feedback : this.feedbackProgram; }
  // Uploads textures that such views march through, by their names in the shader:
  // {dims, data, smooth}; half floats have four channels, as have floats.
  setCutTextures(textures) {
    const {gl} = this, target = gl.TEXTURE_3D;
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    for (const [name, {dims, data, smooth}] of Object.entries(textures)) {
      gl.deleteTexture(this.cutTextures[name]);
      const [storage, channels, type] = data instanceof Uint8Array
        ? [gl.R8, gl.RED, gl.UNSIGNED_BYTE] : data instanceof Uint16Array
        ? [gl.RGBA16F, gl.RGBA, gl.HALF_FLOAT] : [gl.RGBA32F, gl.RGBA, gl.FLOAT];
      this.cutTextures[name] = this.texture(kUnits.indexOf(name), target, storage, ...dims,
                                            smooth ? gl.LINEAR : gl.NEAREST);
      gl.texSubImage3D(target, 0, 0, 0, 0, ...dims, channels, type, data);
    }
  }

  // Resolves when rays can ask for tiles. Called after the first picture, which would wait for it.
  get asks() {
    return this.warmed ??= this.warm(this.feedbackProgram, () => this.bindFeedback());
  }

  texture(unit, target, format, width, height, layers, filter = this.gl.NEAREST) {
    const gl = this.gl, texture = gl.createTexture();
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(target, texture);
    if (layers) gl.texStorage3D(target, 1, format, width, height, layers);
    else gl.texStorage2D(target, 1, format, width, height);
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER])
      gl.texParameteri(target, name, filter);
    for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T, gl.TEXTURE_WRAP_R])
      gl.texParameteri(target, name, gl.CLAMP_TO_EDGE);
    return texture;
  }

  // A tile takes 2^bits × height texels of a texture layer. A layer holds one or more tiles.
  makeTiles(budget) {
    const gl = this.gl, {columns, maxRows, half, hasDepth} = this.shape;
    const samples = columns * maxRows;
    this.bits = Math.ceil(Math.log2(Math.sqrt(samples)));
    const width = 1 << this.bits, height = Math.ceil(samples / width);
    const maxSize = gl.getParameter(gl.MAX_TEXTURE_SIZE);
    if (width > maxSize || height > maxSize)
      throw new Told('largeTiles');
    const bytes = width * height * ((half ? 8 : 4) + (hasDepth ? 1 : 0));
    const layers = gl.getParameter(gl.MAX_ARRAY_TEXTURE_LAYERS);
    const tiles = Math.min(Math.max(64, Math.floor(budget / bytes)), 0x7000);
    this.tilesPerLayer =
      Math.max(1, Math.min(Math.ceil(tiles / layers), Math.floor(maxSize / height)));
    this.slots = Math.min(tiles, layers * this.tilesPerLayer);
    this.tileWidth = width;
    this.tileHeight = height;
    this.tileBytes = bytes;
    const depthLayers = Math.ceil(this.slots / this.tilesPerLayer);
    this.texture(2, gl.TEXTURE_2D_ARRAY, half ? gl.RGBA16F : gl.RGBA8, width,
                 height * this.tilesPerLayer, depthLayers);
    this.texture(3, gl.TEXTURE_2D_ARRAY, gl.R8, hasDepth ? width : 1,
                 hasDepth ? height * this.tilesPerLayer : 1, hasDepth ? depthLayers : 1);
  }

  // Uploads the tables of the geometry, rows and sections, and an empty page table.
  makeTables() {
    const gl = this.gl, {tables, pages} = this.shape;
    const upload = (unit, format, type, data, storage) => {
      const height = Math.max(1, Math.ceil(data.length / kTableWidth));
      const padded = new data.constructor(kTableWidth * height);
      padded.set(data);
      this.texture(unit, gl.TEXTURE_2D, storage, kTableWidth, height);
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, kTableWidth, height, format, type, padded);
    };
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    upload(0, gl.RED_INTEGER, gl.UNSIGNED_INT, tables, gl.R32UI);
    upload(1, gl.RED_INTEGER, gl.UNSIGNED_SHORT, new Uint16Array(pages), gl.R16UI);
  }

  makeTargets() {
    const gl = this.gl;
    this.picture = null;  // where pictures are drawn, and a copy with those pixels that are final
    this.feedbackTarget = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.feedbackTarget);
    for (const i of [0, 1]) {
      const target = this.texture(5, gl.TEXTURE_2D, gl.RGBA32UI, kFeedbackSize, kFeedbackSize);
      gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0 + i, gl.TEXTURE_2D, target, 0);
    }
    gl.drawBuffers([gl.COLOR_ATTACHMENT0, gl.COLOR_ATTACHMENT1]);
    gl.bindTexture(gl.TEXTURE_2D, null);
    this.readBuffers = [0, 1].map(() => {
      const buffer = gl.createBuffer();
      gl.bindBuffer(gl.PIXEL_PACK_BUFFER, buffer);
      gl.bufferData(gl.PIXEL_PACK_BUFFER, kFeedbackSize * kFeedbackSize * 16, gl.STREAM_COPY);
      return buffer;
    });
    gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);
  }

  // Uploads the samples of a tile to a slot. `depth` may be null.
  setTile(slot, color, depth) {
    const gl = this.gl, {half} = this.shape;
    const layer = Math.floor(slot / this.tilesPerLayer);
    const y = slot % this.tilesPerLayer * this.tileHeight;
    const put = (unit, samples, texelBytes, format, type, view) => {
      const texels = samples.byteLength / texelBytes;
      const rows = Math.ceil(texels / this.tileWidth);
      const padded = new Uint8Array(rows * this.tileWidth * texelBytes);
      padded.set(samples);
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, 0, 0, y, layer, this.tileWidth, rows, 1, format, type,
                       view(padded));
    };
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    if (half) put(2, color, 8, gl.RGBA, gl.HALF_FLOAT, (b) => new Uint16Array(b.buffer));
    else put(2, color, 4, gl.RGBA, gl.UNSIGNED_BYTE, (b) => b);
    if (depth) put(3, depth, 1, gl.RED, gl.UNSIGNED_BYTE, (b) => b);
  }

  setPage(page, value) {
    const gl = this.gl;
    gl.activeTexture(gl.TEXTURE1);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, page % kTableWidth, Math.floor(page / kTableWidth), 1, 1,
                     gl.RED_INTEGER, gl.UNSIGNED_SHORT, new Uint16Array([value]));
  }

  use(program_, view, width, height) {
    const gl = this.gl, {shape} = this, {at} = program_;
    const {eye, forward, right, down, half} = view.camera.axes(width, height);
    const pixel = 2 * half / height;
    gl.useProgram(program_.result);
    gl.uniform3fv(at('uEye'), eye);
    gl.uniform3fv(at('uForward'), forward);
    gl.uniform3fv(at('uRight'), right.map((v) => v * pixel));
    gl.uniform3fv(at('uDown'), down.map((v) => v * pixel));
    gl.uniform2f(at('uSize'), width, height);
    const integers = {
      uLevel: view.level, uMode: view.mode === 'depth', uEntrySide: shape.entrySide,
      uExitSide: shape.exitSide, uRowBits: shape.rowBits, uTileBits: this.bits,
      uTileHeight: this.tileHeight, uTilesPerLayer: this.tilesPerLayer, uKeeps: this.keeps(view)};
    for (const [name, value] of Object.entries(integers)) gl.uniform1i(at(name), value);
    for (const [name, kind, ...values] of view.cut ?? [])
      gl[`uniform${kind}`](at(name), ...values);
    gl.uniform1iv(at('uRowBase'), shape.rowBase);
    gl.uniform1iv(at('uPathBase'), shape.pathBase);
    gl.uniform1iv(at('uPageBase'), shape.pageBase);
    this.setSamplers(program_);
  }
  // Whether the final pixels of a view are kept.
  keeps({stamp}) { return stamp !== undefined && stamp === this.kept; }

  // Without `shown`, the mask tells what level each cell shows.
  useToDraw(view, shown = -1) {
    const gl = this.gl, {width, height} = this.canvas, {at} = this.drawing(view);
    this.bindPicture();
    this.use(this.drawing(view), view, width, height);
    const [across, down] = this.grid(kCells);
    gl.uniform2f(at('uCells'), width / across / this.picture.columns,
                 height / down / this.picture.rows);
    gl.uniform1f(at('uShown'), shown);
    gl.uniform3fv(at('uBackground'), view.background);
    gl.uniform1i(at('uCurve'), kCurves.indexOf(view.curve));
    gl.uniform1f(at('uGain'), 2 ** view.exposure);
  }

  // Sets the level that each cell of the picture shows. Between two integers both levels are
  // blended. Without a list, all cells show at least `level`.
  show(level, levels) {
    const gl = this.gl;
    this.bindPicture();
    const {columns, rows} = this.picture;
    levels ??= this.mask ?? [];
    this.mask = Float32Array.from({length: columns * rows},
                                  (_, i) => Math.max(level, levels[i] ?? 0));
    gl.activeTexture(gl.TEXTURE6);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, columns, rows, gl.RED, gl.UNSIGNED_BYTE,
                     Uint8Array.from(this.mask, (v) => Math.round(v * 255 / kMaskScale)));
  }
  // The finest level that has all tiles for a ray of each cell, from -1, as far as `level`.
  survey(view) {
    const gl = this.gl;
    const [w, h] = this.cast({...view, stamp: undefined}, kCells, this.pass++, 'survey');
    const words = new Uint32Array(w * h * 4);
    gl.readBuffer(gl.COLOR_ATTACHMENT0);
    gl.readPixels(0, 0, w, h, gl.RGBA_INTEGER, gl.UNSIGNED_INT, words);
    return Float32Array.from({length: w * h}, (_, i) => words[4 * i + 3] - 1);
  }
  // Lets the cells of a moving picture show what survey() found, without steps between cells. No
  // cell rises by more than `rise` levels, nor falls where this view was shown before (`again`).
  // Returns false if level 0 is incomplete.
  showMoving(view, rise, again) {
    this.bindPicture();
    const found = this.survey(view), before = this.mask ?? [];
    if (found.some((level) => level < 0)) return false;
    const {columns} = this.picture;
    const levels = found.map((v) => v < view.level ? v - kSlope : v);
    const limit = (at, by) => { levels[at] = Math.min(levels[at], levels[by] + kSlope); };
    const each = (at, step) => {
      if (step < 0 ? at % columns : (at + 1) % columns) limit(at, at + step);
      const beside = at + step * columns;
      if (beside >= 0 && beside < levels.length) limit(at, beside);
    };
    for (let at = 0; at < levels.length; ++at) each(at, -1);
    for (let at = levels.length - 1; at >= 0; --at) each(at, 1);
    const least = again ? before : [];
    this.show(0, levels.map(
      (v, i) => Math.max(least[i] ?? -Infinity, Math.min(v, (before[i] ?? v) + rise))));
    return true;
  }

  // Draws a picture for fade(). `scale` <= 1: with so many pixels along each edge. Resolves to
  // whether all its pixels are final.
  async draw(view, scale) {
    const gl = this.gl, {width, height} = this.canvas;
    const w = Math.max(1, Math.round(width * scale)), h = Math.max(1, Math.round(height * scale));
    this.useToDraw(view);
    gl.viewport(0, 0, w, h);
    gl.uniform2f(this.drawing(view).at('uScale'), width / w, height / h);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    this.drawn = [w, h];
    await this.timed(w * h);
    return this.isFinal();
  }

  // Draws all pixels that are not final, in strips, so that other work for the GPU need not wait
  // long. fade() shows them. Resolves to false if it ended early, once `wanted()` was false.
  async sharpen(view, wanted) {
    const gl = this.gl, {width, height} = this.canvas, again = this.keeps(view);
    if (!again) this.kept = undefined;
    const rows = again || this.cost === 0 ? height
      : Math.max(16, Math.ceil(kStrip / this.cost / width));
    for (let y = 0; y < height; y += rows) {
      this.useToDraw(view, view.level);
      gl.viewport(0, 0, width, height);
      gl.uniform2f(this.drawing(view).at('uScale'), 1, 1);
      gl.enable(gl.SCISSOR_TEST);
      gl.scissor(0, y, width, rows);
      gl.drawArrays(gl.TRIANGLES, 0, 3);
      gl.disable(gl.SCISSOR_TEST);
      if (y + rows >= height) break;
      await this.timed(width * rows);
      if (!wanted() || gl.isContextLost()) return false;
    }
    gl.activeTexture(gl.TEXTURE4);
    gl.copyTexSubImage2D(gl.TEXTURE_2D, 0, 0, 0, 0, 0, width, height);
    this.kept = view.stamp;
    this.drawn = [width, height];
    await this.done();
    return true;
  }
  // Resolves to whether all pixels of the picture that was drawn are final.
  async isFinal() {
    const gl = this.gl, query = gl.createQuery();
    gl.colorMask(false, false, false, false);
    gl.beginQuery(gl.ANY_SAMPLES_PASSED, query);
    this.useFade(this.drawn, true);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.endQuery(gl.ANY_SAMPLES_PASSED);
    gl.colorMask(true, true, true, true);
    do await this.done();
    while (!gl.getQueryParameter(query, gl.QUERY_RESULT_AVAILABLE) && !gl.isContextLost());
    const lacking = gl.getQueryParameter(query, gl.QUERY_RESULT);
    gl.deleteQuery(query);
    return !lacking && !gl.isContextLost();
  }

  // Shows the picture that was drawn, over what the canvas shows.
  fade(opacity) {
    const gl = this.gl;
    this.useFade([this.canvas.width, this.canvas.height], false);
    gl.enable(gl.BLEND);
    gl.blendColor(0, 0, 0, opacity);
    gl.blendFunc(gl.CONSTANT_ALPHA, gl.ONE_MINUS_CONSTANT_ALPHA);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.disable(gl.BLEND);
  }

  useFade(size, seeks) {
    const gl = this.gl, {at, result} = this.fadeProgram;
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, ...size);
    gl.useProgram(result);
    this.setSamplers(this.fadeProgram);
    gl.uniform2fv(at('uSize'), size);
    gl.uniform2fv(at('uDrawn'), this.drawn);
    gl.uniform1i(at('uSeeks'), seeks ? 1 : 0);
  }

  // Binds the framebuffer that pictures are drawn to.
  bindPicture() {
    const gl = this.gl, {width, height} = this.canvas;
    if (this.picture?.width !== width || this.picture?.height !== height) {
      this.kept = undefined;
      for (const texture of this.picture?.textures ?? []) gl.deleteTexture(texture);
      const framebuffer = this.picture?.framebuffer ?? gl.createFramebuffer();
      const smooth = (unit, format, ...size) =>
        this.texture(unit, gl.TEXTURE_2D, format, ...size, 0, gl.LINEAR);
      const textures = [5, 4].map((unit) => smooth(unit, gl.RGBA8, width, height));
      gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
      gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, textures[0], 0);
      const [across, down] = this.grid(kCells);
      const columns = Math.ceil(width / across), rows = Math.ceil(height / down);
      textures.push(smooth(6, gl.R8, columns, rows));
      this.mask = undefined;
      this.picture = {width, height, textures, framebuffer, columns, rows};
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.picture.framebuffer);
  }
  // Resolves when the GPU has done what it was told so far.
  async done() {
    const {gl} = this, fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    do {
      await new Promise((done) => setTimeout(done, 4));
      if (gl.isContextLost()) return;
    } while (gl.clientWaitSync(fence, 0, 0) === gl.TIMEOUT_EXPIRED);  // it may also fail
    gl.deleteSync(fence);
  }
  async timed(pixels) {
    const begin = performance.now(), {measured = Infinity} = this;
    await this.done();
    this.measured = (performance.now() - begin) / pixels;
    this.cost = Math.min(this.measured, measured);  // one that other work delayed tells nothing
  }

  // Finds the pages that a view needs, with a ray for every pixel that is not final. Resolves to a
  // Set of pages.
  async askAll(view) {
    const pages = new Set();
    const count = this.grid(kFeedbackSize).reduce((a, b) => a * b);
    for (let choice = 0; choice < count && !this.gl.isContextLost(); ++choice)
      for (const page of await this.askRays(view, kFeedbackSize, choice)) pages.add(page);
    return pages;
  }

  // The same with few rays, other ones at each call.
  ask(view) {
    // Successive calls are 5 choices apart, because neighbouring rays need the same tiles. Where 5
    // does not divide the number of choices, the calls use all of them in turn.
    const count = this.grid(kFewRays).reduce((a, b) => a * b), stride = count % 5 === 0 ? 1 : 5;
    return this.askRays(view, kFewRays, this.pass++ * stride % count);
  }

  // What rays through at most kFeedbackSize places, in pixels, meet in the finest level that is
  // loaded: {point, distance} in radii, or undefined where the picture is less than half opaque.
  probe(view, places) {
    const gl = this.gl, {width, height} = this.canvas, {at} = this.asking(view);
    const {eye, forward, right, down, half} = view.camera.axes(width, height);
    const pixel = 2 * half / height, found = new Uint32Array(4 * places.length);
    this.bindFeedback();
    this.use(this.asking(view), {...view, stamp: undefined}, width, height);
    gl.uniform1i(at('uTask'), kTasks.probe);
    gl.uniform2f(at('uStep'), 0, 0);
    places.forEach(([x, y], i) => {
      gl.viewport(i, 0, 1, 1);
      gl.uniform2f(at('uShift'), x - 0.5, height - y - 0.5);
      gl.drawArrays(gl.TRIANGLES, 0, 3);
    });
    gl.readBuffer(gl.COLOR_ATTACHMENT0);
    gl.readPixels(0, 0, places.length, 1, gl.RGBA_INTEGER, gl.UNSIGNED_INT, found);
    const distances = new Float32Array(found.buffer);
    return places.map(([x, y], i) => {
      const distance = distances[4 * i];
      const ray = add(add(forward, right, (x - width / 2) * pixel), down, (y - height / 2) * pixel);
      return distance < 0 ? undefined
        : {point: add(eye, ray, distance / Math.hypot(...ray)), distance};
    });
  }

  // How many pixels across and down share one of at most `size` × `size` rays.
  grid(size) { return [this.canvas.width, this.canvas.height].map((n) => Math.ceil(n / size)); }

  // Casts a ray for each cell of the grid, through its pixel number `choice`. Returns how many
  // cells there are across and down.
  cast(view, size, choice, task) {
    const gl = this.gl, {width, height} = this.canvas, [across, down] = this.grid(size);
    const w = Math.ceil(width / across), h = Math.ceil(height / down), {at} = this.asking(view);
    this.bindFeedback();
    gl.viewport(0, 0, w, h);
    this.use(this.asking(view), view, width, height);
    gl.uniform2f(at('uStep'), across, down);
    gl.uniform2f(at('uShift'), choice % across, Math.floor(choice / across) % down);
    gl.uniform1i(at('uTask'), kTasks[task]);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    return [w, h];
  }
  // Finds the pages for one pixel of each cell of the grid: pixel number `choice`.
  async askRays(view, size, choice) {
    const gl = this.gl, [w, h] = this.cast(view, size, choice, 'ask');
    this.readBuffers.forEach((buffer, i) => {
      gl.readBuffer(gl.COLOR_ATTACHMENT0 + i);
      gl.bindBuffer(gl.PIXEL_PACK_BUFFER, buffer);
      gl.readPixels(0, 0, w, h, gl.RGBA_INTEGER, gl.UNSIGNED_INT, 0);
    });
    gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);
    await this.done();
    if (gl.isContextLost()) return new Set();
    const pages = new Set();
    const words = new Uint32Array(w * h * 4);
    this.readBuffers.forEach((buffer) => {
      gl.bindBuffer(gl.PIXEL_PACK_BUFFER, buffer);
      gl.getBufferSubData(gl.PIXEL_PACK_BUFFER, 0, words);
      let last = 0;
      for (let i = 0; i < words.length; ++i) {
        if (words[i] === last || words[i] === 0 || i % 4 === 3) continue;
        pages.add((last = words[i]) - 1);
      }
    });
    gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);
    return pages;
  }
}
