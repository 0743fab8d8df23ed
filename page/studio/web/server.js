// Requests to the server of the studio, and what the page says when there is no answer.

import {sleep} from '../../web/media.js';

const kPatience = 20000;  // milliseconds after which a request counts as lost
const kRetry = 1000;
const kLost = 'slf view does not answer. This page keeps what you change and tries again. If slf ' +
              'view has ended, start it again and open the address that it prints.';
const kOther = 'slf view was started again, with another address: open the one that it printed. ' +
               'What you changed before it ended is there.';

export const page = crypto.getRandomValues(new Uint32Array(1))[0];
export const byId = (id) => document.getElementById(id);
export const make = (tag, members = {}, ...children) => {
  const made = Object.assign(document.createElement(tag), members);
  made.append(...children);
  return made;
};

let failed = false;  // what is said is that a request failed
export function say(text, wrong = false) {
  failed = false;
  byId('status').textContent = text;
  byId('status').classList.toggle('wrong', wrong);
}
export let gone = false;
// Says what went wrong. Returns whether the request is to be sent again, and waits for that.
export async function retries(error) {
  const again = gone = !error.status || error.status === 403;
  say(!error.status ? kLost : error.status === 403 ? kOther : error.message, true);
  failed = true;
  if (again) await sleep(kRetry);
  return again;
}
export function found() {
  gone = false;
  if (failed) say('');
}

// Throws an error with the `status` of the answer, if there is one.
async function ask(what, {signal, patience = kPatience, ...options} = {}) {
  const signals = [AbortSignal.timeout(patience), ...(signal ? [signal] : [])];
  const answer = await fetch(what, {...options, signal: AbortSignal.any(signals)});
  if (answer.ok) return answer;
  const otherwise = {error: `the server answered ${answer.status}`};
  const {error} = await answer.json().catch(() => otherwise);
  throw Object.assign(new Error(error), {
    status: answer.status, revision: Number(answer.headers.get('Slf-Revision'))});
}
// Sends JSON, or a Blob.
export const post = (what, body = {}, options = {}) => ask(what, {
  ...options, method: 'POST', body: body instanceof Blob ? body : JSON.stringify(body)});
export const getState = async () => (await ask('state')).json();
