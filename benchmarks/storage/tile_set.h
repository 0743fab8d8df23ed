// TileSet: the encoded tiles that every store of a comparison holds.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "codec/codec.h"

namespace slf::bench {

struct TileSet {
  std::string name;
  std::uint8_t level = 0;
  std::vector<std::uint64_t> keys;  ///< ascending indexes within the level
  std::vector<Bytes> payloads;
  std::vector<codec::Tile> shapes;  ///< empty where tiles are never decoded
  std::shared_ptr<const codec::Codec> codec;
  std::shared_ptr<const void> owner;  ///< of what shapes view

  [[nodiscard]] std::size_t size() const { return payloads.size(); }
  [[nodiscard]] std::uint64_t bytes() const;
  /// Whether tiles are pictures of 8-bit colour in JPEG, which picture formats can hold too.
  [[nodiscard]] bool jpeg_color() const;
  void decode(std::size_t tile, ByteSpan payload, Bytes& samples) const;
};

/// The stored colour tiles of a field's finest level, at most `most`, taken evenly.
[[nodiscard]] TileSet tiles_of_field(const std::string& path, std::size_t most);

/// The set again and again, under further keys, until it has about `bytes`: cold reads of a file so
/// small that reading one tile reads ahead a good part of the others would say little.
[[nodiscard]] TileSet repeated(TileSet set, std::uint64_t bytes);

/// Textured colour tiles whose payloads as jpeg:75 are about `payload_bytes` long.
[[nodiscard]] TileSet synthetic_tiles(std::size_t payload_bytes, std::size_t count);

/// Payloads without meaning, for what never decodes.
[[nodiscard]] TileSet opaque_tiles(std::size_t payload_bytes, std::size_t count);

}  // namespace slf::bench
