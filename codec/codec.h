// Codec: turns the samples of one tile into bytes and back.
//
// A tile is a stack of `rows` triangular pictures of equal side. A codec knows nothing of
// spheres, files or keys. It treats encoded bytes as untrusted: any input decodes to samples or
// to an error, with no crash, no hang, no over-read and no allocation beyond what the shape
// implies.
//
// Thread-safety: a Codec is immutable; encode and decode may be called from many threads at once.
//
//   auto codec = codec::make_codec("jpeg:75", codec::SampleFormat::rgba8);
//   Bytes payload;
//   codec.value()->encode(tile, samples, payload);
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "base/bytes.h"
#include "slf/error.h"

namespace slf::codec {

/// What one sample holds, in memory and in order.
enum class SampleFormat : std::uint8_t {
  rgba8 = 0,    ///< 4 bytes: premultiplied R, G, B and A
  depth8 = 1,   ///< 1 byte: depth along the chord, 0 at entry, 255 at exit
  rgba16f = 2,  ///< 8 bytes: premultiplied R, G, B, A as little-endian IEEE half floats
};

[[nodiscard]] constexpr std::size_t sample_bytes(SampleFormat format) {
  return format == SampleFormat::rgba8 ? 4 : format == SampleFormat::depth8 ? 1 : 8;
}

/// Where a picture of the stack was taken: integer coordinates on a triangular lattice. Pictures
/// at adjacent coordinates, (±1, 0), (0, ±1) and (±1, ∓1), look alike.
struct LocalPoint {
  std::uint16_t p = 0;
  std::uint16_t q = 0;
  friend bool operator==(const LocalPoint&, const LocalPoint&) = default;
};

/// The shape of a tile: positions.size() pictures ("rows"), each a triangle of
/// (side+1)(side+2)/2 samples ("columns"). Samples lie row after row; within a row the sample at
/// (p, q), p + q <= side, has index q*(side+1) - q*(q-1)/2 + p: lines of constant q, each one
/// shorter than the one before.
/// `positions` is only viewed: it must outlive the Tile. Positions are distinct and in ascending
/// (q, p) order.
struct Tile {
  SampleFormat format = SampleFormat::rgba8;
  std::uint32_t side = 0;
  std::span<const LocalPoint> positions;

  [[nodiscard]] std::size_t rows() const { return positions.size(); }
  [[nodiscard]] std::size_t columns() const {
    return static_cast<std::size_t>(side + 1) * (side + 2) / 2;
  }
  [[nodiscard]] std::size_t bytes() const { return rows() * columns() * sample_bytes(format); }
};

class Codec {
 public:
  virtual ~Codec() = default;

  /// The full, normalised specification, e.g. "jpeg:75"; make_codec accepts it.
  [[nodiscard]] virtual std::string spec() const = 0;

  /// Whether decode returns exactly what encode was given.
  [[nodiscard]] virtual bool lossless() const = 0;

  /// Whether a payload is the samples themselves, so that a reader may use it where it lies and
  /// skip decode. A payload of another size than tile.bytes() is damaged, as decode would say.
  [[nodiscard]] virtual bool in_place() const { return false; }

  /// Bytes that every tile's decoder needs and that are stored once per field (shared JPEG tables,
  /// a dictionary); empty for codecs without any.
  [[nodiscard]] virtual ByteSpan tables() const { return {}; }

  /// Encodes `samples` (exactly tile.bytes() bytes) and appends nothing: `payload` is replaced.
  /// The same samples give the same bytes on every machine and thread.
  [[nodiscard]] virtual Result<void> encode(const Tile& tile, ByteSpan samples,
                                            Bytes& payload) const = 0;

  /// Decodes `payload` into `samples` (exactly tile.bytes() bytes, caller-owned).
  /// bad_file: the payload is damaged or is not of this shape; `samples` then holds garbage.
  [[nodiscard]] virtual Result<void> decode(const Tile& tile, ByteSpan payload,
                                            std::span<std::byte> samples) const = 0;
};

/// Makes a codec from its specification: "raw", "zstd", "zstd:LEVEL", "jpeg:QUALITY",
/// "jpeg:QUALITY:444".
/// `tables` is what an equal codec's tables() returned, untrusted; empty for the defaults.
/// usage: unknown name, or a parameter out of range; the message lists what is known.
/// bad_file: tables that are damaged, or for a codec that has none.
/// unsupported: the codec cannot hold this format (JPEG and half floats).
[[nodiscard]] Result<std::unique_ptr<Codec>> make_codec(std::string_view spec, SampleFormat format,
                                                        ByteSpan tables = {});

/// One tile of a training set; views only.
struct TrainingTile {
  Tile tile;
  ByteSpan samples;
};

/// Makes the codec whose shared tables fit a sample of a field's tiles best (Huffman tables
/// optimised over them). Deterministic. With an empty sample, or for codecs without tables,
/// the same as make_codec(spec, format).
[[nodiscard]] Result<std::unique_ptr<Codec>> train_codec(std::string_view spec, SampleFormat format,
                                                         std::span<const TrainingTile> sample);

}  // namespace slf::codec
