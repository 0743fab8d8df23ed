#include "field/write/field_index.h"

#include <map>
#include <vector>

#include "base/sort_unique.h"
#include "base/try.h"
#include "field/field_file.h"
#include "field/geometry/tile_order.h"
#include "field/reference_index.h"
#include "storage/tile_writer.h"

namespace slf {
namespace {

/// The tiles of a level, each with those of the next coarser level that it is predicted from in any
/// state, as if of state 0.
Result<std::vector<ReferenceIndex::Tile>> references_of(const FieldFile& field, unsigned level,
                                                        const GoOn& go_on) {
  std::map<TileKey, std::vector<TileKey>> references;
  const auto visit = [&](const storage::TileRef& tile) -> Result<void> {
    if (go_on && !go_on()) return fail(ErrorCode::cancelled, field.path(), ": interrupted");
    if (tile.state != storage::TileState::stored || !field.shape().has(tile.key)) return {};
    auto& of_all = references[in_state(tile.key, 0)];
    for (const TileKey reference : field.coder().references(tile.key, tile.payload))
      if (reference.level < level) of_all.push_back(in_state(reference, 0));
    sort_unique(of_all);
    return {};
  };
  SLF_TRY(field.store().visit(first_key(level), first_key(level + 1), visit));
  std::vector<ReferenceIndex::Tile> tiles;
  tiles.reserve(references.size());
  for (auto& [key, of_all] : references) tiles.push_back({key, std::move(of_all)});
  return tiles;
}

}  // namespace

Result<void> index_field(const std::string& path, const GoOn& go_on) {
  std::vector<storage::IndexExtra> extras;
  {
    const auto field = SLF_TRY(FieldFile::open(path));
    for (unsigned level = 1; field->predicts() && level <= field->shape().levels; ++level) {
      if (field->shape().tiles(level) / field->shape().states > kMaxIndexedTiles) break;
      const auto tiles = SLF_TRY(references_of(*field, level, go_on));
      extras.push_back({reference_section(level), ReferenceIndex::encode(tiles)});
    }
  }
  return storage::write_index(path, extras, go_on);
}

}  // namespace slf
