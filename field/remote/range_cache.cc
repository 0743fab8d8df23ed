#include "field/remote/range_cache.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>
#include <xxhash.h>

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <utility>
#include <vector>

#include "base/content_hash.h"
#include "base/file.h"

namespace slf {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kOurs = "slf-range-";
constexpr std::size_t kHash = 32;  // hexadecimal digits
constexpr std::size_t kChecksum = sizeof(std::uint64_t);

/// Whether a cache may have written a file of such a name, whole or not: others are not removed.
bool is_ours(std::string_view name) {
  return name.starts_with(kOurs) && name.size() > kOurs.size() + kHash &&
         name.substr(kOurs.size()).find_first_not_of("0123456789abcdef") == kHash &&
         name[kOurs.size() + kHash] == '-';
}

}  // namespace

RangeCache::RangeCache(const std::string& folder, std::uint64_t limit, std::string identity)
    : folder_(folder), identity_(std::move(identity)), limit_(limit) {
  ContentHash hash;
  hash.add(bytes_of(identity_));
  const std::string text = hash.text();
  prefix_ = folder_ + "/" + std::string(kOurs) + text.substr(text.find(':') + 1) + "-";
}

Result<std::unique_ptr<RangeCache>> RangeCache::open(const std::string& folder, std::uint64_t limit,
                                                     std::string identity) {
  std::error_code error;
  fs::create_directories(fs::path(folder).parent_path(), error);
  struct stat is {};
  if ((::mkdir(folder.c_str(), 0700) != 0 && errno != EEXIST) || ::stat(folder.c_str(), &is) != 0)
    return io_error(folder, "cannot make the folder of the cache");
  if (!S_ISDIR(is.st_mode) || is.st_uid != ::geteuid() || (is.st_mode & 022) != 0)
    return fail(ErrorCode::usage, folder,
                ": a cache needs a folder of your own, which others may not write to");
  std::unique_ptr<RangeCache> cache(new RangeCache(folder, limit, std::move(identity)));
  cache->trim();
  return cache;
}

std::string RangeCache::path(std::uint64_t begin, std::uint64_t end) const {
  return prefix_ + std::to_string(begin) + "-" + std::to_string(end);
}

std::uint64_t RangeCache::checksum(std::uint64_t begin, ByteSpan bytes) const {
  return XXH3_64bits_withSeed(bytes.data(), bytes.size(), begin);
}

std::optional<RangeCache::Entry> RangeCache::read(std::uint64_t at, std::uint64_t& end) {
  const std::lock_guard lock(mutex_);
  auto entry = entries_.upper_bound(at);
  const std::uint64_t next = entry == entries_.end() ? end : entry->first;
  if (entry != entries_.begin() && (--entry)->second > at) {
    const auto [first, last] = *entry;
    const std::string file = path(first, last);
    Bytes all(kChecksum + identity_.size() + (last - first) + 1);
    const Descriptor opened(::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW));
    const ssize_t got = ::read(opened.get(), all.data(), all.size());
    const ByteSpan content = ByteSpan(all).first(all.size() - 1).subspan(kChecksum);
    std::uint64_t sum = 0;
    std::memcpy(&sum, all.data(), sizeof sum);
    if (got + 1 == static_cast<ssize_t>(all.size()) && sum == checksum(first, content) &&
        std::memcmp(content.data(), identity_.data(), identity_.size()) == 0) {
      ::futimens(opened.get(), nullptr);
      const ByteSpan bytes = content.subspan(identity_.size());
      return Entry{first, {bytes.begin(), bytes.end()}};
    }
    ::unlink(file.c_str());  // damaged, or removed by another process
    entries_.erase(entry);
  }
  end = std::min(end, next);
  return std::nullopt;
}

void RangeCache::put(std::uint64_t offset, ByteSpan bytes) {
  const std::lock_guard lock(mutex_);
  Bytes all(kChecksum + identity_.size() + bytes.size());
  if (!writes_ || all.size() > limit_ / 4) return;
  std::memcpy(all.data() + kChecksum, identity_.data(), identity_.size());
  std::ranges::copy(bytes, all.end() - static_cast<std::ptrdiff_t>(bytes.size()));
  const std::uint64_t sum = checksum(offset, ByteSpan(all).subspan(kChecksum));
  std::memcpy(all.data(), &sum, sizeof sum);
  added_ += all.size();
  // Other processes add entries, too, so the folder is listed now and then.
  if (total_ + added_ > limit_ || added_ > limit_ / 16) trim(), added_ += all.size();
  const std::string file = path(offset, offset + bytes.size()), draft = unused_name(file);
  Descriptor made(::open(draft.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600));
  writes_ = made.get() >= 0 && write_all(made.get(), all) == 0 &&
            ::rename(draft.c_str(), file.c_str()) == 0;
  if (writes_)
    entries_[offset] = offset + bytes.size();
  else
    ::unlink(draft.c_str());
}

// Lists the folder, and makes room in it for added_ bytes.
void RangeCache::trim() {
  struct Found {
    fs::file_time_type used;
    std::uint64_t bytes;
    fs::path path;
  };
  std::vector<Found> entries;
  std::error_code error;
  entries_.clear();
  total_ = 0;
  for (auto at = fs::directory_iterator(folder_, error); !error && at != end(at);
       at.increment(error)) {
    std::error_code gone;
    const std::string name = at->path().filename();
    if (!is_ours(name) || !at->is_regular_file(gone)) continue;
    entries.push_back({at->last_write_time(gone), at->file_size(gone), at->path()});
    if (gone) {
      entries.pop_back();
      continue;
    }
    total_ += entries.back().bytes;
  }
  // A little more than is needed, so that not every new entry lists the folder.
  const std::uint64_t most = limit_ - std::min(limit_, added_) - limit_ / 8;
  std::ranges::sort(entries, std::greater<>(), &Found::used);
  for (bool full = total_ + added_ > limit_; full && total_ > most && !entries.empty();) {
    total_ -= entries.back().bytes;
    fs::remove(entries.back().path, error);
    entries.pop_back();
  }
  added_ = 0;
  for (const Found& entry : entries) {
    unsigned long long begin = 0, end = 0;
    int length = 0;
    const std::string path = entry.path;
    if (path.starts_with(prefix_) &&
        std::sscanf(path.c_str() + prefix_.size(), "%llu-%llu%n", &begin, &end, &length) == 2 &&
        prefix_.size() + static_cast<std::size_t>(length) == path.size() && begin < end &&
        entry.bytes == kChecksum + identity_.size() + (end - begin))
      entries_[begin] = std::max<std::uint64_t>(entries_[begin], end);
  }
}

}  // namespace slf
