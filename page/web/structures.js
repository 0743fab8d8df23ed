// Structures: the parts of an object that a field has as states, drawn together
// (doc/structures.md). How each is shown, also as text; and composing their tiles.
//
// A look is {shown, opacity, tint}: whether a structure is shown, its opacity from 0 to 1, and the
// colour that its own are multiplied by, as '#rrggbb'.

import {kDamaged, kEmpty, kMissing, kStored} from './field.js';

const kPlain = {shown: true, opacity: 1, tint: '#ffffff'};

// Reads a text such as 'left *:0.3:#ffd0b0', as parse_structure() of slf does. The module's C++
// library cannot parse floats, and would have to hand names and looks to and fro.
function parsed(text, names) {
  const look = {...kPlain};
  let name = text;
  for (let at; !names.includes(name) && (at = name.lastIndexOf(':')) >= 0;
       name = name.slice(0, at)) {
    const part = name.slice(at + 1);
    if (/^#[0-9a-f]{6}$/i.test(part)) look.tint = part.toLowerCase();
    else if (/^[\d.-][\d.e+-]*$/i.test(part) && part >= 0 && part <= 1) look.opacity = Number(part);
    else break;
  }
  if (look.opacity === 0) Object.assign(look, {shown: false, opacity: 1});
  return {name, look};
}
// How `texts` show the structures of a field: {looks, unknown}; `unknown` are names that no
// structure has. Without texts, or if none names a structure, all are shown.
export function looksOf(field, texts = ['*']) {
  const names = field.structures;
  const looks = names.map(() => ({...kPlain, shown: false})), unknown = [];
  for (const text of texts) {
    const {name, look} = parsed(text, names);
    const fits = names.includes(name) ? names.map((one) => one === name) : field.fitting(name);
    if (!fits.some(Boolean)) unknown.push(name);
    fits.forEach((is, k) => { if (is) looks[k] = {...look}; });
  }
  const useless = texts.length > 0 && texts.length === unknown.length;
  return {looks: useless ? names.map(() => ({...kPlain})) : looks, unknown};
}
// The shortest list of such texts.
export function textsOf(names, looks) {
  const text = (k) => {
    const {shown, opacity, tint} = looks[k];
    return names[k] + (!shown ? ':0' : (opacity < 1 ? `:${opacity}` : '') +
                                       (tint !== kPlain.tint ? `:${tint}` : ''));
  };
  const all = [...names.keys()], listed = all.filter((k) => looks[k].shown).map(text);
  const others = ['*', ...all.map(text).filter((one, k) => one !== names[k])];
  return others.length < listed.length ? others : listed;
}

// The structures that are shown: {state, opacity, tint} each, by their states in the field.
export const layersOf = (looks) => looks.flatMap(
  ({shown, opacity, tint}, state) => shown ? [{state, opacity, tint}] : []);

// Such a list as one text, as the page's address has it, and back. Commas in it are %2C.
export const joined = (texts) => texts.map(encodeURIComponent).join().replaceAll('%3A', ':');
export function split(list) {
  const decoded = (text) => {
    try {
      return decodeURIComponent(text);
    } catch {
      return text;
    }
  };
  return Array.isArray(list) ? list : list === '' ? [] : String(list).split(',').map(decoded);
}

// Reads tiles of the structures that are shown, and composes them.
export class Composer {
  constructor(field, reader, decoders) { Object.assign(this, {field, reader, decoders}); }

  // As Reader.read(); the pages are those of one state. Tiles lack their samples if other
  // structures are shown meanwhile.
  read(pages) {
    const {layers} = this.field, tiles = this.reader.read(this.field.inFile(pages));
    return pages.map((page, i) =>
      this.compose(page, layers, layers.map((_, k) => tiles[k * pages.length + i])));
  }
  async compose(page, layers, coming) {
    const {field} = this, tile = field.tile(page), tiles = await Promise.all(coming);
    tile.state = [kDamaged, kMissing, kStored].find(
      (state) => tiles.some((one) => one.state === state)) ?? kEmpty;
    if (tile.state !== kStored) return tile;
    const stored = layers.flatMap(({opacity, tint}, k) =>
      tiles[k].state === kStored ? [{opacity, tint, samples: tiles[k].samples}] : []);
    const samples = await this.decoders.compose(stored, field.radiance,
                                                () => field.layers === layers);
    if (samples) this.reader.place(tile, samples);
    return tile;
  }
}
