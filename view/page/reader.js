// Reads tiles: finds, fetches, checks and decodes them, together with those that they are predicted
// from. Such a tile is decoded once, and kept for others within a budget.

import {kDamaged, kEmpty, kStored} from './field.js';
import {merged} from './source.js';

const kParallel = 6;          // requests
const kKept = 48 << 20;       // bytes of samples
const kNothing = new Uint8Array(0);

// A tile that was read: `state` of its colours, `depthState` of its depths if the field has any, and
// `color` and `depth`, the samples of what is stored.
class Tile {
  constructor(place) {
    Object.assign(this, place);  // page, level, entry, exit
    this.ready = new Promise((done, failed) => Object.assign(this, {done, failed}));
    this.ready.catch(() => {});
  }
}

export class Reader {
  constructor(field, decoders) {
    Object.assign(this, {field, decoders});
    this.tiles = new Map();  // by page; the least recently used first
    this.bytes = 0;          // of those that are ready
  }

  // Reads pages, and fetches together what it can. One promise of a Tile each.
  read(pages) {
    const fresh = [];
    const tiles = pages.map((page) => {
      let tile = this.tiles.get(page);
      if (!tile) fresh.push(tile = new Tile(this.field.tile(page)));
      this.tiles.delete(page);
      this.tiles.set(page, tile);
      return tile;
    });
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
    await this.fetch(wanted);
    await this.findReferences(wanted);
    await Promise.all(tiles.map(async (tile) => {
      await Promise.all(wanted.filter((part) => part.tile === tile).map((p) => this.decode(p)));
      this.finish(tile);
    }));
  }

  async fetch(parts) {
    const requests = merged(parts.map(({begin, end}) => [begin, end]));
    const fetchNext = async () => {
      for (let request; (request = requests.shift());) {
        const [begin, end] = request, bytes = await this.field.source.read(begin, end);
        for (const part of parts)
          if (part.begin >= begin && part.end <= end)
            part.payload = bytes.slice(part.begin - begin, part.end - begin);
      }
    };
    await Promise.all(Array.from({length: kParallel}, fetchNext));
  }

  // Starts to read what the parts are predicted from, all of it together.
  async findReferences(parts) {
    const {field} = this, needed = new Map();
    await Promise.all(parts.map(async (part) => {
      part.references = [];
      const {level} = part.tile;
      if (!field.predicts || level === 0) return;
      const found = await this.ask('references', part);
      for (const [entry, exit] of found ?? []) {
        const page = field.page(level - 1, entry, exit);
        part.references.push(page);
        needed.set(page, undefined);
      }
    }));
    const pages = [...needed.keys()];
    this.read(pages).forEach((ready, i) => needed.set(pages[i], ready));
    for (const part of parts) part.references = part.references.map((page) => needed.get(page));
  }

  async decode(part) {
    const {field} = this, references = [];
    for (const tile of await Promise.all(part.references)) {
      if (tile.state !== kStored && tile.state !== kEmpty)
        return this.spoil(part);  // it cannot be predicted
      references.push({entry: tile.entry, exit: tile.exit, samples: tile.samples ?? kNothing});
    }
    const samples = await this.ask('decode', part, references);
    if (!samples) return;
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

  // Asks a worker about a part. Undefined: it is damaged.
  async ask(what, part, references) {
    const {layer, checksum, payload, tile: {level, entry, exit}} = part;
    if (part.spoilt) return undefined;
    try {
      return await this.decoders[what]({layer, level, entry, exit, checksum, payload}, references);
    } catch {
      this.spoil(part);
    }
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
