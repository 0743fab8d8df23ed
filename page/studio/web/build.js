// Saving, forecasts, building, and the field that was built.

import {sleep} from '../../web/media.js';
import {again, camera, picture} from './picture.js';
import {isSending, model} from './recipe.js';
import {byId, found, getState, make, post, retries} from './server.js';

// Milliseconds that a forecast is waited for at a time, and between: browsers have six connections
// for all pages of a server.
const kForecast = 2000, kBetween = 500;

// Tells what a build would take, while nothing changes.
let forecast = 0;  // the revision that it is of
export async function tellForecast() {
  const {revision} = model.server;
  if (forecast === revision) return;
  forecast = revision;
  byId('forecast').textContent = 'Estimating size and time …';
  for (; revision === model.server.revision; await sleep(kBetween)) {
    try {
      const answer = await post('forecast', {}, {patience: kForecast});
      if (revision !== model.server.revision) return;
      if (answer.status === 204) return forecast = 0;  // asked again at the next rest
      const {file_bytes: bytes, seconds, rays} = await answer.json();
      byId('forecast').textContent = `About ${(bytes / 2 ** 20).toPrecision(3)} MiB, ` +
        `${clock(seconds)}, ${(rays / 1e6).toPrecision(3)} million rays`;
      return;
    } catch (error) {
      if (error.name === 'TimeoutError') continue;
      byId('forecast').textContent = error.status ? error.message : '';
      if (!error.status) forecast = 0;
      return;
    }
  }
}
let command = '';
async function save(what, more = {}) {
  try {
    while (isSending()) await sleep(8);  // what is saved has all changes
    const said = await (await post(what, more)).json();
    command = said.command;
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
// Where the browser does not let pages copy, it can be selected.
async function copy(text) {
  const copied = await navigator.clipboard?.writeText(text).then(() => true, () => false);
  byId('said').textContent = copied ? `Copied: ${text}` : text;
}
byId('copy').onclick = async () => { if (await save('save')) await copy(command); };
byId('copypublish').onclick = () => copy(byId('publish').textContent);
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
export function turnField() {
  if (!field?.element) return;
  field.element.view = camera.toText();
  const {states, current} = model;
  if (states.length > 0) field.element.state = states[Math.max(0, current)].name;
}
byId('compare').oninput = () => {
  // Where the middle of the slider's knob is.
  field.style.clipPath = `inset(0 0 0 calc(8px + ${byId('compare').value / 100} * (100% - 16px)))`;
};
const clock = (s) => s < 90 ? `${Math.round(s)} s` : `${Math.round(s / 60)} min`;
export async function follow() {
  for (;;) {
    const told = await getState().catch(retries);
    if (told === true) continue;
    found();
    const {build, output} = told;
    const runs = build && !build.field && !build.error;
    byId('build').hidden = Boolean(runs);
    byId('stop').hidden = byId('progress').hidden = !runs;
    byId('forecast').hidden = Boolean(runs);
    if (!runs) {
      if (build?.error) {
        const exists = build.error.includes('exists');
        byId('said').textContent = build.error;
        if (exists && confirm(`${output} is there, with other settings. Replace it?`) &&
            await save('build', {replace: true}))
          return follow();
      }
      if (build?.field) {
        byId('result').hidden = false;
        byId('publish').textContent = build.publish;
        showField(build.field);
        byId('field').href = `../${build.field}/`;
        byId('said').textContent = `Complete: ${output}`;
        byId('result').scrollIntoView({block: 'nearest'});
      }
      return again();
    }
    byId('progress').value = build.total > 0 ? build.done / build.total : 0;
    const left = build.done > 0 ? build.seconds * (build.total / build.done - 1) : 0;
    byId('said').textContent = `${build.phase}: ${clock(build.seconds)} so far` +
      (left > 0 ? `, ${clock(left)} left` : '');
    await sleep(400);
  }
}
