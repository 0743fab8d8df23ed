#include "field/write/field_index.h"

#include <vector>

#include "base/try.h"
#include "field/field_file.h"
#include "field/geometry/tile_order.h"
#include "field/reference_index.h"
#include "storage/tile_writer.h"

namespace slf {
namespace {

/// The tiles of a level, each with the tiles that it is predicted from.
Result<std::vector<ReferenceIndex::Tile>> references_of(const FieldFile& field, unsigned level,
                                                        const GoOn& go_on) {
  std::vector<ReferenceIndex::Tile> tiles;
  const auto visit = [&](const storage::TileRef& tile) -> Result<void> {
    if (go_on && !go_on()) return fail(ErrorCode::cancelled, field.path(), ": interrupted");
    if (tile.state != storage::TileState::stored || !field.shape().has(tile.key)) return {};
    tiles.push_back({tile.key, {}});
    for (const Reference& reference : field.coder().references(tile.key, tile.payload))
      tiles.back().references.push_back(reference.tile);
    return {};
  };
  SLF_TRY(field.store().visit(first_key(level), first_key(level + 1), visit));
  return tiles;
}

}  // namespace

Result<void> index_field(const std::string& path, const GoOn& go_on) {
  std::vector<storage::IndexExtra> extras;
  {
    const auto field = SLF_TRY(FieldFile::open(path));
    const bool listed = field->predicts() && field->manifest().states.empty();
    for (unsigned level = 1; listed && level <= field->shape().levels; ++level) {
      if (field->shape().tiles(level) > kMaxIndexedTiles) break;
      const auto tiles = SLF_TRY(references_of(*field, level, go_on));
      extras.push_back({reference_section(level), ReferenceIndex::encode(tiles)});
    }
  }
  return storage::write_index(path, extras, go_on);
}

}  // namespace slf
