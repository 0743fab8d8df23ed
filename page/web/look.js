// What <slf-field> consists of, and how it looks. {name} is a text of text.js.

import {kHandleStyle} from './handle.js';

// A new element with these properties.
export const make = (tag, values = {}) => Object.assign(document.createElement(tag), values);

export const markup = (t) => `<div lang="${t.language}">
<slot name="poster"></slot>
<canvas id="picture" tabindex="0" role="img" aria-describedby="keys"
  aria-label="{picture}"></canvas>
<svg id="lines" aria-hidden="true"></svg>
<svg id="planes" class="planes" role="group" aria-label="{planes}"></svg>
<div id="notes"></div>
<div id="cross" aria-hidden="true" hidden></div>
<div id="compass" aria-hidden="true" hidden></div>
<div id="scale" role="img" hidden></div>
<div id="under" aria-hidden="true" hidden></div>
<p id="seen" class="unseen" aria-live="polite"></p>
<p id="keys" class="unseen">{keys}</p>
<aside id="panel" aria-label="{settings}">
  <header>
    <h2 id="name">{loading}</h2>
    <button id="fold" class="fold" type="button" aria-expanded="true" aria-controls="settings"
      aria-label="{settings}" title="{fold}">–</button>
  </header>
  <slot name="about"></slot>
  <div id="settings">
    <div id="states" hidden>
      <label>{state} <select id="state"></select></label>
      <button id="play" type="button" aria-pressed="false" title="P">{play}</button>
    </div>
    <div id="tones" hidden>
      <label>{tones} <select id="curve">
        <option value="neutral">{neutral}</option>
        <option value="srgb">srgb</option>
        <option value="none">{none}</option>
      </select></label>
      <label>{exposure}
        <input id="exposure" type="range" min="-6" max="6" step="0.25" value="0"></label>
    </div>
    <label>{background} <input id="background" type="color" value="#000000"></label>
    <div id="cuts" hidden>
      <label>{cutFaces} <select id="cap">
        <option value="shaded">{shaded}</option>
        <option value="slice">{grey}</option>
        <option value="hollow">{hollow}</option>
      </select></label>
      <div id="greys" hidden>
        <label>{greyLevel} <input id="grey" type="range"></label>
        <label>{window} <input id="span" type="range"></label>
      </div>
      <div class="buttons">
        <button id="flip" type="button">{flip}</button>
        <button id="snap" type="button">{snap}</button>
        <button id="more" type="button">{more}</button>
        <button id="remove" type="button">{remove}</button>
      </div>
    </div>
    <div class="buttons">
      <label class="check"><input id="marks" type="checkbox"> {directions}</label>
      <label class="check"><input id="spin" type="checkbox"> {spin}</label>
      <button id="reset" type="button" title="R">{reset}</button>
      <button id="full" type="button" title="F">{full}</button>
      <button id="ruler" type="button" aria-pressed="false" title="M">{measure}</button>
      <button id="cut" type="button" aria-pressed="false" title="C">{cut}</button>
      <button id="save" type="button">{save}</button>
      <button id="link" type="button">{copyLink}</button>
      <button id="copy" type="button">{copyView}</button>
      <button id="mark" type="button" aria-pressed="false">{copyNote}</button>
      <button id="about" type="button">{about}</button>
    </div>
  </div>
</aside>
<aside id="structures" aria-label="{structures}" hidden>
  <header>
    <h2>{structures} <span id="shown"></span></h2>
    <button id="unroll" class="fold" type="button" aria-expanded="true" aria-controls="parts"
      aria-label="{listOf}" title="{unroll}">–</button>
  </header>
  <div id="parts">
    <div class="buttons">
      <button id="all-on" type="button">{allOn}</button>
      <button id="all-off" type="button">{allOff}</button>
    </div>
    <input id="find" type="search" placeholder="{find}" aria-label="{findParts}">
    <ul id="list"></ul>
  </div>
</aside>
<nav id="views" aria-label="{views}" hidden>
  <button id="previous" type="button" aria-label="{previous}" title="{pageUp}">‹</button>
  <div aria-live="polite"><a id="title"></a> <span id="count"></span><p id="text"></p></div>
  <button id="tour" type="button" aria-pressed="false" aria-label="{tour}"
    title="{tour} (T)">▸</button>
  <button id="next" type="button" aria-label="{next}" title="{pageDown}">›</button>
</nav>
<p id="hint" aria-hidden="true" hidden></p>
<p id="status" role="status" aria-live="polite"></p>
<p id="choose" hidden>{choose} <input id="file" type="file" accept=".slf" aria-label="{field}"></p>
<dialog id="facts" aria-labelledby="facts-title">
  <h2 id="facts-title">{about}</h2>
  <dl>
    <div id="facts-list"></div>
    <dt>{loaded}</dt><dd id="bytes">–</dd>
    <dt>{tiles}</dt><dd id="tiles">–</dd>
    <dt>{rate}</dt><dd id="rate">–</dd>
  </dl>
  <label>{mode} <select id="mode">
    <option value="depth">depth</option>
    <option value="bitri">bitri</option>
  </select></label>
  <label>{level} <select id="level"><option value="auto">{auto}</option></select></label>
  <form method="dialog"><button>{close}</button></form>
</dialog></div>`.replace(/\{(\w+)\}/g, (_, name) => t(name));

export const kStyle = `
:host {
  color-scheme: dark light;
  --ink: #e8eaed; --dim: #b3b9c3; --panel: rgb(24 27 32 / 88%); --line: rgb(255 255 255 / 22%);
  --accent: #7db4ff; --pressed: #06101f;
  display: block; position: relative; min-height: 120px; overflow: hidden; container-type: size;
  color: var(--ink); font: 14px/1.4 system-ui, sans-serif;
}
@media (prefers-color-scheme: light) {
  :host {
    --ink: #1c2026; --dim: #4b535e; --panel: rgb(255 255 255 / 90%); --line: rgb(0 0 0 / 24%);
    --accent: #0b5cc4; --pressed: #fff;
  }
}
* { box-sizing: border-box; }
[hidden] { display: none !important; }
[lang] { display: contents; }
#poster { position: absolute; inset: 0; width: 100%; height: 100%; object-fit: contain; }
#picture {
  position: absolute; inset: 0; width: 100%; height: 100%; touch-action: pan-y; cursor: grab;
  outline-offset: -3px; opacity: 0; transition: opacity 0.2s;
}
:host(:focus-within) #picture { touch-action: none; }
#picture.shown { opacity: 1; }
#picture:active { cursor: grabbing; }
#picture.picks { cursor: crosshair; }
.unseen { position: absolute; width: 1px; height: 1px; overflow: hidden; clip-path: inset(50%); }
:is(a, button, select, input, #picture):focus-visible {
  outline: 2px solid var(--accent); outline-offset: 1px;
}
#picture:focus-visible { outline-offset: -3px; }

#panel, #structures, #views, #hint, #status, #choose, dialog, #compass, #scale {
  background: var(--panel); border: 1px solid var(--line); border-radius: 10px;
}
:host([controls="none"])
  :is(#panel, #structures, #views, #hint, #compass, #scale, #under, #planes, #notes) {
  display: none;
}
#panel, #structures {
  position: absolute; top: 12px; left: 12px; width: 272px; max-height: calc(100% - 24px);
  max-width: calc(100% - 24px); overflow: auto; backdrop-filter: blur(10px);
}
#structures { left: auto; right: 12px; width: 312px; max-height: calc(100% - 132px); }
aside header { display: flex; align-items: center; gap: 8px; padding: 0 0 0 12px; }
:is(#panel, #structures):has(> div[hidden]) { width: auto; }
::slotted([slot="about"]) {
  max-width: 24em; margin: 0; padding: 0 12px 8px; font-size: 12px; color: var(--dim);
}
::slotted([slot="about"]:empty) { display: none; }
aside h2 {
  flex: 1; margin: 0; font-size: 14px; font-weight: 600; overflow: hidden; white-space: nowrap;
  text-overflow: ellipsis;
}
#settings, #parts { padding: 2px 12px 12px; display: grid; gap: 6px; }
dl { display: grid; grid-template-columns: auto 1fr; gap: 2px 12px; margin: 0; }
dt { color: var(--dim); }
dd { margin: 0; text-align: right; font-variant-numeric: tabular-nums; overflow-wrap: anywhere; }
#tones, #states, #cuts { display: grid; gap: 6px; }
label {
  display: flex; justify-content: space-between; align-items: center; gap: 8px; min-height: 44px;
}
label.check { justify-content: flex-start; }
input[type="checkbox"] {
  accent-color: var(--accent); width: 24px; height: 24px; margin: 0; flex: none;
}
select, button, input[type="color"], #find {
  font: inherit; color: inherit; background: transparent; border: 1px solid var(--line);
  border-radius: 6px; min-height: 44px; min-width: 44px; padding: 2px 8px;
}
select { background: var(--panel); min-width: 96px; }
option { color: #1c2026; background: #fff; }
input[type="color"] { width: 96px; padding: 2px; }
input[type="range"] { width: 120px; height: 44px; accent-color: var(--accent); }
button { cursor: pointer; }
button:hover { border-color: var(--accent); }
button[aria-pressed="true"] { background: var(--accent); color: var(--pressed); }
.fold { border-color: transparent; padding: 0; font-size: 20px; }
.buttons { display: grid; grid-template-columns: 1fr 1fr; gap: 6px; }
.buttons button { padding: 2px 4px; }

#shown { color: var(--dim); font-weight: 400; }
#find { min-width: 0; }
#list { list-style: none; margin: 0; padding: 0; display: grid; gap: 4px; }
#list li { display: grid; grid-template-columns: 44px 1fr 44px auto; gap: 4px; }
#list label { display: grid; gap: 0; grid-template-columns: minmax(0, 1fr); }
#list span { overflow: hidden; white-space: nowrap; text-overflow: ellipsis; }
#list i {
  display: inline-block; width: 10px; height: 10px; margin-right: 6px; border-radius: 50%;
  border: 1px solid var(--line);
}
#list input[type="range"] { width: 100%; min-width: 0; height: 28px; margin: 0; }
@media (pointer: coarse) { #list input[type="range"] { height: 44px; } }
#list input[type="color"] { width: 44px; }
#list .off :is(span, input) { opacity: 0.6; }
.eye[aria-pressed] {
  background: transparent; color: inherit; border-color: transparent; padding: 0;
}
.eye svg { width: 24px; height: 24px; fill: none; stroke: currentcolor; stroke-width: 1.8; }
.eye[aria-pressed="true"] .slash { display: none; }
.eye[aria-pressed="false"] { color: var(--dim); }

#compass {
  position: absolute; right: 16px; bottom: 16px; width: 92px; height: 92px; border-radius: 50%;
  pointer-events: none;
}
#compass span {
  position: absolute; transform: translate(-50%, -50%); font-weight: 600; font-size: 12px;
  min-width: 24px; line-height: 24px; text-align: center; pointer-events: auto; cursor: pointer;
  border-radius: 50%;
}
#compass span:hover { background: var(--line); }
#scale {
  position: absolute; right: 124px; bottom: 16px; padding: 2px 6px 6px; text-align: center;
  pointer-events: none;
}
#under {
  position: absolute; left: 16px; bottom: 16px; font-variant-numeric: tabular-nums;
  pointer-events: none; color: var(--dim); text-shadow: 0 0 4px var(--panel), 0 0 2px var(--panel);
}
#scale i { display: block; border: 2px solid currentcolor; border-top: 0; height: 6px; }
#lines, #notes {
  position: absolute; inset: 0; width: 100%; height: 100%; pointer-events: none; overflow: hidden;
}
#lines line { stroke: var(--ink); stroke-width: 2; paint-order: stroke; }
#lines circle { fill: var(--accent); stroke: #000; }
.note {
  position: absolute; left: 0; top: 0; max-width: 240px; pointer-events: auto;
  background: var(--panel); border-radius: 22px; transition: opacity 0.2s; touch-action: none;
}
.note::before {
  content: ''; position: absolute; left: -5px; top: -5px; width: 10px; height: 10px;
  border-radius: 50%; background: var(--accent); border: 1px solid #000;
}
.note.left::before { left: auto; right: -5px; }
.note.above::before { top: auto; bottom: -5px; }
.note:focus-within { z-index: 1; }
.note:is(.behind, .crowded):not(:focus-within) { pointer-events: none; background: none; }
.note.behind:not(:focus-within), .note.crowded:not(:focus-within) > * { opacity: 0; }
.note button { border: 0; border-radius: 22px; padding: 2px 14px; text-align: left; }
.note p { margin: 0; padding: 0 14px 10px; }
#cross {
  position: absolute; inset: 0; margin: auto; width: 24px; height: 24px; pointer-events: none;
  background: linear-gradient(var(--accent) 0 0) 50% / 2px 100% no-repeat,
    linear-gradient(var(--accent) 0 0) 50% / 100% 2px no-repeat;
}

#views {
  position: absolute; bottom: 16px; left: 50%; transform: translateX(-50%); display: flex;
  width: min(460px, calc(100% - 24px)); max-height: 40%; gap: 8px;
  padding: 8px; backdrop-filter: blur(10px); touch-action: pan-y;
}
#views div { flex: 1; overflow: auto; touch-action: pan-y; }
#views button { flex: none; align-self: flex-end; font-size: 22px; }
#title { font-weight: 600; color: inherit; display: inline-block; padding: 10px 0; }
#count { color: var(--dim); }
#text { margin: 0; }
a { color: var(--accent); }
#status, #choose {
  position: absolute; bottom: 12px; left: 50%; transform: translateX(-50%); margin: 0;
  max-width: min(560px, calc(100% - 24px)); padding: 8px 14px; z-index: 1;
  max-height: calc(100% - 24px); overflow: auto; width: max-content;
}
#views:not([hidden]) ~ #status:not(.wrong) { bottom: auto; top: 12px; }
#hint {
  position: absolute; top: 64%; left: 50%; transform: translateX(-50%); margin: 0;
  padding: 8px 14px; width: max-content; max-width: calc(100% - 24px); text-align: center;
  pointer-events: none; animation: appear 0.6s 1s both;
}
@keyframes appear { from { opacity: 0; } }
#status:empty { display: none; }
#status.wrong { border-color: #ff6b5e; bottom: auto; top: 50%; transform: translate(-50%, -50%); }
dialog {
  max-width: min(560px, calc(100% - 24px)); max-height: 80%; color: var(--ink);
  backdrop-filter: blur(14px);
}
dialog h2 { margin: 0 0 10px; font-size: 16px; }
dialog dd { text-align: left; }
#facts-list { display: contents; }
dialog form { margin-top: 14px; text-align: right; }

@container (min-width: 521px) and (max-width: 1110px) {  /* the panel ends above #views */
  #views { max-height: min(40%, 104px); }
  #panel:has(~ #views:not([hidden])) { max-height: calc(100% - 132px); }
}
@container (min-width: 641px) and (max-width: 1000px) {  /* free of #views */
  #scale { right: 16px; bottom: 116px; }
  #views { width: min(460px, calc(100% - 240px)); }
}
@container (max-width: 640px) {
  #under { display: none; }
  #structures { top: 68px; left: 12px; right: auto; max-height: calc(100% - 188px); }
  #scale { bottom: auto; top: 20px; right: 116px; }
  #compass { top: 12px; right: 12px; bottom: auto; }
}
@container (max-width: 520px) {
  #panel, #structures { max-width: calc(100% - 128px); }
  #scale { top: 112px; right: 12px; }
  :is(#panel, #structures):not(:has(> div[hidden])) {
    top: auto; bottom: 8px; left: 8px; right: 8px; width: auto; max-width: none; max-height: 60%;
    z-index: 1;
  }
  #structures:not(:has(> div[hidden])) { max-height: 42%; }
}
@media print {  /* the picture, then the title, the caption, and what is said of the data */
  :host { --ink: #000; --dim: #333; container-type: normal; height: auto; overflow: visible; }
  [lang] > :not(#picture, #panel, #views), :is(#panel, #views) :is(button, #settings, #count) {
    display: none;
  }
  #picture { position: static; height: auto; max-height: 88vh; object-fit: contain; opacity: 1; }
  #panel, #views {
    position: static; transform: none; width: auto; max-width: none; max-height: none; border: 0;
    background: none; backdrop-filter: none; padding: 0;
  }
  aside header { padding: 8px 0 0; }
  ::slotted([slot="about"]) { padding: 0; max-width: none; }
  #views #title { padding: 8px 0 0; }
}${kHandleStyle}`;
