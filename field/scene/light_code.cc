#include "field/scene/light_code.h"

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

constexpr std::uint32_t kCodeMagic = 0x31474c53;  // "SLG1"
constexpr std::size_t kCodeHead = 4 + 8 + 3 * 4 + 3 * 8 + 8;
constexpr int kZstdLevel = 9;
/// Planes of bytes, one byte of each per node: the exponent, and a low and a high byte for each
/// channel.
constexpr std::size_t kPlanes = 7;

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

using Channels = std::array<int, 3>;  // green first: the others are predicted from it

constexpr std::array kShifts{9, 0, 18};  // of green, red and blue in a word

int exponent_of(std::uint32_t word) { return static_cast<int>(word >> 27); }

/// Predicts a node's mantissas: the mean of the lit ones among the three nodes before it along the
/// axes, at its own exponent.
class Predictor {
 public:
  explicit Predictor(const LightGrid& light) : light_(light) {
    steps_ = {1, static_cast<std::size_t>(light.dims[0]),
              static_cast<std::size_t>(light.dims[0]) * light.dims[1]};
  }

  [[nodiscard]] Channels predict(std::size_t number, int exponent) const {
    Channels sum{};
    int count = 0;
    const glm::ivec3 at = node_at(light_, number);
    for (int axis = 0; axis < 3; ++axis) {
      const std::uint32_t word =
          at[axis] > 0 ? light_.nodes[number - steps_[static_cast<std::size_t>(axis)]] : 0;
      if (word == 0) continue;
      ++count;
      const int shift = exponent_of(word) - exponent;
      for (std::size_t c = 0; c < 3; ++c) {
        const int mantissa = static_cast<int>(word >> kShifts[c] & 511);
        sum[c] += shift >= 0 ? std::min(mantissa << std::min(shift, 9), 511) : mantissa >> -shift;
      }
    }
    if (count > 0)
      for (int& channel : sum) channel /= count;
    return sum;
  }

 private:
  const LightGrid& light_;
  std::array<std::size_t, 3> steps_;
};

/// 0, -1, 1, -2, … become 0, 1, 2, 3, …
std::uint32_t zigzag(int v) {
  return static_cast<std::uint32_t>(v) << 1 ^ static_cast<std::uint32_t>(v >> 31);
}
int unzigzag(std::uint32_t v) { return static_cast<int>(v >> 1) ^ -static_cast<int>(v & 1); }

}  // namespace

Bytes encode_light(const std::string& key, const LightGrid& light) {
  const std::size_t size = light.nodes.size();
  Bytes planes(kPlanes * size);
  const Predictor predictor(light);
  for (std::size_t k = 0; k < size; ++k) {
    const std::uint32_t word = light.nodes[k];
    if (word == 0) continue;
    planes[k] = static_cast<std::byte>(exponent_of(word) + 1);
    const Channels predicted = predictor.predict(k, exponent_of(word));
    int green = 0;
    for (std::size_t c = 0; c < 3; ++c) {
      int difference = static_cast<int>(word >> kShifts[c] & 511) - predicted[c];
      if (c == 0) green = difference;
      if (c > 0) difference -= green;
      const std::uint32_t coded = zigzag(difference);
      planes[(1 + c) * size + k] = static_cast<std::byte>(coded & 255);
      planes[(4 + c) * size + k] = static_cast<std::byte>(coded >> 8);
    }
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
  plan.nodes.assign(size, 0);
  const Predictor predictor(plan);
  for (std::size_t k = 0; k < size; ++k) {
    const auto code = std::to_integer<int>(planes[k]);
    if (code == 0) continue;
    if (code > 32) return std::nullopt;
    const Channels predicted = predictor.predict(k, code - 1);
    std::uint32_t word = static_cast<std::uint32_t>(code - 1) << 27;
    int green = 0;
    for (std::size_t c = 0; c < 3; ++c) {
      const auto low = std::to_integer<std::uint32_t>(planes[(1 + c) * size + k]);
      const auto high = std::to_integer<std::uint32_t>(planes[(4 + c) * size + k]);
      int difference = unzigzag(high << 8 | low);
      if (c == 0) green = difference;
      if (c > 0) difference += green;
      const int mantissa = predicted[c] + difference;
      if (mantissa < 0 || mantissa > 511) return std::nullopt;
      word |= static_cast<std::uint32_t>(mantissa) << kShifts[c];
    }
    plan.nodes[k] = word;
  }
  return plan;
}

}  // namespace slf
