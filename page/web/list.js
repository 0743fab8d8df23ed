// The list of structures: which are shown, how opaque, and in what colour.

import {make} from './look.js';

const kEye = '<svg viewBox="0 0 24 24" aria-hidden="true">' +
  '<path d="M2 12s4-6 10-6 10 6 10 6-4 6-10 6S2 12 2 12z"/><circle cx="12" cy="12" r="3"/>' +
  '<path class="slash" d="M4 4l16 16"/></svg>';
const kMany = 12;  // structures: more have a field that searches them

// The own colours of structures, where the field tells them: by state, as CSS.
export function ownColors({states, provenance: p}) {
  const points = p.labels && p.transfer?.[0]?.RGBPoints, colors = new Map();
  for (let i = 0; i < points?.length; i += 4)
    colors.set(points[i], points.slice(i + 1, i + 4));
  const {only, styles = []} = p.structures;
  for (const {id, color} of styles) if (color) colors.set(id, color);
  return states.map(({provenance: own}) => {
    const color = colors.get((own?.structures?.only ?? only)[0]);
    return color && `rgb(${color.map((v) => Math.round(255 * v)).join(' ')})`;
  });
}

export class StructureList {
  // `byId` finds parts of the element; `t` says texts. Calls `changed(looks)` when the reader has
  // changed some.
  constructor(byId, t, changed) {
    Object.assign(this, {byId, t, changed, rows: [], looks: []});
    byId('all-on').onclick = () => this.change(() => ({shown: true}));
    byId('all-off').onclick = () => this.change(() => ({shown: false}));
    byId('find').oninput = ({target}) => this.rows.forEach(({row}, k) => {
      row.hidden = !this.names[k].toLowerCase().includes(target.value.trim().toLowerCase());
    });
  }

  // Makes the rows.
  fill(names, colors) {
    const {t} = this;
    this.names = names;
    this.byId('find').hidden = names.length <= kMany;
    this.rows = names.map((name, k) => {
      const row = make('li'), label = make('label', {title: name}), text = make('span');
      const dot = make('i', {hidden: !colors[k]});
      const button = (ariaLabel, values) => make('button', {type: 'button', ariaLabel, ...values});
      const eye = button(t('show', name), {className: 'eye', innerHTML: kEye});
      const only = button(t('onlyOne', name), {textContent: t('only')});
      const opacity = make('input', {type: 'range', min: 0, max: 1, step: 0.01,
                                     ariaLabel: t('opacity', name)});
      const tint = make('input', {type: 'color', title: t('tints'), ariaLabel: t('tint', name)});
      dot.style.background = colors[k];
      text.append(dot, name);
      label.append(text, opacity);
      row.append(eye, label, tint, only);
      eye.onclick = () => this.set(k, {shown: !this.looks[k].shown});
      // What was faded out comes back opaque.
      opacity.oninput = () => this.set(k, {shown: opacity.value > 0,
                                           opacity: Number(opacity.value) || 1});
      tint.oninput = () => this.set(k, {tint: tint.value});
      only.onclick = () => this.isolate(k);
      return {row, dot, eye, opacity, tint, only};
    });
    this.byId('list').replaceChildren(...this.rows.map(({row}) => row));
  }
  // Shows looks.
  show(looks) {
    this.looks = looks;
    const count = looks.filter(({shown}) => shown).length;
    this.byId('shown').textContent = this.t('of', count, looks.length);
    this.rows.forEach(({row, eye, opacity, tint, only}, k) => {
      const {shown} = looks[k];
      row.className = shown ? '' : 'off';
      eye.setAttribute('aria-pressed', String(shown));
      only.setAttribute('aria-pressed', String(shown && count === 1));
      // The slider of what was faded out stays where the reader has put it.
      if (shown || opacity.value > 0) opacity.value = looks[k].opacity;
      tint.value = looks[k].tint;
    });
  }
  change(how) {
    const looks = this.looks.map((look, k) => ({...look, ...how(k)}));
    this.show(looks);
    this.changed(looks);
  }
  set(k, values) { this.change((other) => other === k ? values : {}); }
  // Shows one structure alone; if it is that already, those from before, or all.
  isolate(k) {
    const alone = this.looks.every(({shown}, other) => shown === (other === k));
    const before = alone ? this.before ?? this.looks.map(() => true) : undefined;
    this.before = this.looks.map(({shown}) => shown);
    this.change((other) => ({shown: before ? before[other] : other === k}));
  }
}
