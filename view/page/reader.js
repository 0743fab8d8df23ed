// Reads tiles: finds, fetches, checks and decodes them, together with those that they are predicted
// from. Such a tile is decoded once, and kept for others within a budget.

import {kDamaged, kEmpty, kStored} from './field.js';

const kKept = 48 << 20;  // bytes of samples
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
    const fresh = [], held = new Map();  // held: by page; none is read twice for this call
    const hold = (page) => {
      let tile = this.tiles.get(page);
      if (!tile) fresh.push(tile = new Tile(this.field.tile(page)));
      this.tiles.delete(page);
      this.tiles.set(page, tile);
      held.set(page, tile);
      return tile;
    };
    const tiles = pages.map(hold);
    for (const page of this.field.withAncestors(fresh))
      if (!held.has(page)) hold(page).ready.then(this.onReference, () => {});
    if (fresh.length > 0)
      this.load(fresh, held).catch((error) => fresh.forEach((tile) => {
        this.tiles.delete(tile.page);
        tile.failed(error);
      }));
    return tiles.map((tile) => tile.ready);
  }

  async load(tiles, held) {
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
    const payloads = field.source.readAll(wanted.map(({begin, end}) => [begin, end]));
    const allCame = Promise.all(payloads);
    allCame.catch(() => {});  // decode() reports it
    const decoding = new Map(tiles.map((tile) => [tile, []]));
    wanted.forEach((part, i) =>
      decoding.get(part.tile).push(this.decode(part, payloads[i], held, allCame)));
    await Promise.all(tiles.map(async (tile) => {
      await Promise.all(decoding.get(tile));
      this.finish(tile);
    }));
  }

  // Decodes a payload, which names the tiles that it is predicted from. If the index lists them,
  // read() holds them. Otherwise they are read once all payloads of the batch have come, so that
  // they are fetched together.
  async decode(part, coming, held, allCame) {
    const {tile, layer} = part, payload = await coming;
    let pages;
    try {
      pages = this.field.references(part, payload);
    } catch {
      return this.spoil(part);
    }
    const tileOf = (page) => held.get(page) ?? this.tiles.get(page);
    if (!pages.every(tileOf)) await allCame;
    const references = await Promise.all(
      pages.map((page) => tileOf(page)?.ready ?? this.readReference(page)));
    if (references.some(({state}) => state !== kStored && state !== kEmpty))
      return this.spoil(part);  // it cannot be predicted
    try {
      this.place(part, await this.decoders.decode(
        {layer, level: tile.level, entry: tile.entry, exit: tile.exit, payload},
        references.map(({page, entry, exit, samples}) =>
          ({page, entry, exit, samples: samples ?? kNothing}))));
    } catch {
      this.spoil(part);
    }
  }
  readReference(page) {
    const [ready] = this.read([page]);
    ready.then(this.onReference, () => {});
    return ready;
  }

  // Takes the samples of a part.
  place({tile, layer}, samples) {
    const {field} = this;
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
  spoil({tile, layer}) {
    tile[layer === this.field.color ? 'state' : 'depthState'] = kDamaged;
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
