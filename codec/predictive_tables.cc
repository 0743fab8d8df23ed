#include "codec/predictive_tables.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/try.h"
#include "codec/zstd_frame.h"

namespace slf::codec {
namespace {

constexpr const char* kTables = "shared tables of a predictive codec";  // in errors
constexpr std::size_t kStepBytes = kPlanesWithSteps * 4;
/// The first byte of the tables: their version. Others are of older releases, whose tiles were
/// coded in another way.
constexpr std::byte kVersion{2};
/// As many sets as a byte can choose from, and far more than are of use.
constexpr std::size_t kMaxSets = 64;

constexpr std::ptrdiff_t kUsedBytes = 2 * kReferenceKinds * 2;

constexpr std::uint8_t kTrained[] = {
#include "codec/predictive_trained.inc"
};

/// The symbols of all models of a set together.
template <std::size_t kGroups>
constexpr std::size_t symbols_of(const std::array<ModelGroup, kGroups>& groups) {
  std::size_t sum = 0;
  for (const ModelGroup& group : groups) sum += group.models * group.symbols;
  return sum;
}

std::size_t stored_weights(std::size_t alpha_sets, std::size_t block_sets) {
  return 2 * (alpha_sets + 1 + kPlanes * (block_sets + 1)) +
         alpha_sets * symbols_of(AlphaModels::kGroups) +
         block_sets * symbols_of(BlockModels::kGroups);
}

void read_weights(std::span<const std::uint8_t> weights, PredictiveModels& models) {
  const auto next = [&](std::size_t count) {
    const auto taken = weights.first(count);
    weights = weights.subspan(count);
    return taken;
  };
  for (LevelModels& level : models.levels) {
    level.alpha_set.emplace_back(next(models.alpha_sets + 1));
    for (std::size_t plane = 0; plane < kPlanes; ++plane)
      level.block_set.emplace_back(next(models.block_sets + 1));
  }
  const auto read_sets = [&](std::size_t count, const auto& groups, auto& to) {
    for (std::size_t set = 0; set < count; ++set)
      to.push_back(std::make_shared<ModelSet>(groups, next(symbols_of(groups))));
  };
  read_sets(models.alpha_sets, AlphaModels::kGroups, models.alpha);
  read_sets(models.block_sets, BlockModels::kGroups, models.blocks);
}

Result<PredictiveModels> unpack_models(ByteSpan packed) {
  PredictiveModels models;
  if (packed.size() < std::size_t{kUsedBytes} + 2)
    return bad_file(kTables, "end before the models");
  std::size_t at = 0;
  for (LevelModels& level : models.levels)
    for (auto& of_kind : level.used)
      for (BitModel& model : of_kind)
        model = BitModel(probability_of(std::to_integer<std::uint8_t>(packed[at++])));
  models.alpha_sets = std::to_integer<std::size_t>(packed[at++]);
  models.block_sets = std::to_integer<std::size_t>(packed[at++]);
  packed = packed.subspan(at);
  if (models.alpha_sets > kMaxSets || models.block_sets > kMaxSets)
    return bad_file(kTables, "more than ", kMaxSets, " sets of models");
  if (models.alpha_sets + models.block_sets > 0) {
    std::vector<std::uint8_t> weights(stored_weights(models.alpha_sets, models.block_sets));
    SLF_TRY(read_stream(packed, std::as_writable_bytes(std::span(weights))));
    if (std::any_of(weights.begin(), weights.end(),
                    [](std::uint8_t w) { return w >= SymbolModel::kWeights; }))
      return bad_file(kTables, "a weight above 63");
    read_weights(weights, models);
  }
  if (!packed.empty()) return bad_file(kTables, packed.size(), " bytes are left over");
  return models;
}

/// The models of this release, or those that coding by sample needs.
struct TrainedModels {
  Bytes packed;
  std::shared_ptr<const PredictiveModels> models;

  explicit TrainedModels(ByteSpan from)
      : packed(from.begin(), from.end()),
        models(std::make_shared<PredictiveModels>(unpack_models(from).value())) {}
};
const TrainedModels& trained_models(bool by_sample) {
  static const TrainedModels with_sets(as_bytes(std::span(kTrained)));
  static const TrainedModels without_sets([] {
    Bytes packed(with_sets.packed.begin(), with_sets.packed.begin() + kUsedBytes);
    packed.insert(packed.end(), 2, std::byte{0});
    return packed;
  }());
  return by_sample ? without_sets : with_sets;
}

}  // namespace

std::span<const SymbolModel> ModelSet::models() const {
  std::call_once(once_, [&] {
    std::vector<SymbolModel> made;  // whole, or none if memory is short: the next call tries again
    std::span<const std::uint8_t> left = weights_;
    for (const ModelGroup& group : groups_)
      for (std::size_t k = 0; k < group.models; ++k, left = left.subspan(group.symbols))
        made.emplace_back(left.first(group.symbols));
    models_ = std::move(made);
  });
  return models_;
}

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
  const TrainedModels& trained = trained_models(settings.by_sample());
  PredictiveTables tables{{}, trained.packed};
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
    made.models = trained.models;
    made.kind = level == 0 ? 0 : 1;
  }
  return tables;
}

Bytes to_bytes(const PredictiveTables& tables) {
  Bytes bytes{kVersion, static_cast<std::byte>(tables.levels.size())};
  for (const PredictiveLevel& level : tables.levels)
    for (const StepRange& steps : level.steps)
      for (const std::uint16_t step : {steps.low, steps.high}) append_le(bytes, step);
  bytes.insert(bytes.end(), tables.models.begin(), tables.models.end());
  return bytes;
}

Result<PredictiveTables> parse_predictive_tables(ByteSpan bytes) {
  if (bytes.empty() || bytes[0] != kVersion)
    return bad_file(
        kTables,
        "not those of this release, but of one before 0.3, which coded tiles in another "
        "way");
  const std::size_t levels = bytes.size() < 2 ? 0 : std::to_integer<std::size_t>(bytes[1]);
  const std::size_t models = 2 + levels * kStepBytes;
  if (levels == 0 || bytes.size() < models)
    return bad_file(kTables, bytes.size(), " bytes, too few for the steps of ", levels, " levels");
  auto unpacked = SLF_TRY(unpack_models(bytes.subspan(models)));
  const auto shared = std::make_shared<PredictiveModels>(std::move(unpacked));
  PredictiveTables tables{{},
                          Bytes(bytes.begin() + static_cast<std::ptrdiff_t>(models), bytes.end())};
  for (std::size_t level = 0; level < levels; ++level) {
    PredictiveLevel& read = tables.levels.emplace_back();
    for (std::size_t plane = 0; plane < kPlanesWithSteps; ++plane) {
      const std::byte* at = bytes.data() + 2 + level * kStepBytes + plane * 4;
      read.steps[plane] = {load_le<std::uint16_t>(at), load_le<std::uint16_t>(at + 2)};
      if (read.steps[plane].low == 0 || read.steps[plane].high == 0)
        return bad_file(kTables, "a step of 0");
    }
    read.models = shared;
    read.kind = level == 0 ? 0 : 1;
  }
  return tables;
}

}  // namespace slf::codec
