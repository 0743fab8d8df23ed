// RangedStore: reads a container from ranges of its bytes, as they come over HTTP.
//
// It does no input and output itself. A call that needs bytes which are not there yet fails with
// ErrorCode::io, and wanted() says which: fetch these, add() them, and repeat the call. So a reader
// collects what many calls want and fetches it together. It begins with the start and the end of
// the file: add() kFileStart bytes and as many as are cheap to open() with one round trip. If the
// file has an index, that gives most of what finding tiles needs.
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
};

/// The file is untrusted, as for TileStore. Belongs to one thread.
class RangedStore {
 public:
  static constexpr std::uint64_t kFileStart = 2 * internal::kPageSize;

  /// `name` is for messages; `file_bytes` is the length of the file.
  RangedStore(std::string name, std::uint64_t file_bytes);
  RangedStore(const RangedStore&) = delete;
  RangedStore& operator=(const RangedStore&) = delete;

  /// Adds bytes of the file. Ends the validity of what blob() returned.
  void add(std::uint64_t offset, Bytes bytes);

  /// What the calls since the last wanted() lacked; ascending, whole pages, not overlapping.
  [[nodiscard]] std::vector<FileRange> wanted();

  /// Must succeed before the calls below. io: more bytes are needed. Others as TileStore::open().
  [[nodiscard]] Result<void> open();

  [[nodiscard]] const std::vector<internal::LayerInfo>& layers() const { return trees_.layers(); }

  /// As TileStore::blob().
  [[nodiscard]] Result<ByteSpan> blob(std::string_view name) const { return trees_.blob(name); }

  /// A section of the index that the container does not know, checked; no bytes if there is none.
  [[nodiscard]] Result<Bytes> section(std::uint32_t what) const;

  /// As TileStore::find(). REQUIRES: `layer` < layers().size().
  [[nodiscard]] Result<RangedTile> find(LayerId layer, TileKey key);

 private:
  class Source final : public internal::ByteSource {
   public:
    [[nodiscard]] Result<ByteSpan> bytes(std::uint64_t offset, std::uint64_t size) const override;
    std::map<std::uint64_t, Bytes> blocks;  ///< by offset
    std::uint64_t file_bytes = 0;
    mutable std::vector<FileRange> wanted;
  };

  [[nodiscard]] Result<void> take_section(std::uint32_t what);
  [[nodiscard]] const internal::IndexSection* section_of(std::uint32_t what) const;

  Source source_;
  internal::Trees trees_;
  std::vector<internal::IndexSection> sections_;  // of the index, not taken yet
};

}  // namespace slf::storage
