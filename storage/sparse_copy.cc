#include "storage/internal/sparse_copy.h"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <string>

#include "base/guarded.h"
#include "base/try.h"
#include "storage/internal/file_index.h"
#include "storage/internal/pages.h"

namespace slf::storage::internal {
namespace {

constexpr std::uint64_t kGap = 16 << 10;         // smaller gaps cost less than a request
constexpr std::uint64_t kMaxGap = 128 << 10;     // larger gaps are never fetched
constexpr std::size_t kBaseRequests = 4;         // requests that fetch() may always make
constexpr std::size_t kRangesPerRequest = 24;    // fetch() may make one more for this many ranges
constexpr std::uint64_t kReadAround = 64 << 10;  // bytes fetched for a single part, aligned

}  // namespace

Result<std::unique_ptr<SparseCopy>> SparseCopy::make(std::shared_ptr<RangeSource> source) {
  std::unique_ptr<SparseCopy> copy(new SparseCopy(std::move(source)));
  const std::string& name = copy->source_->name();
  copy->file_ = open_unnamed_file();
  if (copy->file_.get() < 0 ||
      ftruncate(copy->file_.get(), static_cast<off_t>(copy->source_->size())) != 0)
    return fail(ErrorCode::io, name, ": cannot make a temporary file of ", copy->source_->size(),
                " bytes: ", std::strerror(errno), "; set TMPDIR to another folder");
  copy->map_ = SLF_TRY(MappedFile::map(copy->file_.get(), copy->source_->size(), name));
  return copy;
}

Result<void> SparseCopy::write(std::uint64_t offset, ByteSpan bytes) const {
  const int cause = write_all(file_.get(), bytes, offset);
  if (cause == 0) return {};
  return fail(ErrorCode::io, source_->name(),
              ": cannot store fetched bytes: ", std::strerror(cause),
              "; set TMPDIR to another folder");
}

Result<void> SparseCopy::put(std::uint64_t offset, ByteSpan bytes) const {
  SLF_TRY(write(offset, bytes));
  const std::lock_guard lock(mutex_);
  present_.add({offset, offset + bytes.size()});
  return {};
}

/// The ranges that a thread is fetching. Their release allocates nothing.
struct SparseCopy::Claim {
  const SparseCopy& copy;
  std::list<RangeSet>::iterator at;

  ~Claim() {
    {
      const std::lock_guard lock(copy.mutex_);
      copy.fetching_.erase(at);
    }
    copy.fetched_.notify_all();
  }
};

Result<void> SparseCopy::fetch(std::span<const FileRange> ranges) const {
  while (true) {
    std::unique_lock lock(mutex_);
    std::vector<FileRange> absent;
    for (const FileRange& range : ranges) present_.append_missing(range, absent);
    if (absent.empty()) return {};
    std::vector<FileRange> ours = absent;
    for (const RangeSet& others : fetching_) {
      std::vector<FileRange> rest;
      for (const FileRange& range : ours) others.append_missing(range, rest);
      ours = std::move(rest);
    }
    if (ours.empty()) {
      fetched_.wait(lock, [&] {
        return std::none_of(fetching_.begin(), fetching_.end(), [&](const RangeSet& others) {
          return std::any_of(absent.begin(), absent.end(),
                             [&](const FileRange& range) { return others.intersects(range); });
        });
      });
      continue;  // check again: the other thread may have failed
    }
    const std::size_t max_requests = kBaseRequests + ours.size() / kRangesPerRequest;
    ours = merged(std::move(ours), kGap, max_requests, kMaxGap);
    RangeSet claimed;
    for (const FileRange& range : ours) claimed.add(range);
    const Claim claim{*this, fetching_.insert(fetching_.end(), std::move(claimed))};
    lock.unlock();
    SLF_TRY(guarded([&] { return load(ours); }));
  }
}

Result<void> SparseCopy::load(std::span<const FileRange> ranges) const {
  std::vector<FileRange> came;  // they count once they are known to be of the same file
  SLF_TRY(source_->fetch(ranges, [&](std::uint64_t offset, ByteSpan bytes) {
    came.push_back({offset, offset + bytes.size()});
    return write(offset, bytes);
  }));
  if (!source_->has_version() && ranges.front().begin > 0) {
    // The meta pages have the transaction; the footer of the index has a checksum of all tables.
    const std::uint64_t size = source_->size();
    const FileRange ends[] = {{0, 2 * kPageSize}, {size - kIndexFooter, size}};
    SLF_TRY(source_->fetch(ends, [&](std::uint64_t offset, ByteSpan bytes) -> Result<void> {
      if (std::ranges::equal(bytes, file().subspan(offset, bytes.size()))) return {};
      return bad_file(source_->name(), "the file has changed on the server since it was opened");
    }));
  }
  const std::lock_guard lock(mutex_);
  for (const FileRange& range : came) present_.add(range);
  return {};
}

Result<void> SparseCopy::fetch(ByteSpan part) const {
  const auto begin = static_cast<std::uint64_t>(part.data() - file().data());
  const FileRange range{begin, begin + part.size()};
  {
    const std::lock_guard lock(mutex_);
    if (present_.contains(range)) return {};
  }
  const FileRange more{range.begin / kReadAround * kReadAround,
                       std::min((range.end + kReadAround - 1) / kReadAround * kReadAround,
                                static_cast<std::uint64_t>(file().size()))};
  return fetch(std::span(&more, 1));
}

Result<ByteSpan> SparseCopy::bytes(std::uint64_t offset, std::uint64_t size) const {
  const ByteSpan part = file().subspan(offset, size);
  SLF_TRY(fetch(part));
  return part;
}

}  // namespace slf::storage::internal
