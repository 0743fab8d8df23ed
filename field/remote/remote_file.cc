#include "field/remote/remote_file.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <sstream>
#include <thread>
#include <utility>

#include "base/content_hash.h"
#include "base/try.h"
#include "storage/internal/file_index.h"
#include "storage/internal/pages.h"
#include "storage/internal/range_set.h"

namespace slf {
namespace {

using storage::FileRange;
using storage::internal::RangeSet;

constexpr std::uint64_t kGap = 16 << 10;  // smaller gaps cost less than a request

/// Each address after a blank begins with its scheme; other blanks are of an address.
std::vector<std::string> addresses(const std::string& place) {
  std::vector<std::string> found;
  std::istringstream words(place);
  for (std::string word; words >> word;)
    if (found.empty() || is_address(word))
      found.push_back(word);
    else
      found.back() += " " + word;
  if (found.size() == 1) found[0] = place;
  return found;
}

}  // namespace

std::vector<FileRange> RemoteFile::ends() const {
  const std::uint64_t start = 2 * storage::internal::kPageSize;
  const std::uint64_t footer = storage::internal::kIndexFooter;
  if (size_ < start + footer) return {{0, size_}};
  return {{0, start}, {size_ - footer, size_}};
}

bool RemoteFile::has_version() const {
  const std::lock_guard lock(mutex_);
  return std::ranges::all_of(hosts_, [](const Host& host) {
    return host.refused || !host.source || host.source->has_version();
  });
}

RemoteTraffic RemoteFile::traffic() const {
  const std::lock_guard lock(mutex_);
  RemoteTraffic sum;
  for (const Host& host : hosts_) {
    const RemoteTraffic one = host.source ? host.source->traffic() : RemoteTraffic();
    sum.requests += one.requests;
    sum.repeated += one.repeated;
    sum.bytes += one.bytes;
  }
  return sum;
}

Result<std::shared_ptr<RemoteFile>> RemoteFile::open(const std::string& place,
                                                     const RemoteOptions& options,
                                                     const ProgressCallback& progress) {
  std::shared_ptr<RemoteFile> file(new RemoteFile(options));
  for (std::string& url : addresses(place)) file->hosts_.emplace_back().url = std::move(url);
  SLF_TRY(file->download({}, {}, progress));
  Host& host = file->hosts_[file->first_];
  const std::string version = host.source->version();
  if (options.cache.empty() || version.empty()) return file;
  std::string identity = place + "\n" + std::to_string(file->size_) + "\n" + version + "\n";
  if (!file->has_version() || file->hosts_.size() > 1) {
    if (file->ends_.empty()) SLF_TRY(file->compare(host, *host.source));
    ContentHash hash;
    hash.add(file->ends_);
    identity = place + "\n" + hash.text() + "\n";
  }
  file->cache_ = SLF_TRY(RangeCache::open(options.cache, options.cache_bytes, identity));
  return file;
}

// The first comparison of all learns what the file is.
Result<void> RemoteFile::compare(Host& host, HttpSource& source) {
  if (ends_.empty()) size_ = source.size();
  host.refused = true;
  if (!source.has_ranges())
    return fail(ErrorCode::unsupported, host.url,
                ": a mirror must serve parts of files (HTTP ranges)");
  const auto differs = [&] {
    return fail(ErrorCode::bad_file, host.url, ": not the same file as at ", name());
  };
  if (source.size() != size_) return differs();
  const std::vector<FileRange> parts = ends();
  Bytes found(parts.front().size() + (parts.size() > 1 ? parts.back().size() : 0));
  const auto fetched = source.fetch(parts, [&](std::uint64_t offset, ByteSpan bytes) {
    const std::size_t at = offset == 0 ? 0 : parts.front().size();
    std::ranges::copy(bytes, found.begin() + static_cast<std::ptrdiff_t>(at));
    return Result<void>();
  });
  host.refused = false;
  SLF_TRY(fetched);
  host.refused = !ends_.empty() && ends_ != found;
  if (host.refused) return differs();
  ends_ = std::move(found);
  return {};
}

// Where the file is read, at this host. Errors are those of the host.
Result<std::shared_ptr<HttpSource>> RemoteFile::source(Host& host,
                                                       const ProgressCallback& progress) {
  const std::lock_guard lock(mutex_);
  if (host.source) return host.source;
  RemoteOptions options = options_;
  if (hosts_.size() > 1) options.attempts = 1;  // the next host is the next attempt
  auto opened = SLF_TRY(HttpSource::open(host.url, options, progress));
  if (hosts_.size() > 1) SLF_TRY(compare(host, *opened));
  size_ = opened->size();
  return host.source = std::move(opened);
}

Result<void> RemoteFile::fetch(std::span<const FileRange> ranges, const Sink& sink) {
  // Without versions, SparseCopy compares the ends with those of now.
  const auto same = [](FileRange a, FileRange b) { return a.begin == b.begin && a.end == b.end; };
  if (!cache_ || (!has_version() && std::ranges::equal(ranges, ends(), same)))
    return download(ranges, sink, {});
  std::vector<FileRange> absent;
  for (const FileRange& range : ranges)
    for (std::uint64_t at = range.begin, end = 0; at < range.end; at = end) {
      end = range.end;
      if (const auto entry = cache_->read(at, end)) {
        SLF_TRY(sink(entry->begin, entry->bytes));
        end = entry->begin + entry->bytes.size();
      } else {
        absent.push_back({at, end});
      }
    }
  if (absent.empty()) return {};
  absent = storage::internal::merged(std::move(absent), kGap);
  return download(absent,
                  [&](std::uint64_t offset, ByteSpan bytes) {
                    cache_->put(offset, bytes);
                    return sink(offset, bytes);
                  },
                  {});
}

// Asks one host after the other, in rounds, for what has not come. Without ranges, opens one.
Result<void> RemoteFile::download(std::span<const FileRange> ranges, const Sink& sink,
                                  const ProgressCallback& progress) {
  RangeSet came;
  bool sinks = true;  // whether `sink` has accepted what came
  const Sink counted = [&](std::uint64_t offset, ByteSpan bytes) -> Result<void> {
    auto taken = sink(offset, bytes);
    sinks = taken.has_value();
    if (sinks) came.add({offset, offset + bytes.size()});
    return taken;
  };
  const auto ask = [&](Host& host) -> Result<void> {
    std::vector<FileRange> left;
    for (const FileRange& range : ranges) came.append_missing(range, left);
    auto opened = SLF_TRY(source(host, progress));
    if (left.empty()) return {};
    if (hosts_.size() == 1) return opened->fetch(left, sink);
    std::this_thread::sleep_until(opened->resumes());
    return opened->fetch(left, counted);
  };
  if (hosts_.size() == 1) return ask(hosts_[0]);
  Error error{ErrorCode::bad_file, name() + ": no address is left"};
  for (unsigned round = 1;; ++round) {
    bool usable = false;
    for (std::size_t k = 0, begin = first_; k < hosts_.size(); ++k) {
      Host& host = hosts_[(begin + k) % hosts_.size()];
      if (host.refused) continue;
      auto done = ask(host);
      if (done) {
        first_ = (begin + k) % hosts_.size();
        return done;
      }
      const ErrorCode code = done.error().code;
      if (!sinks || code == ErrorCode::cancelled) return done;
      if (code == ErrorCode::bad_file)
        host.refused = true;  // it has another file, perhaps now only
      usable |= !host.refused;
      error = std::move(done.error());
    }
    if (!usable || round >= options_.attempts) break;
    const double pause = std::ldexp(options_.first_retry_delay, static_cast<int>(round) - 1);
    std::this_thread::sleep_for(std::chrono::duration<double>(std::min(pause, kMaxPause)));
  }
  for (const Host& host : hosts_)
    if (host.refused)
      error.message += "; " + host.url + ": not used: its file differs, or comes whole only";
  return tl::unexpected(std::move(error));
}

}  // namespace slf
