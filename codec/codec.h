// Codec: turns the samples of one tile into bytes and back.
//
// A tile is a stack of `rows` triangular pictures of equal side. Codecs do not depend on spheres,
// files or keys. Encoded bytes are untrusted: any input decodes to samples or to an error. No input
// makes a decoder crash, hang, read beyond the input, or allocate more than the shape implies.
//
// Thread-safety: a Codec is immutable; encode and decode may be called from many threads at once.
//
//   auto codec = codec::make_codec("jpeg:75", codec::SampleFormat::rgba8);
//   Bytes payload;
//   codec.value()->encode(tile, samples, nullptr, payload);
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/bytes.h"
#include "base/tile_shape.h"
#include "slf/error.h"
#include "slf/tile.h"

namespace slf::codec {

using slf::LocalPoint;
using slf::sample_bytes;
using slf::SampleFormat;
using slf::TileShape;

struct Predicted;

class Codec {
 public:
  virtual ~Codec() = default;

  /// The full, normalised specification, e.g. "jpeg:75"; make_codec accepts it.
  [[nodiscard]] virtual std::string spec() const = 0;

  /// Whether decode restores exactly the samples given to encode.
  [[nodiscard]] virtual bool lossless() const = 0;

  /// Whether tiles of levels above 0 are coded as differences from a prediction. Other codecs
  /// ignore predictions.
  [[nodiscard]] virtual bool predicts() const { return false; }

  /// Predicted::used of a payload, untrusted, for a tile of this level with candidates of these
  /// kinds. Empty if the codec does not predict.
  [[nodiscard]] virtual std::vector<std::uint8_t> references(
      unsigned /*level*/, std::span<const std::uint8_t> /*kinds*/, ByteSpan /*payload*/) const {
    return {};
  }

  /// For each sample of a tile, the number of the block that it is coded with, from 0 on, where a
  /// prediction may change without harm. Empty if the codec does not predict.
  [[nodiscard]] virtual std::vector<std::uint32_t> blocks(const TileShape& /*tile*/) const {
    return {};
  }

  /// Whether it keeps rays of Predicted::earlier, and the tile has no such blocks.
  [[nodiscard]] virtual bool keeps_rays() const { return false; }

  /// Bytes that decoding any tile needs and that are stored once per field, such as shared JPEG
  /// tables. Empty for codecs without any.
  [[nodiscard]] virtual ByteSpan tables() const { return {}; }

  /// Encodes `samples` (exactly tile.bytes() bytes) and replaces the content of `payload`. The same
  /// samples and predictions give the same bytes on every machine and thread, with the same
  /// versions of compression libraries. A tile with samples gets at least one byte, because no
  /// bytes stand for an empty tile; a tile without rows gets none. `predicted` is null for a tile
  /// of level 0, which is predicted from nothing.
  [[nodiscard]] virtual Result<void> encode(const TileShape& tile, ByteSpan samples,
                                            const Predicted* predicted, Bytes& payload) const = 0;

  /// Decodes `payload` into `samples` (exactly tile.bytes() bytes, at any alignment; caller-owned).
  /// `predicted` is what encode() was given, or null as well.
  /// bad_file: the payload is damaged, of another shape, or predicted from other tiles; the content
  /// of `samples` is undefined.
  [[nodiscard]] virtual Result<void> decode(const TileShape& tile, ByteSpan payload,
                                            const Predicted* predicted,
                                            std::span<std::byte> samples) const = 0;

  /// Whether it expects colours halfway between predicted columns from four of these, not two
  /// (FORMAT.md, "Prediction").
  [[nodiscard]] virtual bool four_taps() const { return false; }
};

/// Whether a codec of this specification predicts.
[[nodiscard]] bool is_predictive(std::string_view spec);

/// Makes a codec from its specification: "raw", "zstd", "zstd:LEVEL", "jpeg:QUALITY",
/// "jpeg:QUALITY:444", "predictive:QUALITY", "predictive:lossless".
/// `tables` are Codec::tables() of a codec with the same specification, untrusted. Empty selects
/// the defaults. usage: an unknown name, or a parameter out of range; the message lists what is
/// valid. bad_file: `tables` are damaged, or not empty although the codec has none. unsupported:
/// the codec cannot store this format: JPEG stores no half floats, predictive codecs no colour
/// without depth.
[[nodiscard]] Result<std::unique_ptr<Codec>> make_codec(std::string_view spec, SampleFormat format,
                                                        ByteSpan tables = {});

/// Whether train_codec() looks at its sample.
[[nodiscard]] bool needs_training(std::string_view spec);

/// One tile of a training set. Views the samples.
struct TrainingTile {
  TileShape tile;
  ByteSpan samples;
};
inline constexpr std::size_t kTrainingTiles = 16;  ///< that suffice

/// Makes a codec with shared tables for a field. A predictive codec gets tables for levels 0 to
/// `finest`. A JPEG codec gets Huffman codes optimised for `sample`, tiles of the field, or the
/// standard ones if it is empty. Other codecs are those of make_codec(spec, format). Deterministic.
[[nodiscard]] Result<std::unique_ptr<Codec>> train_codec(std::string_view spec, SampleFormat format,
                                                         std::span<const TrainingTile> sample,
                                                         unsigned finest = 0);

}  // namespace slf::codec
