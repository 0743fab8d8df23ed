// The codecs that codec_peers compares: ours, and those of other libraries.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "base/bytes.h"
#include "slf/field.h"
#include "slf/tile.h"

namespace slf::bench {

/// The colours of one tile of the field, decoded.
struct Sample {
  TileKey key;
  Bytes color;
};

/// What one codec does with a tile. Errors end the program.
struct Contender {
  std::string name;
  std::function<void(const Sample&, Bytes&)> encode;
  std::function<void(const Sample&, ByteSpan, Bytes&)> decode;  // to colours
  bool lossless = false;
};

/// Our codec, with tables trained on some of the samples. `field` must outlive it.
[[nodiscard]] Contender ours(const Field& field, const std::string& spec,
                             const std::vector<Sample>& samples);
/// The alpha of lossless colour alone: the part of its payload that is not RGB.
[[nodiscard]] Contender alpha_of_zstd(const Field& field);

// Peers encode the RGB planes as mirrored mosaics (codec/mosaic.h). `field` must outlive them.
[[nodiscard]] Contender png(const Field& field);
[[nodiscard]] Contender webp(const Field& field, int effort);
[[nodiscard]] Contender libjpeg(const Field& field, int quality, bool full_chroma);
[[nodiscard]] Contender plain_zstd(const Field& field, int level);
[[nodiscard]] Contender median_zstd(const Field& field, int level);

}  // namespace slf::bench
