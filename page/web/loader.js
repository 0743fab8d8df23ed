// Decides which tiles are on the GPU: loads those that a view needs, and evicts others.

import {kDamaged, kEmpty as kEmptyTile, kStored} from './field.js';
import {Reader} from './reader.js';
import {kEmpty, kFirstSlot, kMaxParts, kMissing, kNotLoaded, kPartBit} from './shader.js';
import {Composer} from './structures.js';

const kBatch = 96;    // tiles that are loaded together while the view moves
const kBatches = 2;   // batches at a time: one is fetched while another is decoded
const kAtOnce = 16;   // tiles that are completed at once, when the view begins to move
const kAll = [...Array(kMaxParts).keys()];  // parts of a tile

// Loads the tiles that want() names, in their order, into the slots of the renderer.
export class Loader {
  // restart() tells where tiles are put.
  constructor(field, decoders, onError) {
    Object.assign(this, {field, onError});
    this.reader = new Reader(field, decoders, async (tile) => {
      await this.opened;
      if (!this.composes && !this.still) this.place(tile, false);
    }, (tile) => this.fill(this.pageOf(tile), kAll, tile));
    this.composer = new Composer(field, this.reader, decoders);
    this.composes = field.structures.length > 0;
    this.pages = new Uint16Array(field.shape.pages);  // as the GPU's page table
    this.loading = new Set();
    this.plan = [];
    this.used = new Map();  // page with a slot → when it was last needed; the oldest first
    this.wanted = new Map();   // page → the numbers of its parts that the view needs
    this.partial = new Map();  // page with a slot that lacks parts → for each part, whether it is
                               // there. The reader keeps its tile; if it drops that, it is filled.
    this.opened = new Promise((done) => { this.open = done; });
    this.now = 0;
    this.damaged = 0;
    this.arrivals = 0;  // tiles that came
    this.full = false;  // whether a view needed more tiles than there are slots
    this.batches = 0;   // that are being loaded now
    this.round = 0;     // counts the changes of what structures show
  }

  get tiles() { return this.used.size; }
  // Of the tiles that are wanted, how many there are: from 0 to 1.
  get share() {
    const absent = this.plan.length + this.loading.size;
    return this.tiles / (this.tiles + absent || 1);
  }

  // The page table and the slots of this renderer are empty.
  restart(renderer) {
    this.renderer = renderer;
    this.open();
    this.pages.fill(kNotLoaded);
    this.used.clear();
    this.partial.clear();
    this.free = Array.from({length: renderer.slots}, (_, i) => renderer.slots - 1 - i);
  }

  // The field shows another state, or its structures have other looks: all pages are to be loaded
  // anew, mostly from what the reader keeps.
  show() {
    if (this.composes) {  // what is on its way shows other structures
      ++this.round;
      this.loading = new Set();
      this.plan = [];
      this.batches = 0;
    }
    this.pages.forEach((value, page) => value !== kNotLoaded &&
                                        this.renderer.setPage(page, kNotLoaded));
    this.restart(this.renderer);
  }

  // Replaces the plan. A want is a page: all of its tile; with k × 2^kPartBit, part k - 1 of it.
  // `whole`: these are all that a view needs, which does not move: so they are loaded as one batch,
  // and no other parts of tiles. Returns how many of the pages are not loaded yet.
  want(wants, whole = false) {
    ++this.now;
    this.still = whole;
    this.wanted.clear();
    for (const want of wants) {
      const page = want % 2 ** kPartBit, part = Math.floor(want / 2 ** kPartBit) - 1;
      if (part < 0) this.wanted.set(page, kAll);
      else if (!this.wanted.has(page)) this.wanted.set(page, [part]);
      else if (this.wanted.get(page) !== kAll) this.wanted.get(page).push(part);
    }
    const absent = [];
    let rest = whole ? 0 : kAtOnce;
    for (const [page, parts] of this.wanted) {
      const held = this.pages[page];
      if (held === kNotLoaded) absent.push(page);
      else if (this.used.delete(page)) this.used.set(page, this.now);
      this.fill(page, this.partial.has(page) && rest-- > 0 ? kAll : parts);
    }
    this.plan = absent.filter((page) => !this.loading.has(page));
    while (this.batches < kBatches && this.plan.length > 0)
      this.run(whole ? Infinity : kBatch);
    return absent.length;
  }

  // Whether tiles are being loaded.
  get busy() { return this.batches > 0; }

  read(pages) {
    return this.composes ? this.composer.read(pages) : this.reader.read(this.field.inFile(pages));
  }
  // Loads the plan, batch by batch, until other structures are shown.
  async run(batch) {
    const {loading, round} = this, current = () => round === this.round;
    ++this.batches;
    try {
      while (current() && this.plan.length > 0) {
        const pages = this.plan.splice(0, batch);
        for (const page of pages) loading.add(page);
        await Promise.all(this.read(pages).map(async (ready) => {
          const tile = await ready;
          await this.opened;
          if (current()) this.place(tile);
        }));
        for (const page of pages) loading.delete(page);
      }
    } catch (error) {
      this.plan = [];
      this.onError(error);
    }
    if (current()) --this.batches;
  }

  // Puts a tile into a slot. `needed`: the view needs it, not only tiles that are predicted from
  // it.
  place(tile, needed = true) {
    const page = this.pageOf(tile), {state, color, depth} = tile;
    if (this.pages[page] !== kNotLoaded) return;
    this.damaged += state === kDamaged;
    let value = state === kEmptyTile ? kEmpty : kMissing;
    if (state === kStored) {
      const slot = this.free.pop() ?? (needed ? this.evict() : undefined);
      if (slot === undefined) {  // all tiles are needed: coarser ones are drawn instead
        this.full ||= needed;
        return;
      }
      const parts = this.still && !this.composes && this.reader.cache.get(tile.page) === tile
        ? this.wanted.get(page) : undefined;
      value = slot + kFirstSlot;
      this.partial.set(page, new Uint8Array(kMaxParts));
      this.pages[page] = value;
      this.fill(page, parts ?? kAll, tile);
      this.used.set(page, this.now);
    }
    this.pages[page] = value;
    this.renderer.setPage(page, value);
    ++this.arrivals;
  }

  // The page of a tile in the state that is shown. Others are not on the GPU.
  pageOf({page}) { return page - this.field.state * this.field.shape.pages; }
  // Uploads the parts that the slot of a page lacks.
  fill(page, parts, tile) {
    const has = this.partial.get(page), lacking = parts.filter((part) => has?.[part] === 0);
    if (lacking.length === 0) return;
    const {color, depth} = tile ?? this.reader.cache.get(this.field.inFile([page])[0]);
    for (const part of lacking) has[part] = 1;
    this.renderer.setTile(this.pages[page] - kFirstSlot, color, depth,
                          lacking.sort((a, b) => a - b), has);
    if (parts === kAll) this.partial.delete(page);
    ++this.arrivals;
  }

  // Frees the slot of the least recently needed tile and returns it. Level 0 stays.
  evict() {
    const first = this.field.shape.pageBase[1] || this.field.shape.pages;
    for (const [page, when] of this.used) {
      if (page < first) continue;
      if (when === this.now) return undefined;
      const slot = this.pages[page] - kFirstSlot;
      this.used.delete(page);
      this.partial.delete(page);
      this.pages[page] = kNotLoaded;
      this.renderer.setPage(page, kNotLoaded);
      return slot;
    }
    return undefined;
  }
}
