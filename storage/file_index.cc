#include "storage/internal/file_index.h"

#include <algorithm>

#include "base/try.h"
#include "storage/internal/pages.h"
#include "storage/internal/record.h"

namespace slf::storage::internal {
namespace {

constexpr std::size_t kPartHeader = 16;

}  // namespace

std::uint64_t FileIndex::size(ByteSpan footer) {
  if (footer.size() != kIndexFooter || load_le<std::uint64_t>(footer.data() + 8) != kIndexMagic ||
      load_le<std::uint32_t>(footer.data() + 36) != kIndexVersion)
    return 0;
  const auto count = load_le<std::uint32_t>(footer.data() + 32);
  return count <= kMaxSections ? count * kIndexEntry + kIndexFooter : 0;
}

Result<FileIndex> FileIndex::parse(ByteSpan end, std::uint64_t file_bytes) {
  const ByteSpan footer = end.last(kIndexFooter);
  // The checksum covers the directory and the rest of the footer, but not itself.
  Bytes covered(end.begin(), end.end());
  std::fill_n(covered.end() - static_cast<std::ptrdiff_t>(kIndexFooter), 8, std::byte{0});
  if (checksum(covered) != load_le<std::uint64_t>(footer.data()))
    return fail(ErrorCode::bad_file, "the index does not match its checksum");
  FileIndex index;
  index.transaction = load_le<std::uint64_t>(footer.data() + 16);
  const auto count = load_le<std::uint32_t>(footer.data() + 32);
  for (std::size_t i = 0; i < count; ++i) {
    const std::byte* at = end.data() + i * kIndexEntry;
    const auto begin = load_le<std::uint64_t>(at + 8), size = load_le<std::uint64_t>(at + 16);
    if (begin > file_bytes || size > file_bytes - begin)
      return fail(ErrorCode::bad_file, "a section of the index is outside the file");
    index.sections.push_back(
        {load_le<std::uint32_t>(at), {begin, begin + size}, load_le<std::uint64_t>(at + 24)});
  }
  return index;
}

Result<std::vector<IndexSection>> find_sections(const ByteSource& source, std::uint64_t file_bytes,
                                                std::uint64_t transaction) {
  if (file_bytes < 2 * kPageSize + kIndexFooter) return {};
  const auto footer = SLF_TRY(source.bytes(file_bytes - kIndexFooter, kIndexFooter));
  const std::uint64_t size = FileIndex::size(footer);
  if (size == 0 || size > file_bytes - 2 * kPageSize) return {};
  const auto end = SLF_TRY(source.bytes(file_bytes - size, size));
  auto index = FileIndex::parse(end, file_bytes);
  if (!index || index->transaction != transaction) return {};
  return std::move(index->sections);
}

Result<void> open_section(const IndexSection& section, ByteSpan bytes, std::uint64_t file_bytes,
                          const AddPart& add) {
  if (bytes.size() != section.range.size() || checksum(bytes) != section.checksum)
    return fail(ErrorCode::bad_file, "a section of the index does not match its checksum");
  while (!bytes.empty()) {
    if (bytes.size() < kPartHeader) return fail(ErrorCode::bad_file, "the index ends early");
    const auto offset = load_le<std::uint64_t>(bytes.data());
    const auto size = load_le<std::uint64_t>(bytes.data() + 8);
    bytes = bytes.subspan(kPartHeader);
    if (size > bytes.size() || offset > file_bytes || size > file_bytes - offset)
      return fail(ErrorCode::bad_file, "a part of the index is outside the file");
    add(offset, bytes.first(size));
    bytes = bytes.subspan(size);
  }
  return {};
}

}  // namespace slf::storage::internal
