// Vectors of colours, pixels and depths, for the kernels that blend.

// Included once per instruction set.
#if defined(SLF_FIELD_RENDER_BLEND_VECTORS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SLF_FIELD_RENDER_BLEND_VECTORS_INL_H_
#undef SLF_FIELD_RENDER_BLEND_VECTORS_INL_H_
#else
#define SLF_FIELD_RENDER_BLEND_VECTORS_INL_H_
#endif

#include <algorithm>

#include "field/render/render_vectors-inl.h"

HWY_BEFORE_NAMESPACE();
namespace slf {
namespace HWY_NAMESPACE {
namespace {

struct Colors {
  V r, g, b, a;

  static HWY_INLINE Colors none() {
    const V zero = hn::Zero(D());
    return {zero, zero, zero, zero};
  }
  HWY_INLINE Colors times(V t) const {
    return {hn::Mul(r, t), hn::Mul(g, t), hn::Mul(b, t), hn::Mul(a, t)};
  }
  HWY_INLINE Colors plus(V t, const Colors& c) const {
    return {hn::MulAdd(t, c.r, r), hn::MulAdd(t, c.g, g), hn::MulAdd(t, c.b, b),
            hn::MulAdd(t, c.a, a)};
  }
  HWY_INLINE Colors minus(const Colors& c) const {
    return {hn::Sub(r, c.r), hn::Sub(g, c.g), hn::Sub(b, c.b), hn::Sub(a, c.a)};
  }
};

/// The least and the greatest value of each channel.
struct ColorRange {
  Colors low, high;

  static HWY_INLINE ColorRange of(const Colors& c) { return {c, c}; }
  HWY_INLINE void add(const ColorRange& other) {
    const Colors &l = other.low, &h = other.high;
    low = {hn::Min(low.r, l.r), hn::Min(low.g, l.g), hn::Min(low.b, l.b), hn::Min(low.a, l.a)};
    high = {hn::Max(high.r, h.r), hn::Max(high.g, h.g), hn::Max(high.b, h.b), hn::Max(high.a, h.a)};
  }
  [[nodiscard]] HWY_INLINE Colors clamp(const Colors& c) const {
    const auto limit = [](V v, V least, V most) { return hn::Min(hn::Max(v, least), most); };
    return {limit(c.r, low.r, high.r), limit(c.g, low.g, high.g), limit(c.b, low.b, high.b),
            limit(c.a, low.a, high.a)};
  }
  /// The largest difference of R, G or B.
  [[nodiscard]] HWY_INLINE V contrast() const {
    const Colors range = high.minus(low);
    return hn::Max(range.r, hn::Max(range.g, range.b));
  }
};

HWY_INLINE Colors load_colors(const RayArray<std::uint32_t>& from, std::size_t k) {
  const VU v = hn::LoadU(DU(), from.data() + k);
  return {byte_of<0>(v), byte_of<1>(v), byte_of<2>(v), byte_of<3>(v)};
}

HWY_INLINE Colors load_colors(const RayArray<std::uint64_t>& from, std::size_t k) {
  const hn::Rebind<std::uint16_t, D> bits;
  const hn::Rebind<hwy::float16_t, D> half;
  hn::Vec<decltype(bits)> r, g, b, a;
  hn::LoadInterleaved4(bits, reinterpret_cast<const std::uint16_t*>(from.data() + k), r, g, b, a);
  const auto to_float = [&](auto v) { return hn::PromoteTo(D(), hn::BitCast(half, v)); };
  return {to_float(r), to_float(g), to_float(b), to_float(a)};
}

/// Loads the pixels of the rays from `k` on.
HWY_INLINE Colors load_pixels(const RayBlock& rays, std::size_t k, const glm::vec4* picture) {
  HWY_ALIGN glm::vec4 pixels[hn::MaxLanes(D())] = {};
  const std::size_t n = std::min(hn::Lanes(D()), rays.count - k);
  for (std::size_t i = 0; i < n; ++i) pixels[i] = picture[rays.pixel[k + i]];
  Colors colors;
  hn::LoadInterleaved4(D(), &pixels[0].x, colors.r, colors.g, colors.b, colors.a);
  return colors;
}

/// Writes the pixels of the rays from `k` on.
HWY_INLINE void store_pixels(const Colors& colors, const RayBlock& rays, std::size_t k,
                             glm::vec4* picture) {
  const D d;
  HWY_ALIGN glm::vec4 pixels[hn::MaxLanes(D())];
  hn::StoreInterleaved4(colors.r, colors.g, colors.b, colors.a, d, &pixels[0].x);
  const std::size_t n = std::min(hn::Lanes(d), rays.count - k);
  const std::uint32_t* to = &rays.pixel[k];
  const DU du;
  const VU step = hn::Sub(hn::LoadU(du, to + 1), hn::LoadU(du, to));
  const VU place =
      hn::And(hn::Iota(du, 1), hn::Set(du, PixelSquare::kAcross - 1));  // 0 where a run ends
  const auto runs = hn::Or(hn::Eq(step, hn::Set(du, 1)), hn::Eq(place, hn::Zero(du)));
  if (n == hn::Lanes(d) && hn::AllTrue(du, runs)) {
    for (std::size_t i = 0; i < n; i += PixelSquare::kAcross)
      std::copy_n(pixels + i, PixelSquare::kAcross, picture + to[i]);
  } else {
    for (std::size_t i = 0; i < n; ++i) picture[to[i]] = pixels[i];
  }
}

/// The share of its weight that a sample at another depth keeps, so that the sum of weights is
/// never 0.
constexpr float kMinAgreement = 0.1f;
/// From this opacity on, a sample at another depth loses the full share of its weight; below, a
/// part proportional to its opacity.
constexpr float kReliableOpacity = 0.25f;

/// The stored value that stands for 1.
template <bool kHalf>
constexpr float kFullScale = kHalf ? 1.f : 255.f;

template <bool kHalf>
HWY_INLINE const auto& colors_of(const BlockSamples& samples) {
  if constexpr (kHalf)
    return samples.rgba16f;
  else
    return samples.rgba8;
}

/// A vector of rays: where they enter, and their chords.
struct Chords {
  Point enter, along;
  V inverse;  ///< of the squared length

  HWY_INLINE Chords(const RayBlock& rays, std::size_t k)
      : enter(Point::load(rays.enter, k)),
        along(Point::load(rays.leave, k).minus(enter)),
        inverse(hn::Div(hn::Set(D(), 1.f), along.dot(along))) {}
};

/// Where an entry vertex's samples lie along the rays from `k` on: at begin + depth · scale.
struct Places {
  V begin, scale, depth[3];

  HWY_INLINE Places(const Pass& pass, const EntryCells& entries, const BlockSamples& samples,
                    const Chords& rays, std::size_t c, std::size_t k) {
    const VU three = hn::LoadU(DU(), &samples.depth[c][k]);
    depth[0] = byte_of<0>(three), depth[1] = byte_of<1>(three), depth[2] = byte_of<2>(three);
    const Point from = Point::load(entries.point[c], k);
    const Point aim = Point::load(*pass.exit_point[c], k).minus(from);
    begin = hn::Mul(from.minus(rays.enter).dot(rays.along), rays.inverse);
    scale = hn::Mul(aim.dot(rays.along), hn::Mul(rays.inverse, hn::Set(D(), 1.f / 255)));
  }
};

/// How well the depths of an entry vertex's samples agree with its aim.
template <bool kHalf>
struct Agreement {
  V offset, slope;

  HWY_INLINE Agreement(const Pass& pass, const Places& at, const RayArray<float>& aim,
                       std::size_t k) {
    const V sharpness = hn::Set(D(), 1 / pass.depth_tolerance);
    offset = hn::Mul(hn::Sub(at.begin, hn::LoadU(D(), &aim[k])), sharpness);
    slope = hn::Mul(at.scale, sharpness);
  }
  /// What is left of a sample's weight.
  [[nodiscard]] HWY_INLINE V of(V weight, V depth, V opacity) const {
    const V by_opacity = hn::Set(D(), (1 - kMinAgreement) / (kReliableOpacity * kFullScale<kHalf>));
    const V off = hn::MulAdd(depth, slope, offset);
    const V apart = hn::Min(hn::Mul(off, off), hn::Set(D(), 1.f));
    const V lost =
        hn::Mul(apart, hn::Min(hn::Mul(opacity, by_opacity), hn::Set(D(), 1 - kMinAgreement)));
    return hn::NegMulAdd(lost, weight, weight);
  }
};

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slf
HWY_AFTER_NAMESPACE();

#endif  // include guard
