// The editor of a transfer function: points of colour and opacity over the histogram. A function
// is the JSON that slf reads (ParaView's): `Points` has a value, an opacity, a midpoint and a
// sharpness of each, `RGBPoints` a value and a colour. Here a point has both.

export const hex = (color) =>
  '#' + color.map((c) => Math.round(255 * c).toString(16).padStart(2, '0')).join('');
export const rgb = (text) =>
  [1, 3, 5].map((i) => Number((parseInt(text.slice(i, i + 2), 16) / 255).toFixed(4)));
const mix = (a, b, t) => a + t * (b - a);
const short = (v) => String(Number(v.toPrecision(5)));

// The value of a list of [value, ...] at v, linear between its entries.
function at(list, v) {
  const after = list.findIndex((one) => one[0] > v);
  if (after === 0 || list.length === 1) return list[0].slice(1);
  if (after < 0) return list.at(-1).slice(1);
  const [a, b] = [list[after - 1], list[after]], t = (v - a[0]) / (b[0] - a[0]);
  return a.slice(1).map((x, i) => mix(x, b[i + 1], t));
}
const grouped = (flat, n) =>
  Array.from({length: flat.length / n}, (_, i) => flat.slice(n * i, n * i + n));

// {value, opacity, color} of each value at which the function has a point.
function pointsOf(fn) {
  const colors = grouped(fn.RGBPoints, 4);
  const opacities = grouped(fn.Points, 4).map(([v, o]) => [v, o]);
  const values = [...new Set([...colors, ...opacities].map(([v]) => v))].sort((a, b) => a - b);
  return values.map((value) => (
    {value, opacity: at(opacities, value)[0], color: at(colors, value)}));
}

export class Curve {
  // `changed(function, moving)` is called after each change.
  constructor(canvas, list, add, changed) {
    Object.assign(this, {canvas, list, changed, points: [], chosen: -1});
    add.onclick = () => this.insert((this.low + this.high) / 2);
    canvas.onpointerdown = (event) => this.press(event);
    canvas.ondblclick = (event) => this.insert(this.place(event).value, this.place(event).opacity);
  }

  show(fn, histogram) {
    this.rest = {...fn};
    this.histogram = histogram;
    this.points = pointsOf(fn);
    this.chosen = Math.min(this.chosen, this.points.length - 1);
    this.fit();
    this.draw();
    this.tell();
  }
  // The values that the canvas shows: those of the volume, as far as points are, or nearly.
  fit() {
    const values = this.points.map((p) => p.value), {low, high} = this.histogram;
    const first = Math.min(...values), last = Math.max(...values), span = last - first || 1;
    this.low = Math.max(Math.min(low, first), first - 0.6 * span);
    this.high = Math.min(Math.max(high, last), last + 0.6 * span);
  }
  get function() {
    return {...this.rest, Name: 'studio',
            Points: this.points.flatMap((p) => [p.value, p.opacity, 0.5, 0]),
            RGBPoints: this.points.flatMap((p) => [p.value, ...p.color])};
  }
  stretch(low, high) {
    const first = this.points[0].value, span = this.points.at(-1).value - first || 1;
    for (const p of this.points) p.value = low + (p.value - first) / span * (high - low);
    this.fit();
    this.edited(false);
  }

  // ---- by pointer ---------------------------------------------------------------------------

  place(event) {
    const {width, height, left, top} = this.canvas.getBoundingClientRect();
    const x = Math.min(Math.max((event.clientX - left) / width, 0), 1);
    const y = Math.min(Math.max((event.clientY - top) / height, 0), 1);
    return {value: mix(this.low, this.high, x), opacity: 1 - y};
  }
  press(event) {
    const here = this.place(event), {width, height} = this.canvas.getBoundingClientRect();
    const away = (p) => Math.hypot((p.value - here.value) / (this.high - this.low) * width,
                                   (p.opacity - here.opacity) * height);
    const near = this.points.reduce((a, b) => away(b) < away(a) ? b : a);
    if (away(near) > 18) return;
    this.chosen = this.points.indexOf(near);
    this.canvas.setPointerCapture(event.pointerId);
    const before = this.points[this.chosen - 1]?.value ?? -Infinity;
    const after = this.points[this.chosen + 1]?.value ?? Infinity;
    let moves = false;
    this.canvas.onpointermove = (moved) => {
      const {value, opacity} = this.place(moved);
      near.value = Math.min(Math.max(value, before), after);
      near.opacity = opacity;
      this.edited(moves = true);
    };
    this.canvas.onpointerup = this.canvas.onpointercancel = () => {
      this.canvas.onpointermove = this.canvas.onpointerup = null;
      if (moves) this.edited(false);
    };
    this.draw();
    this.tell();
  }
  insert(value, opacity) {
    const {Points, RGBPoints} = this.function;
    const opacities = grouped(Points, 4).map(([v, o]) => [v, o]);
    const point = {value, opacity: opacity ?? at(opacities, value)[0],
                   color: at(grouped(RGBPoints, 4), value)};
    this.points.push(point);
    this.points.sort((a, b) => a.value - b.value);
    this.chosen = this.points.indexOf(point);
    this.edited(false);
  }
  edited(moving) {
    this.draw();
    if (!moving) this.tell();
    this.changed(this.function, moving);
  }

  draw() {
    const {canvas, points, low, high, histogram} = this;
    if (canvas.clientWidth > 0) canvas.width = 2 * canvas.clientWidth;  // circles stay circles
    const {width, height} = canvas;
    const pen = canvas.getContext('2d'), ink = getComputedStyle(canvas).color;
    const x = (v) => (v - low) / (high - low) * width, y = (o) => (1 - o) * (height - 16) + 8;
    pen.clearRect(0, 0, width, height);
    const {counts} = histogram, step = (histogram.high - histogram.low) / counts.length || 1;
    const most = Math.log1p(Math.max(...counts));
    pen.fillStyle = ink;
    pen.globalAlpha = 0.28;
    counts.forEach((count, i) => {
      const tall = Math.log1p(count) / most * (height - 16);
      pen.fillRect(x(histogram.low + i * step), height - tall, Math.max(1, x(low + step)), tall);
    });
    pen.globalAlpha = 1;
    const shade = pen.createLinearGradient(0, 0, width, 0);
    for (const p of points)
      shade.addColorStop(Math.min(Math.max(x(p.value) / width, 0), 1), hex(p.color));
    pen.beginPath();
    pen.moveTo(0, y(points[0].opacity));
    for (const p of points) pen.lineTo(x(p.value), y(p.opacity));
    pen.lineTo(width, y(points.at(-1).opacity));
    for (const [line, wide] of [[ink, 9], [shade, 5]]) {  // white shows on white, too
      Object.assign(pen, {strokeStyle: line, lineWidth: wide});
      pen.stroke();
    }
    points.forEach((p, i) => {
      pen.beginPath();
      pen.arc(x(p.value), y(p.opacity), i === this.chosen ? 13 : 10, 0, 7);
      pen.fillStyle = hex(p.color);
      pen.fill();
      pen.lineWidth = 3;
      pen.strokeStyle = ink;
      pen.stroke();
    });
  }

  // ---- by keyboard: numbers of each point ------------------------------------------------------

  tell() {
    this.list.replaceChildren(...this.points.map((p, i) => {
      const row = document.createElement('div');
      const field = (type, value, label, set) => {
        const input = Object.assign(document.createElement('input'), {type, value, step: 'any'});
        input.setAttribute('aria-label', `${label} of point ${i + 1}`);
        input.onchange = () => { set(input.value); this.edited(false); };
        input.onfocus = () => { this.chosen = i; this.draw(); };
        return input;
      };
      const number = (text, otherwise) =>
        Number.isFinite(parseFloat(text)) ? parseFloat(text) : otherwise;
      const remove = Object.assign(document.createElement('button'), {textContent: '×'});
      remove.setAttribute('aria-label', `Remove point ${i + 1}`);
      remove.disabled = this.points.length < 2;
      remove.onclick = () => { this.points.splice(i, 1); this.edited(false); };
      row.append(
        field('number', short(p.value), 'Value', (text) => {
          p.value = number(text, p.value);
          this.points.sort((a, b) => a.value - b.value);
          this.fit();
        }),
        field('number', short(p.opacity), 'Opacity', (text) => {
          p.opacity = Math.min(Math.max(number(text, p.opacity), 0), 1);
        }),
        field('color', hex(p.color), 'Colour', (text) => { p.color = rgb(text); }), remove);
      return row;
    }));
  }
}
