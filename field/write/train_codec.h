// The codec of a new field, with shared tables that are fitted to a sample of its tiles.
#pragma once

#include <memory>

#include "base/reporter.h"
#include "field/write/tile_source.h"

namespace slf {

/// Runs of tiles that a codec which predicts is fitted to; those of a sketch give nearly the same.
constexpr std::uint64_t kTrainingRuns = 24, kSketchedRuns = 4;

/// The tables are the same for any number of threads. Fits to at most `runs`; takes some tiles of
/// `source` several times. cancelled: stopped by `go_on`, which is asked at least once.
[[nodiscard]] Result<std::unique_ptr<codec::Codec>> train_codec(
    const TileSource& source, const TileCoder::Geometries& geometries, const Manifest& manifest,
    unsigned threads, const GoOn& go_on, std::uint64_t runs = kTrainingRuns);

}  // namespace slf
