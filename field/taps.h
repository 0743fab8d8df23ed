// Taps: the samples that rays take from tiles. Private to field/.
//
// A tap is what a ray needs of one entry vertex: up to three samples of one row of one tile. A
// block's taps are grouped by tile, so that each tile is pinned once per pass, and one at a time.
#pragma once

#include <array>
#include <cstdint>
#include <glm/glm.hpp>
#include <vector>

#include "base/error.h"
#include "field/level_geometry.h"
#include "field/tile_cache.h"

namespace slf {

/// Samples of one row of a tile: up to three columns, and how much each counts.
struct Tap {
  std::uint32_t entry_section = 0;
  std::uint32_t exit_section = 0;
  std::uint32_t row = 0;
  std::array<std::uint32_t, 3> columns{};
  std::array<float, 3> weights{};
};

/// What a tap found: premultiplied colour, and depth along the tapped ray, weighted by opacity.
struct TapValue {
  glm::vec4 rgba{0};
  float depth = 0;
  bool missing = false;  ///< the tile was never built
};

/// Reused from block to block. Thread-safety: one thread.
class TapGatherer {
 public:
  TapGatherer(const Field& field, TileCache& cache);

  /// Takes all taps at a level. `values` gets one value per tap. Depth is filled when `with_depth`.
  /// Touched tiles are added to touched(), each once per call.
  [[nodiscard]] Result<void> gather(const LevelGeometry& geometry, std::span<const Tap> taps,
                                    bool with_depth, std::vector<TapValue>& values);

  [[nodiscard]] std::vector<TileKey>& touched() { return touched_; }

 private:
  struct Group {
    std::uint64_t sections;  // entry << 32 | exit
    std::uint32_t begin;     // into order_
    std::uint32_t count;
  };
  void group(std::span<const Tap> taps);

  TileCache& cache_;
  storage::LayerId color_;
  std::optional<storage::LayerId> depth_;
  codec::SampleFormat format_;
  std::vector<Group> groups_;
  std::vector<std::uint32_t> order_;
  std::vector<std::uint32_t> group_of_;
  std::vector<std::uint32_t> slots_;  // open-addressing table over groups_
  std::vector<TileKey> touched_;
};

}  // namespace slf
