// Tiles for tests: shapes and contents that codecs meet, made without randomness of the machine.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "codec/codec.h"

namespace slf::codec {

/// A tile that owns its positions and samples.
struct SampleTile {
  std::vector<LocalPoint> positions;
  TileShape tile;  ///< views positions
  Bytes samples;

  SampleTile() = default;
  SampleTile(SampleTile&&) = default;
  SampleTile& operator=(SampleTile&&) = default;
};

enum class Content {
  zero,      ///< nothing there
  constant,  ///< one opaque colour
  smooth,    ///< a soft, opaque surface that shifts a little from picture to picture
  disc,      ///< the same inside a disc, clear outside, translucent at the rim
  veil,      ///< alpha from 0 to 255 everywhere
  noise,     ///< all bytes random, also colour above alpha and NaN halves
};

constexpr Content kAllContents[] = {Content::zero, Content::constant, Content::smooth,
                                    Content::disc, Content::veil,     Content::noise};
constexpr SampleFormat kAllFormats[] = {SampleFormat::rgba8, SampleFormat::rgba16f,
                                        SampleFormat::rgba8_depth8, SampleFormat::rgba16f_depth8};

[[nodiscard]] std::string name(Content content);

/// The first `rows` points of a triangular lattice in the order TileShape asks for.
[[nodiscard]] SampleTile make_tile(SampleFormat format, std::size_t rows, std::uint32_t side,
                                   Content content);

/// xorshift64*: the same numbers on every machine.
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed * 0x9E3779B97F4A7C15u + 1) {}
  std::uint64_t next() {
    state_ ^= state_ >> 12;
    state_ ^= state_ << 25;
    state_ ^= state_ >> 27;
    return state_ * 0x2545F4914F6CDD1Du;
  }
  /// 0 <= result < bound.
  std::size_t below(std::size_t bound) { return (next() >> 33) % bound; }

 private:
  std::uint64_t state_;
};

/// dB between samples of 8 bits: over R, G and B, or over depths where `expected` is not 0, which
/// is to say nothing; whichever is lower. Infinity when equal.
[[nodiscard]] double psnr(const TileShape& tile, ByteSpan expected, ByteSpan found);

}  // namespace slf::codec
