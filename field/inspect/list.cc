#include <algorithm>

#include "base/try.h"
#include "field/field_file.h"
#include "slf/inspect.h"

namespace slf {
namespace {

using storage::TileRef;
/// After this many tiles, pages that were read are released.
constexpr std::uint64_t kReleaseEvery = 1 << 14;
/// A file declares levels for nothing, and callers keep lists.
constexpr std::uint64_t kMaxMissing = 1 << 24;

/// Visits the tiles that pass the filter.
class Listing {
 public:
  using Visitor = std::function<Result<void>(const ListedTile&)>;

  Listing(const Field& field, const TileFilter& filter, const Visitor& visitor)
      : handle_(field), field_(field.file()), filter_(filter), visitor_(visitor) {}

  Result<void> run() {
    for (unsigned level = filter_.first_level; level <= last_level(); ++level) {
      const unsigned bits = 4 * level + 2 * field_.shape().entry_extra_levels;
      if (filter_.subfields.empty() && field_.shape().subfields.empty()) {
        SLF_TRY(range(level, 0, std::uint64_t{64} << bits));
        continue;
      }
      for (const std::uint8_t subfield :
           filter_.subfields.empty() ? field_.shape().subfields : filter_.subfields) {
        const std::uint64_t begin = std::uint64_t{subfield} << bits;
        SLF_TRY(range(level, begin, begin + (std::uint64_t{1} << bits)));
      }
    }
    return {};
  }

 private:
  [[nodiscard]] unsigned last_level() const {
    return std::min(filter_.last_level, field_.shape().finest_level);
  }

  /// The tiles of a level with indexes in [begin, end).
  Result<void> range(unsigned level, std::uint64_t begin, std::uint64_t end) {
    const auto l = static_cast<std::uint8_t>(level);
    std::uint64_t due = begin;
    const auto at = [&](std::uint64_t index) { return in_state({l, index}, handle_.state()); };
    const auto add = [&](const TileRef& found) -> Result<void> {
      const auto tile =
          SLF_TRY(found.state == TileState::same ? field_.store().find(found.key) : found);
      if (tile.state == TileState::missing) return {};
      SLF_TRY(missing(l, due, tile.key.index));
      due = tile.key.index + 1;
      return visit(tile);
    };
    SLF_TRY(field_.store().visit(at(begin), at(end), add));
    return missing(l, due, end);
  }

  Result<void> missing(std::uint8_t level, std::uint64_t begin, std::uint64_t end) {
    if (!filter_.missing) return {};
    missing_ += end - begin;
    if (missing_ > kMaxMissing)
      return misuse(field_.path(), "more than ", kMaxMissing, " tiles are missing up to level ",
                    int{level}, "; list those of fewer levels or subfields");
    for (std::uint64_t index = begin; index < end; ++index)
      SLF_TRY(visit({TileState::missing, {level, index}}));
    return {};
  }

  Result<void> visit(const TileRef& tile) {
    if (++visited_ % kReleaseEvery == 0) field_.store().release_all();
    ListedTile listed;
    listed.key = in_state(tile.key, 0);
    listed.address = address_of(handle_, tile.key);
    listed.subfield = static_cast<std::uint8_t>(
        tile.key.index >> (4 * tile.key.level + 2 * field_.shape().entry_extra_levels));
    listed.state = tile.source == tile.key ? tile.state : TileState::same;
    listed.payload_bytes = tile.payload.size();
    listed.offset_bytes = field_.store().range(tile).begin;
    return visitor_(listed);
  }

  const Field& handle_;
  const FieldFile& field_;
  const TileFilter& filter_;
  const Visitor& visitor_;
  std::uint64_t visited_ = 0, missing_ = 0;
};

Result<void> check(const FieldFile& field, const TileFilter& filter) {
  if (filter.first_level > field.shape().finest_level || filter.last_level < filter.first_level)
    return misuse(field.path(), "has levels 0 to ", field.shape().finest_level);
  for (const std::uint8_t subfield : filter.subfields)
    if (!field.shape().has({0, std::uint64_t{subfield} << (2 * field.shape().entry_extra_levels)}))
      return misuse(field.path(), "has no subfield ", int{subfield});
  return {};
}

}  // namespace

const char* name(TileState state) {
  constexpr const char* kNames[] = {"missing", "empty", "stored", "same"};
  return kNames[static_cast<int>(state)];
}

std::string to_string(const TileAddress& address) {
  return std::to_string(address.level) + "/" + std::to_string(address.entry) + "/" +
         std::to_string(address.exit);
}

TileAddress address_of(const Field& field, TileKey key) {
  const TileSections sections = sections_of(key, field.shape().entry_extra_levels);
  return {key.level, sections.entry.index, sections.exit.index};
}

Result<TileKey> find_tile(const Field& field, const TileAddress& address) try {
  const FieldShape& shape = field.shape();
  const auto refuse = [&](const auto&... what) {
    return misuse(field.path(), "tile ", address.level, "/", address.entry, "/", address.exit, ": ",
                  what...);
  };
  if (address.level > shape.finest_level)
    return refuse("the field has levels 0 to ", shape.finest_level);
  const unsigned entry_level = address.level + shape.entry_extra_levels;
  if (address.entry >= section_count(entry_level) || address.exit >= section_count(address.level))
    return refuse("level ", address.level, " has entry sections 0 to ",
                  section_count(entry_level) - 1, " and exit sections 0 to ",
                  section_count(address.level) - 1);
  const TileKey key = tile_key(
      {{static_cast<std::uint8_t>(entry_level), static_cast<std::uint32_t>(address.entry)},
       {static_cast<std::uint8_t>(address.level), static_cast<std::uint32_t>(address.exit)}});
  if (!shape.has(key)) return refuse("is in a subfield that the field does not have");
  return key;
} catch (...) {
  return tl::unexpected(error_of_exception());
}

Result<TileKey> find_tile(const Field& field, unsigned level, std::uint64_t index) try {
  const FieldShape& shape = field.shape();
  const auto refuse = [&](const auto&... what) {
    return misuse(field.path(), "tile ", level, "/", index, ": ", what...);
  };
  if (level > shape.finest_level) return refuse("the field has levels 0 to ", shape.finest_level);
  const TileKey key{static_cast<std::uint8_t>(level), index};
  if (shape.has(key)) return key;
  const std::uint64_t count = tile_count(level, shape.entry_extra_levels);
  if (index < count) return refuse("is in a subfield that the field does not have");
  return refuse("level ", level, " has tiles 0 to ", count - 1);
} catch (...) {
  return tl::unexpected(error_of_exception());
}

Result<void> list_tiles(const Field& field, const TileFilter& filter,
                        const std::function<Result<void>(const ListedTile&)>& visitor) try {
  SLF_TRY(check(field.file(), filter));
  return Listing(field, filter, visitor).run();
} catch (...) {
  return tl::unexpected(error_of_exception());
}

}  // namespace slf
