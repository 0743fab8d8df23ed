#include "field/write/missing_tiles.h"

#include <algorithm>

#include "base/try.h"

namespace slf {

Result<MissingTiles> MissingTiles::of(const FieldFile& field, const TileOrder& order,
                                      TileSelection selection) {
  MissingTiles missing(std::move(selection));
  SLF_TRY(field.store().visit({0, 0}, {255, 0}, [&](const storage::TileRef& tile) -> Result<void> {
    if (!field.shape().has(tile.key)) return {};
    const std::uint64_t number = order.number(tile.key);
    if (!missing.selection_.has(number)) return {};
    const std::uint64_t rank = missing.selection_.rank(number);
    for (; missing.end_ < rank; ++missing.end_) missing.holes_.push_back(missing.end_);
    ++missing.end_;
    return {};
  }));
  return missing;
}

TileSelection MissingTiles::numbers() const {
  TileSelection numbers;
  for (const std::uint64_t rank : holes_) {
    const std::uint64_t number = selection_.number(rank);
    numbers.add({number, number + 1});
  }
  if (end_ == selection_.count()) return numbers;
  const std::uint64_t first = selection_.number(end_);
  for (const NumberRange& range : selection_.ranges())
    if (range.end > first) numbers.add({std::max(range.begin, first), range.end});
  return numbers;
}

}  // namespace slf
