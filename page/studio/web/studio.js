// The studio: shows what a recipe makes while it is changed, and saves and builds it. All pictures
// come from the server (page/studio/studio.h).

import {add, Camera, dot} from '../../web/camera.js';
import {attach} from '../../web/controls.js';
import {planesOf} from '../../web/cut.js';
import {Handles, kHandleStyle} from '../../web/handle.js';
import {sleep} from '../../web/media.js';
import {Curve, hex, rgb} from './curve.js';

const kRest = 160;      // milliseconds without a change after which nothing moves
const kDirect = 2;      // of Stage in caster.h
const kMaxUndo = 200;

const byId = (id) => document.getElementById(id);
const make = (tag, members = {}, ...children) => {
  const made = Object.assign(document.createElement(tag), members);
  made.append(...children);
  return made;
};
const picture = byId('picture'), pen = picture.getContext('2d');
const page = crypto.getRandomValues(new Uint32Array(1))[0];
const camera = new Camera(location.hash.slice(1));

let state;              // what the server told
let recipe = {};        // without states
let states = [];        // {name, options}
let views = {};         // what --views takes: {views, notes, about}
let current = -1;       // the state that is shown and edited; -1: the recipe itself
let history = [], future = [];
let sphere = [0, 0, 0, 0];
let serial = 0, shown = {serial: 0, stage: 0};
let movedAt = 0, waiting;

// ---- the server ---------------------------------------------------------------------------------

function say(text, wrong = false) {
  byId('status').textContent = text;
  byId('status').classList.toggle('wrong', wrong);
}
async function post(what, body = {}, signal) {
  const answer = await fetch(what, {method: 'POST', body: JSON.stringify(body), signal});
  if (answer.ok) return answer;
  const otherwise = {error: `the server answered ${answer.status}`};
  const {error} = await answer.json().catch(() => otherwise);
  throw Object.assign(new Error(error), {status: answer.status});
}
const lost = 'The server does not answer. What you made is kept beside the output; ' +
             'start slf view again.';

// ---- the recipe ---------------------------------------------------------------------------------

const options = () => current < 0 ? recipe : states[current];
const merged = () => {
  const {name, light_from: light, ...own} = current < 0 ? {} : states[current];
  return {...recipe, ...own};
};
const whole = () => states.length > 0 ? {...recipe, states} : recipe;
const snapshot = () => JSON.stringify({recipe, states, views, current});

// Sets an option of what is edited; undefined: its default.
function set(name, value, moving = false) {
  if (!moving || history.at(-1)?.moving !== name) remember(moving ? name : undefined);
  const to = options();
  if (value === undefined && current < 0) delete to[name];
  else to[name] = value ?? null;
  changed(moving);
}
function remember(moving) {
  history.push({text: snapshot(), moving});
  history.splice(0, history.length - kMaxUndo);
  future = [];
}
function restore(from, to) {
  const last = from.pop();
  if (!last) return;
  to.push({text: snapshot()});
  ({recipe, states, views, current} = JSON.parse(last.text));
  changed();
  refresh();
}

// Sends the recipe. While one is on its way, only the newest waits.
let sending = false, unsent = false;
async function changed(moving = false) {
  if (moving) movedAt = performance.now();
  unsent = true;
  if (sending) return;
  sending = true;
  while (unsent) {
    unsent = false;
    try {
      const answer = await post('recipe', {
        revision: state.revision, shown: merged(), recipe: whole(), views});
      state.revision = (await answer.json()).revision;
      if (byId('status').classList.contains('wrong')) say('');
      again();
    } catch (error) {
      if (error.status === 409) return location.reload();
      say(error.status ? error.message : lost, true);
    }
  }
  sending = false;
  byId('copy').disabled = true;
}

// ---- pictures -----------------------------------------------------------------------------------

function again() {
  ++serial;
  if (!waiting?.moving) waiting?.abort();
}
function turned() {
  movedAt = performance.now();
  again();
}
const sizes = () => {
  const scale = Math.min(devicePixelRatio, 2);
  return [picture.clientWidth, picture.clientHeight].map(
    (side) => Math.max(1, Math.round(side * scale)));
};
const look = (moving) => ({
  page, serial, moving, sphere, size: sizes(), seen: shown.serial === serial ? shown.stage : 0,
  orbit: [camera.azimuth, camera.elevation, camera.distance, ...camera.target]});

// Tells what a build would take, while nothing changes.
let forecast = 0;  // the revision that it is of
async function tellForecast() {
  if (forecast === state.revision) return;
  const revision = forecast = state.revision;
  byId('forecast').textContent = 'Estimating size and time …';
  try {
    const answer = await post('forecast');
    if (revision !== state.revision) return;
    if (answer.status === 204) return forecast = 0;  // asked again at the next rest
    const {file_bytes: bytes, seconds, rays} = await answer.json();
    byId('forecast').textContent = `About ${(bytes / 2 ** 20).toPrecision(3)} MiB, ` +
      `${clock(seconds)}, ${(rays / 1e6).toPrecision(3)} million rays`;
  } catch (error) {
    byId('forecast').textContent = error.status ? error.message : '';
  }
}
// Shows pictures of the newest look, better and better, for ever.
async function draw() {
  for (let last = 0, complete = false, then = performance.now();; ) {
    const now = performance.now();
    if (camera.advance(Math.min(0.1, (now - then) / 1000))) turned();
    then = now;
    const moving = now - movedAt < kRest;
    if (last === serial && complete) {
      await sleep(8);
      continue;
    }
    if (last !== serial) complete = false;
    last = serial;
    waiting = Object.assign(new AbortController(), {moving});
    try {
      const answer = await post('look', look(moving), waiting.signal);
      if (answer.status === 204) continue;
      const header = (name) => answer.headers.get('Slf-' + name);
      const bitmap = await createImageBitmap(await answer.blob());
      if (picture.width !== bitmap.width || picture.height !== bitmap.height)
        Object.assign(picture, {width: bitmap.width, height: bitmap.height});
      pen.drawImage(bitmap, 0, 0);
      shown = {serial: last, stage: Number(header('Stage')), bitmap};
      place(JSON.parse(header('Sphere')));
      complete = header('Last') === '1';
      if (byId('status').classList.contains('wrong')) say('');
      if (complete && moving) {  // it may rest now
        complete = false;
        ++serial;
      }
      globalThis.studio.pictures.push({...shown, bitmap: undefined, width: bitmap.width, moving,
                                       last: header('Last') === '1', at: performance.now()});
      if (shown.stage >= kDirect && !state.box) await load();
      if (complete) tellForecast();
      handles.place();
      placeNotes();
      turnField();
    } catch (error) {
      if (error.name === 'AbortError') continue;
      say(error.status ? error.message : lost, true);
      complete = true;
      if (!error.status) await sleep(1000).then(() => { complete = false; });
    }
  }
}
// The camera stays where it is while the sphere, which its numbers refer to, changes.
function place(next) {
  if (sphere[3] > 0 && next.some((v, i) => v !== sphere[i])) {
    const scale = sphere[3] / next[3];
    camera.distance *= scale;
    camera.target = camera.target.map((t, i) => (t * sphere[3] + sphere[i] - next[i]) / next[3]);
  }
  sphere = next;
}

// ---- what is under the pointer ------------------------------------------------------------------

let pointing = false;
picture.addEventListener('pointermove', async (event) => {
  if (pointing || event.buttons || !shown.serial) return;
  pointing = true;
  const at = [event.offsetX / picture.clientWidth, event.offsetY / picture.clientHeight];
  const found = await post('point', {...look(false), at}).then((a) => a.json()).catch(() => ({}));
  const n = (v) => Number(v.toPrecision(4));
  byId('under').textContent = !found.position ? ''
    : (found.value === undefined || found.value === null ? '' : `${n(found.value)} at `) +
      `${found.position.map(n).join(', ')} ${state.unit ?? ''}`;
  await sleep(60);
  pointing = false;
});

// ---- the panel ----------------------------------------------------------------------------------

const curve = new Curve(byId('curve'), byId('points'), byId('add'), (fn, moving) => {
  set('transfer', fn, moving);
  showEnds();
});
function showEnds() {
  const n = (v) => Number(v.toPrecision(5));
  byId('ends').replaceChildren(make('span', {textContent: n(curve.low)}),
                               make('span', {textContent: n(curve.high)}));
  byId('low').value = n(curve.points[0].value);
  byId('high').value = n(curve.points.at(-1).value);
}
for (const id of ['low', 'high'])
  byId(id).onchange = () => {
    const low = Number(byId('low').value), high = Number(byId('high').value);
    if (low < high) curve.stretch(low, high);
    showEnds();
  };

function showPresets() {
  const preset = ({name, description, function: fn}, k) => {
    const image = make('img', {src: `preset/${k}`, alt: '', loading: 'lazy'});
    image.onerror = () => image.replaceWith(make('i', {textContent: 'shows nothing'}));
    const button = make('button', {title: description}, image, make('span', {textContent: name}));
    button.onclick = () => {
      curve.show(fn, state.histogram);
      set('transfer', fn);
      showEnds();
    };
    return button;
  };
  byId('presets').replaceChildren(...(state.presets ?? []).map(preset));
}
const takeFile = async (file) => {
  if (!file) return;
  try {
    const said = await post('presets', {name: file.name, text: await file.text()});
    const {first} = await said.json();
    await load();
    byId('presets').children[first]?.click();
  } catch (error) {
    say(error.message, true);
  }
};
byId('file').onchange = (event) => takeFile(event.target.files[0]);
addEventListener('dragover', (event) => event.preventDefault());
addEventListener('drop', (event) => {
  event.preventDefault();
  takeFile(event.dataTransfer.files[0]);
});

// Options that an input states as they are. Empty: the default.
const kInputs = {
  lighting: String, light_rig: String, projection: String, exposure: Number, radius: Number,
  center: (text) => text.split(',').map(Number), crop: String, quality: String,
  finest_level: Number, codec: String};
const kInstead = {quality: ['entry', 'exit', 'finest_level'], finest_level: ['quality']};
for (const [name, read] of Object.entries(kInputs)) {
  const input = byId(name);
  const update = (moving) => {
    for (const other of kInstead[name] ?? []) delete recipe[other];
    set(name, input.value.trim() === '' ? undefined : read(input.value), moving);
    if (kInstead[name]) showInputs();
  };
  if (input.type === 'range') input.oninput = () => update(true);
  input.onchange = () => update(false);
}
byId('each_label').onchange = (event) => set('each_label', event.target.checked || undefined);

function showInputs() {
  const values = merged();
  for (const name of Object.keys(kInputs)) {
    const input = byId(name), value = values[name];
    input.value = value ?? (name === 'lighting' ? 'global' : name === 'light_rig' ? 'studio'
      : name === 'exposure' ? 0 : '');
  }
  byId('each_label').checked = Boolean(recipe.each_label);
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
showBall(0, 0);

// ---- planes -------------------------------------------------------------------------------------

const rounded = (v) => Number(v.toPrecision(7));
const planes = () => (merged().clip ?? []).map((plane) => [...plane]);
const setPlanes = (all, moving) => set('clip', all.length > 0 ? all : undefined, moving);
// The ends of a plane's way through the sphere, along its normal.
const along = (plane) => dot(add(plane.slice(0, 3), sphere, -1), plane.slice(3)) / sphere[3];
const shifted = (plane, to) => [...add(sphere.slice(0, 3), plane.slice(3), to * sphere[3]),
                                ...plane.slice(3)].map(rounded);
for (const button of document.querySelectorAll('[data-axis]'))
  button.onclick = () => {
    const normal = [0, 0, 0];
    normal[button.dataset.axis] = 1;
    setPlanes([...planes(), shifted([0, 0, 0, ...normal], 0)]);
    showPlanes();
  };
function showPlanes() {
  byId('planes').replaceChildren(...planes().map((plane, k) => {
    const edit = (change, moving) => {
      const all = planes();
      all[k] = change(all[k]);
      setPlanes(all, moving);
      handles.place();
    };
    const slider = make('input', {
      type: 'range', min: -1, max: 1, step: 0.005, value: along(plane)});
    slider.setAttribute('aria-label', `Place of plane ${k + 1}`);
    slider.oninput = () => edit((p) => shifted(p, Number(slider.value)), true);
    slider.onchange = () => edit((p) => shifted(p, Number(slider.value)), false);
    const numbers = make('input', {type: 'text', value: plane.join(', ')});
    numbers.setAttribute('aria-label', `Point and normal of plane ${k + 1}`);
    numbers.onchange = () => {
      const v = numbers.value.split(',').map(Number);
      if (v.length === 6 && v.every(Number.isFinite)) edit(() => v);
      showPlanes();
    };
    const flip = make('button', {textContent: 'Flip', onclick: () => {
      edit((p) => [...p.slice(0, 3), ...p.slice(3).map((v) => v === 0 ? 0 : -v)]);
      showPlanes();
    }});
    const remove = make('button', {textContent: 'Remove', onclick: () => {
      setPlanes(planes().filter((_, i) => i !== k));
      showPlanes();
    }});
    return make('div', {}, slider, numbers, make('p', {className: 'row'}, flip, remove));
  }));
  handles.place();
}
// Their handles in the picture.
class PlaneHandles extends Handles {
  get planes() { return planesOf(planes()); }
  set(all, moving) {
    setPlanes(all.map(({point, normal}) => [...point, ...normal].map(rounded)), moving);
    if (moving) this.place();
    else showPlanes();
  }
  get sphere() { return {center: sphere.slice(0, 3), radius: sphere[3]}; }
  get camera() { return camera; }
  get canvas() { return picture; }
  place() { if (sphere[3] > 0) super.place(); }
}
const handles = new PlaneHandles(byId('handles'));
const handleSheet = new CSSStyleSheet();
handleSheet.replaceSync(kHandleStyle);
document.adoptedStyleSheets = [handleSheet];

// ---- labels, states, views ----------------------------------------------------------------------

function showLabels() {
  byId('labels').hidden = byId('each').hidden = !state.labels;
  for (const id of ['presets', 'curve', 'ends', 'numbers', 'add', 'low', 'high'])
    byId(id).hidden = Boolean(state.labels) || !state.histogram;
  const labels = merged().label_table?.labels ?? state.labels ?? [], only = merged().only_labels;
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
function showStates() {
  const choose = (k) => () => {
    current = k;
    changed();
    refresh();
  };
  byId('statelist').replaceChildren(
    item('The recipe', choose(-1), undefined, current < 0), ...states.map(({name}, k) =>
      item(name, choose(k), () => {
        remember();
        states.splice(k, 1);
        choose(-1)();
      }, current === k)));
}
byId('addstate').onclick = () => {
  const name = byId('statename').value.trim();
  if (!name || states.some((one) => one.name === name))
    return say('A state needs a name of its own.', true);
  remember();
  const own = current < 0 ? {} : states[current];
  if (states.length === 0 && current < 0) states.push({name: 'whole'});
  states.push({...own, name});
  byId('statename').value = '';
  current = states.length - 1;
  changed();
  refresh();
};
function showViews() {
  const removed = (list, k) => () => {
    remember();
    list.splice(k, 1);
    changed();
    showViews();
  };
  const all = views.views ??= [], notes = views.notes ??= [];
  byId('viewlist').replaceChildren(...all.map((view, k) => item(view.title, () => {
    camera.reset();
    [camera.azimuth, camera.elevation, camera.distance] = view.orbit;
    if (view.target) camera.target = inward(view.target);
    turned();
  }, removed(all, k))));
  byId('notelist').replaceChildren(...notes.map((note, k) => item(note.label, () => {
    camera.face(inward(note.point));
    turned();
  }, removed(notes, k))));
  byId('notes').replaceChildren(...notes.map(({label}) => make('span', {textContent: label})));
  for (const input of document.querySelectorAll('[data-about]'))
    input.value = views.about?.[input.dataset.about] ?? '';
  placeNotes();
}
const inward = (point) => point.map((v, i) => (v - sphere[i]) / sphere[3]);
function placeNotes() {
  if (!(sphere[3] > 0)) return;
  [...byId('notes').children].forEach((span, k) => {
    const {x, y, far} = camera.project(inward(views.notes[k].point), picture.clientWidth,
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
async function tap(x, y) {
  if (!placing) return;
  placing = false;
  const at = [x / picture.clientWidth, y / picture.clientHeight];
  const found = await post('point', {...look(false), at}).then((a) => a.json()).catch(() => ({}));
  if (!found.position) return say('Nothing is there; the note was not placed.', true);
  say('');
  remember();
  const label = byId('notename').value.trim() || `Note ${views.notes.length + 1}`;
  views.notes.push({label, point: found.position.map((v) => Number(v.toPrecision(6)))});
  byId('notename').value = '';
  changed();
  showViews();
}
for (const input of document.querySelectorAll('[data-about]'))
  input.onchange = () => {
    remember();
    views.about = {...views.about, [input.dataset.about]: input.value.trim()};
    for (const [name, text] of Object.entries(views.about)) if (!text) delete views.about[name];
    if (Object.keys(views.about).length === 0) delete views.about;
    changed();
  };
byId('addview').onclick = () => {
  remember();
  const n = (v) => Number(v.toPrecision(6));
  const view = {title: byId('viewname').value.trim() || `View ${views.views.length + 1}`,
                orbit: [camera.azimuth, camera.elevation, camera.distance].map(n)};
  if (camera.target.some((v) => v !== 0))
    view.target = camera.target.map((t, i) => n(t * sphere[3] + sphere[i]));
  views.views.push(view);
  byId('viewname').value = '';
  changed();
  showViews();
};

// ---- saving and building ------------------------------------------------------------------------

let command = '';
async function save(what, more = {}) {
  try {
    while (sending) await sleep(8);  // what is saved has all changes
    const said = await (await post(what, more)).json();
    command = said.command;
    byId('copy').disabled = false;
    byId('said').textContent = `${what === 'build' ? 'Building' : 'Saved'} ${said.save}`;
    return true;
  } catch (error) {
    byId('said').textContent = error.message;
    return false;
  }
}
byId('save').onclick = () => save('save');
byId('build').onclick = async () => { if (await save('build')) follow(); };
byId('stop').onclick = () => post('stop');
byId('copy').onclick = async () => {
  if (await save('save')) await navigator.clipboard.writeText(command).catch(() => {});
  byId('said').textContent = command;
};
// The field that was built, beside the live picture, from the same side.
let field;
function showField(folder) {
  field?.remove();
  field = make('iframe', {src: `../${folder}/`, title: 'The field that was built'});
  field.onload = () => {
    field.element = field.contentDocument.querySelector('slf-field');
    field.element.setAttribute('controls', 'none');
    turnField();
  };
  picture.after(field);
  byId('compare').hidden = false;
  byId('compare').oninput();
}
function turnField() {
  if (!field?.element) return;
  field.element.view = camera.toText();
  if (states.length > 0) field.element.state = states[Math.max(0, current)].name;
}
byId('compare').oninput = () => {
  field.style.clipPath = `inset(0 0 0 ${byId('compare').value}%)`;
};
const clock = (s) => s < 90 ? `${Math.round(s)} s` : `${Math.round(s / 60)} min`;
async function follow() {
  for (;;) {
    const {build} = state = await (await fetch('state')).json();
    const runs = build && !build.field && !build.error;
    byId('build').hidden = Boolean(runs);
    byId('stop').hidden = byId('progress').hidden = !runs;
    if (!runs) {
      if (build?.error) {
        const exists = build.error.includes('exists');
        byId('said').textContent = build.error;
        if (exists && confirm(`${build.error}\n\nReplace it?`) &&
            await save('build', {replace: true}))
          return follow();
      }
      if (build?.field) {
        byId('result').hidden = false;
        showField(build.field);
        byId('field').href = `../${build.field}/`;
        byId('said').textContent = `Complete: ${state.output}`;
      }
      return again();
    }
    byId('progress').value = build.total > 0 ? build.done / build.total : 0;
    const left = build.done > 0 ? build.seconds * (build.total / build.done - 1) : 0;
    byId('said').textContent =
      clock(build.seconds) + (left > 0 ? `, ${clock(left)} left` : '');
    await sleep(400);
  }
}

// ---- all of it ----------------------------------------------------------------------------------

function refresh() {
  showInputs();
  showPlanes();
  showLabels();
  showStates();
  showViews();
  const fn = merged().transfer;
  if (state.histogram && (typeof fn === 'object' ? fn : state.function))
    curve.show(typeof fn === 'object' ? fn : state.function, state.histogram), showEnds();
}
async function load() {
  state = await (await fetch('state')).json();
  const {states: known = [], ...rest} = state.recipe;
  [recipe, states, views] = [rest, known, state.views];
  current = Math.min(current, states.length - 1);
  byId('name').textContent = state.name;
  document.title = `${state.name} · slf studio`;
  showPresets();
  refresh();
  if (state.notes.length > 0) byId('said').textContent = state.notes.join(' ');
  if (state.restored) byId('said').textContent = 'Went on from the draft of last time.';
}
byId('undo').onclick = () => restore(history, future);
byId('redo').onclick = () => restore(future, history);
addEventListener('keydown', (event) => {
  if (!(event.ctrlKey || event.metaKey) || event.key.toLowerCase() !== 'z') return;
  if (event.target.matches('input[type="text"], input[type="number"]')) return;
  event.preventDefault();
  if (event.shiftKey) restore(future, history);
  else restore(history, future);
});
attach(picture, camera, {
  moved: turned, tap, wheels: () => true, hears: picture, signal: undefined,
  keys: {r: () => { camera.reset(); turned(); },
         enter: () => tap(picture.clientWidth / 2, picture.clientHeight / 2)}});
new ResizeObserver(again).observe(picture);

globalThis.studio = {camera, pictures: [], get serial() { return serial; },
                     get sending() { return sending; },
                     get shown() { return shown; }, get state() { return state; }};
load().then(() => {
  serial = 1;
  movedAt = performance.now();  // a small picture comes first
  if (state.build && !state.build.field) follow();
  draw();
}, () => say(lost, true));
