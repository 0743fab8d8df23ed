// The tables that all tiles of a predictive codec share: quantisation steps for each level, and the
// probabilities of the models, of which there are several sets for tiles to choose from.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <mutex>
#include <span>
#include <vector>

#include "base/bytes.h"
#include "codec/alpha_levels.h"
#include "codec/block_coder.h"
#include "codec/color_kernel.h"
#include "codec/prediction.h"
#include "codec/range_coder.h"
#include "codec/rans.h"
#include "slf/error.h"
#include "slf/tile.h"

namespace slf::codec {

/// The planes of blocks in a tile, in their order. Each chooses a set of models, and has steps of
/// its own, except Cr, which has those of Cb.
enum PlaneIndex : std::size_t { kAlphaPlane, kDepthPlane, kYPlane, kCbPlane, kCrPlane };
inline constexpr std::size_t kPlanes = 5, kPlanesWithSteps = 4;

/// The step of a coefficient grows with its frequency, from `low` for the mean of a block to `high`
/// for the finest detail; in 1/16 of a sample's unit, 1..65535. Samples that are coded one by one
/// have the step `low`.
struct StepRange {
  std::uint16_t low = 16, high = 16;

  /// The steps of a block's coefficients.
  [[nodiscard]] std::array<std::int32_t, 64> steps() const;
  friend bool operator==(const StepRange&, const StepRange&) = default;
};

/// The models of tiles of one kind of level: level 0, which is predicted from nothing, or another.
struct LevelModels {
  /// Whether a candidate is a reference. These adapt where tiles are coded sample by sample.
  using Used = std::array<std::array<BitModel, 2>, kReferenceKinds>;
  Used used;
  /// Which set codes levels of alpha; one more symbol stands for a plane of blocks.
  std::vector<SymbolModel> alpha_set;
  /// For each plane, which set codes it; one more symbol stands for a plane of zeros.
  std::vector<SymbolModel> block_set;
};

/// A set of models, made of stored weights at first use: many views do without some. Thread-safe.
class ModelSet {
 public:
  ModelSet(std::span<const ModelGroup> groups, std::span<const std::uint8_t> weights)
      : groups_(groups), weights_(weights.begin(), weights.end()) {}
  [[nodiscard]] std::span<const SymbolModel> models() const;

 private:
  std::span<const ModelGroup> groups_;
  std::vector<std::uint8_t> weights_;
  mutable std::once_flag once_;
  mutable std::vector<SymbolModel> models_;
};

/// Models as they are stored (FORMAT.md, "Shared tables").
struct StoredModels {
  std::array<std::uint8_t, 2 * kReferenceKinds * 2> used{};  ///< probabilities
  std::size_t alpha_sets = 0, block_sets = 0;  ///< 0 of both where tiles are coded by sample
  std::vector<std::uint8_t> weights;           ///< of choices, then of sets

  /// Where the weights of a level kind's choices begin, which are of `alpha_sets` + 1 symbols, then
  /// for each plane of `block_sets` + 1.
  [[nodiscard]] std::size_t choices(std::size_t level_kind) const {
    return level_kind * (alpha_sets + 1 + kPlanes * (block_sets + 1));
  }
  [[nodiscard]] Result<Bytes> pack() const;
  /// Of what pack() returns; untrusted.
  [[nodiscard]] static Result<StoredModels> unpack(ByteSpan packed);
};

/// The models of a codec. Levels of all kinds and planes share the sets.
struct PredictiveModels {
  std::array<LevelModels, 2> levels;
  std::size_t alpha_sets = 0, block_sets = 0;  ///< 0 of both where tiles are coded by sample
  std::vector<std::shared_ptr<const ModelSet>> alpha, blocks;
};

/// The tiles of one level.
struct PredictiveLevel {
  std::array<StepRange, kPlanesWithSteps> steps;
  std::shared_ptr<const PredictiveModels> models;
  std::size_t kind = 0;  ///< an index of models->levels
  ColorMatrix matrix = kYcbcr;

  /// The steps of a plane's coefficients in tiles of this scale (Predicted::scale).
  [[nodiscard]] std::array<std::int32_t, 64> steps_of(std::size_t plane, int scale) const;
  [[nodiscard]] const LevelModels& level_models() const { return models->levels[kind]; }
};

/// The tables of a codec. Levels beyond the last entry use the last entry.
struct PredictiveTables {
  /// Tables of version 2, those of releases up to 0.3 and of tiles that are coded sample by sample:
  /// YCbCr, steps without scales, and colours that are predicted by two taps.
  bool plain = false;
  std::vector<PredictiveLevel> levels;
  Bytes models;  ///< the models as they are stored

  [[nodiscard]] const PredictiveLevel& level(std::size_t index) const {
    return levels[index < levels.size() ? index : levels.size() - 1];
  }
};

/// Stands for lossless coding; above every other quality.
inline constexpr int kLosslessQuality = 101;

/// The parameters of a predictive codec.
struct PredictiveSettings {
  int quality = 90;  ///< 1..100, or kLosslessQuality
  SampleFormat format = SampleFormat::rgba8_depth8;

  /// Whether tiles are coded sample by sample (codec/predictive_channels.h), not with a transform.
  [[nodiscard]] bool by_sample() const { return quality == kLosslessQuality || is_half(format); }
};

/// Steps for the levels 0 to `finest` of a field, YCbCr, and models trained on several volumes.
[[nodiscard]] PredictiveTables predictive_tables(const PredictiveSettings& settings,
                                                 unsigned finest);

[[nodiscard]] Bytes to_bytes(const PredictiveTables& tables);

/// Parses the output of to_bytes(); untrusted. bad_file: anything else.
[[nodiscard]] Result<PredictiveTables> parse_predictive_tables(ByteSpan bytes);

/// The symbols of all models of a set together.
[[nodiscard]] std::size_t symbols_of(std::span<const ModelGroup> groups);

/// The initial probability that a byte of the tables stands for, in 1/65536.
[[nodiscard]] std::uint16_t probability_of(std::uint8_t byte);

}  // namespace slf::codec
