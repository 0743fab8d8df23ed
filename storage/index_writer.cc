#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <map>
#include <set>
#include <span>

#include "storage/internal/file_index.h"
#include "storage/internal/record.h"
#include "storage/internal/snapshot.h"

namespace slf::storage::internal {
namespace {

/// Collects the parts of a snapshot, each section in the order of the file.
class IndexBuilder {
 public:
  explicit IndexBuilder(const Snapshot& snapshot) : snapshot_(snapshot) {}

  Result<void> collect() {
    if (auto ok = walk(snapshot_.meta().main, nullptr); !ok) return ok;
    const auto blob = [&](const Cursor& at) -> Result<void> {
      if ((at.node().flags & kBigData) != 0) add_value(kCore, at.node(), at.node().data_size);
      return {};
    };
    if (auto ok = walk(snapshot_.manifest(), blob); !ok) return ok;
    for (LayerId layer = 0; layer < snapshot_.layers().size(); ++layer) {
      const auto record = [&](const Cursor& at) { return add_record(layer, at); };
      if (auto ok = walk(snapshot_.tree(layer), record); !ok) return ok;
    }
    return {};
  }

  /// The index, for a file whose pages end at `begin`.
  [[nodiscard]] Bytes encode(std::uint64_t begin) const {
    Bytes bytes, directory;
    std::uint32_t count = 0;
    // The finest level first and the core last: the end of the file is what is read first.
    const auto put = [&](std::uint32_t what, const Parts& parts) {
      const std::size_t start = bytes.size();
      for (const auto& [offset, size] : parts) {
        append(bytes, offset);
        append(bytes, size);
        const ByteSpan part = snapshot_.bytes().subspan(offset, size);
        bytes.insert(bytes.end(), part.begin(), part.end());
      }
      append(directory, std::uint64_t{what});
      append(directory, begin + start);
      append(directory, std::uint64_t{bytes.size() - start});
      append(directory, checksum(ByteSpan(bytes).subspan(start)));
      ++count;
    };
    for (auto level = levels_.rbegin(); level != levels_.rend(); ++level)
      put(level->first, level->second);
    put(kCore, core_);

    Bytes footer;
    append(footer, std::uint64_t{0});  // the checksum
    append(footer, kIndexMagic);
    append(footer, snapshot_.meta().transaction);
    append(footer, begin);
    append(footer, std::uint64_t{kIndexVersion} << 32 | count);
    append(footer, std::uint64_t{0});
    directory.insert(directory.end(), footer.begin(), footer.end());
    store_le(directory.data() + directory.size() - kIndexFooter, checksum(directory));
    bytes.insert(bytes.end(), directory.begin(), directory.end());
    return bytes;
  }

 private:
  using Parts = std::map<std::uint64_t, std::uint64_t>;  // offset → size

  static void append(Bytes& to, std::uint64_t value) {
    to.resize(to.size() + 8);
    store_le(to.data() + to.size() - 8, value);
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
      if constexpr (!std::is_null_pointer_v<Visit>)
        if (auto ok = visit(cursor); !ok) return ok;
    }
  }

  Result<void> add_record(LayerId layer, const Cursor& at) {
    const auto record = snapshot_.record(layer, at);
    if (!record) return tl::unexpected(record.error());
    if ((at.node().flags & kBigData) == 0) return {};
    // As much as Trees reads of a record before it knows how long the table is.
    const std::uint64_t usual = usual_head(span_of(at.leaf(), at.index(), at.node()));
    add_value(record->first().level, at.node(),
              std::max(usual, Record::table_end(record->bytes())));
    return {};
  }

  /// The first `most` bytes of a value in overflow pages.
  void add_value(std::uint32_t what, const Node& node, std::uint64_t most) {
    Parts& parts = what == kCore ? core_ : levels_[what];
    parts[node.child * kPageSize] = kPageHeader + std::min(node.data_size, most);
  }

  const Snapshot& snapshot_;
  Parts core_;
  std::map<std::uint32_t, Parts> levels_;
};

Result<void> write_end(int file, const std::string& path, std::uint64_t begin, ByteSpan bytes) {
  const auto failed = [&] {
    return fail(ErrorCode::io, path, ": cannot write the index: ", std::strerror(errno));
  };
  if (ftruncate(file, static_cast<off_t>(begin)) != 0) return failed();
  while (!bytes.empty()) {
    const ssize_t put = pwrite(file, bytes.data(), bytes.size(), static_cast<off_t>(begin));
    if (put < 0 && errno == EINTR) continue;
    if (put <= 0) return failed();
    bytes = bytes.subspan(static_cast<std::size_t>(put));
    begin += static_cast<std::uint64_t>(put);
  }
  if (fsync(file) != 0) return failed();
  return {};
}

}  // namespace

Result<void> write_index(const std::string& path) {
  Bytes index;
  std::uint64_t begin = 0;
  {
    const auto snapshot = Snapshot::open(path);
    if (!snapshot) return tl::unexpected(snapshot.error());
    IndexBuilder builder(**snapshot);
    if (auto ok = builder.collect(); !ok) return ok;
    begin = (*snapshot)->pages().count() * kPageSize;
    index = builder.encode(begin);
    if (auto same = (*snapshot)->unchanged(); !same) return same;
  }
  const int file = ::open(path.c_str(), O_RDWR | O_CLOEXEC);
  if (file < 0) return fail(ErrorCode::io, path, ": cannot open: ", std::strerror(errno));
  auto written = write_end(file, path, begin, index);
  ::close(file);
  return written;
}

}  // namespace slf::storage::internal
