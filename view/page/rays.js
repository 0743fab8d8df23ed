// Which tiles of level 0 a view needs first, found without the graphics card: its programs may not
// be compiled yet. The shader finds all that a picture needs.

const kAcross = 64;  // rays across the picture

// Where a ray of direction `d` meets the unit sphere around the origin: [entry, exit].
function meet(eye, d) {
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const d2 = dot(d, d), nearest = -dot(eye, d) / d2;
  const offset = eye.map((v, i) => v + nearest * d[i]);
  const rest = 1 - dot(offset, offset), half = Math.sqrt(rest / d2);
  if (!(rest > 0) || nearest + half <= 0) return undefined;
  return [-half, half].map((t) => offset.map((v, i) => v + t * d[i]));
}

const octant = (d) => (d[0] < 0 ? 1 : 0) | (d[1] < 0 ? 2 : 0) | (d[2] < 0 ? 4 : 0);

// The section that owns the vertex nearest to a direction, of the three around it: that with the
// greatest weight.
function nearestSection({entrySide: n, tables, rowBase, rowBits}, d) {
  const a = d.map(Math.abs), sum = a[0] + a[1] + a[2];
  const x = n * a[0] / sum, y = n * a[1] / sum;
  const bx = Math.min(Math.floor(x), n - 1), by = Math.min(Math.floor(y), n - 1 - bx);
  const fx = x - bx, fy = y - by, inverted = fx + fy > 1 && bx + by < n - 1;
  const weights = inverted ? [fx + fy - 1, 1 - fx, 1 - fy] : [1 - fx - fy, fx, fy];
  const k = weights.indexOf(Math.max(...weights));
  const px = bx + (inverted !== (k === 1) ? 1 : 0), py = by + (inverted !== (k === 2) ? 1 : 0);
  return tables[rowBase[0] + (octant(d) * (n + 1) + py) * (n + 1) + px] >> rowBits;
}

// The pages of the tile of each ray that matters most.
export function firstTiles(shape, camera, width, height) {
  const {eye, forward, right, down, half} = camera.axes(width, height);
  const pages = new Set(), step = 2 / kAcross;
  for (let v = -1 + step / 2; v < 1; v += step)
    for (let u = -1 + step / 2; u < 1; u += step) {
      const ray = meet(eye, forward.map(
        (f, i) => f + half * (u * width / height * right[i] + v * down[i])));
      // The exit sections of level 0 are the octants.
      if (ray) pages.add(shape.pageBase[0] + nearestSection(shape, ray[0]) * 8 + octant(ray[1]));
    }
  return pages;
}
