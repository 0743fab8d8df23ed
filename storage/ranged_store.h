// RangedStore: reads a container from ranges of its bytes, such as those fetched over HTTP. The
// page in a browser uses it; elsewhere, TileStore reads remote files.
//
// It does no input or output itself. A call that needs bytes which are not present fails with
// ErrorCode::io, and take_needed_ranges() returns their ranges. The caller fetches these ranges,
// passes them to add(), and repeats the call. So a reader can collect the ranges that many calls
// need, and fetch them together.
//
// To open() with one round trip, first add the start of the file, kFileStart bytes, and as much of
// its end as is cheap to fetch. If the file has an index, its end holds most of the bytes that a
// search for tiles reads.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "base/bytes.h"
#include "slf/error.h"
#include "storage/internal/byte_source.h"
#include "storage/internal/file_index.h"
#include "storage/internal/trees.h"
#include "storage/tile_store.h"

namespace slf::storage {

/// A tile's state and the part of the file that holds its payload.
struct RangedTile {
  TileState state = TileState::missing;
  FileRange payload;
  std::uint64_t checksum = 0;
  TileKey source{};  ///< as TileRef::source
};

/// The file is untrusted, as for TileStore. Thread-safety: none; one thread.
class RangedStore {
 public:
  static constexpr std::uint64_t kFileStart = 2 * internal::kPageSize;

  /// `name` is for messages; `file_bytes` is the length of the file.
  RangedStore(std::string name, std::uint64_t file_bytes);
  RangedStore(const RangedStore&) = delete;
  RangedStore& operator=(const RangedStore&) = delete;

  /// Adds bytes of the file. Invalidates the views that blob() returned.
  void add(std::uint64_t offset, Bytes bytes);

  /// The ranges that calls since the last take_needed_ranges() needed and that were not present:
  /// whole pages, ascending, without overlap.
  [[nodiscard]] std::vector<FileRange> take_needed_ranges();

  /// Opens the container. The calls below require that this has succeeded.
  /// io: more bytes are needed. Other errors as TileStore::open().
  [[nodiscard]] Result<void> open();

  /// As TileStore::blob().
  [[nodiscard]] Result<ByteSpan> blob(std::string_view name) const { return trees_.blob(name); }

  /// The verified bytes of a section of the index that storage itself does not use; empty if there
  /// is none.
  [[nodiscard]] Result<Bytes> section(std::uint32_t id) const;

  /// As TileStore::find(), with the keys of all states. A tile that is the same as an earlier one
  /// is found stored, or missing if that is not stored.
  [[nodiscard]] Result<RangedTile> find(TileKey key);

 private:
  class Source final : public internal::ByteSource {
   public:
    [[nodiscard]] Result<ByteSpan> bytes(std::uint64_t offset, std::uint64_t size) const override;
    std::map<std::uint64_t, Bytes> blocks;  ///< by offset
    std::uint64_t file_bytes = 0;
    mutable std::vector<FileRange> needed;
  };

  [[nodiscard]] Result<RangedTile> find_own(TileKey key);
  [[nodiscard]] Result<void> load_section(std::uint32_t id);
  [[nodiscard]] const internal::IndexSection* find_section(std::uint32_t id) const;

  Source source_;
  internal::Trees trees_;
  std::vector<internal::IndexSection> sections_;  // of the index, not yet read
};

}  // namespace slf::storage
