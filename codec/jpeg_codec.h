// JpegCodec: lossy, for rgba8 colours and their depths (FORMAT.md, "The jpeg codec").
#pragma once

#include <memory>

#include "codec/codec.h"
#include "codec/jpeg_decode.h"
#include "codec/jpeg_tables.h"

namespace slf::codec {

struct JpegOptions {
  int quality = 75;  ///< 1..100
  JpegColor color = JpegColor::ycbcr_420;
};

/// The tables of the streams of a tile: of its colours, and of its depths if it has any.
struct JpegTileTables {
  JpegTables color;
  JpegTables depth;
};
[[nodiscard]] JpegTileTables standard_tables(const JpegOptions& options);

/// REQUIRES: the format has no half floats.
[[nodiscard]] std::unique_ptr<Codec> make_jpeg_codec(SampleFormat format,
                                                     const JpegOptions& options,
                                                     const JpegTileTables& tables);

/// Returns tables with Huffman codes optimised for a sample of tiles.
[[nodiscard]] JpegTileTables train_tables(SampleFormat format, const JpegOptions& options,
                                          std::span<const TrainingTile> sample);

}  // namespace slf::codec
