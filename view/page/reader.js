// Reads tiles: finds, fetches, checks and decodes them, together with those that they are predicted
// from. Such a tile is decoded once, and kept for others within a budget.

import {kDamaged, kEmpty, kStored} from './field.js';

const kKept = 48 << 20;       // bytes of samples
const kNothing = new Uint8Array(0);

// A tile that was read: `state` of its colours, `depthState` of its depths if the field has any,
// and `color` and `depth`, the samples of what is stored.
class Tile {
  constructor(place) {
    Object.assign(this, place);  // page, level, entry, exit
    this.ready = new Promise((done, failed) => Object.assign(this, {done, failed}));
    this.ready.catch(() => {});
  }
}

export class Reader {
  // Calls `onReference` with tiles that were read because others are predicted from them.
  constructor(field, decoders, onReference) {
    Object.assign(this, {field, decoders, onReference});
    this.tiles = new Map();  // by page; the least recently used first
    this.bytes = 0;          // of those that are ready
  }

  // Reads pages, and fetches together what it can. One promise of a Tile each.
  read(pages) {
    const fresh = [];
    const tileOf = (page) => {
      let tile = this.tiles.get(page);
      if (!tile) fresh.push(tile = new Tile(this.field.tile(page)));
      this.tiles.delete(page);
      this.tiles.set(page, tile);
      return tile;
    };
    const tiles = pages.map(tileOf);
    const asked = new Set(pages);
    for (const page of this.field.withAncestors(fresh))
      if (!asked.has(page)) tileOf(page).ready.then(this.onReference, () => {});
    if (fresh.length > 0)
      this.load(fresh).catch((error) => fresh.forEach((tile) => {
        this.tiles.delete(tile.page);
        tile.failed(error);
      }));
    return tiles.map((tile) => tile.ready);
  }

  async load(tiles) {
    const {field} = this, parts = [];  // payloads
    for (const layer of field.layers) {
      const found = await field.find(tiles, layer);
      tiles.forEach((tile, i) => {
        tile[layer === field.color ? 'state' : 'depthState'] = found[i].state;
        if (found[i].state === kStored) parts.push({...found[i], layer, tile});
      });
    }
    // Colours decide: a tile without them has no use for depths.
    const wanted = parts.filter(({tile}) => tile.state === kStored);
    field.source.readAll(wanted.map(({begin, end}) => [begin, end]))
      .forEach((payload, i) => { wanted[i].payload = payload; });
    const references = this.findReferences(wanted);
    references.catch(() => {});  // the parts report it
    await Promise.all(tiles.map(async (tile) => {
      await Promise.all(wanted.filter((part) => part.tile === tile)
        .map((part) => this.decode(part, references)));
      this.finish(tile);
    }));
  }

  // Lists what the parts are predicted from. What nobody reads yet is read all together, once all
  // lists are known; until then a part may be decoded whose references are all on their way.
  async findReferences(parts) {
    const {field} = this;
    if (!field.predicts) return;
    const fresh = new Set();
    await Promise.all(parts.map((part) => part.listed = (async () => {
      const pages = field.references(part.tile) ?? await this.referencesOf(part);
      part.references = pages.map((page) => {
        const ready = this.tiles.get(page)?.ready;
        if (!ready) fresh.add(page);
        return {page, ready};
      });
    })()));
    if (fresh.size === 0) return;
    const pages = [...fresh];
    this.read(pages).forEach((ready) => ready.then((tile) => this.onReference(tile), () => {}));
  }
  // What a payload itself says that it is predicted from.
  async referencesOf(part) {
    part.payload = await part.payload;
    const {level} = part.tile;
    if (level === 0) return [];
    try {
      const found = await this.ask('references', part);
      return found.map(([entry, exit]) => this.field.page(level - 1, entry, exit));
    } catch {
      this.spoil(part);
      return [];
    }
  }

  async decode(part, findReferences) {
    const {field} = this, references = [];
    part.payload = await part.payload;
    await part.listed;
    const ready = () => (part.references ?? []).map((r) => r.ready ?? this.read([r.page])[0]);
    if (part.references?.some((r) => !r.ready)) await findReferences;
    for (const tile of await Promise.all(ready())) {
      if (tile.state !== kStored && tile.state !== kEmpty)
        return this.spoil(part);  // it cannot be predicted
      const {page, entry, exit, samples} = tile;
      references.push({page, entry, exit, samples: samples ?? kNothing});
    }
    if (part.spoilt) return;
    let samples;
    try {
      samples = await this.ask('decode', part, references);
    } catch {
      if (part.own) return this.spoil(part);
      part.own = true;  // the index may be wrong about it
      part.references = (await this.referencesOf(part))
        .map((page) => ({page, ready: this.tiles.get(page)?.ready}));
      return this.decode(part, findReferences);
    }
    const {tile, layer} = part;
    if (layer !== field.color) {
      tile.depth = samples;
    } else if (field.together) {
      const colors = field.shape.half ? samples.byteLength / 9 * 8 : samples.byteLength / 5 * 4;
      tile.samples = samples;
      tile.color = samples.subarray(0, colors);
      tile.depth = samples.subarray(colors);
      tile.depthState = kStored;
    } else {
      tile.color = samples;
    }
  }

  // Asks a worker about a part. Fails if the part is damaged.
  ask(what, {layer, checksum, payload, tile: {level, entry, exit}}, references) {
    return this.decoders[what]({layer, level, entry, exit, checksum, payload}, references);
  }
  spoil(part) {
    part.spoilt = true;
    part.tile[part.layer === this.field.color ? 'state' : 'depthState'] = kDamaged;
  }

  // Keeps a tile that others may be predicted from.
  finish(tile) {
    if (this.field.predicts && tile.level < this.field.shape.levels)
      this.bytes += tile.kept = tile.samples?.byteLength ?? 0;
    else
      this.tiles.delete(tile.page);
    for (const [page, {kept}] of this.tiles) {
      if (this.bytes <= kKept) break;
      if (!kept) continue;  // under way, or nothing in it
      this.bytes -= kept;
      this.tiles.delete(page);
    }
    tile.done(tile);
  }
}
