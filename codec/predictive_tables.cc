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
/// The first byte of the tables: their version. Lower ones are of releases before 0.3, whose tiles
/// were coded in another way.
constexpr std::byte kPlainVersion{2}, kVersion{3};
constexpr std::size_t kMatrixBytes = 2 * std::tuple_size_v<ColorMatrix>;
/// As many sets as a byte can choose from, and far more than are of use.
constexpr std::size_t kMaxSets = 64;

constexpr std::uint8_t kTrained[] = {
#include "codec/predictive_trained.inc"
};

PredictiveModels make_models(const StoredModels& stored) {
  PredictiveModels models;
  for (std::size_t at = 0; at < stored.used.size(); ++at)
    models.levels[at / (2 * kReferenceKinds)].used[at / 2 % kReferenceKinds][at % 2] =
        BitModel(probability_of(stored.used[at]));
  models.alpha_sets = stored.alpha_sets, models.block_sets = stored.block_sets;
  if (stored.weights.empty()) return models;
  std::span<const std::uint8_t> weights = stored.weights;
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
  const auto make_sets = [&](std::size_t count, const auto& groups, auto& to) {
    for (std::size_t set = 0; set < count; ++set)
      to.push_back(std::make_shared<ModelSet>(groups, next(symbols_of(groups))));
  };
  make_sets(models.alpha_sets, AlphaModels::kGroups, models.alpha);
  make_sets(models.block_sets, BlockModels::kGroups, models.blocks);
  return models;
}

/// The models of this release, or those that coding by sample needs.
struct TrainedModels {
  Bytes packed;
  std::shared_ptr<const PredictiveModels> models;

  explicit TrainedModels(ByteSpan from)
      : packed(from.begin(), from.end()),
        models(
            std::make_shared<PredictiveModels>(make_models(StoredModels::unpack(from).value()))) {}
};
const TrainedModels& trained_models(bool by_sample) {
  static const TrainedModels with_sets(as_bytes(std::span(kTrained)));
  static const TrainedModels without_sets([] {
    StoredModels stored = StoredModels::unpack(with_sets.packed).value();
    stored.alpha_sets = stored.block_sets = 0, stored.weights.clear();
    return stored.pack().value();
  }());
  return by_sample ? without_sets : with_sets;
}

}  // namespace

std::size_t symbols_of(std::span<const ModelGroup> groups) {
  std::size_t sum = 0;
  for (const ModelGroup& group : groups) sum += group.models * group.symbols;
  return sum;
}

Result<Bytes> StoredModels::pack() const {
  Bytes packed;
  for (const std::uint8_t byte : used) packed.push_back(std::byte{byte});
  for (const std::size_t sets : {alpha_sets, block_sets})
    packed.push_back(static_cast<std::byte>(sets));
  SLF_TRY(append_stream(std::as_bytes(std::span(weights)), 19, packed));
  return packed;
}

Result<StoredModels> StoredModels::unpack(ByteSpan packed) {
  StoredModels models;
  const std::size_t used = models.used.size();
  if (packed.size() < used + 2) return bad_file(kTables, "end before the models");
  const auto byte = [&](std::size_t at) { return std::to_integer<std::uint8_t>(packed[at]); };
  for (std::size_t at = 0; at < used; ++at) models.used[at] = byte(at);
  models.alpha_sets = byte(used), models.block_sets = byte(used + 1);
  packed = packed.subspan(used + 2);
  if (models.alpha_sets > kMaxSets || models.block_sets > kMaxSets)
    return bad_file(kTables, "more than ", kMaxSets, " sets of models");
  if (models.alpha_sets + models.block_sets > 0) {
    models.weights.resize(models.choices(2) + models.alpha_sets * symbols_of(AlphaModels::kGroups) +
                          models.block_sets * symbols_of(BlockModels::kGroups));
    SLF_TRY(read_stream(packed, std::as_writable_bytes(std::span(models.weights))));
    if (std::any_of(models.weights.begin(), models.weights.end(),
                    [](std::uint8_t w) { return w >= SymbolModel::kWeights; }))
      return bad_file(kTables, "a weight above 63");
  }
  if (!packed.empty()) return bad_file(kTables, packed.size(), " bytes are left over");
  return models;
}

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

std::array<std::int32_t, 64> PredictiveLevel::steps_of(std::size_t plane, int scale) const {
  auto of = steps[plane == kCrPlane ? kCbPlane : plane].steps();
  for (std::int32_t& step : of)
    step = std::clamp((step * scale + kPlainScale / 2) / kPlainScale, 1, 65535);
  return of;
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
    color = quality > 90 ? 50 * scale : 1.3 + 40 * scale;
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
  PredictiveTables tables{settings.by_sample(), {}, trained.packed};
  for (unsigned level = 0; level <= finest; ++level) {
    const unsigned above = finest - level;
    const double next = settings.by_sample() ? 0.55 : 0.5;
    const double color =
        shrunk(finest_steps.color, next * std::pow(fine, 0.45), 0.8 * std::pow(fine, 0.7), above);
    const double depth =
        shrunk(finest_steps.depth, 0.65 * std::pow(fine, 0.2), 0.8 * std::pow(fine, 0.4), above);
    const double alpha =
        shrunk(finest_steps.alpha, 0.65 * std::pow(fine, 0.2), 0.9 * std::pow(fine, 0.4), above);
    PredictiveLevel& made = tables.levels.emplace_back();
    if (settings.quality == kLosslessQuality)
      made.steps.fill(step_range(1, 1));
    else if (settings.by_sample())
      // Half floats are in 1/1024 of an octave. Without a transform, smaller steps give about the
      // same error.
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
  Bytes bytes{tables.plain ? kPlainVersion : kVersion,
              static_cast<std::byte>(tables.levels.size())};
  for (const PredictiveLevel& level : tables.levels)
    for (const StepRange& steps : level.steps)
      for (const std::uint16_t step : {steps.low, steps.high}) append_le(bytes, step);
  if (!tables.plain)
    for (const std::int16_t element : tables.levels[0].matrix)
      append_le(bytes, static_cast<std::uint16_t>(element));
  bytes.insert(bytes.end(), tables.models.begin(), tables.models.end());
  return bytes;
}

Result<PredictiveTables> parse_predictive_tables(ByteSpan bytes) {
  PredictiveTables tables;
  tables.plain = !bytes.empty() && bytes[0] == kPlainVersion;
  if (bytes.empty() || bytes[0] < kPlainVersion)
    return bad_file(kTables, "those of a release before 0.3, which coded tiles in another way");
  if (bytes[0] > kVersion) return bad_file(kTables, "those of a newer release");
  const std::size_t levels = bytes.size() < 2 ? 0 : std::to_integer<std::size_t>(bytes[1]);
  const std::size_t matrix_at = 2 + levels * kStepBytes,
                    models_at = matrix_at + (tables.plain ? 0 : kMatrixBytes);
  if (levels == 0 || bytes.size() < models_at)
    return bad_file(kTables, bytes.size(), " bytes, too few for the steps of ", levels, " levels");
  ColorMatrix matrix = kYcbcr;
  for (std::size_t k = 0; k < matrix.size() && !tables.plain; ++k) {
    matrix[k] = static_cast<std::int16_t>(load_le<std::uint16_t>(&bytes[matrix_at + 2 * k]));
    if (matrix[k] < -kMaxMatrix || matrix[k] > kMaxMatrix)
      return bad_file(kTables, "an element of the colour matrix beyond ", kMaxMatrix);
  }
  if (std::abs(determinant(matrix)) < 1 << 24)
    return bad_file(kTables, "a colour matrix that cannot be inverted");
  const ByteSpan packed = bytes.subspan(models_at);
  tables.models.assign(packed.begin(), packed.end());
  const auto stored = SLF_TRY(StoredModels::unpack(packed));
  const auto shared = std::make_shared<PredictiveModels>(make_models(stored));
  for (std::size_t level = 0; level < levels; ++level) {
    PredictiveLevel& read = tables.levels.emplace_back();
    for (std::size_t plane = 0; plane < kPlanesWithSteps; ++plane) {
      const std::byte* at = &bytes[2 + level * kStepBytes + plane * 4];
      read.steps[plane] = {load_le<std::uint16_t>(at), load_le<std::uint16_t>(at + 2)};
      if (read.steps[plane].low == 0 || read.steps[plane].high == 0)
        return bad_file(kTables, "a step of 0");
    }
    read.models = shared;
    read.kind = level == 0 ? 0 : 1;
    read.matrix = matrix;
  }
  return tables;
}

}  // namespace slf::codec
