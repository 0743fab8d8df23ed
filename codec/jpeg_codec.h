// JpegCodec: lossy, for rgba8 colour and depth8 (FORMAT.md, "The jpeg codec").
#pragma once

#include <memory>

#include "codec/codec.h"
#include "codec/jpeg_tables.h"

namespace slf::codec {

enum class ChromaSampling : std::uint8_t { full, half };

struct JpegOptions {
  int quality = 75;  ///< 1..100
  ChromaSampling chroma = ChromaSampling::half;
};

/// REQUIRES: format is rgba8 or depth8.
[[nodiscard]] std::unique_ptr<Codec> make_jpeg_codec(SampleFormat format,
                                                     const JpegOptions& options,
                                                     const JpegTables& tables);

/// Returns tables with Huffman codes optimised for a sample of tiles.
[[nodiscard]] JpegTables train_tables(SampleFormat format, const JpegOptions& options,
                                      std::span<const TrainingTile> sample);

}  // namespace slf::codec
