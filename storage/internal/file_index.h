// The index at the end of a finished container (doc/format/optional.md, "Index"): copies of the
// parts that a reader needs before it reads payloads. A reader of a remote file gets them with one
// or two requests; other readers ignore them.
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
inline constexpr std::uint32_t kMaxSections = 256;
/// Larger sections are neither written nor read, because reading the pages takes fewer bytes.
inline constexpr std::uint64_t kMaxSectionBytes = 1 << 20;
inline constexpr std::uint32_t kCoreSection = 0xFFFFFFFF;  ///< the section of trees and blobs
inline constexpr std::uint32_t kFirstExtraSection = 256;   ///< sections that storage does not use

/// A part of the index that is read as a whole: the trees and blobs, the tables of the records of
/// one level, or data that storage does not use.
struct IndexSection {
  std::uint32_t id = kCoreSection;  ///< or a level, or kFirstExtraSection and above
  FileRange range;
  std::uint64_t checksum = 0;
};

/// The directory of an index, at the end of its file.
struct FileIndex {
  std::uint64_t transaction = 0;  ///< the commit that it describes; stale for any other
  std::vector<IndexSection> sections;

  /// The number of bytes at the end of the file that parse() needs; 0 if the file has no index.
  /// `footer` is the last kIndexFooter bytes of the file.
  [[nodiscard]] static std::uint64_t size(ByteSpan footer);

  /// Parses `end`, the last size() bytes of a file of `file_bytes` bytes. bad_file: it is damaged.
  [[nodiscard]] static Result<FileIndex> parse(ByteSpan end, std::uint64_t file_bytes);
};

/// Finds the sections of the index of a file of `file_bytes` bytes. Returns none if there is no
/// intact index of this transaction: the pages hold everything that an index does. Errors as
/// ByteSource::bytes().
[[nodiscard]] Result<std::vector<IndexSection>> find_sections(const ByteSource& source,
                                                              std::uint64_t file_bytes,
                                                              std::uint64_t transaction);

/// Calls `add` for each part of a section, with the part's offset in the file and its bytes.
/// bad_file: the section does not match its checksum, or a part is outside the file.
using AddPart = std::function<void(std::uint64_t offset, ByteSpan bytes)>;
[[nodiscard]] Result<void> open_section(const IndexSection& section, ByteSpan bytes,
                                        std::uint64_t file_bytes, const AddPart& add);

}  // namespace slf::storage::internal
