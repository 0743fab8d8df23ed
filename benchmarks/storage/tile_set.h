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
  std::vector<TileShape> shapes;  ///< empty if tiles are never decoded
  std::shared_ptr<const codec::Codec> codec;
  std::shared_ptr<const void> owner;  ///< of the data that `shapes` view

  [[nodiscard]] std::size_t size() const { return payloads.size(); }
  [[nodiscard]] std::uint64_t bytes() const;
  /// Whether tiles are pictures of 8-bit colour in JPEG, which picture formats can hold too.
  [[nodiscard]] bool jpeg_color() const;
  void decode(std::size_t tile, ByteSpan payload, Bytes& samples) const;
};

/// The stored colour tiles of a field's finest level, at most `max_tiles`, taken evenly.
[[nodiscard]] TileSet tiles_of_field(const std::string& path, std::size_t max_tiles);

/// Repeats the set under further keys until it has about `bytes`. In a small file, the readahead of
/// a single cold read would load a large part of the other tiles.
[[nodiscard]] TileSet repeated(TileSet set, std::uint64_t bytes);

/// Textured colour tiles whose payloads as jpeg:75 are about `payload_bytes` long.
[[nodiscard]] TileSet synthetic_tiles(std::size_t payload_bytes, std::size_t count);

/// Random payloads, for scenarios that never decode.
[[nodiscard]] TileSet opaque_tiles(std::size_t payload_bytes, std::size_t count);

}  // namespace slf::bench
