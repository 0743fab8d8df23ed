// Labels, states, views and notes.

import {hex, rgb} from './curve.js';
import {camera, picture, point, turned, view} from './picture.js';
import {after, changed, merged, model, remember, set} from './recipe.js';
import {byId, make, say} from './server.js';

export function showLabels() {
  byId('labels').hidden = byId('each').hidden = !model.server.labels;
  for (const id of ['presets', 'curve', 'ends', 'numbers', 'add', 'range'])
    byId(id).hidden = Boolean(model.server.labels) || !model.server.histogram;
  const {label_table: table, only_labels: only} = merged();
  const labels = table?.labels ?? model.server.labels ?? [];
  const boxes = labels.map(({id, name}) => make('input', {
    type: 'checkbox', checked: !only || only.includes(id), ariaLabel: `Show ${name}`}));
  const choose = () => {
    const chosen = labels.filter((_, k) => boxes[k].checked).map(({id}) => id);
    set('only_labels', chosen.length === labels.length ? undefined : chosen);
  };
  byId('labels').replaceChildren(...labels.map(({id, name, color, opacity}, k) => {
    const edit = (members, moving) => set('label_table', {
      labels: (merged().label_table?.labels ?? labels).map(
        (label) => label.id === id ? {...label, ...members} : label)}, moving);
    const paint = make('input', {type: 'color', value: hex(color), ariaLabel: `Colour of ${name}`});
    paint.oninput = () => edit({color: rgb(paint.value)}, true);
    const fade = make('input', {type: 'range', min: 0, max: 1, step: 0.05, value: opacity,
                                ariaLabel: `Opacity of ${name}`});
    fade.oninput = () => edit({opacity: Number(fade.value)}, true);
    boxes[k].onchange = choose;
    const alone = make('button', {textContent: 'Only', ariaLabel: `Only ${name}`, onclick: () => {
      const others = boxes.some((box, other) => box.checked !== (other === k));
      boxes.forEach((box, other) => { box.checked = !others || other === k; });
      choose();
    }});
    return make('div', {className: 'label'}, boxes[k], paint, make('span', {textContent: name}),
                fade, alone);
  }));
}
function item(text, act, remove, pressed) {
  const button = make('button', {textContent: text, onclick: act});
  if (pressed !== undefined) button.setAttribute('aria-pressed', pressed);
  const children = [button];
  if (remove) {
    children.push(make('button', {textContent: '×', onclick: remove}));
    children[1].setAttribute('aria-label', `Remove ${text}`);
  }
  return make('li', {}, ...children);
}
export function showStates() {
  const choose = (k) => () => {
    model.current = k;
    changed();
    after.loaded();
  };
  byId('statelist').replaceChildren(
    item('The recipe', choose(-1), undefined, model.current < 0), ...model.states.map(({name}, k) =>
      item(name, choose(k), () => {
        remember();
        model.states.splice(k, 1);
        choose(-1)();
      }, model.current === k)));
}
byId('addstate').onclick = () => {
  const name = byId('statename').value.trim(), {states, current} = model;
  if (!name || states.some((one) => one.name === name))
    return say('A state needs a name of its own.', true);
  remember();
  const own = current < 0 ? {} : states[current];
  if (states.length === 0 && current < 0) states.push({name: 'whole'});
  states.push({...own, name});
  byId('statename').value = '';
  model.current = states.length - 1;
  changed();
  after.loaded();
};
export function showViews() {
  const removed = (list, k) => () => {
    remember();
    list.splice(k, 1);
    changed();
    showViews();
  };
  const {views} = model, all = views.views ??= [], notes = views.notes ??= [];
  byId('viewlist').replaceChildren(...all.map(({title, orbit, target}, k) => item(title, () => {
    camera.reset();
    [camera.azimuth, camera.elevation, camera.distance] = orbit;
    if (target) camera.target = inward(target);
    turned();
  }, removed(all, k))));
  byId('notelist').replaceChildren(...notes.map((note, k) => item(note.label, () => {
    camera.face(inward(note.point));
    turned();
  }, removed(notes, k))));
  byId('notes').replaceChildren(...notes.map(({label}) => make('span', {textContent: label})));
  for (const input of about) input.value = model.views.about?.[input.dataset.about] ?? '';
  about[0].oninput();
  placeNotes();
}
const inward = (point) => point.map((v, i) => (v - view.sphere[i]) / view.sphere[3]);
export function placeNotes() {
  if (!(view.sphere[3] > 0)) return;
  [...byId('notes').children].forEach((span, k) => {
    const {x, y, far} = camera.project(inward(model.views.notes[k].point), picture.clientWidth,
                                       picture.clientHeight);
    span.style.cssText = `left:${x}px;top:${y}px`;
    span.hidden = far <= 0;
  });
}
// A note is placed where the picture is pressed next, or in its middle by Enter.
let placing = false;
byId('addnote').onclick = () => {
  placing = true;
  say('Click the place of the note; Enter is the middle of the picture.');
  picture.focus();
};
addEventListener('keydown', (event) => {
  if (placing && event.key === 'Escape') say(''), placing = false;
});
for (const id of ['statename', 'viewname', 'notename'])
  byId(id).onkeydown = ({key, target}) => {
    if (key === 'Enter') target.nextElementSibling.click();
  };
export async function tap(x, y) {
  if (!placing) return;
  placing = false;
  const {position} = await point(x, y), {notes} = model.views;
  if (!position) return say('Nothing is there; the note was not placed.', true);
  say('');
  remember();
  const label = byId('notename').value.trim() || `Note ${notes.length + 1}`;
  notes.push({label, point: position.map((v) => Number(v.toPrecision(6)))});
  byId('notename').value = '';
  changed();
  showViews();
}
// Nothing is said of a page without a title.
const about = [...document.querySelectorAll('[data-about]')];
about[0].oninput = () => {
  for (const input of about.slice(1)) input.disabled = !about[0].value.trim();
};
for (const input of about)
  input.onchange = () => {
    if (!input.reportValidity()) return;
    remember();
    const {views} = model;
    views.about = {...views.about, [input.dataset.about]: input.value.trim()};
    for (const [name, text] of Object.entries(views.about)) if (!text) delete views.about[name];
    if (!views.about.title) delete views.about;
    changed();
    showViews();
  };
byId('addview').onclick = () => {
  remember();
  const n = (v) => Number(v.toPrecision(6)), {sphere} = view, {views} = model.views;
  const added = {title: byId('viewname').value.trim() || `View ${views.length + 1}`,
                 orbit: [camera.azimuth, camera.elevation, camera.distance].map(n)};
  if (camera.target.some((v) => v !== 0))
    added.target = camera.target.map((t, i) => n(t * sphere[3] + sphere[i]));
  views.push(added);
  byId('viewname').value = '';
  changed();
  showViews();
};
