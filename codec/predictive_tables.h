// The tables that all tiles of a predictive layer share: quantisation steps for each level, and the
// initial probabilities of the models.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "base/bytes.h"
#include "codec/alpha_levels.h"
#include "codec/block_coder.h"
#include "codec/range_coder.h"
#include "slf/error.h"
#include "slf/tile.h"

namespace slf::codec {

enum PredictivePlane : std::size_t { kAlphaPlane, kDepthPlane, kLumaPlane, kChromaPlane };
inline constexpr std::size_t kPredictivePlanes = 4;

/// The step of a coefficient grows with its frequency, from `low` for the mean of a block to `high`
/// for the finest detail; in 1/16 of a sample's unit, 1..65535. Samples that are coded one by one
/// have the step `low`.
struct StepRange {
  std::uint16_t low = 16, high = 16;

  /// The steps of a Block's coefficients.
  [[nodiscard]] std::array<std::int32_t, 64> steps() const;
  friend bool operator==(const StepRange&, const StepRange&) = default;
};

inline constexpr std::size_t kReferenceKinds = 4;

/// The models of a tile. It has no members but BitModels, so it can be used as an array of them.
struct PredictiveModels {
  BitModel used[kReferenceKinds][2];
  BitModel soft;
  AlphaModels alpha;
  BlockModels planes[kPredictivePlanes];

  static const std::size_t kCount;
  [[nodiscard]] BitModel* begin() { return reinterpret_cast<BitModel*>(this); }
};
inline const std::size_t PredictiveModels::kCount = sizeof(PredictiveModels) / sizeof(BitModel);

/// The tiles of one level.
struct PredictiveLevel {
  std::array<StepRange, kPredictivePlanes> steps;
  PredictiveModels models;
  /// Whether differences of colour are those of premultiplied colours. In older files they are not.
  bool premultiplied = true;
};

/// The tables of a layer. Levels beyond the last entry use the last entry.
struct PredictiveTables {
  std::vector<PredictiveLevel> levels;
  Bytes models;  ///< the initial probabilities of all levels' models, as they are stored

  [[nodiscard]] const PredictiveLevel& level(std::size_t index) const {
    return levels[index < levels.size() ? index : levels.size() - 1];
  }
};

/// Stands for lossless coding; above every other quality.
inline constexpr int kLosslessQuality = 101;

/// The parameters of a predictive layer.
struct PredictiveSettings {
  int quality = 90;  ///< 1..100, or kLosslessQuality
  SampleFormat format = SampleFormat::rgba8_depth8;

  /// Whether tiles are coded sample by sample (codec/predictive_channels.h), not with a transform.
  [[nodiscard]] bool by_sample() const {
    return quality == kLosslessQuality || format == SampleFormat::rgba16f_depth8;
  }
};

/// Steps for the levels 0 to `finest` of a field, and probabilities trained on several volumes.
[[nodiscard]] PredictiveTables predictive_tables(const PredictiveSettings& settings,
                                                 unsigned finest);

[[nodiscard]] Bytes to_bytes(const PredictiveTables& tables);

/// Parses the output of to_bytes(); untrusted. bad_file: anything else.
[[nodiscard]] Result<PredictiveTables> parse_predictive_tables(ByteSpan bytes);

/// The initial probability that a byte of the tables stands for, in 1/65536; and the byte nearest
/// to a probability.
[[nodiscard]] std::uint16_t probability_of(std::uint8_t byte);
[[nodiscard]] std::uint8_t byte_of_probability(double probability);

}  // namespace slf::codec
