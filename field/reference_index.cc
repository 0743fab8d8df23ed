#include "field/reference_index.h"

#include <algorithm>

#include "base/sort_unique.h"
#include "base/try.h"
#include "base/varint.h"

namespace slf {
namespace {

constexpr unsigned kChildBits = 4;  // low bits of an index: which child of its parent a tile is
constexpr unsigned kChildren = 1 << kChildBits;

std::size_t use_bytes(std::size_t references) { return references * kChildren / 8; }

Result<std::uint64_t> take_number(ByteSpan& from) {
  if (const auto value = take_varint(from)) return *value;
  return fail(ErrorCode::bad_file, "the index has no number where one is expected");
}

}  // namespace

Bytes ReferenceIndex::encode(std::span<const Tile> tiles) {
  Bytes section;
  std::uint64_t next_parent = 0;  // the smallest parent that may come next
  while (!tiles.empty()) {
    const std::uint64_t parent = tiles.front().key.index >> kChildBits;
    const auto end = std::find_if(tiles.begin(), tiles.end(), [&](const Tile& tile) {
      return tile.key.index >> kChildBits != parent;
    });
    const auto family = tiles.first(static_cast<std::size_t>(end - tiles.begin()));
    tiles = tiles.subspan(family.size());
    std::vector<std::uint64_t> references;
    for (const Tile& tile : family)
      for (const TileKey reference : tile.references) references.push_back(reference.index);
    sort_unique(references);
    if (references.empty()) continue;

    append_varint(section, parent - next_parent);
    next_parent = parent + 1;
    append_varint(section, references.size());
    std::uint64_t next = 0;
    for (const std::uint64_t reference : references) {
      append_varint(section, reference - next);
      next = reference + 1;
    }
    Bytes uses(use_bytes(references.size()));
    for (const Tile& tile : family)
      for (const TileKey reference : tile.references) {
        const auto at = std::lower_bound(references.begin(), references.end(), reference.index);
        const auto bit = static_cast<std::size_t>(at - references.begin()) * kChildren +
                         tile.key.index % kChildren;
        uses[bit / 8] |= std::byte{1} << bit % 8;
      }
    section.insert(section.end(), uses.begin(), uses.end());
  }
  return section;
}

Result<ReferenceIndex> ReferenceIndex::parse(ByteSpan section, unsigned level) {
  ReferenceIndex index;
  index.level_ = level;
  std::uint64_t due = 0;
  while (!section.empty()) {
    const auto step = SLF_TRY(take_number(section));
    const auto count = SLF_TRY(take_number(section));
    if (count > section.size())  // each takes at least one byte
      return fail(ErrorCode::bad_file, "the index ends early");
    Family family;
    family.parent = due + step;
    due = family.parent + 1;
    if (family.parent < step || due == 0 || (count == 0))
      return fail(ErrorCode::bad_file, "the index has tiles that no level has");
    std::uint64_t next = 0;
    for (std::uint64_t r = 0; r < count; ++r) {
      const auto gap = SLF_TRY(take_number(section));
      family.references.push_back(next + gap);
      next = family.references.back() + 1;
      if (next <= gap) return fail(ErrorCode::bad_file, "the index has tiles that no level has");
    }
    const std::size_t bytes = use_bytes(family.references.size());
    if (section.size() < bytes) return fail(ErrorCode::bad_file, "the index ends early");
    family.uses.assign(section.begin(), section.begin() + static_cast<std::ptrdiff_t>(bytes));
    section = section.subspan(bytes);
    index.families_.push_back(std::move(family));
  }
  return index;
}

void ReferenceIndex::append_references(TileKey key, std::vector<TileKey>& to) const {
  const std::uint64_t parent = key.index >> kChildBits;
  const auto family =
      std::lower_bound(families_.begin(), families_.end(), parent,
                       [](const Family& f, std::uint64_t value) { return f.parent < value; });
  if (family == families_.end() || family->parent != parent) return;
  for (std::size_t r = 0; r < family->references.size(); ++r) {
    const std::size_t bit = r * kChildren + key.index % kChildren;
    if (std::to_integer<unsigned>(family->uses[bit / 8] >> bit % 8) & 1)
      to.push_back({static_cast<std::uint8_t>(level_ - 1), family->references[r], key.state});
  }
}

void append_ancestors(std::span<const ReferenceIndex> indices, std::vector<TileKey>& tiles) {
  sort_unique(tiles);
  // From the finest level down, so that a level is complete before its own references are added.
  for (std::size_t level = indices.size(); level > 0; --level) {
    const auto of_level = [&](TileKey key) { return key.level == level; };
    std::vector<TileKey> found;
    for (const TileKey key : tiles)
      if (of_level(key)) indices[level - 1].append_references(key, found);
    tiles.insert(tiles.end(), found.begin(), found.end());
    sort_unique(tiles);
  }
}

}  // namespace slf
