#include "field/build/missing_tiles.h"

#include <algorithm>
#include <map>

#include "base/try.h"

namespace slf {

Result<MissingTiles> MissingTiles::of(const FieldFile& field, const TileOrder& order,
                                      TileSelection selection) {
  MissingTiles missing(std::move(selection));
  std::map<std::uint64_t, std::uint64_t> layers_by_rank;
  const std::size_t layers = field.manifest().layers.size();
  std::vector<std::uint64_t> ends(layers, 0);
  const auto mark_missing = [&](storage::LayerId layer, std::uint64_t begin, std::uint64_t end) {
    for (std::uint64_t rank = begin; rank < end; ++rank)
      layers_by_rank[rank] |= std::uint64_t{1} << layer;
  };
  for (storage::LayerId layer = 0; layer < layers; ++layer) {
    std::uint64_t& end = ends[layer];
    SLF_TRY(field.store().visit(layer, {0, 0}, {255, 0},
                                [&](const storage::TileRef& tile) -> Result<void> {
                                  if (!field.shape().has(tile.key)) return {};
                                  const std::uint64_t number = order.number(tile.key);
                                  if (!missing.selection_.has(number)) return {};
                                  const std::uint64_t rank = missing.selection_.rank(number);
                                  mark_missing(layer, end, rank);
                                  end = rank + 1;
                                  return {};
                                }));
  }
  missing.end_ = *std::max_element(ends.begin(), ends.end());
  for (storage::LayerId layer = 0; layer < layers; ++layer)
    mark_missing(layer, ends[layer], missing.end_);
  missing.holes_.reserve(layers_by_rank.size());
  for (const auto& [rank, missing_layers] : layers_by_rank)
    missing.holes_.push_back({rank, missing_layers});
  return missing;
}

TileSelection MissingTiles::numbers() const {
  TileSelection numbers;
  for (const Hole& hole : holes_) {
    const std::uint64_t number = selection_.number(hole.rank);
    numbers.add({number, number + 1});
  }
  if (end_ == selection_.count()) return numbers;
  const std::uint64_t first = selection_.number(end_);
  for (const NumberRange& range : selection_.ranges())
    if (range.end > first) numbers.add({std::max(range.begin, first), range.end});
  return numbers;
}

}  // namespace slf
