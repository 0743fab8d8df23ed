// RemoteFile: a file at one or several addresses, and what a cache has of it.
//
// With several, a request that fails at one goes to the next. All must have the same file: the same
// length, meta pages and footer of the index, which has a checksum of all tables. One that has
// another is not used.
#pragma once

#include <atomic>
#include <deque>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "field/remote/http_source.h"
#include "field/remote/range_cache.h"

namespace slf {

/// Thread-safety: any thread.
class RemoteFile final : public storage::RangeSource {
 public:
  /// `place`: addresses, as in RemoteField::open(), whose errors and progress these are.
  [[nodiscard]] static Result<std::shared_ptr<RemoteFile>> open(const std::string& place,
                                                                const RemoteOptions& options,
                                                                const ProgressCallback& progress);

  [[nodiscard]] const std::string& name() const override { return hosts_.front().url; }
  [[nodiscard]] std::uint64_t size() const override { return size_; }
  [[nodiscard]] bool has_version() const override;
  [[nodiscard]] Result<void> fetch(std::span<const storage::FileRange> ranges,
                                   const Sink& sink) override;
  [[nodiscard]] RemoteTraffic traffic() const;

 private:
  struct Host {
    std::string url;
    std::shared_ptr<HttpSource> source{};  ///< once it was asked
    std::atomic<bool> refused{false};      ///< it has another file, or serves no ranges
  };

  explicit RemoteFile(const RemoteOptions& options) : options_(options) {}
  [[nodiscard]] std::vector<storage::FileRange> ends() const;
  [[nodiscard]] Result<std::shared_ptr<HttpSource>> source(Host& host,
                                                           const ProgressCallback& progress);
  [[nodiscard]] Result<void> compare(Host& host, HttpSource& source);
  [[nodiscard]] Result<void> download(std::span<const storage::FileRange> ranges, const Sink& sink,
                                      const ProgressCallback& progress);

  RemoteOptions options_;
  std::uint64_t size_ = 0;
  Bytes ends_;  ///< what tells the file from others; empty until it is known
  std::unique_ptr<RangeCache> cache_;
  mutable std::mutex mutex_;           ///< of the sources of hosts_
  std::deque<Host> hosts_;             ///< one or more
  std::atomic<std::size_t> first_{0};  ///< the host to ask first
};

}  // namespace slf
