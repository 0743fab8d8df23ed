// write_tiles: the one loop that writes the tiles of a field, for builds, repacks and merges.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>

#include "base/reporter.h"
#include "field/geometry/tile_selection.h"
#include "field/manifest.h"
#include "field/write/field_writer.h"
#include "field/write/tile_source.h"
#include "field/write/write_budget.h"
#include "slf/error.h"

namespace slf {

struct WritePlan {
  const Manifest& manifest;  ///< of the new field
  const WriteBudget budget;
  const TileCoder* coder = nullptr;     ///< null: the source's payloads are copied
  const TileSelection& all;             ///< that the field has when it is complete
  std::optional<TileReader> coarser{};  ///< if another file has the coarser levels
  /// Between commits, besides those of the budget: the most work that a kill can lose.
  double commit_seconds = std::numeric_limits<double>::infinity();
};

struct WriteReport {
  std::uint64_t tiles = 0;    ///< written, stored, empty or the same as others
  std::uint64_t missing = 0;  ///< in the source, and so in the field
  std::uint64_t payload_bytes = 0;
};

/// Writes tiles of a source, by their numbers in key order, on all threads; the bytes do not depend
/// on how many. Stores tiles whose samples equal those of an earlier state once. Tiles that are
/// predicted are made level by level and state by state, from what is committed before. Missing
/// tiles of the field's part stay missing. cancelled: the reporter asked to stop; what was made is
/// committed. Errors of the source, the coder and the writer, which is not finished.
[[nodiscard]] Result<WriteReport> write_tiles(const TileSource& source, const WritePlan& plan,
                                              const TileSelection& tiles, FieldWriter& writer,
                                              Reporter& reporter);

}  // namespace slf
