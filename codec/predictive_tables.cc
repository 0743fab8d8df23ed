#include "codec/predictive_tables.h"

#include <algorithm>
#include <cmath>

namespace slf::codec {
namespace {

/// Models of two kinds of level: the first, which is predicted from nothing, and the others.
constexpr std::size_t kModelSets = 2;
constexpr std::size_t kStepBytes = kPredictivePlanes * 4;

constexpr std::uint8_t kTrained[] = {
#include "codec/predictive_trained.inc"
};

void set_models(ByteSpan from, PredictiveModels& models) {
  for (std::size_t k = 0; k < PredictiveModels::kCount; ++k)
    models.begin()[k] = BitModel(probability_of(std::to_integer<std::uint8_t>(from[k])));
}

}  // namespace

std::array<std::int32_t, 64> StepRange::steps() const {
  std::array<std::int32_t, 64> steps{};
  for (int k = 0; k < 64; ++k)
    steps[static_cast<std::size_t>(k)] = low + (high - low) * (k % 8 + k / 8) / 14;
  return steps;
}

std::uint16_t probability_of(std::uint8_t byte) {
  // Finer towards both ends, where a small difference costs most.
  const std::uint32_t m = byte < 128 ? 2 * byte + 1u : 511u - 2 * byte;
  const std::uint32_t tail = std::max(32u, m * m / 2);
  return static_cast<std::uint16_t>(byte < 128 ? tail : 65536 - tail);
}

std::uint8_t byte_of_probability(double probability) {
  std::size_t best = 0;
  double least = 1e9;
  for (std::size_t byte = 0; byte < 256; ++byte) {
    const double p = probability_of(static_cast<std::uint8_t>(byte)) / 65536.;
    const double bits = -probability * std::log2(p) - (1 - probability) * std::log2(1 - p);
    if (bits < least) least = bits, best = byte;
  }
  return static_cast<std::uint8_t>(best);
}

PredictiveTables predictive_tables(int quality, unsigned finest) {
  // At the finest level, colour's steps follow libjpeg's scale of quality, so that views are about
  // as good as with JPEG of that quality. What is coarser is seen through all finer levels: there
  // steps are smaller, by rendered PSNR for the bytes of the whole pyramid.
  const double scale = quality < 50 ? 50. / quality : std::max(0.02 * (100 - quality), 0.02);
  const double finest_color = quality > 90 ? 50 * scale : 2 + 40 * scale;
  const double finest_depth = quality > 90 ? 80 * scale : 8 + 40 * scale;
  PredictiveTables tables;
  for (unsigned level = 0; level <= finest; ++level) {
    const double finer = finest - level;
    const auto range = [](double step, double growth) {
      const double low = std::clamp(std::round(16 * step), 8., 16000.);
      return StepRange{static_cast<std::uint16_t>(low), static_cast<std::uint16_t>(low * growth)};
    };
    PredictiveLevel& made = tables.levels.emplace_back();
    const double color = finest_color * std::pow(0.35, finer);
    const double depth = finest_depth * std::pow(0.5, finer);
    const double alpha = finest_color * std::pow(0.6, finer);
    made.steps = {range(alpha, 2), range(depth, 2), range(color, 1.5), range(0.8 * color, 2)};
    const std::size_t set = level == 0 ? 0 : 1;
    set_models(as_bytes(std::span(kTrained)).subspan(set * PredictiveModels::kCount), made.models);
  }
  return tables;
}

Bytes to_bytes(const PredictiveTables& tables) {
  Bytes bytes{static_cast<std::byte>(tables.levels.size())};
  for (const PredictiveLevel& level : tables.levels)
    for (const StepRange& steps : level.steps)
      for (const std::uint16_t step : {steps.low, steps.high}) append_le(bytes, step);
  for (const std::uint8_t byte : kTrained) bytes.push_back(static_cast<std::byte>(byte));
  return bytes;
}

Result<PredictiveTables> parse_predictive_tables(ByteSpan bytes) {
  const std::size_t levels = bytes.empty() ? 0 : std::to_integer<std::size_t>(bytes[0]);
  const std::size_t models = 1 + levels * kStepBytes;
  if (levels == 0 || bytes.size() != models + kModelSets * PredictiveModels::kCount)
    return fail(ErrorCode::bad_file, "shared tables of a predictive codec: ", bytes.size(),
                " bytes, which no number of levels has");
  PredictiveTables tables;
  for (std::size_t level = 0; level < levels; ++level) {
    PredictiveLevel& read = tables.levels.emplace_back();
    for (std::size_t plane = 0; plane < kPredictivePlanes; ++plane) {
      const std::byte* at = bytes.data() + 1 + level * kStepBytes + plane * 4;
      read.steps[plane] = {load_le<std::uint16_t>(at), load_le<std::uint16_t>(at + 2)};
      if (read.steps[plane].low == 0 || read.steps[plane].high == 0)
        return fail(ErrorCode::bad_file, "shared tables of a predictive codec: a step of 0");
    }
    set_models(bytes.subspan(models + (level == 0 ? 0 : 1) * PredictiveModels::kCount),
               read.models);
  }
  return tables;
}

}  // namespace slf::codec
