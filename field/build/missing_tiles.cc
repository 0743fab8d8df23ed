#include "field/build/missing_tiles.h"

#include <algorithm>
#include <map>

namespace slf {

Result<MissingTiles> MissingTiles::of(const FieldFile& field, const TileOrder& order) {
  MissingTiles missing(order);
  std::map<std::uint64_t, std::uint64_t> layers_by_number;
  const std::size_t layers = field.manifest().layers.size();
  std::vector<std::uint64_t> ends(layers, 0);
  for (storage::LayerId layer = 0; layer < layers; ++layer) {
    std::uint64_t& end = ends[layer];
    const auto visited = field.store().visit(layer, {0, 0}, {255, 0},
                                             [&](const storage::TileRef& tile) -> Result<void> {
                                               if (!field.shape().has(tile.key)) return {};
                                               const std::uint64_t number = order.number(tile.key);
                                               for (; end < number; ++end)
                                                 layers_by_number[end] |= std::uint64_t{1} << layer;
                                               end = number + 1;
                                               return {};
                                             });
    if (!visited) return tl::unexpected(visited.error());
  }
  missing.end_ = *std::max_element(ends.begin(), ends.end());
  for (storage::LayerId layer = 0; layer < layers; ++layer)
    for (std::uint64_t number = ends[layer]; number < missing.end_; ++number)
      layers_by_number[number] |= std::uint64_t{1} << layer;
  missing.holes_.reserve(layers_by_number.size());
  for (const auto& [number, lacking] : layers_by_number)
    missing.holes_.push_back({number, lacking});
  return missing;
}

}  // namespace slf
