#include "storage/internal/snapshot.h"

#include <sys/mman.h>

#include <algorithm>
#include <atomic>
#include <thread>
#include <utility>
#include <vector>

#include "base/try.h"
#include "storage/internal/file_index.h"

namespace slf::storage::internal {
namespace {

constexpr int kAttempts = 100;
constexpr std::uint64_t kTailBytes = 64 << 10;  // at the end of a remote file, fetched first

}  // namespace

Result<std::unique_ptr<Snapshot>> Snapshot::open(const std::string& path) {
  std::unique_ptr<Snapshot> snapshot(new Snapshot(path));
  snapshot->file_ = SLF_TRY(LockedFile::open(path, LockedFile::Access::read));
  auto meta = SLF_TRY(snapshot->pin_current());
  SLF_TRY(snapshot->load(meta, snapshot->file_));
  return snapshot;
}

Result<std::unique_ptr<Snapshot>> Snapshot::open_locked(const std::string& path,
                                                        const LockedFile& file) {
  std::unique_ptr<Snapshot> snapshot(new Snapshot(path));
  auto meta = SLF_TRY(read_metas(file.descriptor(), path));
  SLF_TRY(snapshot->load(meta, file));
  return snapshot;
}

Result<std::unique_ptr<Snapshot>> Snapshot::open(std::shared_ptr<RangeSource> source) {
  std::unique_ptr<Snapshot> snapshot(new Snapshot(source->name()));
  const std::uint64_t size = source->size();
  if (size < 2 * kPageSize)
    return bad_file(snapshot->path(), "not a field, or truncated: ", size, " bytes");
  snapshot->copy_ = SLF_TRY(SparseCopy::make(std::move(source)));
  const FileRange ends[] = {{0, 2 * kPageSize}, {size - std::min(size, kTailBytes), size}};
  SLF_TRY(snapshot->copy_->fetch(ends));
  const auto meta = SLF_TRY(parse_metas(snapshot->bytes().first(2 * kPageSize), snapshot->path()));
  SLF_TRY(check_length(meta, size, snapshot->path()));
  SLF_TRY(snapshot->read_index(meta));
  const Pages pages(*snapshot->copy_, meta, &snapshot->path());
  SLF_TRY(snapshot->Trees::load(pages));
  return snapshot;
}

// Uses those sections of the index that are not too large. A damaged index is not an error, because
// the pages hold everything that it does.
Result<void> Snapshot::read_index(const Meta& meta) {
  const std::uint64_t size = bytes().size();
  const auto sections = SLF_TRY(find_sections(*copy_, size, meta.transaction));
  std::vector<FileRange> ranges;
  for (const IndexSection& section : sections)
    if (section.range.size() <= kMaxSectionBytes) ranges.push_back(section.range);
  SLF_TRY(copy_->fetch(ranges));
  Result<void> stored;
  for (const IndexSection& section : sections) {
    if (section.range.size() > kMaxSectionBytes) continue;
    if (section.id >= kFirstExtraSection && section.id != kCoreSection) {
      extras_.push_back(section);
      continue;
    }
    const ByteSpan part = bytes().subspan(section.range.begin, section.range.size());
    (void)open_section(section, part, size, [&](std::uint64_t offset, ByteSpan piece) {
      if (stored) stored = copy_->put(offset, piece);
    });
  }
  return stored;
}

void Snapshot::release() const {
  (void)madvise(const_cast<std::byte*>(bytes().data()), bytes().size(), MADV_DONTNEED);
}

Bytes Snapshot::section(std::uint32_t id) const {
  for (const IndexSection& section : extras_) {
    if (section.id != id) continue;
    const ByteSpan part = bytes().subspan(section.range.begin, section.range.size());
    if (checksum(part) == section.checksum) return {part.begin(), part.end()};
  }
  return {};
}

// A pin is valid if its transaction is still the current one after the lock was taken: no writer
// can have reused pages of the current snapshot, and a later commit sees the lock.
Result<Meta> Snapshot::pin_current() {
  Result<Meta> meta = read_metas(file_.descriptor(), path());
  for (int i = 0; i < kAttempts; ++i) {
    if (!meta) {
      // A writer may have been in the middle of writing a meta page.
      std::this_thread::yield();
      meta = read_metas(file_.descriptor(), path());
      if (!meta) return meta;
    }
    const std::uint64_t transaction = meta->transaction;
    file_.pin(transaction);
    std::atomic_thread_fence(std::memory_order_seq_cst);
    meta = read_metas(file_.descriptor(), path());
    if (meta && meta->transaction == transaction) return meta;
    file_.unpin(transaction);
  }
  return fail(ErrorCode::failed, path(), ": a writer commits faster than it can be opened");
}

Result<void> Snapshot::load(const Meta& meta, const LockedFile& file) {
  auto size = SLF_TRY(file.size(path()));
  SLF_TRY(check_length(meta, size, path()));
  map_ = SLF_TRY(MappedFile::map(file.descriptor(), static_cast<std::size_t>(size), path()));
  return Trees::load(Pages(map_.bytes(), meta, &path()));
}

Result<void> Snapshot::unchanged() const { return map_.unchanged(path()); }

}  // namespace slf::storage::internal
