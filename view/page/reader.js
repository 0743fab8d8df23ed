// Reads tiles: finds, fetches, checks and decodes them, together with those that they are predicted
// from. Such a tile is decoded once, and kept for others within a budget.

import {kDamaged, kEmpty, kStored} from './field.js';

const kKept = 48 << 20;  // bytes of samples
const kNothing = new Uint8Array(0);

// A tile that was read: its `state` and, if it is stored, its `samples`, which `color` and `depth`
// are the parts of.
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
    const found = await this.field.find(tiles);
    tiles.forEach((tile, i) => { tile.state = found[i].state; });
    const stored = found.filter(({state}) => state === kStored);
    const payloads = this.field.source.readAll(stored.map(({begin, end}) => [begin, end]));
    const allCame = Promise.all(payloads);
    allCame.catch(() => {});  // decode() reports it
    await Promise.all(tiles.map(async (tile, i) => {
      if (tile.state === kStored)
        await this.decode(tile, found[i].checksum, payloads[stored.indexOf(found[i])], held,
                          allCame);
      this.finish(tile);
    }));
  }

  // Decodes a payload, which names the tiles that it is predicted from. If the index lists them,
  // read() holds them. Otherwise they are read once all payloads of the batch have come, so that
  // they are fetched together.
  async decode(tile, checksum, coming, held, allCame) {
    const payload = await coming;
    let pages;
    try {
      pages = this.field.references(tile, checksum, payload);
    } catch {
      tile.state = kDamaged;
      return;
    }
    const tileOf = (page) => held.get(page) ?? this.tiles.get(page);
    if (!pages.every(tileOf)) await allCame;
    const references = await Promise.all(
      pages.map((page) => tileOf(page)?.ready ?? this.readReference(page)));
    if (references.some(({state}) => state !== kStored && state !== kEmpty)) {
      tile.state = kDamaged;  // it cannot be predicted
      return;
    }
    try {
      this.place(tile, await this.decoders.decode(
        {level: tile.level, entry: tile.entry, exit: tile.exit, payload},
        references.map(({page, entry, exit, samples}) =>
          ({page, entry, exit, samples: samples ?? kNothing}))));
    } catch {
      tile.state = kDamaged;
    }
  }
  readReference(page) {
    const [ready] = this.read([page]);
    ready.then(this.onReference, () => {});
    return ready;
  }

  place(tile, samples) {
    const {half, hasDepth} = this.field.shape, color = half ? 8 : 4;
    const colors = hasDepth ? samples.byteLength / (color + 1) * color : samples.byteLength;
    tile.samples = samples;
    tile.color = samples.subarray(0, colors);
    if (hasDepth) tile.depth = samples.subarray(colors);
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
