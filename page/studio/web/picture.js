// The picture: a camera, and the newest picture from the server, better and better.

import {Camera} from '../../web/camera.js';
import {attach} from '../../web/controls.js';
import {sleep} from '../../web/media.js';
import {isSending, load, model} from './recipe.js';
import {byId, found, page, post, retries, say} from './server.js';

const kRest = 100;      // milliseconds without a change after which nothing moves
const kDirect = 2, kFine = 5;  // of Stage in caster.h
const kFrame = 115;     // milliseconds that a picture in motion may take to come
const kLeastPixels = 64 * 64;

export const picture = byId('picture'), pen = picture.getContext('2d');
export const camera = new Camera(location.hash.slice(1));
// `sphere` is what the camera's numbers refer to: centre and radius. `shown`: of the last picture.
export const view = {sphere: [0, 0, 0, 0], serial: 0, shown: {serial: 0, stage: 0}, pictures: []};
// What follows each picture, and what is done when nothing changes.
export const then = {drawn() {}, rested() {}};
let movedAt = 0, waiting, pace = Infinity;  // `pace`: pixels of a picture in motion

export function again() {
  ++view.serial;
  if (!waiting?.moving) waiting?.abort();
}
export const moved = () => { movedAt = performance.now(); };
export function turned() {
  moved();
  again();
}
const sizes = (moving) => {
  const scale = Math.min(devicePixelRatio, 2), {clientWidth: width, clientHeight: height} = picture;
  const less = moving ? Math.min(scale, Math.sqrt(pace / (width * height || 1))) : scale;
  return [width, height].map((side) => Math.max(1, Math.round(side * less)));
};
const look = (moving) => ({
  page, serial: view.serial, moving, sphere: view.sphere, size: sizes(moving),
  seen: view.shown.serial === view.serial ? view.shown.stage : 0, revision: view.shown.revision,
  orbit: [camera.azimuth, camera.elevation, camera.distance, ...camera.target]});

// Where the object is under a place of the picture, and its value there.
export const point = (x, y) =>
  post('point', {...look(false), at: [x / picture.clientWidth, y / picture.clientHeight]})
    .then((answer) => answer.json()).catch(() => ({}));

let before = performance.now();
async function ask() {
  const now = performance.now();
  if (camera.advance(Math.min(0.1, (now - before) / 1000))) turned();
  before = now;
  const moving = now - movedAt < kRest, serial = view.serial;
  waiting = Object.assign(new AbortController(), {moving, serial});
  return {answer: await post('look', look(moving), {signal: waiting.signal}), now, moving, serial};
}
// Shows the newest picture, for ever. One that is complete is asked for again, which the server
// answers once there is a newer recipe.
export async function draw() {
  for (let next;;) {
    if (document.hidden)
      await new Promise((go) => document.addEventListener('visibilitychange', go, {once: true}));
    try {
      const {answer, now, moving, serial} = await (next ?? ask());
      next = undefined;
      if (answer.status === 204) continue;
      const header = (name) => answer.headers.get('Slf-' + name);
      const blob = await answer.blob();
      if (moving && header('Last') === '1') {
        ++view.serial;  // it may rest now
        next = ask();   // while this picture is decoded, the next one is drawn
        next.catch(() => {});
      }
      const bitmap = await createImageBitmap(blob);
      const {width, height} = bitmap, at = performance.now();
      // What the scene took is no reason for a smaller picture.
      const took = Math.max(1, at - now - Number(header('Prepared')));
      if (moving)
        pace = Math.max(kLeastPixels, width * height * Math.min(1.5, kFrame / took));
      if (picture.width !== width || picture.height !== height)
        Object.assign(picture, {width, height});
      pen.drawImage(bitmap, 0, 0);
      if (view.shown.stage === 0) say('');  // this is the first one
      const last = header('Last') === '1', stage = Number(header('Stage'));
      view.shown = {serial, stage, revision: Number(header('Revision'))};
      place(JSON.parse(header('Sphere')));
      found();
      view.pictures.push({...view.shown, width, moving, last, at});
      const {box, revision} = model.server;
      if ((stage >= kDirect && !box) || (view.shown.revision !== revision && !isSending()))
        await load();
      if (last && !moving) {
        window.history.replaceState(null, '', `#${camera.toText()}`);
        then.rested();
      }
      then.drawn();
    } catch (error) {
      next = undefined;
      if (error.name === 'AbortError' || error.name === 'TimeoutError') continue;
      if (!await retries(error) && !error.revision) await sleep(1000);
      const serial = error.status ? waiting.serial : 0;
      view.shown = {serial, stage: kFine, revision: error.revision};
    }
  }
}
// What waits on a network that changes is asked for again.
for (const name of ['offline', 'online']) addEventListener(name, () => waiting?.abort());

// The camera stays where it is while the sphere, which its numbers refer to, changes.
function place(next) {
  const {sphere} = view;
  if (sphere[3] > 0 && next.some((v, i) => v !== sphere[i])) {
    const scale = sphere[3] / next[3];
    camera.distance *= scale;
    camera.target = camera.target.map((t, i) => (t * sphere[3] + sphere[i] - next[i]) / next[3]);
  }
  view.sphere = next;
}

// What is under the pointer.
let pointing = false;
picture.addEventListener('pointermove', async (event) => {
  if (pointing || event.buttons || !view.shown.serial) return;
  pointing = true;
  const {position, value} = await point(event.offsetX, event.offsetY);
  const n = (v) => Number(v.toPrecision(4));
  byId('under').textContent = !position ? ''
    : (value === undefined || value === null ? '' : `${n(value)} ${model.server.value_unit} at `) +
      `${position.map(n).join(', ')} ${model.server.unit ?? ''}`;
  await sleep(60);
  pointing = false;
});

// Keys and pointers move the camera; `tap(x, y)` is a click.
export const listen = (tap) => {
  attach(picture, camera, {
    moved: turned, tap, wheels: () => true, hears: picture, signal: undefined,
    keys: {r: () => { camera.reset(); turned(); },
           enter: () => tap(picture.clientWidth / 2, picture.clientHeight / 2)}});
  new ResizeObserver(again).observe(picture);
};
