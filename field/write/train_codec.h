// The codec of a new field, with shared tables that are fitted to a sample of its tiles.
#pragma once

#include <memory>

#include "base/reporter.h"
#include "field/write/tile_source.h"

namespace slf {

/// The tables are the same for any number of threads. cancelled: stopped by `go_on`, which is asked
/// at least once.
[[nodiscard]] Result<std::unique_ptr<codec::Codec>> train_codec(
    const TileSource& source, const TileCoder::Geometries& geometries, const Manifest& manifest,
    unsigned threads, const GoOn& go_on);

}  // namespace slf
