// The studio: shows what a recipe makes while it is changed, and saves and builds it. All pictures
// come from the server (page/studio/studio.h).

import {follow, tellForecast, turnField} from './build.js';
import {placeNotes, showLabels, showStates, showViews, tap} from './lists.js';
import {showCurve, showInputs, showLight, showPresets, showSurroundings} from './panel.js';
import {again, camera, draw, listen, moved, then, view} from './picture.js';
import {handles, showPlanes} from './planes.js';
import {after, isSending, load, model, redo, undo} from './recipe.js';
import {byId, retries} from './server.js';

after.moved = moved;
after.sent = again;
after.loaded = () => {
  byId('name').textContent = byId('name').title = model.server.name;
  document.title = `${model.server.name} · slf studio`;
  showInputs();
  showLight();
  showPlanes();
  showLabels();
  showStates();
  showViews();
  showPresets();
  showCurve();
  if (model.server.notes.length > 0) byId('said').textContent = model.server.notes.join(' ');
};
then.drawn = () => {
  handles.place();
  placeNotes();
  showLight();
  turnField();
  if (!isSending()) showSurroundings();
};
then.rested = tellForecast;
byId('undo').onclick = undo;
byId('redo').onclick = redo;
addEventListener('keydown', (event) => {
  if (!(event.ctrlKey || event.metaKey) || event.key.toLowerCase() !== 'z') return;
  if (event.target.matches('input[type="text"], input[type="number"]')) return;
  event.preventDefault();
  if (event.shiftKey) redo();
  else undo();
});

globalThis.studio = {camera, get pictures() { return view.pictures; },
                     get serial() { return view.serial; }, get sending() { return isSending(); },
                     get shown() { return view.shown; }, get state() { return model.server; }};
async function start() {
  while (!model.server) await load().catch(retries);
  view.serial = 1;
  moved();  // a small picture comes first
  if (model.server.restored) byId('said').textContent = 'Went on from the draft of last time.';
  if (model.server.build) follow();
  listen(tap);
  draw();
}
start();
