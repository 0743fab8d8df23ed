#include "codec/predictive_tables.h"

#include <algorithm>
#include <cmath>

namespace slf::codec {
namespace {

/// Models of two kinds of level: the first, which is predicted from nothing, and the others.
constexpr std::size_t kModelSets = 2;
constexpr std::size_t kStepBytes = kPredictivePlanes * 4;
/// The first byte of the tables. Tables for straight colours, which older versions wrote, lack it.
constexpr std::byte kPremultiplied{0};

constexpr std::uint8_t kTrained[] = {
#include "codec/predictive_trained.inc"
};

/// Sets the models of a level to the probabilities in `stored`, those of all sets.
void set_models(ByteSpan stored, std::size_t level, PredictiveModels& models) {
  const std::size_t first = level == 0 ? 0 : PredictiveModels::kCount;
  for (std::size_t k = 0; k < PredictiveModels::kCount; ++k)
    models.begin()[k] = BitModel(probability_of(std::to_integer<std::uint8_t>(stored[first + k])));
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
  double min_bits = 1e9;
  for (std::size_t byte = 0; byte < 256; ++byte) {
    const double p = probability_of(static_cast<std::uint8_t>(byte)) / 65536.;
    const double bits = -probability * std::log2(p) - (1 - probability) * std::log2(1 - p);
    if (bits < min_bits) min_bits = bits, best = byte;
  }
  return static_cast<std::uint8_t>(best);
}

namespace {

/// Steps of the finest level, in units of 8-bit samples. Those of colour follow libjpeg's scale of
/// quality, so views are about as good as with JPEG of that quality.
struct FinestSteps {
  double color, alpha, depth;

  explicit FinestSteps(int quality) {
    const double scale = quality < 50 ? 50. / quality : std::max(0.02 * (100 - quality), 0.02);
    color = quality > 90 ? 50 * scale : 1.7 + 40 * scale;
    // Colours make up for errors of alpha, but over a bright background these are visible.
    alpha = color + std::min(color, 5.);
    depth = quality > 90 ? 80 * scale : 8 + 40 * scale;
  }
};

/// Coarser levels have smaller steps, because all finer levels are predicted from them. The factors
/// were chosen by rendered PSNR, for the bytes of the whole pyramid and of a single view: `next`
/// leads from the finest level to the next coarser one, `further` from there to each coarser one.
double shrunk(double step, double next, double further, unsigned levels_above) {
  return levels_above == 0 ? step : step * next * std::pow(further, levels_above - 1);
}

StepRange step_range(double step, double growth) {
  const double low = std::clamp(std::round(16 * step), 8., 16000.);
  return {static_cast<std::uint16_t>(low), static_cast<std::uint16_t>(low * growth)};
}

}  // namespace

PredictiveTables predictive_tables(const PredictiveSettings& settings, unsigned finest) {
  const FinestSteps finest_steps(settings.quality);
  // The larger the finest steps, the more detail must come from the coarser levels.
  const double fine = std::min(1., 10 / finest_steps.color);
  const ByteSpan trained = as_bytes(std::span(kTrained));
  PredictiveTables tables{{}, Bytes(trained.begin(), trained.end())};
  for (unsigned level = 0; level <= finest; ++level) {
    const unsigned above = finest - level;
    const double color =
        shrunk(finest_steps.color, 0.55 * std::pow(fine, 0.45), 0.8 * std::pow(fine, 0.7), above);
    const double depth =
        shrunk(finest_steps.depth, 0.65 * std::pow(fine, 0.2), 0.8 * std::pow(fine, 0.4), above);
    const double alpha =
        shrunk(finest_steps.alpha, 0.65 * std::pow(fine, 0.2), 0.9 * std::pow(fine, 0.4), above);
    PredictiveLevel& made = tables.levels.emplace_back();
    if (settings.quality == kLosslessQuality)
      made.steps.fill(step_range(1, 1));
    else if (settings.by_sample())
      // Half floats are in 1/1024 of an octave. Without a transform, a third of the step gives
      // about the same error.
      made.steps = {step_range(1, 1), step_range(depth / 3, 1), step_range(6 * color, 1),
                    step_range(6 * color, 1)};
    else
      made.steps = {step_range(alpha, 2), step_range(depth, 2), step_range(color, 1.5),
                    step_range(0.8 * color, 2)};
    set_models(trained, level, made.models);
  }
  return tables;
}

Bytes to_bytes(const PredictiveTables& tables) {
  Bytes bytes;
  if (tables.levels[0].premultiplied) bytes.push_back(kPremultiplied);
  bytes.push_back(static_cast<std::byte>(tables.levels.size()));
  for (const PredictiveLevel& level : tables.levels)
    for (const StepRange& steps : level.steps)
      for (const std::uint16_t step : {steps.low, steps.high}) append_le(bytes, step);
  bytes.insert(bytes.end(), tables.models.begin(), tables.models.end());
  return bytes;
}

Result<PredictiveTables> parse_predictive_tables(ByteSpan bytes) {
  const bool premultiplied = !bytes.empty() && bytes[0] == kPremultiplied;
  if (premultiplied) bytes = bytes.subspan(1);
  const std::size_t levels = bytes.empty() ? 0 : std::to_integer<std::size_t>(bytes[0]);
  const std::size_t models = 1 + levels * kStepBytes;
  if (levels == 0 || bytes.size() != models + kModelSets * PredictiveModels::kCount)
    return fail(ErrorCode::bad_file, "shared tables of a predictive codec: ", bytes.size(),
                " bytes, which no number of levels has");
  const ByteSpan stored = bytes.subspan(models);
  PredictiveTables tables{{}, Bytes(stored.begin(), stored.end())};
  for (std::size_t level = 0; level < levels; ++level) {
    PredictiveLevel& read = tables.levels.emplace_back();
    read.premultiplied = premultiplied;
    for (std::size_t plane = 0; plane < kPredictivePlanes; ++plane) {
      const std::byte* at = bytes.data() + 1 + level * kStepBytes + plane * 4;
      read.steps[plane] = {load_le<std::uint16_t>(at), load_le<std::uint16_t>(at + 2)};
      if (read.steps[plane].low == 0 || read.steps[plane].high == 0)
        return fail(ErrorCode::bad_file, "shared tables of a predictive codec: a step of 0");
    }
    set_models(stored, level, read.models);
  }
  return tables;
}

}  // namespace slf::codec
