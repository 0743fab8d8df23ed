// The index at the end of a finished container: copies of the parts that a reader needs before it
// reads payloads, so that a reader of a distant file gets them in one or two requests (FORMAT.md,
// "Index"). Other readers ignore it.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "base/bytes.h"
#include "slf/error.h"
#include "storage/internal/byte_source.h"
#include "storage/tile_store.h"

namespace slf::storage::internal {

inline constexpr std::uint64_t kIndexMagic = 0x5845444E49464C53;  ///< "SLFINDEX"
inline constexpr std::uint32_t kIndexVersion = 1;
inline constexpr std::size_t kIndexFooter = 48;
inline constexpr std::size_t kIndexEntry = 32;
inline constexpr std::uint32_t kMostSections = 256;
/// Larger sections are not written, and not read: reading pages takes fewer bytes.
inline constexpr std::uint64_t kMostSectionBytes = 1 << 20;
inline constexpr std::uint32_t kCore = 0xFFFFFFFF;  ///< the section of trees and blobs
inline constexpr std::uint32_t kFirstExtra = 256;   ///< sections that the container does not know

/// A part of the index that is read as a whole: the trees and blobs, the tables of the records of
/// one level, or what the container does not know.
struct IndexSection {
  std::uint32_t what = kCore;  ///< or a level, or from kFirstExtra on
  FileRange range;
  std::uint64_t checksum = 0;
};

/// What the end of a file says about its index.
struct FileIndex {
  std::uint64_t transaction = 0;  ///< the index is of this state of the file, and of no other
  std::vector<IndexSection> sections;

  /// How many bytes before the end of the file parse() needs. `footer`: the last kIndexFooter
  /// bytes. 0: the file has no index.
  [[nodiscard]] static std::uint64_t size(ByteSpan footer);

  /// `end`: the last size() bytes of a file of `file_bytes`. bad_file: they are damaged.
  [[nodiscard]] static Result<FileIndex> parse(ByteSpan end, std::uint64_t file_bytes);
};

/// The sections of the index of a file of `file_bytes`. None, if it has no sound index of this
/// transaction: the pages have all that an index has. Errors of the source.
[[nodiscard]] Result<std::vector<IndexSection>> find_sections(const ByteSource& source,
                                                              std::uint64_t file_bytes,
                                                              std::uint64_t transaction);

/// Calls `add` for each part of a section: where it is in the file, and its bytes.
/// bad_file: the section does not match its checksum, or a part is outside the file.
using AddPart = std::function<void(std::uint64_t offset, ByteSpan bytes)>;
[[nodiscard]] Result<void> open_section(const IndexSection& section, ByteSpan bytes,
                                        std::uint64_t file_bytes, const AddPart& add);

}  // namespace slf::storage::internal
