#include "storage/internal/sparse_copy.h"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <string>

#include "base/file.h"
#include "base/guarded.h"
#include "base/try.h"

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
  if (copy->file_ < 0 || ftruncate(copy->file_, static_cast<off_t>(copy->source_->size())) != 0)
    return fail(ErrorCode::io, name, ": cannot make a temporary file of ", copy->source_->size(),
                " bytes: ", std::strerror(errno), "; set TMPDIR to another folder");
  copy->map_ = SLF_TRY(MappedFile::map(copy->file_, copy->source_->size(), name));
  return copy;
}

SparseCopy::~SparseCopy() {
  if (file_ >= 0) ::close(file_);
}

Result<void> SparseCopy::put(std::uint64_t offset, ByteSpan bytes) const {
  const FileRange range{offset, offset + bytes.size()};
  while (!bytes.empty()) {
    const ssize_t put = pwrite(file_, bytes.data(), bytes.size(), static_cast<off_t>(offset));
    if (put < 0 && errno == EINTR) continue;
    if (put <= 0)
      return fail(ErrorCode::io, source_->name(),
                  ": cannot store fetched bytes: ", std::strerror(errno),
                  "; set TMPDIR to another folder");
    bytes = bytes.subspan(static_cast<std::size_t>(put));
    offset += static_cast<std::uint64_t>(put);
  }
  const std::lock_guard lock(mutex_);
  present_.add(range);
  return {};
}

Result<void> SparseCopy::fetch(std::span<const FileRange> ranges) const {
  while (true) {
    std::vector<FileRange> ours;
    std::list<RangeSet> mine(1);
    const auto place = mine.begin();
    {
      std::unique_lock lock(mutex_);
      std::vector<FileRange> absent;
      for (const FileRange& range : ranges) present_.append_missing(range, absent);
      if (absent.empty()) return {};
      ours = absent;
      for (const RangeSet& theirs : fetching_) {
        std::vector<FileRange> left;
        for (const FileRange& range : ours) theirs.append_missing(range, left);
        ours = std::move(left);
      }
      if (ours.empty()) {
        const auto is_fetched = [&](const FileRange& range) {
          return std::ranges::any_of(
              fetching_, [&](const RangeSet& theirs) { return theirs.intersects(range); });
        };
        fetched_.wait(lock, [&] { return std::ranges::none_of(absent, is_fetched); });
        continue;  // check again: the other thread may have failed
      }
      const std::size_t max_requests = kBaseRequests + ours.size() / kRangesPerRequest;
      ours = merged(std::move(ours), kGap, max_requests, kMaxGap);
      for (const FileRange& range : ours) place->add(range);
      fetching_.splice(fetching_.end(), mine);
    }
    auto fetched = guarded([&] {
      return source_->fetch(
          ours, [&](std::uint64_t offset, ByteSpan bytes) { return put(offset, bytes); });
    });
    {
      const std::lock_guard lock(mutex_);
      fetching_.erase(place);
    }
    fetched_.notify_all();
    if (!fetched) return fetched;
  }
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
