// Field: reads a field's manifest, describes its shape in numbers for the GPU, and finds its tiles.
//
// A tile's number in the GPU's page table is called its page; `level` to `exit` of a `tile` are
// what the module knows it by: its level, with its state from bit 8 on, and the indices of its
// sections.
// The GPU's table is that of one state. In the file, pages of state s begin at s × shape.pages.

import {kDone, kNeedsBytes, Native} from './module.js';
import {Told} from './text.js';

export const kMissing = 0, kEmpty = 1, kStored = 2, kDamaged = 4;  // states of tiles

const kFirstRays = 64;             // across the picture, that choose the first tiles
const kMaxTableEntries = 1 << 24;  // numbers in the tables, and in the page table

// Tiles in the form that the module reads.
const keysOf = (tiles) =>
  new Uint8Array(new Uint32Array(tiles.flatMap((t) => [t.level, t.entry, t.exit])).buffer);

export class Field {
  constructor(source, module) {
    this.source = source;
    this.native = new Native(module);
    this.module = module;
    this.fetching = new Map();  // ranges that are being fetched → promises
    this.prepared = [];       // promises of prepare(), by level
    this.state = 0;           // that is shown
    this.structures = [];     // names; `layers` then tells which are shown, as layersOf() does
  }

  add(offset, bytes) {
    this.native.fill(bytes);
    this.native.calls.slf_add(offset);
  }
  async fetchAll(ranges) {
    const within = ranges.map(([begin, end]) => [begin, Math.min(end, this.source.size)]);
    const fresh = within.filter((range) => !this.fetching.has(String(range)));
    this.source.readAll(fresh).forEach((load, i) => {
      const key = String(fresh[i]);
      this.fetching.set(key, (async () => {
        this.add(fresh[i][0], await load);
        this.fetching.delete(key);
      })());
    });
    await Promise.all(within.map((range) => this.fetching.get(String(range))));
  }
  // Repeats a call until it has the bytes that it needs.
  async complete(call) {
    for (let round = 0; round < 64; ++round) {
      const status = call(this.native.calls);
      if (status === kDone) return;
      if (status !== kNeedsBytes) this.native.check(status);
      await this.fetchAll(this.native.ranges());
    }
    throw new Told('noEnd');
  }

  async open() {
    const parts = await this.source.open(), {calls} = this.native;
    this.native.fill(new TextEncoder().encode('field.slf'));
    calls.slf_begin(this.source.size);
    for (const {begin, bytes} of parts) this.add(begin, bytes);
    await this.complete((c) => c.slf_open());
    this.manifestBytes = this.native.textBytes();
    this.manifest = JSON.parse(new TextDecoder().decode(this.manifestBytes));
    this.predicts = this.manifest.codec.startsWith('predictive');
    this.states = this.manifest.states?.map(({name}) => name) ?? [];
    if (this.states.length > 1 && this.manifest.provenance?.structures?.only)  // as slf render
      [this.structures, this.states] = [this.states, []];
    // Whether colours are linear radiance, so that pictures need tone mapping.
    const light = this.manifest.provenance?.lighting;
    this.radiance = light?.linear === true && light.mode !== 'direct';
    await this.complete((c) => c.slf_tables());
    this.tables = this.native.textBytes();
    this.native.fill(this.tables);
    this.native.check(this.native.calls.slf_codec());
    this.shape = this.makeShape();
  }

  // Resolves to the code of the reveal; empty: there is none.
  async reveal() {
    await this.complete((c) => c.slf_reveal());
    return this.native.textBytes();
  }
  // The provenance of the state that is shown, as UTF-8.
  provenance() {
    this.native.calls.slf_provenance(this.state);
    return this.native.textBytes();
  }

  // The shape in numbers for the GPU. Leaves out levels whose tables would be too large.
  makeShape() {
    const m = this.manifest, {calls} = this.native, deeper = m.entry_depth;
    const side = m.entry_side >> deeper;
    const shape = {
      entrySide: m.entry_side, exitSide: m.exit_side, hasDepth: m.format.endsWith('_depth8'),
      half: m.format.startsWith('rgba16f'), levels: -1, rowBits: 0, pages: 0,
      columns: (m.exit_side + 1) * (m.exit_side + 2) / 2, maxRows: (side + 1) * (side + 2) / 2,
      rowBase: new Int32Array(11), pathBase: new Int32Array(11), pageBase: new Int32Array(11)};
    const parts = [];
    let size = 0;
    for (let level = 0; level <= m.levels; ++level) {
      const pages = 64 * 16 ** level * 4 ** deeper, rows = 8 * ((m.entry_side << level) + 1) ** 2;
      if (shape.pages + pages > kMaxTableEntries || size + rows > kMaxTableEntries) break;
      const copyOf = (at, count) =>
        new Uint32Array(calls.memory.buffer, at, count).slice();
      for (const [base, at, count] of [
        [shape.rowBase, calls.slf_entry_rows(level), calls.slf_entry_row_count(level)],
        [shape.pathBase, calls.slf_exit_paths(level), calls.slf_exit_path_count(level)]]) {
        base[level] = size;
        parts.push(copyOf(at, count));
        size += count;
      }
      shape.rowBits = calls.slf_row_bits(level);
      shape.pageBase[level] = shape.pages;
      shape.pages += pages;
      shape.levels = level;
    }
    if (shape.levels < 0) throw new Told('level0');
    shape.tables = new Uint32Array(size);
    size = 0;
    for (const part of parts) {
      shape.tables.set(part, size);
      size += part.length;
    }
    return shape;
  }

  page(level, entry, exit) {
    const {pages, pageBase} = this.shape, plain = level & 255;
    return (level >> 8) * pages + pageBase[plain] + entry * (8 << (2 * plain)) + exit;
  }
  tile(page) {
    const {pages, pageBase, levels} = this.shape, state = Math.floor(page / pages);
    const inState = page % pages;
    let level = levels;
    while (pageBase[level] > inState) --level;
    const exits = 8 << (2 * level), at = inState - pageBase[level];
    return {page, level: level | state << 8, entry: Math.floor(at / exits), exit: at % exits};
  }
  // The number of a state, of which `text` is the name or the number; of the first without such.
  stateNumber(text) {
    const named = this.states.indexOf(text), number = Number(text ?? 0);
    return named >= 0 ? named : this.states[number] === undefined ? 0 : number;
  }
  // Whether the name of each structure fits a pattern.
  fitting(pattern) {
    this.native.fill(new TextEncoder().encode(pattern));
    const fitting = this.native.bytes(this.native.calls.slf_fitting(), this.structures.length);
    return [...fitting].map(Boolean);
  }
  // Pages of the state that is shown, in the file; of each structure that is shown, if there are
  // structures.
  inFile(pages) {
    const states = this.structures.length > 0 ? this.layers : [this];
    return states.flatMap(({state}) => pages.map((page) => state * this.shape.pages + page));
  }

  // Resolves to the total size of the payloads of pages in the file.
  async payloadBytes(pages) {
    const found = await this.find(pages.map((page) => this.tile(page)));
    return found.reduce((sum, {begin, end}) => sum + end - begin, 0);
  }

  // Reads the parts of the file that finding tiles of levels up to this one needs, and the lists of
  // the tiles that these are predicted from.
  prepare(level) {
    return this.prepared[level] ??= this.complete((c) => c.slf_prepare(level));
  }

  // The pages of the tiles of level 0 that a view needs first, found without the graphics card: its
  // programs may not be compiled yet. The shader finds all that a picture needs.
  firstTiles(camera, width, height) {
    const {eye, forward, right, down, half} = camera.axes(width, height);
    const view = [eye, forward, right.map((v) => v * half * width / height),
                  down.map((v) => v * half)];
    this.native.fill(new Uint8Array(new Float64Array(view.flat()).buffer));
    return this.pagesAt(this.native.calls.slf_first_tiles(kFirstRays));
  }

  // Where the sample of a level is that is nearest to the ray from the eye to a point of the
  // surface, in radii: its page, and its number in that tile.
  sampleAt(level, eye, point) {
    this.native.fill(new Uint8Array(new Float64Array([...eye, ...point]).buffer));
    const at = this.native.calls.slf_sample(level);
    const [entry, exit, row, column] = new Uint32Array(this.native.calls.memory.buffer, at, 4);
    return {page: this.page(level, entry, exit), number: row * this.shape.columns + column};
  }

  // Of these pages, those that the source fetches early or that have no payload; none if it fetches
  // none early.
  async early(pages) {
    const {early} = this.source;
    if (!early?.size) return [];
    const found = await this.find(this.inFile(pages).map((page) => this.tile(page)));
    const late = new Set(found.flatMap(({state, begin, end}, i) =>
      state === kStored && !early.has(`${begin},${end}`) ? i % pages.length : []));
    return pages.filter((_, i) => !late.has(i));
  }

  // The pages of tiles, and of all tiles that these are predicted from, as far as the field lists
  // them and prepare() has read the lists.
  withAncestors(tiles) {
    if (!this.predicts) return tiles.map(({page}) => page);
    const {calls} = this.native;
    this.native.fill(keysOf(tiles));
    return this.pagesAt(calls.slf_with_ancestors());
  }
  // Verifies the payload of a tile. Returns the pages of the tiles that it is predicted
  // from. Throws if it is damaged.
  references({level, entry, exit}, checksum, payload) {
    const {calls} = this.native;
    this.native.fill(payload);
    this.native.check(calls.slf_check(level, entry, exit, ...checksum));
    return this.pagesAt(calls.slf_references(level, entry, exit));
  }
  pagesAt(at) {
    const {calls} = this.native, count = calls.slf_tile_count();
    const found = new Uint32Array(calls.memory.buffer, at, 3 * count);
    return Array.from({length: count}, (_, i) => this.page(...found.subarray(3 * i, 3 * i + 3)));
  }

  // Finds tiles. Resolves to {state, begin, end, checksum, source} for each; `source` is the page
  // of the tile that has the payload.
  async find(tiles) {
    const keys = keysOf(tiles);
    let found;
    await this.complete((calls) => {
      this.native.fill(keys);
      const at = calls.slf_find();
      if (this.native.ranges().length > 0) return kNeedsBytes;
      const view = new DataView(calls.memory.buffer, at, 48 * tiles.length);
      found = tiles.map(({page}, i) => {
        const number = (k) => view.getFloat64(48 * i + 8 * k, true);
        const word = (k) => view.getUint32(48 * i + 4 * k, true), state = number(0);
        return {state, begin: number(1), end: number(2), checksum: [word(6), word(7)],
                source: state === kStored ? this.page(word(8), word(9), word(10)) : page};
      });
      return kDone;
    });
    return found;
  }
}
