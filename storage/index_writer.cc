#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <map>
#include <span>

#include "base/file.h"
#include "base/try.h"
#include "storage/internal/file_index.h"
#include "storage/internal/record.h"
#include "storage/internal/snapshot.h"
#include "storage/tile_writer.h"

namespace slf::storage {
namespace internal {
namespace {

/// Larger blobs, such as light, are fetched by those who need them.
constexpr std::uint64_t kMaxIndexedBlob = 256 << 10;

/// Collects the parts of a snapshot by section, and sorts them by their offset in the file.
class IndexBuilder {
 public:
  IndexBuilder(const Snapshot& snapshot, const GoOn& go_on) : snapshot_(snapshot), go_on_(go_on) {}

  Result<void> collect() {
    SLF_TRY(walk(snapshot_.meta().main, nullptr));
    const auto blob = [&](const Cursor& at) -> Result<void> {
      if ((at.node().flags & kBigData) != 0 && at.node().data_size <= kMaxIndexedBlob)
        add_value(kCoreSection, at.node(), at.node().data_size);
      return {};
    };
    SLF_TRY(walk(snapshot_.manifest(), blob));
    return walk(snapshot_.tiles(), [&](const Cursor& at) { return add_record(at); });
  }

  /// Encodes the index of a file whose pages end at `begin`.
  [[nodiscard]] Bytes encode(std::uint64_t begin, std::span<const IndexExtra> extras) const {
    Bytes bytes, directory;
    std::uint32_t count = 0;
    const auto put = [&](std::uint32_t id, const Bytes& section) {
      if (section.empty() || section.size() > kMaxSectionBytes) return;
      append_le(directory, std::uint64_t{id});
      append_le(directory, begin + bytes.size());
      append_le(directory, std::uint64_t{section.size()});
      append_le(directory, checksum(section));
      bytes.insert(bytes.end(), section.begin(), section.end());
      ++count;
    };
    // Readers fetch the end of the file first, so the finest level comes first and the core last.
    for (const IndexExtra& extra : extras) put(extra.id, extra.bytes);
    for (auto level = levels_.rbegin(); level != levels_.rend(); ++level)
      put(level->first, joined(level->second));
    put(kCoreSection, joined(core_));

    Bytes footer;
    append_le(footer, std::uint64_t{0});  // the checksum
    append_le(footer, kIndexMagic);
    append_le(footer, snapshot_.meta().transaction);
    append_le(footer, begin);
    append_le(footer, std::uint64_t{kIndexVersion} << 32 | count);
    append_le(footer, std::uint64_t{0});
    directory.insert(directory.end(), footer.begin(), footer.end());
    store_le(directory.data() + directory.size() - kIndexFooter, checksum(directory));
    bytes.insert(bytes.end(), directory.begin(), directory.end());
    return bytes;
  }

 private:
  using Parts = std::map<std::uint64_t, std::uint64_t>;  // offset → size

  /// The parts, encoded as a section; no bytes if it would be too large.
  [[nodiscard]] Bytes joined(const Parts& parts) const {
    Bytes section;
    for (const auto& [offset, size] : parts) {
      append_le(section, offset);
      append_le(section, size);
      const ByteSpan part = snapshot_.bytes().subspan(offset, size);
      section.insert(section.end(), part.begin(), part.end());
      count_part();
      if (section.size() > kMaxSectionBytes) return {};
    }
    return section;
  }

  /// Adds the pages of a tree, and visits its entries.
  template <class Visit>
  Result<void> walk(const Tree& tree, const Visit& visit) {
    Cursor cursor(snapshot_.pages(), tree);
    std::vector<std::uint64_t> path;
    for (auto at = cursor.seek({});; at = cursor.next()) {
      if (!at) return tl::unexpected(at.error());
      if (!*at) return {};
      path.clear();
      cursor.path(path);
      for (const std::uint64_t page : path) core_[page * kPageSize] = kPageSize;
      if constexpr (!std::is_null_pointer_v<Visit>) SLF_TRY(visit(cursor));
    }
  }

  void count_part() const {
    if (++parts_read_ % Snapshot::kReleaseEvery == 0) snapshot_.release();
  }

  Result<void> add_record(const Cursor& at) {
    count_part();
    if (go_on_ && !go_on_()) return fail(ErrorCode::cancelled, snapshot_.path(), ": interrupted");
    const auto record = SLF_TRY(snapshot_.record(at));
    if ((at.node().flags & kBigData) == 0) return {};
    // Trees reads this much of a record before it knows how long the table is.
    const std::uint64_t usual =
        usual_head_bytes(max_tiles_in_record(at.leaf(), at.index(), at.node()));
    add_value(record.first().level, at.node(), std::max(usual, Record::table_end(record.bytes())));
    return {};
  }

  /// Adds the first `max_bytes` bytes of a value in overflow pages.
  void add_value(std::uint32_t id, const Node& node, std::uint64_t max_bytes) {
    Parts& parts = id == kCoreSection ? core_ : levels_[id];
    parts[node.child * kPageSize] = kPageHeader + std::min(node.data_size, max_bytes);
  }

  const Snapshot& snapshot_;
  const GoOn& go_on_;
  Parts core_;
  std::map<std::uint32_t, Parts> levels_;
  mutable std::uint64_t parts_read_ = 0;
};

Result<void> write_end(int file, const std::string& path, std::uint64_t begin, ByteSpan bytes) {
  int cause = ftruncate(file, static_cast<off_t>(begin)) == 0 ? 0 : errno;
  if (cause == 0) cause = write_all(file, bytes, begin);
  if (cause == 0 && fsync(file) != 0) cause = errno;
  if (cause == 0) return {};
  return io_error(path, "cannot write the index", cause);
}

}  // namespace
}  // namespace internal

Result<void> write_index(const std::string& path, std::span<const IndexExtra> extras,
                         const GoOn& go_on) {
  Bytes index;
  std::uint64_t begin = 0;
  {
    const auto snapshot = SLF_TRY(internal::Snapshot::open(path));
    internal::IndexBuilder builder(*snapshot, go_on);
    SLF_TRY(builder.collect());
    begin = snapshot->pages().count() * internal::kPageSize;
    index = builder.encode(begin, extras);
    SLF_TRY(snapshot->unchanged());
  }
  const Descriptor file(::open(path.c_str(), O_RDWR | O_CLOEXEC));
  if (file.get() < 0) return io_error(path, "cannot open");
  return internal::write_end(file.get(), path, begin, index);
}

}  // namespace slf::storage
