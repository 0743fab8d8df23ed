// What the studio makes: a recipe, its states, views and notes, with undo. Each change is sent to
// the server, the newest one until it has arrived.

import {found, getState, gone, page, post, retries, say} from './server.js';

const kMaxUndo = 200;
const kOfAll = ['center', 'radius', 'quality', 'finest_level', 'codec', 'each_label'];  // states

// `current` is the state that is shown and edited; -1: the recipe itself. `server` is what the
// server told. `views` is what --views takes.
export const model = {server: undefined, recipe: {}, states: [], views: {}, current: -1};
// What follows: `moved` a change while more will come, `sent` its arrival, `loaded` another recipe.
export const after = {moved() {}, sent() {}, loaded() {}};
let history = [], future = [];

const mergedWith = (k) => {
  const {name, light_from: light, ...own} = model.states[k] ?? {};
  return {...model.recipe, ...own};
};
export const merged = () => mergedWith(model.current);
const whole = () =>
  model.states.length > 0 ? {...model.recipe, states: model.states} : model.recipe;
const snapshot = () => {
  const {recipe, states, views, current} = model;
  return JSON.stringify({recipe, states, views, current});
};

// Sets an option of what is edited; undefined: its default, as that of those that it replaces.
export function set(name, value, moving = false, replaced = []) {
  const last = history.at(-1);
  if (last?.moving !== name) remember(moving ? name : undefined);
  else if (!moving) last.moving = undefined;  // the end of the same movement
  const {recipe, states, current} = model;
  const to = kOfAll.includes(name) ? recipe : states[current] ?? recipe;
  for (const [key, now] of [...replaced.map((other) => [other]), [name, value]])
    if (now === undefined && (to === recipe || !(key in recipe))) delete to[key];
    else to[key] = now ?? null;
  changed(moving);
}
export function remember(moving) {
  history.push({text: snapshot(), moving});
  history.splice(0, history.length - kMaxUndo);
  future = [];
}
function restore(from, to) {
  const last = from.pop();
  if (!last) return;
  to.push({text: snapshot()});
  Object.assign(model, JSON.parse(last.text));
  changed();
  after.loaded();
}
export const undo = () => restore(history, future);
export const redo = () => restore(future, history);

let sending = false, unsent = false;
export const isSending = () => sending;
const message = () => ({
  page, revision: model.server.revision, shown: merged(), recipe: whole(), views: model.views});

export async function changed(moving = false) {
  if (moving) after.moved();
  unsent = true;
  if (sending) return;
  sending = true;
  while (unsent) {
    unsent = false;
    try {
      model.server.revision = (await (await post('recipe', message())).json()).revision;
      found();
      say('');
      after.sent();
    } catch (error) {
      if (error.status !== 409) {
        unsent = await retries(error) || unsent;
      } else if (await getState().then(accept, () => { unsent = true; })) {
        say('Another page changed the recipe, which is shown now. Undo brings back yours.', true);
      }
    }
  }
  sending = false;
}
// A page that is left sends what is on its way once more.
addEventListener('pagehide', () => {
  if (sending) navigator.sendBeacon('recipe', JSON.stringify(message()));
});
addEventListener('beforeunload', (event) => {
  if (sending && gone) event.preventDefault();
});

// Takes what the server told, in place of what this page has, which undo brings back.
function accept(told) {
  if (model.server && told.revision !== model.server.revision) remember();
  model.server = told;
  const {states = [], ...recipe} = told.recipe;
  Object.assign(model, {recipe, states, views: told.views});
  const sorted = (key, value) => value?.constructor !== Object ? value
    : Object.fromEntries(Object.entries(value).sort(([a], [b]) => a < b ? -1 : 1));
  const isShown = (k) =>
    JSON.stringify(mergedWith(k), sorted) === JSON.stringify(told.shown, sorted);
  if (!isShown(model.current)) model.current = [-1, ...states.keys()].find(isShown) ?? -1;
  after.loaded();
  return true;
}
// Loads what the server has, unless this page has something newer.
export async function load() {
  const told = await getState();
  if (!sending) accept(told);
}
