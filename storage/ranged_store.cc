#include "storage/ranged_store.h"

#include <algorithm>
#include <utility>

#include "base/try.h"
#include "storage/internal/range_set.h"
#include "storage/internal/record.h"

namespace slf::storage {

using internal::kPageSize;

Result<ByteSpan> RangedStore::Source::bytes(std::uint64_t offset, std::uint64_t size) const {
  if (size == 0) return ByteSpan();
  auto block = blocks.upper_bound(offset);
  if (block != blocks.begin()) {
    --block;
    const std::uint64_t within = offset - block->first;
    if (within <= block->second.size() && size <= block->second.size() - within)
      return ByteSpan(block->second).subspan(within, size);
  }
  if (offset > file_bytes || size > file_bytes - offset)  // fetching cannot help
    return fail(ErrorCode::bad_file, "bytes ", offset, " to ", offset + size,
                " are beyond the end of the file");
  const std::uint64_t begin = offset / kPageSize * kPageSize;
  const std::uint64_t end = (offset + size + kPageSize - 1) / kPageSize * kPageSize;
  needed.push_back({begin, std::min(end, file_bytes)});
  return fail(ErrorCode::io, "bytes ", begin, " to ", end, " are not present yet");
}

RangedStore::RangedStore(std::string name, std::uint64_t file_bytes) : trees_(std::move(name)) {
  source_.file_bytes = file_bytes;
}

void RangedStore::add(std::uint64_t offset, Bytes bytes) {
  Bytes& block = source_.blocks[offset];
  if (block.size() < bytes.size()) block = std::move(bytes);
}

std::vector<FileRange> RangedStore::take_needed_ranges() {
  return internal::merged(std::exchange(source_.needed, {}), 0);
}

Result<void> RangedStore::open() {
  const std::uint64_t start = std::min(source_.file_bytes, kFileStart);
  const auto metas = SLF_TRY(source_.bytes(0, start));
  const auto meta = SLF_TRY(internal::parse_metas(metas, trees_.path()));
  SLF_TRY(internal::check_length(meta, source_.file_bytes, trees_.path()));
  sections_ = SLF_TRY(internal::find_sections(source_, source_.file_bytes, meta.transaction));
  SLF_TRY(load_section(internal::kCoreSection));
  return trees_.load(internal::Pages(source_, meta, &trees_.path()));
}

const internal::IndexSection* RangedStore::find_section(std::uint32_t id) const {
  const auto section =
      std::find_if(sections_.begin(), sections_.end(), [&](const auto& s) { return s.id == id; });
  return section == sections_.end() ? nullptr : &*section;
}

Result<void> RangedStore::load_section(std::uint32_t id) {
  const internal::IndexSection* const section = find_section(id);
  if (section == nullptr) return {};
  const std::uint64_t size = section->range.size();
  if (size <= internal::kMaxSectionBytes) {
    const auto bytes = SLF_TRY(source_.bytes(section->range.begin, size));
    const Bytes block(bytes.begin(), bytes.end());  // add() may replace what `bytes` views
    (void)internal::open_section(
        *section, block, source_.file_bytes,
        [&](std::uint64_t offset, ByteSpan part) { add(offset, Bytes(part.begin(), part.end())); });
  }
  std::erase_if(sections_, [&](const auto& s) { return s.id == id; });
  return {};
}

Result<Bytes> RangedStore::section(std::uint32_t id) const {
  const internal::IndexSection* const section = find_section(id);
  const std::uint64_t size = section ? section->range.size() : 0;
  if (size == 0 || size > internal::kMaxSectionBytes) return Bytes();
  const auto bytes = SLF_TRY(source_.bytes(section->range.begin, size));
  if (internal::checksum(bytes) != section->checksum) return Bytes();
  return Bytes(bytes.begin(), bytes.end());
}

Result<RangedTile> RangedStore::find(TileKey key) {
  auto tile = SLF_TRY(find_own(key));
  if (tile.state != TileState::same) return tile;
  tile = SLF_TRY(find_own(tile.source));
  return tile.state == TileState::stored ? tile : RangedTile{};
}

Result<RangedTile> RangedStore::find_own(TileKey key) {
  SLF_TRY(load_section(key.level));
  std::uint64_t value = 0;
  const auto found = SLF_TRY(trees_.find(key, &value));
  if (!found) return RangedTile{};
  const internal::Record& record = *found;
  const internal::Tile tile =
      record.tile(static_cast<std::uint32_t>(key.index - record.first().index));
  RangedTile result{tile.state, {}, tile.checksum, tile.source(key)};
  if (tile.state == TileState::stored)
    result.payload = {value + tile.offset, value + tile.offset + tile.size};
  return result;
}

}  // namespace slf::storage
