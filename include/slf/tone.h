// Tone mapping: from linear radiance, which has no upper limit, to the colours of a picture.
//
//   const slf::ToneMapper show({.exposure = 1});
//   glm::vec4 pixel = show(radiance);
//
// Radiance is linear Rec. 709 RGB; a white surface that faces a light of intensity 1 has
// radiance 1. The result has the transfer curve of sRGB, as picture files and screens expect.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <glm/glm.hpp>

namespace slf {

enum class ToneCurve : std::uint8_t {
  neutral,  ///< colours as they are up to 0.76, brighter ones compressed: Khronos PBR Neutral
            ///< (2024)
  srgb,     ///< colours as they are up to 1, brighter ones cut off
  none,     ///< no change at all: neither exposure nor the transfer curve of sRGB
};

struct ToneMapping {
  float exposure = 0;  ///< photographic stops: radiance is multiplied by 2^exposure
  ToneCurve curve = ToneCurve::neutral;

  bool operator==(const ToneMapping&) const = default;
};

/// The sRGB transfer curve and its inverse (IEC 61966-2-1), for values from 0 to 1.
template <class T>
[[nodiscard]] T srgb_from_linear(T v) {
  return v <= T(0.0031308) ? T(12.92) * v : T(1.055) * std::pow(v, 1 / T(2.4)) - T(0.055);
}
template <class T>
[[nodiscard]] T linear_from_srgb(T v) {
  return v <= T(0.04045) ? v / T(12.92) : std::pow((v + T(0.055)) / T(1.055), T(2.4));
}

/// Applies a ToneMapping. Thread-safety: immutable.
class ToneMapper {
 public:
  explicit ToneMapper(const ToneMapping& mapping)
      : curve_(mapping.curve), gain_(std::exp2(mapping.exposure)) {
    for (std::size_t k = 0; k < encoded_.size(); ++k) {
      const float root = static_cast<float>(k) / kLast;
      encoded_[k] = srgb_from_linear(root * root);
    }
  }

  /// Maps premultiplied linear radiance to a premultiplied colour. Opacity does not change. The
  /// curve applies to the straight colour, so the result can still be composited.
  [[nodiscard]] glm::vec4 operator()(const glm::vec4& radiance) const {
    if (curve_ == ToneCurve::none || !(radiance.a > 0)) return radiance;
    glm::vec3 color = glm::max(glm::vec3(radiance) * (gain_ / radiance.a), glm::vec3(0));
    if (curve_ == ToneCurve::neutral) color = neutral(color);
    return {radiance.a * encode(color.r), radiance.a * encode(color.g),
            radiance.a * encode(color.b), radiance.a};
  }

 private:
  /// https://github.com/KhronosGroup/ToneMapping, PBR Neutral specification.
  static glm::vec3 neutral(glm::vec3 color) {
    constexpr float kStart = 0.8f - 0.04f, kDesaturation = 0.15f;
    const float min_channel = std::min({color.r, color.g, color.b});
    color -= min_channel < 0.08f ? min_channel - 6.25f * min_channel * min_channel : 0.04f;
    const float peak = std::max({color.r, color.g, color.b});
    if (peak < kStart) return color;
    constexpr float kRoom = 1 - kStart;
    const float compressed = 1 - kRoom * kRoom / (peak + kRoom - kStart);
    const float white = 1 - 1 / (kDesaturation * (peak - compressed) + 1);
    return glm::mix(color * (compressed / peak), glm::vec3(compressed), white);
  }

  /// srgb_from_linear() of min(v, 1), interpolated in a table. The table is indexed by the square
  /// root, over which the curve is nearly linear.
  [[nodiscard]] float encode(float v) const {
    const float at = std::sqrt(std::min(v, 1.f)) * kLast;
    const auto k = std::min(static_cast<std::size_t>(at), encoded_.size() - 2);
    return glm::mix(encoded_[k], encoded_[k + 1], at - static_cast<float>(k));
  }

  static constexpr float kLast = 1023;
  ToneCurve curve_;
  float gain_;
  std::array<float, 1024> encoded_{};
};

}  // namespace slf
