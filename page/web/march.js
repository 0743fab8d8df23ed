// The part of the shaders that cuts need (doc/cut.md): which samples planes leave, and marching
// rays through the reveal, as the ray-caster of slf does.

export const kMaxPlanes = 12;  // of a view, and those that the field was built with
export const kCaps = ['hollow', 'shaded', 'slice'];
export const kCutTextures = ['uVoxels', 'uRows', 'uLeaps', 'uMatters', 'uMean', 'uChange', 'uTint'];

export const kMarch = `
precision highp sampler3D;
uniform int uViewPlanes, uPlanes;       // of the view, which come first; in all
uniform vec4 uPlane[${kMaxPlanes}];     // inwards, in radii: what is below 0 is removed
uniform float uVoxelsAway[${kMaxPlanes}];  // voxels across a plane in a radius
uniform int uCap;                       // of kCaps
uniform vec2 uWindow;                   // of a slice, as values of uVoxels: black and white
uniform float uMatter;                  // what a slice shows is above
uniform vec3 uDims;                     // voxels
uniform mat3 uToIndex, uGradient;       // from radii to voxels; from gradients to the world
uniform vec3 uIndexOrigin;              // the sphere's centre, in voxels
uniform float uUnits;                   // of extinction, in a radius
uniform float uSurface;                 // see RayGrid::inverse_gradient_floor
uniform sampler3D uVoxels, uRows, uLeaps, uMean, uChange, uTint;
uniform sampler3D uMatters;             // the table: three texels an entry
uniform bool uHasRows, uLabels, uShade, uLights, uLinear;
uniform int uEntries, uLightCount;      // entries of a row
uniform vec2 uToEntry;                    // from values of uVoxels to entries
uniform float uAmbient;
uniform vec3 uToLight;                  // of direct light
uniform vec3 uIrradiance[3];            // of lights, and where they are, in radii: if uNear is 0,
uniform vec3 uDirection[3], uPlace[3];  // infinitely far
uniform float uNear[3];
// Light if nothing is in the way: of faces, and of what is far from planes.
uniform vec3 uOpenMean[2], uOpenChange[2], uOpenTint[2], uOpenArrives[2];
uniform vec3 uLightLow, uLightDims;     // in voxels; nodes
uniform float uLightSpacing;

vec2 part_ = vec2(0, 1);  // of the chord, that planes leave
bool divided = false;     // whether matter on a chord must be marched
bool sliced = false;      // whether march() met a slice

// The part of the chord from P to Q that the first so many planes leave; .x > .y: nothing.
vec2 leftBy(int planes, vec3 P, vec3 V) {
  vec2 part = vec2(0, 1);
  for (int k = 0; k < planes; ++k) {
    float at = dot(uPlane[k].xyz, P) + uPlane[k].w, rate = dot(uPlane[k].xyz, V);
    if (rate > 0.0) part.x = max(part.x, -at / rate);
    else if (rate < 0.0) part.y = min(part.y, -at / rate);
    else if (at < 0.0) part.y = -1.0;
  }
  if (dot(uEye, uEye) < 1.0) part.x = max(part.x, dot(uEye - P, V) / dot(V, V));
  return part;
}

float valueAt(vec3 p) { return texture(uVoxels, (p + 0.5) / uDims).r; }
int rowAt(vec3 p) {
  if (!uHasRows) return 0;
  ivec3 nearest = clamp(ivec3(p + 0.5), ivec3(0), ivec3(uDims) - 1);
  return int(texelFetch(uRows, nearest, 0).r * 255.0 + 0.5) * uEntries;
}
vec4 matter(int entry, int k) {
  int at = 3 * entry + k;
  return texelFetch(uMatters, ivec3(at & 255, at >> 8 & 255, at >> 16), 0);
}

// The normal (world) times how far this is a surface, as NormalFinder has it.
vec3 normalAt(vec3 p, vec3 radii, bool smooth_) {
  vec2 e = vec2(1, 0);
  vec3 g = vec3(valueAt(p + e.xyy) - valueAt(p - e.xyy), valueAt(p + e.yxy) - valueAt(p - e.yxy),
                valueAt(p + e.yyx) - valueAt(p - e.yyx));
  vec3 n = uGradient * (g * (uLabels ? -0.5 : -127.5));
  float size = length(n) + 1e-15;
  n *= (smooth_ ? 1.0 - exp(-size * uSurface) : min(1.0, size * uSurface)) / size;
  vec3 high = uDims - 1.0 - p, below = min(p, high);
  for (int k = 0; k < 3; ++k) {
    float share = clamp(1.0 - below[k], 0.0, 1.0);
    if (share > 0.0 && smooth_)
      n = mix(n, (p[k] < high[k] ? -1.0 : 1.0) * normalize(uGradient[k]), share);
  }
  for (int k = 0; k < uPlanes; ++k) {
    float under = (dot(uPlane[k].xyz, radii) + uPlane[k].w) * uVoxelsAway[k];
    n = mix(n, -uPlane[k].xyz, clamp(1.0 - under, 0.0, 1.0));
  }
  return n;
}

struct Arriving {
  vec3 mean, change, tint, arrives;
};
// What of it matter with a normal times the share of a surface scatters.
vec3 scattered(Arriving light, vec3 n, vec3 radii) {
  vec3 sum = max(light.mean + dot(light.change, n) * light.tint, 0.0);
  float s = length(n);
  for (int l = 0; l < uLightCount; ++l) {
    vec3 to = uDirection[l], rgb = uIrradiance[l];
    if (uNear[l] > 0.0) {
      vec3 away = uPlace[l] - radii;
      float apart = length(away), ratio = uNear[l] / apart;
      rgb *= max(dot(away, to), 0.0) / apart * ratio * ratio;
      to = away / apart;
    }
    float kernel = max(dot(to, n), 0.0) / 3.14159265 + (1.0 - s) / 12.5663706;
    sum += light.arrives[l] * kernel * rgb;
  }
  return sum;
}
// The colour of lit matter.
vec3 shaded(int entry, vec3 p, vec3 radii) {
  vec3 color = matter(entry, 0).rgb;
  if (uLightCount < 0) {  // direct
    if (!uShade) return color;
    vec3 n = normalAt(p, radii, false);
    float s = length(n), lambert = max(dot(n, uToLight), 0.0) / max(s, 1e-6);
    return color * (1.0 - (1.0 - uAmbient) * (1.0 - lambert) * s);
  }
  vec4 albedo = matter(entry, 1);
  vec3 n = normalAt(p, radii, true);
  float known = 0.0, under = 1e9;
  for (int k = 0; k < uPlanes; ++k)
    under = min(under, (dot(uPlane[k].xyz, radii) + uPlane[k].w) * uVoxelsAway[k]);
  vec3 lit = vec3(0);
  if (uLights) {
    vec3 surface = albedo.w * n, aside = surface * uGradient;
    vec3 at = (p - uLightLow) / uLightSpacing +
              0.5 * length(surface) * aside / max(length(aside), 1e-6);
    at = (at + 0.5) / uLightDims;
    vec4 mean = texture(uMean, at), change = texture(uChange, at), tint = texture(uTint, at);
    known = mean.a;
    vec4 rest = vec4(change.xyz, 0) / max(known, 1e-3);
    vec2 hue = tint.rg / max(known, 1e-3);
    float green = (1.0 - 0.2126 * hue.x - 0.0722 * hue.y) / 0.7152;
    lit = mix(albedo.rgb, color, length(surface)) * scattered(
      Arriving(mean.rgb / max(known, 1e-3), rest.xyz, vec3(hue.x, green, hue.y),
               vec3(change.a, tint.ba) / max(known, 1e-3)), surface, radii);
  }
  if (known > 0.99) return lit;
  n /= max(length(n), 1e-3);
  vec3 open[2];
  for (int k = 0; k < 2; ++k)
    open[k] = color * scattered(
      Arriving(uOpenMean[k], uOpenChange[k], uOpenTint[k], uOpenArrives[k]), n, radii);
  return mix(mix(open[0], open[1], clamp(under, 0.0, 1.0)), lit, known);
}

// Marches the chord through the reveal. t: where it meets something, or below 0.
vec4 march(vec3 P, vec3 Q, bool lights, out float t) {
  vec3 V = Q - P, a = uToIndex * P + uIndexOrigin, d = uToIndex * V;
  vec2 part = leftBy(uPlanes, P, V);
  float face = part.x;
  t = -1.0;
  vec3 inverse = 1.0 / mix(d, vec3(1e-9), lessThan(abs(d), vec3(1e-9)));
  vec3 t0 = -a * inverse, t1 = (uDims - 1.0 - a) * inverse, near = min(t0, t1), far = max(t0, t1);
  part.x = max(part.x, max(near.x, max(near.y, near.z)));
  part.y = min(part.y, min(far.x, min(far.y, far.z)));
  if (part.x >= part.y) return vec4(0);
  if (uCap == 2 && face >= part.x) {
    vec3 p = a + face * d;
    float value = valueAt(p);
    int row = rowAt(p);
    if (uLabels ? matter(row, 2).g > 0.0 : value > uMatter) {
      t = face;
      sliced = true;
      vec3 grey = vec3(clamp((value - uWindow.x) / (uWindow.y - uWindow.x), 0.0, 1.0));
      if (uLinear && !uLabels)
        grey = mix(pow((grey + 0.055) / 1.055, vec3(2.4)), grey / 12.92,
                   lessThanEqual(grey, vec3(0.04045)));
      return vec4(uLabels ? matter(row, 0).rgb : grey, 1);
    }
  }
  float units = length(V) * uUnits, step_ = 0.5 / units, at = part.x, place = 0.0, left = 1.0;
  float before = -1.0;  // the value at \`at\`
  vec3 sum = vec3(0), light = vec3(0);
  for (int k = 0; k < 2048 && at < part.y && left > 1.0 / 256.0; ++k) {
    vec3 p = a + at * d;
    ivec3 brick = clamp(ivec3(p + 1e-3 * sign(d)), ivec3(0), ivec3(uDims) - 2) >> 1;
    int empty = int(texelFetch(uLeaps, brick, 0).r * 255.0 + 0.5);
    if (empty > 0) {
      vec3 low = vec3(2 * (brick - empty + 1)), high = vec3(2 * (brick + empty));
      vec3 leaves = (mix(low, high, greaterThan(d, vec3(0))) - a) * inverse;
      at = max(at + 0.01 * step_, min(leaves.x, min(leaves.y, leaves.z)));
      before = -1.0;
      continue;
    }
    float next = min(at + step_, part.y);
    if (uHasRows) {  // to the next place where another voxel is the nearest, or its centre
      vec3 faces = (floor(2.0 * p + 2e-3 * sign(d)) + step(0.0, d)) / 2.0;
      vec3 leaves = (faces - a) * inverse;
      next = min(next, max(at + 0.01 * step_, min(leaves.x, min(leaves.y, leaves.z))));
    }
    int row = rowAt(a + 0.5 * (at + next) * d);
    float from = before, to = valueAt(a + next * d);
    if (from < 0.0) from = valueAt(p);
    before = to;
    vec2 x = uLabels ? vec2(0) : clamp(vec2(from, to) * uToEntry.x + uToEntry.y, 0.0,
                                       float(uEntries - 1));
    ivec2 e = ivec2(x);
    vec4 m0 = matter(row + e.x, 0), m1 = matter(row + e.y, 0);
    float change = x.y - x.x, mean = 0.5 * (m0.a + m1.a);
    if (abs(change) >= 1.0)
      mean = (matter(row + e.y, 2).r + (x.y - float(e.y)) * m1.a - matter(row + e.x, 2).r -
              (x.x - float(e.x)) * m0.a) / change;
    float through = exp(-mean * (next - at) * units), share = left * (1.0 - through);
    if (share > 1e-5) {
      // Where most of the matter is, as find_opacity() has it.
      float ratio = min(mean / max(max(m0.a, m1.a), 1e-20), 1.0);
      float rising = max(1.0 - ratio * 2.0 / 3.0, 5.0 / 6.0 - ratio / 3.0);
      float mass = m1.a > m0.a ? rising : 1.0 - rising, extent = min(2.0 * ratio, 1.0);
      float depth = min(mean * (next - at) * units, 8.0);
      float middle = mass - extent * depth * (1.0 / 12.0 - 0.0045 * depth);
      float where = mix(at, next, middle);
      if (lights && (share > 1e-3 || light == vec3(0)))
        light = shaded(row + clamp(int(x.x + middle * change + 0.5), 0, uEntries - 1),
                       a + where * d, P + where * V);
      sum += share * light;
      place += share * where;
      left *= through;
    }
    at = next;
  }
  if (left < 1.0) t = place / (1.0 - left);
  return left > 1.0 / 256.0 ? vec4(sum, 1.0 - left) : vec4(sum / (1.0 - left), 1);
}
`;
