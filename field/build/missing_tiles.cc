#include "field/build/missing_tiles.h"

#include <algorithm>
#include <map>

namespace slf {

Result<MissingTiles> MissingTiles::of(const FieldFile& field, const TileOrder& order,
                                      TileSelection wanted) {
  MissingTiles missing(std::move(wanted));
  std::map<std::uint64_t, std::uint64_t> layers_by_rank;
  const std::size_t layers = field.manifest().layers.size();
  std::vector<std::uint64_t> ends(layers, 0);
  const auto lacks = [&](storage::LayerId layer, std::uint64_t begin, std::uint64_t end) {
    for (std::uint64_t rank = begin; rank < end; ++rank)
      layers_by_rank[rank] |= std::uint64_t{1} << layer;
  };
  for (storage::LayerId layer = 0; layer < layers; ++layer) {
    std::uint64_t& end = ends[layer];
    const auto visited = field.store().visit(
        layer, {0, 0}, {255, 0}, [&](const storage::TileRef& tile) -> Result<void> {
          if (!field.shape().has(tile.key)) return {};
          const std::uint64_t number = order.number(tile.key);
          if (!missing.wanted_.has(number)) return {};
          const std::uint64_t rank = missing.wanted_.rank(number);
          lacks(layer, end, rank);
          end = rank + 1;
          return {};
        });
    if (!visited) return tl::unexpected(visited.error());
  }
  missing.end_ = *std::max_element(ends.begin(), ends.end());
  for (storage::LayerId layer = 0; layer < layers; ++layer) lacks(layer, ends[layer], missing.end_);
  missing.holes_.reserve(layers_by_rank.size());
  for (const auto& [rank, lacking] : layers_by_rank) missing.holes_.push_back({rank, lacking});
  return missing;
}

}  // namespace slf
