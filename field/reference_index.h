// ReferenceIndex: which tiles those of a level are predicted from, as a section of a file's index
// (doc/format/optional.md, "Index"). With it, a reader of a remote file requests a view's tiles and
// all their references at once. Payloads name their references, too, but must be fetched first.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "base/bytes.h"
#include "slf/error.h"
#include "slf/tile.h"

namespace slf {

/// The number of the section for the tiles of a level.
[[nodiscard]] constexpr std::uint32_t reference_section(unsigned level) { return 256 + level; }

/// Levels of more tiles have no such section: the tables of their records have none either.
inline constexpr std::uint64_t kMaxIndexedTiles = 1 << 16;

/// Thread-safety: immutable.
class ReferenceIndex {
 public:
  struct Tile {
    TileKey key;
    std::vector<TileKey> references;  ///< of the next coarser level
  };

  /// The section for tiles of one level above 0, in key order. They are of state 0, and stand for
  /// those of all states.
  [[nodiscard]] static Bytes encode(std::span<const Tile> tiles);

  /// Reads an untrusted section of a level above 0. Uses memory of about the section's size.
  /// bad_file: it is damaged.
  [[nodiscard]] static Result<ReferenceIndex> parse(ByteSpan section, unsigned level);

  /// Appends the tiles that a tile of the level is predicted from, and those that it is in other
  /// states, all of its own state. The field may not have them.
  void append_references(TileKey key, std::vector<TileKey>& to) const;

 private:
  /// The tiles into which one tile of the next coarser level divides.
  struct Family {
    std::uint64_t parent = 0;
    std::vector<std::uint64_t> references;  ///< of any of them
    Bytes uses;                             ///< bit r · kChildren + c: child c refers to r
  };

  unsigned level_ = 0;
  std::vector<Family> families_;  // by parent, ascending
};

/// Adds all tiles that the given ones are predicted from, directly or not.
/// `indices[level - 1]` is that of a level above 0. Sorts `tiles` and removes repetitions.
void append_ancestors(std::span<const ReferenceIndex> indices, std::vector<TileKey>& tiles);

}  // namespace slf
