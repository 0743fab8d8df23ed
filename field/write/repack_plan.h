// RepackPlan: what a repack makes of some states, and how.
#pragma once

#include <memory>

#include "field/field_file.h"
#include "field/manifest.h"
#include "field/write/train_codec.h"
#include "slf/repack.h"

namespace slf {

struct RepackPlan {
  const FieldFile& first;  ///< of the first state
  Manifest manifest;
  std::unique_ptr<TileSource> source;
  bool copy = false;  ///< payloads are copied, not encoded again
  KeptBlobs kept;     ///< by the copy

  [[nodiscard]] TileCoder::Geometries geometries() const;
  /// The codec of the copy. Errors of train_codec().
  [[nodiscard]] Result<std::unique_ptr<codec::Codec>> codec(unsigned threads,
                                                            const GoOn& go_on) const;
};

/// Plans a repack of a state, or of several to one field. They must outlive the plan. `memory`:
/// bytes of decoded tiles. Errors as join_states().
[[nodiscard]] Result<RepackPlan> plan_repack(std::span<const StateSource> states,
                                             const RepackOptions& options, std::uint64_t memory);

}  // namespace slf
