// TileReader: finds, checks, decodes and keeps the tiles of a field, within a memory budget.
//
//   TileReader tiles(field, {.memory = 64 << 20});
//   Renderer renderer(tiles), another(tiles);  // these share what is decoded
//   auto tile = tiles.read({0, 5});
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "slf/error.h"
#include "slf/field.h"
#include "slf/tile.h"

namespace slf {

class TileCache;  // internal

struct TileReaderOptions {
  /// Bytes of decoded tiles. Not included, for each level that is read: about 32 N² bytes to find
  /// the rows of the entry vertices, with N = FieldShape::entry_resolution(level); and a table of
  /// tiles that takes 4 KiB for each 128 neighbours of which one was loaded.
  std::uint64_t memory = 256ull << 20;
};

/// A handle: copies share the decoded tiles and one budget. When that is used up, the tiles that
/// were not used for longest are evicted, except those that somebody holds. A tile that others are
/// predicted from is a tile like any other. Thread-safety: any thread.
class TileReader {
 public:
  /// Keeps a copy of the field's handle.
  explicit TileReader(const Field& field, const TileReaderOptions& options = {});

  /// A tile that stays decoded while this or a copy lives; it keeps the reader alive.
  class Tile {
   public:
    /// Whether it, or a tile that it is predicted from, was never built. Then it has no samples.
    [[nodiscard]] bool missing() const { return missing_; }
    /// Premultiplied colours, rgba8 or rgba16f as Field::format() says, for each entry vertex those
    /// of all exit vertices (FORMAT.md, "Samples"). None if the tile is empty: all would be 0.
    [[nodiscard]] std::span<const std::byte> colors() const { return colors_; }
    /// A byte for each sample, in the same order; none if the tile is empty or has no depth.
    [[nodiscard]] std::span<const std::byte> depths() const { return depths_; }

   private:
    friend class TileReader;
    std::shared_ptr<const void> pin_;
    std::span<const std::byte> colors_, depths_;
    bool missing_ = false;
  };

  /// Reads a tile, and first those that it is predicted from, unless they are kept already. A tile
  /// that was never built is no error: see Tile::missing(). usage: the field has no such tile.
  /// bad_file: it, or one that it is predicted from, is damaged. unsupported: the field declares so
  /// many tiles of its level that the tables for them would take far more than `memory` and the
  /// file.
  [[nodiscard]] Result<Tile> read(TileKey key) const;

  [[nodiscard]] const Field& field() const;

  /// For slf's own libraries; the type is not installed.
  [[nodiscard]] TileCache& cache() const;

 private:
  struct State;
  std::shared_ptr<State> state_;
};

}  // namespace slf
