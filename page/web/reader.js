// Reads tiles: finds, fetches, checks and decodes them, together with those that they are predicted
// from. Such a tile is decoded once, and the cache keeps it for others.

import {kDamaged, kEmpty, kStored} from './field.js';

// A tile that was read: its `state` and, if it is stored, its `samples`, which `color` and `depth`
// are the parts of.
//
//   absent ── read() ──> coming ── finish(), if others are predicted from it ──> kept
//     ^                     └─ finish(), if none are; failure        Cache drops it ─┘
//     └──────────────────────────┴──────────────────────────────────────┘
class Tile {
  constructor(place) {
    Object.assign(this, place);  // page, level, entry, exit
    this.samples = new Uint8Array(0);
    this.ready = new Promise((done, failed) => Object.assign(this, {done, failed}));
    this.ready.catch(() => {});
  }
}

export class Reader {
  // Calls `onReference` with tiles that were read because others are predicted from them.
  constructor(field, decoders, onReference) {
    Object.assign(this, {field, decoders, onReference, cache: decoders.cache});
  }

  // Reads pages, and fetches together what it can. One promise of a Tile each.
  read(pages) {
    const fresh = [], held = new Map();  // held: by page; none is read twice for this call
    const hold = (page) => {
      let tile = this.cache.get(page);
      if (!tile) {
        fresh.push(tile = new Tile(this.field.tile(page)));
        this.cache.set(page, tile, 0);
      }
      held.set(page, tile);
      return tile;
    };
    const tiles = pages.map(hold);
    for (const page of this.field.withAncestors(fresh))
      if (!held.has(page)) hold(page).ready.then(this.onReference, () => {});
    if (fresh.length > 0)
      this.load(fresh, held).catch((error) => fresh.forEach((tile) => {
        this.cache.remove(tile.page);
        tile.failed(error);
      }));
    return tiles.map((tile) => tile.ready);
  }

  async load(tiles, held) {
    const found = await this.field.find(tiles), isOwn = (tile, i) => found[i].source === tile.page;
    const same = tiles.filter((tile, i) => !isOwn(tile, i));
    const sources = this.read(found.filter((f, i) => !isOwn(tiles[i], i)).map((f) => f.source));
    tiles.forEach((tile, i) => { tile.state = found[i].state; });
    const stored = found.filter((f, i) => f.state === kStored && isOwn(tiles[i], i));
    const payloads = this.field.source.readAll(stored.map(({begin, end}) => [begin, end]));
    const allCame = Promise.all(payloads);
    allCame.catch(() => {});  // decode() reports it
    await Promise.all(tiles.map(async (tile, i) => {
      if (!isOwn(tile, i)) {  // the same as a tile of an earlier state
        const {state, samples, color, depth} = await sources[same.indexOf(tile)];
        Object.assign(tile, {state, samples, color, depth});
      } else if (tile.state === kStored) {
        await this.decode(tile, found[i].checksum, payloads[stored.indexOf(found[i])], held,
                          allCame);
      }
      this.finish(tile, isOwn(tile, i));
    }));
  }

  // Decodes a payload, which names the tiles that it is predicted from. If the index lists them,
  // read() holds them. Otherwise they are read once all payloads of the batch have come, so that
  // they are fetched together.
  async decode(tile, checksum, coming, held, allCame) {
    const payload = await coming;
    let pages;
    tile.state = kDamaged;  // until it is decoded
    try {
      pages = this.field.references(tile, checksum, payload);
    } catch {
      this.field.source.store?.clear();
      return;
    }
    const tileOf = (page) => this.cache.get(page) ?? held.get(page);
    if (!pages.every(tileOf)) {
      await allCame;
      this.read(pages).forEach((ready) => ready.then(this.onReference, () => {}));
    }
    const references = await Promise.all(pages.map((page) => tileOf(page).ready));
    if (references.some(({state}) => state !== kStored && state !== kEmpty)) return;
    await this.decoders.decode(tile, payload, references).then(
      (samples) => this.place(tile, samples), () => {});
  }

  place(tile, samples) {
    const {half, hasDepth} = this.field.shape, color = half ? 8 : 4;
    const colors = hasDepth ? samples.byteLength / (color + 1) * color : samples.byteLength;
    tile.state = kStored;
    tile.samples = samples;
    tile.color = samples.subarray(0, colors);
    if (hasDepth) tile.depth = samples.subarray(colors);
  }

  // Keeps a tile that others may be predicted from, or may be the same as.
  finish(tile, isOwn) {
    const {predicts, shape, states, structures} = this.field;
    if (isOwn && (states.length + structures.length > 1 ||
                  (predicts && tile.level < shape.levels)))
      this.cache.set(tile.page, tile, tile.samples.byteLength);
    else
      this.cache.remove(tile.page);
    tile.done(tile);
  }
}
