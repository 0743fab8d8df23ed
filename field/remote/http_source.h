// HttpSource: a file on a web server, as ranges of bytes (libcurl).
#pragma once

#include <atomic>
#include <chrono>
#include <list>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "slf/remote.h"
#include "storage/range_source.h"

namespace slf {

inline constexpr double kMaxPause = 8;  ///< seconds between two attempts

/// Thread-safety: any thread. Each fetch() uses connections of its own; later calls reuse them.
class HttpSource final : public storage::RangeSource {
 public:
  /// Requests the first byte, to learn the length and version of the file. If the server does not
  /// serve ranges, fetches the file, and the first fetch() passes all of it on. Errors and progress
  /// as RemoteField::open().
  [[nodiscard]] static Result<std::shared_ptr<HttpSource>> open(const std::string& url,
                                                                const RemoteOptions& options,
                                                                const ProgressCallback& progress);
  ~HttpSource() override;

  [[nodiscard]] const std::string& name() const override { return url_; }
  [[nodiscard]] std::uint64_t size() const override { return size_; }
  /// Dates are of whole seconds, and files that are copied may keep them.
  [[nodiscard]] bool has_version() const override {
    return !has_ranges_ || validator_.starts_with('"');
  }
  [[nodiscard]] Result<void> fetch(std::span<const storage::FileRange> ranges,
                                   const Sink& sink) override;
  [[nodiscard]] RemoteTraffic traffic() const { return {requests_, repeated_, bytes_}; }
  /// The ETag or, without one, the date. Empty: none, or the server lets nobody store the file.
  [[nodiscard]] std::string version() const { return may_store_ ? validator_ : ""; }
  [[nodiscard]] bool has_ranges() const { return has_ranges_; }
  /// When the server wants to be asked again, after an answer that said so.
  [[nodiscard]] std::chrono::steady_clock::time_point resumes() const { return resumes_; }

 private:
  class Connections;
  class ConnectionLease;
  struct Transfer;

  HttpSource(std::string url, const RemoteOptions& options);
  [[nodiscard]] Result<void> run(std::vector<Transfer>& transfers, const Sink& sink);
  [[nodiscard]] Result<void> start(Transfer& transfer, Connections& connections);
  [[nodiscard]] tl::unexpected<Error> no_memory() const;
  /// Judges an answer: true if the transfer is complete, false if it must be repeated, or an error.
  [[nodiscard]] Result<bool> evaluate(Transfer& transfer, int code);

  const std::string url_;      ///< as it was given
  const std::string escaped_;  ///< as it is requested
  const RemoteOptions options_;
  std::uint64_t size_ = 0;
  std::string validator_;  ///< the ETag or, without one, the date
  bool has_ranges_ = true, may_store_ = true;
  std::atomic<std::chrono::steady_clock::time_point> resumes_{};
  Bytes whole_;  ///< the file, until fetch() passes it on
  std::atomic<std::uint64_t> requests_{0}, repeated_{0}, bytes_{0};
  std::mutex mutex_;
  std::list<Connections> idle_;
};

}  // namespace slf
