// Colours, light, and the options that inputs state.

import {add, dot} from '../../web/camera.js';
import {Curve} from './curve.js';
import {camera} from './picture.js';
import {load, merged, model, set} from './recipe.js';
import {byId, make, post, retries, say} from './server.js';

const kPiece = 1 << 18;  // bytes of a picture that are sent at once

// ---- colours ------------------------------------------------------------------------------------

const curve = new Curve(byId('curve'), byId('points'), byId('add'), (fn, moving) => {
  set('transfer', fn, moving, ['range']);
  showEnds();
  markPreset(fn);
});
function showEnds() {
  const n = (v) => Number(v.toPrecision(5));
  const high = `${n(curve.high)} ${model.server.value_unit}`;
  byId('ends').replaceChildren(make('span', {textContent: n(curve.low)}),
                               make('span', {textContent: high}));
  byId('low').value = n(curve.points[0].value);
  byId('high').value = n(curve.points.at(-1).value);
}
for (const id of ['low', 'high'])
  byId(id).onchange = () => {
    const low = byId('low').valueAsNumber, high = byId('high').valueAsNumber;
    if (low < high) curve.stretch(low, high);
    else if (low >= high) say('The first value must be less than the last.', true);
    showEnds();
  };

// Marks the preset that is shown as it is.
function markPreset(fn) {
  const text = (one) => JSON.stringify({...one, Name: ''});
  [...byId('presets').children].forEach((button, k) => button.setAttribute(
    'aria-pressed', text(model.server.presets[k].function) === text(fn)));
}
export function showPresets() {
  const preset = ({name, description, function: fn}, k) => {
    const image = make('img', {
      src: `preset/${k}`, alt: '', loading: 'lazy', draggable: false});
    image.onerror = () => image.replaceWith(make('i', {textContent: 'shows nothing'}));
    const button = make('button', {title: description}, image, make('span', {textContent: name}));
    button.onclick = () => {
      curve.show(fn, model.server.histogram);
      set('transfer', fn, false, ['range']);
      showEnds();
      markPreset(fn);
      button.scrollIntoView({block: 'nearest', inline: 'center'});
    };
    return button;
  };
  const {presets = []} = model.server, box = byId('presets');
  if (box.childElementCount !== presets.length) box.replaceChildren(...presets.map(preset));
}
export function showCurve() {
  const {transfer} = merged(), {histogram, function: known} = model.server;
  const fn = typeof transfer === 'object' ? transfer : known;
  if (!histogram || !fn) return;
  curve.show(fn, histogram);
  showEnds();
  markPreset(fn);
}

// ---- files --------------------------------------------------------------------------------------

async function takeColors(file) {
  const said = await post('presets', {name: file.name, text: await file.text()});
  const {first} = await said.json();
  await load();
  byId('presets').children[first]?.click();
}
async function takeSurroundings(file) {
  for (let first = 0, path; !path; ) {
    say(`Sending ${file.name}: ${Math.round(100 * first / file.size)} %`);
    const headers = {'Slf-First': first, 'Slf-Size': file.size};
    try {
      const answer = await post('environment', file.slice(first, first + kPiece), {headers});
      path = (await answer.json()).environment;
      first += kPiece;
    } catch (error) {
      if (error.status || !await retries(error)) throw error;
    }
    if (path) set('environment', path);
  }
  say('');
  showInputs();
}
async function takeFile(file) {
  if (!file) return;
  try {
    await (/\.(hdr|exr)$/i.test(file.name) ? takeSurroundings : takeColors)(file);
  } catch (error) {
    say(`${file.name}: ${error.message}`, true);
  }
}
for (const id of ['file', 'environment'])
  byId(id).onchange = ({target}) => {
    takeFile(target.files[0]);
    target.value = '';  // the same file can be chosen again
  };
addEventListener('dragover', (event) => event.preventDefault());
addEventListener('drop', (event) => {
  event.preventDefault();
  takeFile(event.dataTransfer.files[0]);
});
byId('sky').onclick = () => {
  set('environment', undefined);
  showInputs();
};

// ---- inputs -------------------------------------------------------------------------------------

// Options that an input states as they are. Empty: the default.
const kInputs = {
  lighting: String, light_rig: String, projection: String, exposure: Number,
  environment_gain: Number, radius: Number, center: (text) => text.split(',').map(Number),
  crop: String, quality: String, finest_level: Number, codec: String};
const kInstead = {quality: ['entry', 'exit', 'finest_level'], finest_level: ['quality'],
                  projection: ['lighting'], lighting: ['projection']};
for (const [name, read] of Object.entries(kInputs)) {
  const input = byId(name);
  const update = (moving) => {
    set(name, input.value.trim() === '' ? undefined : read(input.value), moving, kInstead[name]);
    if (kInstead[name]) showInputs();
  };
  if (input.type === 'range') input.oninput = () => update(true);
  input.onchange = () => update(false);
}
byId('each_label').onchange = (event) => set('each_label', event.target.checked || undefined);

export function showInputs() {
  const values = merged();
  for (const name of Object.keys(kInputs)) {
    const input = byId(name), value = values[name];
    input.value = value ?? (name === 'lighting' ? 'global' : name === 'light_rig' ? 'studio'
      : name === 'exposure' ? 0 : '');
  }
  byId('each_label').checked = Boolean(model.recipe.each_label);
  for (const id of ['surroundings', 'sky', 'gain']) byId(id).hidden = !values.environment;
}
// The ball shows where the light is, as the camera sees it.
export function showLight() {
  const to = merged().light ?? [0, 0, 0], length = Math.hypot(...to) || 1;
  const {right, down} = camera.axes(1, 1);
  showBall(dot(to, right) / length, dot(to, down) / length);
}
// REQUIRES: the server shows this recipe.
export function showSurroundings() {
  const {environment} = merged(), address = `environment?${encodeURIComponent(environment)}`;
  const small = byId('surroundings');
  if (environment && small.getAttribute('src') !== address) small.src = address;
}

// The ball: its middle is a light from the eye, its rim one from the side.
const ball = byId('ball');
function light(x, y, moving) {
  const r = Math.max(1, Math.hypot(x, y)), u = x / r, v = y / r;
  const {right, down, forward} = camera.axes(1, 1), out = Math.sqrt(Math.max(0, 1 - u * u - v * v));
  const direction = add(add(right.map((a) => a * u), down, v), forward, -out);
  showBall(u, v);
  set('light', direction.map((a) => Number(a.toFixed(4))), moving);
}
function showBall(u, v) {
  ball.firstElementChild.style.cssText = `left:${50 + 46 * u}%;top:${50 + 46 * v}%`;
  ball.setAttribute('aria-valuetext', `${Math.round(100 * u)} right, ${Math.round(-100 * v)} up`);
  ball.at = [u, v];
}
ball.onpointerdown = (event) => {
  const box = ball.getBoundingClientRect();
  const go = (e, moving) => light((e.clientX - box.left) / box.width * 2.17 - 1.085,
                                  (e.clientY - box.top) / box.height * 2.17 - 1.085, moving);
  ball.setPointerCapture(event.pointerId);
  go(event, true);
  ball.onpointermove = (e) => go(e, true);
  ball.onpointerup = (e) => { ball.onpointermove = ball.onpointerup = null; go(e, false); };
};
ball.onkeydown = (event) => {
  const step = {
    ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1]};
  const [du, dv] = step[event.key] ?? [];
  if (du === undefined) return;
  event.preventDefault();
  light(ball.at[0] + du, ball.at[1] + dv, false);
};

