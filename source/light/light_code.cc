#include "source/light/light_code.h"

#include <xxhash.h>
#include <zstd.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <memory>
#include <vector>

#include "base/bytes.h"

namespace slf {
namespace {

constexpr std::uint32_t kCodeMagic = 0x32474c53;  // "SLG2"
constexpr std::size_t kCodeHead = 4 + 8 + 3 * 4 + 3 * 8 + 8;
constexpr int kZstdLevel = 9;
/// Of bytes, one of each per node: those of the channels less what is predicted, and the exponent.
constexpr std::size_t kPlanes = kChannels + 1;

Bytes head_of(const std::string& key, const LightGrid& light) {
  Bytes head;
  append_le(head, kCodeMagic);
  append_le(head, std::uint64_t{XXH3_64bits(key.data(), key.size())});
  for (const std::int32_t side : light.dims) append_le(head, static_cast<std::uint32_t>(side));
  for (int axis = 0; axis < 3; ++axis)
    append_le(head, std::bit_cast<std::uint64_t>(light.low[axis]));
  append_le(head, std::bit_cast<std::uint64_t>(light.spacing));
  return head;
}

/// Predicts a node's bytes: the mean of those of the lit ones among the three nodes before it along
/// the axes, in its own units.
class Predictor {
 public:
  explicit Predictor(const LightGrid& light) : light_(light) {
    steps_ = {1, static_cast<std::size_t>(light.dims[0]),
              static_cast<std::size_t>(light.dims[0]) * light.dims[1]};
  }

  [[nodiscard]] std::array<std::uint8_t, kChannels> predict(std::size_t number,
                                                            int exponent) const {
    std::array<int, kChannels> sum{};
    int count = 0;
    const glm::ivec3 at = node_at(light_, number);
    for (int axis = 0; axis < 3; ++axis) {
      if (at[axis] == 0) continue;
      const std::uint8_t* node = light_.node(number - steps_[static_cast<std::size_t>(axis)]);
      if (node[kChannels] == 0) continue;
      ++count;
      const int shift = std::clamp(node[kChannels] - exponent, -8, 8);
      for (std::size_t c = 0; c < kChannels; ++c) {
        const int zero = c < 3 || c > 5 ? 0 : 128;
        int value = node[c] - zero;
        if (c < 6) value = shift >= 0 ? value * (1 << shift) : value / (1 << -shift);
        sum[c] += std::clamp(value + zero, 0, 255);
      }
    }
    std::array<std::uint8_t, kChannels> mean{};
    for (std::size_t c = 0; c < kChannels && count > 0; ++c)
      mean[c] = static_cast<std::uint8_t>(sum[c] / count);
    return mean;
  }

 private:
  const LightGrid& light_;
  std::array<std::size_t, 3> steps_;
};

}  // namespace

Bytes encode_light(const std::string& key, const LightGrid& light) {
  const std::size_t size = light.size();
  Bytes planes(kPlanes * size);
  const Predictor predictor(light);
  for (std::size_t k = 0; k < size; ++k) {
    const std::uint8_t* node = light.node(k);
    if (node[kChannels] == 0) continue;
    planes[kChannels * size + k] = static_cast<std::byte>(node[kChannels]);
    const auto predicted = predictor.predict(k, node[kChannels]);
    for (std::size_t c = 0; c < kChannels; ++c)
      planes[c * size + k] = static_cast<std::byte>(node[c] - predicted[c]);
  }
  Bytes out = head_of(key, light);
  const std::size_t begin = out.size();
  out.resize(begin + ZSTD_compressBound(planes.size()));
  const std::unique_ptr<ZSTD_CCtx, decltype(&ZSTD_freeCCtx)> context(ZSTD_createCCtx(),
                                                                     ZSTD_freeCCtx);
  if (!context) return {};
  ZSTD_CCtx_setParameter(context.get(), ZSTD_c_compressionLevel, kZstdLevel);
  ZSTD_CCtx_setParameter(context.get(), ZSTD_c_checksumFlag, 1);
  const std::size_t written = ZSTD_compress2(context.get(), out.data() + begin, out.size() - begin,
                                             planes.data(), planes.size());
  if (ZSTD_isError(written)) return {};
  out.resize(begin + written);
  return out;
}

std::optional<LightGrid> decode_light(ByteSpan coded, const std::string& key, LightGrid plan) {
  const Bytes head = head_of(key, plan);
  if (coded.size() < kCodeHead || !std::equal(head.begin(), head.end(), coded.begin()))
    return std::nullopt;
  const std::size_t size = plan.size();
  Bytes planes(kPlanes * size);
  const std::size_t read = ZSTD_decompress(planes.data(), planes.size(), coded.data() + kCodeHead,
                                           coded.size() - kCodeHead);
  if (ZSTD_isError(read) || read != planes.size()) return std::nullopt;
  plan.nodes.assign(plan.node_bytes(), 0);
  const Predictor predictor(plan);
  for (std::size_t k = 0; k < size; ++k) {
    const auto exponent = std::to_integer<std::uint8_t>(planes[kChannels * size + k]);
    if (exponent == 0) continue;
    if (exponent > kExponents) return std::nullopt;
    std::uint8_t* node = plan.node(k);
    node[kChannels] = exponent;
    const auto predicted = predictor.predict(k, exponent);
    for (std::size_t c = 0; c < kChannels; ++c)
      node[c] = static_cast<std::uint8_t>(predicted[c] +
                                          std::to_integer<std::uint8_t>(planes[c * size + k]));
  }
  return plan;
}

}  // namespace slf
