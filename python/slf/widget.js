// The page of a field as a widget of notebooks: an ES module for anywidget. The element <slf-field>
// shows it; its scripts and the field's bytes come from the kernel, as answers to messages.
//
//   {id, file} or {id, ranges: [[begin, end], …]}  ->  {id, error?} and a buffer of the bytes

const kAnswer = 1 << 20;  // bytes; of larger ones, Jupyter drops some (iopub_data_rate_limit)
const kPause = 100;       // milliseconds between messages of a moving camera
// Traits and the element's properties.
const kNames = {camera: 'view', state: 'state', structures: 'structures', clip: 'clip', cap: 'cap'};

// A function that asks the kernel and resolves to the bytes of its answer.
function asker(model) {
  const waiting = new Map();
  model.on('msg:custom', ({id, error}, [data]) => {
    const {done, failed} = waiting.get(id) ?? {};
    waiting.delete(id);
    if (error) failed?.(new Error(error));
    else done?.(new Uint8Array(data.buffer ?? data, data.byteOffset ?? 0, data.byteLength));
  });
  return (question) => new Promise((done, failed) => {
    const id = Math.random().toString(36);  // other views of the model ask, too
    waiting.set(id, {done, failed});
    model.send({id, ...question});
  });
}

// The bytes of the file. What is read at one time is asked for together.
function sourceOf(size, ask) {
  let wanted = [];
  const flush = () => {
    const groups = [];
    let room = 0;
    for (const want of wanted) {
      const length = want.end - want.begin;
      if (length > room) room = groups.push([]) && kAnswer;
      groups.at(-1).push(want);
      room -= length;
    }
    wanted = [];
    for (const group of groups)
      ask({ranges: group.map(({begin, end}) => [begin, end])}).then((bytes) => {
        let at = 0;
        for (const {begin, end, done} of group) done(bytes.slice(at, at += end - begin));
      }).catch((error) => group.forEach(({failed}) => failed(error)));
  };
  const part = (begin, end) => new Promise((done, failed) => {
    if (wanted.push({begin, end, done, failed}) === 1) setTimeout(flush);
  });
  const read = async (begin, end) => {
    const parts = [];
    for (let at = begin; at < end; at += kAnswer) parts.push(part(at, Math.min(end, at + kAnswer)));
    return new Uint8Array(await new Blob(await Promise.all(parts)).arrayBuffer());
  };
  return {size, read};
}

// Defines the element, once in a page.
let defined;
async function define(ask) {
  globalThis.slfModules ??= {};
  for (const name of ['module.bin', 'cut.bin']) slfModules[name] = () => ask({file: name});
  if (!customElements.get('slf-field'))
    await (defined ??= ask({file: 'page.js'}).then((bytes) => new Promise((done, failed) => {
      const src = URL.createObjectURL(new Blob([bytes], {type: 'text/javascript'}));
      document.head.append(Object.assign(
        document.createElement('script'),
        {src, onload: done, onerror: () => failed(new Error('The script is refused.'))}));
    })));
}

async function render({model, el}) {
  const ask = asker(model);
  await define(ask);
  const field = Object.assign(document.createElement('slf-field'), {
    source: sourceOf(model.get('size'), ask),
    style: `display: block; height: ${model.get('height')}px`});
  const same = (name) =>
    JSON.stringify(field[kNames[name]]) === JSON.stringify(model.get(name));
  field.setAttribute('own', '');  // so it says what the field was made from
  let timer;
  const push = (names) => {
    for (const name of names) if (!same(name)) model.set(name, field[kNames[name]]);
    timer ??= setTimeout(() => {
      timer = undefined;
      model.save_changes();
    }, kPause);
  };
  const pull = (name) => { if (!same(name)) field[kNames[name]] = model.get(name); };
  const mark = () => { field.mark = model.get('picked')?.point ?? null; };
  for (const name in kNames) {
    const given = model.get(name);
    if (given.length > 0) field[kNames[name]] = given;
    model.on(`change:${name}`, () => pull(name));
  }
  model.on('change:picked', mark);
  field.addEventListener('ready', mark);
  field.addEventListener('camera', () => push(['camera']));
  field.addEventListener('change', ({detail}) => push(detail.names));
  field.addEventListener('pick', ({detail: {point, depth, uncertainty}}) => {
    model.set('picked', {point, depth, uncertainty});
    push([]);
  });
  el.replaceChildren(field);
  return () => field.remove();
}

export default {render};
