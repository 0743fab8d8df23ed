// The shaders, which draw a view as doc/drawing.md defines it. Decoded tiles are in texture arrays.
// A page table gives the place of the tile of each pair of sections. Those for views through planes
// (`cuts`) have more, which takes drivers time.

import {kMarch} from './march.js';

export const kMaxLevels = 11;
export const kTableBits = 12;  // log2 of the width of the textures that hold tables

// Values of the page table. Values from kFirstSlot on are kFirstSlot plus the tile's slot.
export const kNotLoaded = 0, kEmpty = 1, kMissing = 2, kFirstSlot = 3;

export const kVertex = `#version 300 es
void main() {  // one triangle that covers the picture
  gl_Position = vec4(float(gl_VertexID & 1) * 4.0 - 1.0, float(gl_VertexID >> 1) * 4.0 - 1.0, 0, 1);
}`;

// What planes take of a sample, and what that makes of its ray, as cut_samples() of slf has it.
const kCutSample = `bool cut = tx < part_.x || tx > part_.y, is = color.a > 0.02;
        cutsAny = cutsAny || (cut && is);
        keepsAny = keepsAny || (is && !cut);
        precedes = precedes || (is && tx < part_.x);
        thin = thin || (is && color.a < 0.98);
        surface = surface || color.a >= 0.98;
        if (cut) color = vec4(0);`;
const kDivide = `bool crosses = part_.x > 0.0 || part_.y < 1.0;
    divided = uCap > 0 && (crosses ? thin || precedes || (cutsAny && keepsAny) : thin && !surface);
    if (divided) return kDone;`;
// Which rays planes leave nothing of, and which are marched.
const kChoose = `part_ = leftBy(uViewPlanes, P, Q - P);
  marches = meets && uCap > 0 && part_.x > 0.0 && part_.x < part_.y;
  meets = meets && !marches && part_.x < part_.y;`;

const common = (cubic, cuts) => `#version 300 es
const bool kCubic = ${cubic};  // whether pictures are interpolated by cubics; needs no other tiles
precision highp float;
precision highp int;
precision highp usampler2D;
precision highp sampler2DArray;

uniform vec3 uEye, uForward, uRight, uDown;  // in radii, from the sphere's centre
uniform vec2 uSize;                          // of the picture, in pixels
uniform int uLevel, uMode;                   // mode: 0 bitri, 1 depth
uniform int uEntrySide, uExitSide, uRowBits;
uniform int uRowBase[${kMaxLevels}], uPathBase[${kMaxLevels}], uPageBase[${kMaxLevels}];
uniform usampler2D uTables, uPages;
uniform sampler2DArray uColor, uDepth;
uniform int uTileBits, uTileHeight, uTilesPerLayer;  // a tile is 2^uTileBits texels wide
uniform bool uKeeps;       // whether uKept is a picture of this view
uniform sampler2D uKept;   // alpha: 1 where a pixel is final

int columns;  // of a tile
${cuts ? kMarch : ''}
uint table(int at) {
  return texelFetch(uTables, ivec2(at & ${(1 << kTableBits) - 1}, at >> ${kTableBits}), 0).r;
}

struct Cell {
  int octant;
  ivec2 base;
  bool inverted;
  vec3 weights;
};

Cell locate(vec3 d, int n) {
  vec3 a = abs(d);
  vec2 at = float(n) * a.xy / (a.x + a.y + a.z);
  Cell cell;
  cell.octant = (d.x < 0.0 ? 1 : 0) | (d.y < 0.0 ? 2 : 0) | (d.z < 0.0 ? 4 : 0);
  cell.base.x = min(int(at.x), n - 1);
  cell.base.y = min(int(at.y), n - 1 - cell.base.x);
  vec2 f = at - vec2(cell.base);
  cell.inverted = f.x + f.y > 1.0 && cell.base.x + cell.base.y < n - 1;
  cell.weights = cell.inverted ? vec3(f.x + f.y - 1.0, 1.0 - f) : vec3(1.0 - f.x - f.y, f);
  cell.weights = clamp(cell.weights, 0.0, 1.0);
  return cell;
}

ivec2 corner(Cell cell, int k) {
  ivec2 offset = k == 0 ? ivec2(0) : k == 1 ? ivec2(1, 0) : ivec2(0, 1);
  return cell.base + (cell.inverted ? ivec2(1) - offset : offset);
}

vec3 vertex(Cell cell, ivec2 p, int n) {
  vec3 v = vec3(p, n - p.x - p.y);
  if ((cell.octant & 1) != 0) v.x = -v.x;
  if ((cell.octant & 2) != 0) v.y = -v.y;
  if ((cell.octant & 4) != 0) v.z = -v.z;
  return normalize(v);
}

int triangle(int p, int q) { return q * (uExitSide + 1) - q * (q - 1) / 2 + p; }

// The exit section of a cell, and the local coordinates of its corners.
void exitCell(Cell cell, int level, out int section, out ivec2 local[3]) {
  int n = uExitSide;
  ivec2 s = cell.base / n, r = cell.base - s * n;
  bool inverted = r.x + r.y + (cell.inverted ? 1 : 0) >= n;
  int number = ((s.y << level) + s.x) * 2 + (inverted ? 1 : 0), last = (2 << (2 * level)) - 1;
  section = (cell.octant << (2 * level)) |
            int(table(uPathBase[level] + min(number, last - number)));
  int shift = 1;
  if (cell.inverted) r += 1;
  if (inverted) r = n - r;
  if (cell.inverted != inverted) shift = -1;
  local = ivec2[3](r, r + ivec2(shift, 0), r + ivec2(0, shift));
}

// The section that owns an entry vertex, and in the lowest uRowBits bits the vertex's row in its
// tiles.
int entryPlace(int level, Cell cell, ivec2 p) {
  int side = (uEntrySide << level) + 1;
  return int(table(uRowBase[level] + (cell.octant * side + p.y) * side + p.x));
}

int page(int level, int entry, int exit) {
  return uPageBase[level] + entry * (8 << (2 * level)) + exit;
}

// Whether local coordinates are those of a vertex of the section.
bool inside(ivec2 p) { return min(min(p.x, p.y), uExitSide - p.x - p.y) >= 0; }

ivec3 texel(int slot, int sample_) {
  int layer = slot / uTilesPerLayer;
  return ivec3(sample_ & ((1 << uTileBits) - 1),
               (sample_ >> uTileBits) + (slot - layer * uTilesPerLayer) * uTileHeight, layer);
}

vec4 colorAt(int slot, int row, ivec2 local) {
  return texelFetch(uColor, texel(slot, row + triangle(local.x, local.y)), 0);
}

const float kFaint = 1.0 / 255.0;
// The picture is complete; a tile is not loaded; a tile is missing from the field.
const int kDone = 0, kWaiting = 1, kUnavailable = 2;

// Draws the chord from P to Q at a level. first and last are the pages of the first and of the last
// round, plus 1. t is where the chord meets something; it is below 0 if it meets nothing, or if
// that is not known. If tiles are not loaded, draw() returns early, with the picture and t of the
// last complete round. In the first round it then uses the tiles that are loaded.
int draw(int level, vec3 P, vec3 Q, out vec4 pixel, out ivec3 first, out ivec3 last, out float t) {
  int entryN = uEntrySide << level, exitN = uExitSide << level;
  pixel = vec4(0);
  first = last = ivec3(0);
  Cell cell = locate(P, entryN);
  vec3 chord = Q - P, aim = vec3(0);
  float chord2 = dot(chord, chord);
  t = -1.0;
  float sharp = float(exitN) / 6.4;

  vec3 entry[3];
  ivec3 section, row;
  // Of the last round. An exit cell has the corners (x, y), (x + z, y), (x, y + z) in slot w.
  vec4 low, high;
  ivec4 exits[3] = ivec4[3](ivec4(-1), ivec4(-1), ivec4(-1));
  vec3 weights[3], agreements = vec3(0);
  float total;
  bool cubic = false;
  for (int e = 0; e < 3; ++e) {
    ivec2 p = corner(cell, e);
    entry[e] = vertex(cell, p, entryN);
    int place = entryPlace(level, cell, p);
    section[e] = place >> uRowBits;
    row[e] = (place & ((1 << uRowBits) - 1)) * columns;
  }

  for (int round_ = 0; round_ < 4; ++round_) {
    vec4 sum = vec4(0);
    float opacity = 0.0, position = 0.0;
    low = vec4(1e9), high = vec4(-1e9), total = 0.0;
    vec3 opacities = vec3(0), positions = vec3(0);
    int state = kDone;
    bool cutsAny = false, keepsAny = false, precedes = false, thin = false, surface = false;
    for (int e = 0; e < 3; ++e) {
      float we = cell.weights[e];
      if (we <= 0.0) low = min(low, 0.0), high = max(high, 0.0);
      if (we <= 0.0) continue;
      vec3 q = Q;
      if (round_ > 0) {
        vec3 v = P + aim[e] * chord - entry[e];
        float v2 = dot(v, v);
        q = v2 > 0.0 ? entry[e] - 2.0 * dot(entry[e], v) / v2 * v : entry[e];
      }
      Cell leave = locate(q, exitN);
      int exit;
      ivec2 local[3];
      exitCell(leave, level, exit, local);
      int at = page(level, section[e], exit);
      if (round_ == 0) first[e] = at + 1; else last[e] = at + 1;
      ivec2 place = ivec2(at & ${(1 << kTableBits) - 1}, at >> ${kTableBits});
      uint entry_ = texelFetch(uPages, place, 0).r;
      if (entry_ == ${kNotLoaded}u) state = max(state, kWaiting);
      if (entry_ == ${kMissing}u) state = kUnavailable;
      if (entry_ <= ${kNotLoaded}u || (state != kDone && round_ > 0)) continue;
      int slot = int(entry_) - ${kFirstSlot};
      vec3 along = vec3(dot(entry[e] - P, chord), dot(q - entry[e], chord), 0) / chord2;
      if (slot < 0) total += we, low = min(low, 0.0), high = max(high, 0.0);
      exits[e] = ivec4(local[0], local[1].x - local[0].x, slot);
      weights[e] = leave.weights;
      float agreement = 0.0;
      for (int x = slot < 0 ? 3 : 0; x < 3; ++x) {
        float wx = leave.weights[x];
        ivec3 from = texel(slot, row[e] + triangle(local[x].x, local[x].y));
        vec4 color = texelFetch(uColor, from, 0);
        float depth = 0.0;
        if (uMode == 1 && color.a > 0.0) depth = texelFetch(uDepth, from, 0).r;
        float tx = along.x + depth * along.y;
        ${cuts ? kCutSample : ''}
        low = min(low, color);
        high = max(high, color);
        opacities[e] += wx * color.a;
        positions[e] += wx * color.a * tx;
        float g = wx;
        if (round_ > 0) {
          float off = (tx - aim[e]) * sharp;
          g *= 1.0 - 0.9 * min(4.0 * color.a, 1.0) * min(off * off, 1.0);
        }
        agreement += g;
        sum += we * g * color;
      }
      total += we * agreement;
      agreements[e] = agreement;
      opacity += we * opacities[e];
      position += we * positions[e];
    }
    if (state != kDone) {
      if (round_ == 0 && total > 0.0) pixel = sum / total;
      if (round_ == 0 && opacity > kFaint) t = clamp(position / opacity, 0.0, 1.0);
      return state;
    }
    ${cuts ? kDivide : ''}
    vec4 before = pixel;
    pixel = round_ == 0 ? sum : sum / total;
    if (uMode == 0) return kDone;
    if (round_ == 0) {
      if (opacity <= kFaint) return kDone;
      t = clamp(position / opacity, 0.0, 1.0);
      aim = vec3(t);
      continue;
    }
    if (opacity > kFaint) t = clamp(position / opacity, 0.0, 1.0);
    vec3 next = vec3(0);
    float moved = 0.0;
    for (int e = 0; e < 3; ++e) {
      float own = opacities[e] > kFaint ? clamp(positions[e] / opacities[e], 0.0, 1.0) : t;
      next[e] = 0.5 * (t + own);
      if (cell.weights[e] > 0.0) moved = max(moved, abs(next[e] - aim[e]));
    }
    if (moved > float(entryN) / 4096.0) {
      if (round_ < 3) {
        aim = next;
        continue;
      }
      pixel = mix(pixel, before, 0.4);
    }
    vec3 contrast = high.rgb - low.rgb;
    cubic = kCubic && !cutsAny && max(contrast.r, max(contrast.g, contrast.b)) >= 0.1;
    break;
  }

  // What a cubic between the exit vertices differs from linear interpolation.
  vec4 bends = vec4(0);
  for (int e = cubic ? 0 : 3; e < 3; ++e) {
    int slot = exits[e].w;
    if (slot < 0) continue;
    ivec2 local[3] = ivec2[3](exits[e].xy, exits[e].xy + ivec2(exits[e].z, 0),
                              exits[e].xy + ivec2(0, exits[e].z));
    vec4 colors[3], linear = vec4(0);
    for (int x = 0; x < 3; ++x) {
      colors[x] = colorAt(slot, row[e], local[x]);
      linear += weights[e][x] * colors[x];
    }
    vec4 bent = linear;
    for (int i = 0; i < 3; ++i) {
      int j = (i + 1) % 3;
      ivec2 a = 2 * local[i] - local[j], b = 2 * local[j] - local[i];
      bool hasA = inside(a), hasB = inside(b);
      vec4 first_ = colors[j] - 2.0 * colors[i], second = colors[i] - 2.0 * colors[j];
      if (hasA) first_ += colorAt(slot, row[e], a);
      if (hasB) second += colorAt(slot, row[e], b);
      float wi = weights[e][i], wj = weights[e][j], s = wi / max(wi + wj, 1e-9);
      if (!hasA) first_ = hasB ? second : vec4(0);
      if (!hasB) second = hasA ? first_ : vec4(0);
      bent -= 0.625 * wi * wj * ((1.0 + s) * first_ + (2.0 - s) * second) / 3.0;
    }
    bends += cell.weights[e] * agreements[e] *
             (clamp(bent, min(colors[0], min(colors[1], colors[2])),
                    max(colors[0], max(colors[1], colors[2]))) - linear);
  }
  if (cubic) pixel = clamp(pixel + bends / total, min(low, pixel), max(high, pixel));
  return kDone;
}

// Where the pixel's line meets the sphere. Returns false if it misses, or if the sphere is behind
// the eye.
bool meet(vec2 at, out vec3 P, out vec3 Q) {
  vec3 d = uForward + (at.x - 0.5 * uSize.x) * uRight + (0.5 * uSize.y - at.y) * uDown;
  float d2 = dot(d, d), nearest = -dot(uEye, d) / d2;
  vec3 offset = uEye + nearest * d;
  float rest = 1.0 - dot(offset, offset);
  if (!(rest > 0.0)) return false;
  float half_ = sqrt(rest / d2);
  P = offset - half_ * d;
  Q = offset + half_ * d;
  return nearest + half_ > 0.0;
}
`;

export const kMaskScale = 12;  // level that 255 stands for in the mask; above kMaxLevels
export const kCurves = ['none', 'neutral', 'srgb'];

export const drawShader = (cuts) => common(true, cuts) + `
uniform vec3 uBackground;
uniform vec2 uScale;  // of the drawn part to the picture
uniform float uShown;     // the level that all cells show; below 0: uMask tells
uniform sampler2D uMask;  // the level that each cell shows, over ${kMaskScale}: 1.5 blends 1 and 2
uniform vec2 uCells;      // how many cells the picture has across and down
uniform int uCurve;   // of kCurves
uniform float uGain;
out vec4 result;

// Tone mapping of premultiplied linear radiance, as in slf/tone.h.
vec4 mapped(vec4 radiance, int curve, float gain) {
  if (curve == 0 || !(radiance.a > 0.0)) return radiance;
  vec3 color = max(radiance.rgb * (gain / radiance.a), 0.0);
  if (curve == 1) {
    const float kStart = 0.8 - 0.04, kDesaturation = 0.15, kRoom = 1.0 - kStart;
    float minChannel = min(color.r, min(color.g, color.b));
    color -= minChannel < 0.08 ? minChannel - 6.25 * minChannel * minChannel : 0.04;
    float peak = max(color.r, max(color.g, color.b));
    if (peak >= kStart) {
      float compressed = 1.0 - kRoom * kRoom / (peak + kRoom - kStart);
      float white = 1.0 - 1.0 / (kDesaturation * (peak - compressed) + 1.0);
      color = mix(color * (compressed / peak), vec3(compressed), white);
    }
  }
  color = min(color, 1.0);
  vec3 low = 12.92 * color, high = 1.055 * pow(color, vec3(1.0 / 2.4)) - 0.055;
  return vec4(radiance.a * mix(high, low, vec3(lessThanEqual(color, vec3(0.0031308)))), radiance.a);
}

${cuts ? `uniform int uMarchedCurve;  // as the field was built with
uniform float uMarchedGain;
vec4 marched(vec3 P, vec3 Q) {
  float t;
  vec4 pixel = march(P, Q, true, t);
  if (uLinear) return mapped(pixel, uCurve, uGain);
  return sliced ? pixel : mapped(pixel, uMarchedCurve, uMarchedGain);
}` : ''}
// The result's alpha is 1 where no tile of the level will change it.
// Software graphics take the time of branches that no pixel takes, but not that of loops.
void main() {
  columns = (uExitSide + 1) * (uExitSide + 2) / 2;
  vec4 before = texelFetch(uKept, ivec2(gl_FragCoord.xy), 0);
  bool kept = uKeeps && before.a == 1.0;
  vec3 P, Q;
  bool meets = meet(gl_FragCoord.xy * uScale, P, Q), marches = false;
  ${cuts ? kChoose : ''}
  float shown = texture(uMask, gl_FragCoord.xy * uScale / uSize * uCells).r * ${kMaskScale}.0;
  shown = uShown < 0.0 ? round(shown * 20.0) / 20.0 : uShown;
  vec4 pixel = vec4(0);
  float final_ = 1.0, rest = 1.0;  // rest: the weight that coarser levels still have
  for (int level = kept || !meets ? -1 : int(ceil(shown)); level >= 0 && rest > 0.0; --level) {
    ivec3 first, last;
    float t;
    vec4 color;
    int state = draw(level, P, Q, color, first, last, t);
    ${cuts ? 'if (marches = divided) break;' : ''}
    if (state == kWaiting && level <= uLevel) final_ = 0.0;
    if (state == kWaiting && uShown >= 0.0) break;  // the pixel will be drawn again
    if (state == kUnavailable || (state != kDone && level > 0)) continue;
    float weight = rest * min(1.0, shown - float(level) + 1.0);
    pixel += weight * color;
    rest -= weight;
  }
  pixel = mapped(pixel, uCurve, uGain);
  ${cuts ? 'if (marches && !kept) pixel = marched(P, Q);' : ''}
  result = kept ? before : vec4(pixel.rgb + (1.0 - pixel.a) * uBackground, final_);
}`;

// Records the tiles that some of the picture's rays need, but none of pixels that are final. Each
// pass chooses other rays. If a tile is missing from the field, the next coarser level is used, as
// when drawing. While tiles of a level are not loaded, a coarser level gives an estimate of where
// the chord meets something, and so of the tiles that the ray will need. A survey finds the finest
// level that has all tiles of a ray. A probe finds how far from the eye a ray meets something.
export const kTasks = {ask: 0, survey: 1, probe: 2};
export const feedbackShader = (cuts) => common(false, cuts) + `
const float kNeighbourOffset = 0.02;  // of the height of the picture
uniform vec2 uStep, uShift;
uniform int uTask;  // of kTasks
layout(location = 0) out uvec4 needed0;
layout(location = 1) out uvec4 needed1;

// The pages, plus 1, of the tiles that the ray needs if the chord meets something at t.
ivec3 guess(int level, vec3 P, vec3 Q, float t) {
  int n = uEntrySide << level;
  Cell cell = locate(P, n);
  ivec3 pages = ivec3(0);
  for (int e = 0; e < 3; ++e) {
    ivec2 p = corner(cell, e);
    vec3 from = vertex(cell, p, n), v = P + t * (Q - P) - from;
    float v2 = dot(v, v);
    if (cell.weights[e] <= 0.0 || v2 <= 0.0) continue;
    int exit;
    ivec2 local[3];
    exitCell(locate(from - 2.0 * dot(from, v) / v2 * v, uExitSide << level), level, exit, local);
    pages[e] = page(level, entryPlace(level, cell, p) >> uRowBits, exit) + 1;
  }
  return pages;
}

void main() {
  columns = (uExitSide + 1) * (uExitSide + 2) / 2;
  needed0 = needed1 = uvec4(0);
  vec3 P, Q;
  vec2 at = (floor(gl_FragCoord.xy) * uStep + uShift) + 0.5;
  bool asks = at.x < uSize.x && at.y < uSize.y && meet(at, P, Q), meets = asks, marches = false;
  ${cuts ? kChoose + 'asks = meets && !marches;' : ''}
  if (uKeeps && texelFetch(uKept, ivec2(at), 0).a == 1.0) asks = false;
  vec4 pixel;
  ivec3 first = ivec3(0), last = ivec3(0);
  float t;
  int level = asks ? uLevel : -1, state = kDone, reach = uLevel;
  for (; level >= 0; --level) {
    state = draw(level, P, Q, pixel, first, last, t);
    ${cuts ? 'if (marches = divided) break;' : ''}
    if (state == kWaiting) reach = level - 1;
    if (state == kDone || level == 0 || (state == kWaiting && uTask == 0)) break;
  }
  if (uTask == 2) {
    ${cuts ? 'if (marches) asks = true, pixel = march(P, Q, false, t);' : ''}
    float hit = t >= 0.0 && pixel.a >= 0.5 ? distance(uEye, P + t * (Q - P)) : -1.0;
    needed0 = floatBitsToUint(vec4(asks ? hit : -1.0));
    return;
  }
  needed0 = uvec4(first, reach + 1);
  needed1 = uvec4(last, 0);
  bool guesses = uMode == 1 && state == kWaiting && uTask == 0;
  bool corrects = last != ivec3(0);  // then the first tiles are loaded: the estimate replaces them
  // Edges lie elsewhere in the finer level, so the estimate comes from a nearby ray.
  vec3 P2 = P, Q2 = Q;
  int side = (int(gl_FragCoord.x) + 2 * int(gl_FragCoord.y)) % 5;
  float angle = 1.57 * float(side);
  vec2 aside = side == 0 ? vec2(0) : kNeighbourOffset * uSize.y * vec2(cos(angle), sin(angle));
  if (!meet(at + aside, P2, Q2)) P2 = P, Q2 = Q;
  for (int coarser = guesses ? level - 1 : -1; coarser >= 0; --coarser) {
    state = draw(coarser, P2, Q2, pixel, first, last, t);
    if (state == kUnavailable || (t < 0.0 && state == kWaiting)) continue;
    uvec3 pages = uvec3(t >= 0.0 ? guess(level, P, Q, t) : ivec3(0));
    if (t >= 0.0 && corrects) needed0.xyz = pages;
    if (t >= 0.0 && !corrects) needed1.xyz = pages;
    return;
  }
}`;

export const kFade = `#version 300 es
precision highp float;
uniform sampler2D uPicture;
uniform vec2 uSize, uDrawn;  // of the canvas; of the part of the picture that was drawn
uniform bool uSeeks;         // pixels that are not final
out vec4 result;
void main() {
  vec2 at = min(gl_FragCoord.xy / uSize * uDrawn, uDrawn - 0.5);
  result = texture(uPicture, at / vec2(textureSize(uPicture, 0)));
  if (uSeeks && result.a > 0.99) discard;
}`;
