// Decides which tiles are on the GPU: loads those that a view needs, and evicts others.

import {kDamaged, kEmpty as kEmptyTile, kStored} from './field.js';
import {Reader} from './reader.js';
import {kEmpty, kFirstSlot, kMissing, kNotLoaded} from './shader.js';
import {Composer} from './structures.js';

const kBatch = 96;    // tiles that are loaded together while the view moves
const kBatches = 2;   // batches at a time: one is fetched while another is decoded

// Loads the tiles that want() names, in their order, into the slots of the renderer.
export class Loader {
  // restart() tells where tiles are put.
  constructor(field, decoders, onError) {
    Object.assign(this, {field, onError});
    this.reader = new Reader(field, decoders, async (tile) => {
      await this.opened;
      if (!this.composes) this.place(tile, false);
    });
    this.composer = new Composer(field, this.reader, decoders);
    this.composes = field.structures.length > 0;
    this.pages = new Uint16Array(field.shape.pages);  // as the GPU's page table
    this.loading = new Set();
    this.plan = [];
    this.used = new Map();  // page with a slot → when it was last needed; the oldest first
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

  // Replaces the plan. `whole`: the pages are all that a view needs, so they are loaded as one
  // batch. Returns how many of the pages are not loaded yet.
  want(pages, whole = false) {
    ++this.now;
    const absent = [];
    for (const page of pages) {
      const held = this.pages[page];
      if (held === kNotLoaded) absent.push(page);
      else if (this.used.delete(page)) this.used.set(page, this.now);
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
  place({page: inFile, state, color, depth}, needed = true) {
    // Of another state, it is not on the GPU.
    const page = inFile - this.field.state * this.field.shape.pages;
    if (this.pages[page] !== kNotLoaded) return;
    this.damaged += state === kDamaged;
    let value = state === kEmptyTile ? kEmpty : kMissing;
    if (state === kStored) {
      const slot = this.free.pop() ?? (needed ? this.evict() : undefined);
      if (slot === undefined) {  // all tiles are needed: coarser ones are drawn instead
        this.full ||= needed;
        return;
      }
      this.renderer.setTile(slot, color, depth);
      value = slot + kFirstSlot;
      this.used.set(page, this.now);
    }
    this.pages[page] = value;
    this.renderer.setPage(page, value);
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
      this.pages[page] = kNotLoaded;
      this.renderer.setPage(page, kNotLoaded);
      return slot;
    }
    return undefined;
  }
}
