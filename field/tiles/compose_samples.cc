#include "field/tiles/compose_samples.h"

#include <vector>

#include "base/half.h"
#include "slf/tone.h"

namespace slf {
namespace {

template <bool kHalf>
glm::vec4 load_color(const std::byte* from) {
  glm::vec4 color;
  for (int c = 0; c < 4; ++c)
    color[c] = kHalf ? half_to_float(load_le<std::uint16_t>(from + 2 * c))
                     : static_cast<float>(from[c]) / 255;
  return color;
}

template <bool kHalf>
void store_color(const glm::vec4& color, std::byte* to) {
  for (int c = 0; c < 4; ++c)
    if constexpr (kHalf)
      store_le<std::uint16_t>(to + 2 * c, half_from_float(color[c]));
    else
      to[c] = static_cast<std::byte>(byte_from_float(color[c]));
}

struct Fragment {
  glm::vec4 color;
  float depth;
};

template <bool kHalf>
void compose(std::span<const TileLayer> layers, std::span<std::byte> samples) {
  constexpr std::size_t kColor = kHalf ? 8 : 4;
  const std::size_t count = samples.size() / (kColor + 1);
  std::vector<Fragment> fragments(layers.size());
  for (std::size_t s = 0; s < count; ++s) {
    std::size_t visible = 0;
    for (const TileLayer& layer : layers) {
      const glm::vec4 color = load_color<kHalf>(&layer.samples[kColor * s]);
      if (!(color.a > 0)) continue;
      const auto depth = static_cast<float>(layer.samples[kColor * count + s]);
      std::size_t k = visible++;
      for (; k > 0 && fragments[k - 1].depth > depth; --k) fragments[k] = fragments[k - 1];
      fragments[k] = {color * layer.factor, depth};
    }
    glm::vec4 sum(0);
    float place = 0;
    for (std::size_t k = 0; k < visible && sum.a < 1; ++k) {
      const glm::vec4 seen = (1 - sum.a) * fragments[k].color;
      sum += seen;
      place += seen.a * fragments[k].depth;
    }
    store_color<kHalf>(sum, &samples[kColor * s]);
    samples[kColor * count + s] = sum.a > 0 ? static_cast<std::byte>(place / sum.a + 0.5f)
                                            : layers.front().samples[kColor * count + s];
  }
}

}  // namespace

glm::vec4 layer_factor(float opacity, const std::array<float, 3>& tint, bool linear) {
  glm::vec4 factor(opacity);  // alpha comes last
  for (int c = 0; c < 3; ++c) {
    const float t = tint[static_cast<std::size_t>(c)];
    factor[c] *= linear ? linear_from_srgb(t) : t;
  }
  return factor;
}

void compose_samples(std::span<const TileLayer> layers, SampleFormat format,
                     std::span<std::byte> samples) {
  (is_half(format) ? compose<true> : compose<false>)(layers, samples);
}

}  // namespace slf
