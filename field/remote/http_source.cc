#include "field/remote/http_source.h"

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cmath>
#include <deque>
#include <optional>
#include <utility>

#include "base/guarded.h"
#include "base/try.h"
#include "field/remote/curl_library.h"

namespace slf {
namespace {

using storage::FileRange;
using Clock = std::chrono::steady_clock;

constexpr std::uint64_t kUnknown = ~std::uint64_t{0};
constexpr long kMinBytesPerSecond = 256;  // a transfer that is slower has stalled
constexpr long kRedirects = 5;
constexpr std::uint64_t kPiece = 4 << 20;        // most bytes that one request asks for
constexpr std::uint64_t kMaxWhole = 64 << 20;    // most bytes of a field that is fetched whole
constexpr std::uint64_t kMaxIgnored = 64 << 10;  // bytes of an answer that nothing needs

bool take_number(std::string_view& text, std::uint64_t& value) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  text.remove_prefix(static_cast<std::size_t>(end - text.data()));
  return error == std::errc();
}

bool take(std::string_view& text, char c) {
  if (!text.starts_with(c)) return false;
  text.remove_prefix(1);
  return true;
}

/// An address as servers expect it: characters that it must not have are escaped. If it is
/// malformed, unchanged; the request then reports it. Empty if libcurl has no memory.
std::string escaped(const std::string& url) {
  const std::unique_ptr<CURLU, decltype(curl.url_cleanup)> parts(curl.url(), curl.url_cleanup);
  if (parts == nullptr) return "";
  char* text = nullptr;
  if (curl.url_set(parts.get(), CURLUPART_URL, url.c_str(), CURLU_URLENCODE | CURLU_ALLOW_SPACE) !=
          CURLUE_OK ||
      curl.url_get(parts.get(), CURLUPART_URL, &text, 0) != CURLUE_OK)
    return url;
  const std::unique_ptr<char, decltype(curl.free)> owner(text, curl.free);
  return text;
}

/// The header Content-Range: "bytes 0-99/1234".
struct ContentRange {
  FileRange range;
  std::uint64_t total = 0;
};
std::optional<ContentRange> parse_content_range(std::string_view text) {
  ContentRange found;
  std::uint64_t last = 0;
  if (!text.starts_with("bytes ")) return std::nullopt;
  text.remove_prefix(6);
  if (!take_number(text, found.range.begin) || !take(text, '-') || !take_number(text, last) ||
      !take(text, '/') || !take_number(text, found.total) || !text.empty() ||
      last < found.range.begin || last >= found.total)
    return std::nullopt;
  found.range.end = last + 1;
  return found;
}

}  // namespace

/// One range that is being fetched, or the whole file, of at most the length of the range.
struct HttpSource::Transfer {
  FileRange range;
  bool whole = false;
  ProgressCallback progress;  ///< of the whole file
  unsigned attempts = 0;      ///< begun so far
  Clock::time_point due;      ///< earliest begin of the next attempt
  // Of the current attempt:
  CURL* easy = nullptr;
  curl_slist* headers = nullptr;
  Bytes body;
  bool oversized = false;      ///< the answer has more bytes than requested
  bool stopped = false;        ///< by `progress`
  std::optional<Error> error;  ///< of memory, or of `progress`

  /// The status of the answer; 0 if there is none.
  [[nodiscard]] long status() const {
    long status = 0;
    curl.easy_getinfo(easy, CURLINFO_RESPONSE_CODE, &status);
    return status;
  }
  /// The stated length of the answer's body, or kUnknown.
  [[nodiscard]] std::uint64_t stated_length() const {
    curl_off_t length = -1;
    curl.easy_getinfo(easy, CURLINFO_CONTENT_LENGTH_DOWNLOAD_T, &length);
    return length < 0 ? kUnknown : static_cast<std::uint64_t>(length);
  }
  /// A header of the answer, or of the last one in a chain of redirections; empty if it has none.
  [[nodiscard]] std::string header(const char* name) const {
    curl_header* found = nullptr;
    const bool there = curl.easy_header(easy, name, 0, CURLH_HEADER, -1, &found) == CURLHE_OK;
    return there ? found->value : "";
  }
  /// The seconds after which the server wants to be asked again; 0 if it does not say.
  [[nodiscard]] double retry_after() const {
    curl_off_t seconds = 0;
    curl.easy_getinfo(easy, CURLINFO_RETRY_AFTER, &seconds);
    return static_cast<double>(seconds);
  }
  /// Whether the request has left for the server.
  [[nodiscard]] bool was_sent() const {
    long bytes = 0;
    curl.easy_getinfo(easy, CURLINFO_REQUEST_SIZE, &bytes);
    return bytes > 0;
  }
  /// Takes a piece of the body. Returns false to end the transfer.
  bool take_body(std::string_view piece);

  /// take_body() for libcurl: no exception may pass its frames.
  static std::size_t write(char* data, std::size_t, std::size_t count, void* to) {
    auto& self = *static_cast<Transfer*>(to);
    auto taken = guarded([&]() -> Result<bool> { return self.take_body({data, count}); });
    if (!taken) self.error = std::move(taken.error());
    return taken && *taken ? count : 0;
  }
};

/// curl handles that keep their connections between uses. Thread-safety: one thread at a time.
class HttpSource::Connections {
 public:
  explicit Connections(std::size_t parallel) {
    free.reserve(parallel);
    running.reserve(parallel);
  }
  Connections(const Connections&) = delete;
  Connections& operator=(const Connections&) = delete;
  ~Connections() {
    for (CURL* easy : free) curl.easy_cleanup(easy);
    curl.multi_cleanup(multi);
  }
  /// Ends a transfer that runs. Allocates nothing.
  void stop(Transfer& transfer) {
    curl.multi_remove_handle(multi, transfer.easy);
    free.push_back(std::exchange(transfer.easy, nullptr));
    curl.slist_free_all(std::exchange(transfer.headers, nullptr));
    std::erase(running, &transfer);
  }

  CURLM* multi = nullptr;
  std::vector<CURL*> free;
  std::vector<Transfer*> running;
};

/// Exclusive use of Connections. The destructor ends their transfers and returns them.
class HttpSource::ConnectionLease {
 public:
  ConnectionLease(HttpSource& source, std::size_t parallel) : source_(source) {
    {
      const std::lock_guard lock(source_.mutex_);
      if (!source_.idle_.empty()) ours_.splice(ours_.end(), source_.idle_, source_.idle_.begin());
    }
    if (ours_.empty()) ours_.emplace_back(parallel);
  }
  ConnectionLease(const ConnectionLease&) = delete;
  ConnectionLease& operator=(const ConnectionLease&) = delete;
  ~ConnectionLease() {
    while (!connections().running.empty()) {
      Transfer& transfer = *connections().running.back();
      if (!transfer.was_sent()) --source_.requests_;
      connections().stop(transfer);
    }
    const std::lock_guard lock(source_.mutex_);
    source_.idle_.splice(source_.idle_.end(), ours_);
  }
  [[nodiscard]] Connections& connections() { return ours_.front(); }

 private:
  HttpSource& source_;
  std::list<Connections> ours_;
};

bool HttpSource::Transfer::take_body(std::string_view piece) {
  // Nothing reads the text of an error, which may be endless.
  if (status() != (whole ? 200 : 206)) return false;
  const ByteSpan bytes = std::as_bytes(std::span(piece));
  oversized = bytes.size() > range.size() - body.size();
  if (oversized) return false;
  body.insert(body.end(), bytes.begin(), bytes.end());
  if (progress) {
    const std::uint64_t length = stated_length();
    stopped = !progress({.done = body.size(), .total = length == kUnknown ? body.size() : length});
  }
  return !stopped;
}

HttpSource::HttpSource(std::string url, const RemoteOptions& options)
    : url_(std::move(url)), escaped_(escaped(url_)), options_(options), size_(kUnknown) {}
HttpSource::~HttpSource() = default;

Result<std::shared_ptr<HttpSource>> HttpSource::open(const std::string& url,
                                                     const RemoteOptions& options,
                                                     const ProgressCallback& progress) {
  SLF_TRY(at_place(load_curl(), url));
  std::shared_ptr<HttpSource> source(new HttpSource(url, options));
  if (source->escaped_.empty()) return source->no_memory();
  std::vector<Transfer> first(1);
  first[0].range = {0, 1};
  auto ok = source->run(first, [](std::uint64_t, ByteSpan) { return Result<void>(); });
  if (ok && !source->has_ranges_) {
    first.assign(1, {});
    first[0].range = {0, kMaxWhole};
    first[0].whole = true;
    first[0].progress = progress;
    ok = source->run(first, [&](std::uint64_t, ByteSpan bytes) {
      source->whole_.assign(bytes.begin(), bytes.end());
      return Result<void>();
    });
  }
  if (!ok) return tl::unexpected(std::move(ok.error()));
  return source;
}

Result<void> HttpSource::fetch(std::span<const FileRange> ranges, const Sink& sink) {
  Bytes whole;
  {
    const std::lock_guard lock(mutex_);
    whole = std::exchange(whole_, {});
  }
  if (!whole.empty()) return sink(0, whole);
  std::vector<Transfer> transfers;
  for (const FileRange& range : ranges)
    for (std::uint64_t at = range.begin; at < range.end; at += kPiece)
      transfers.emplace_back().range = {at, std::min(at + kPiece, range.end)};
  return run(transfers, sink);
}

tl::unexpected<Error> HttpSource::no_memory() const {
  return fail(ErrorCode::failed, url_, ": libcurl has no memory for another transfer");
}

// Runs transfers until all are complete, or one has failed at its last attempt.
Result<void> HttpSource::run(std::vector<Transfer>& transfers, const Sink& sink) {
  const std::size_t parallel = std::max(1u, options_.parallel);
  ConnectionLease lease(*this, parallel);
  Connections& connections = lease.connections();
  if (!connections.multi) connections.multi = curl.multi_init();
  if (!connections.multi) return no_memory();
  std::deque<Transfer*> waiting;
  for (Transfer& transfer : transfers) waiting.push_back(&transfer);
  while (!(waiting.empty() && connections.running.empty())) {
    const auto now = Clock::now();
    auto next_due = now + std::chrono::seconds(1);
    for (std::size_t k = waiting.size(); k > 0 && connections.running.size() < parallel; --k) {
      Transfer* const transfer = waiting.front();
      waiting.pop_front();
      if (transfer->due > now) {
        next_due = std::min(next_due, transfer->due);
        waiting.push_back(transfer);
        continue;
      }
      SLF_TRY(start(*transfer, connections));
    }
    int active = 0;
    if (curl.multi_perform(connections.multi, &active) != CURLM_OK) return no_memory();
    int left = 0;
    bool ended = false;  // then others may begin at once
    while (const CURLMsg* message = curl.multi_info_read(connections.multi, &left)) {
      if (message->msg != CURLMSG_DONE) continue;
      char* owner = nullptr;
      curl.easy_getinfo(message->easy_handle, CURLINFO_PRIVATE, &owner);
      auto& transfer = *reinterpret_cast<Transfer*>(owner);
      const bool done = SLF_TRY(evaluate(transfer, message->data.result));
      connections.stop(transfer);
      ended = true;
      if (done) {
        SLF_TRY(sink(transfer.range.begin, transfer.body));
        transfer.body = {};
      } else {
        ++repeated_;
        waiting.push_back(&transfer);
      }
    }
    if (ended) continue;
    const auto pause = std::chrono::duration_cast<std::chrono::milliseconds>(next_due - now);
    curl.multi_poll(connections.multi, nullptr, 0,
                    static_cast<int>(std::max<long long>(1, pause.count())), nullptr);
  }
  return {};
}

Result<void> HttpSource::start(Transfer& transfer, Connections& connections) {
  ++transfer.attempts;
  ++requests_;
  transfer.body.clear();
  transfer.oversized = transfer.stopped = false;
  transfer.error.reset();
  CURL* easy = nullptr;
  if (connections.free.empty()) {
    easy = curl.easy_init();
  } else {
    easy = connections.free.back();
    connections.free.pop_back();
    curl.easy_reset(easy);
  }
  if (!easy) return no_memory();
  transfer.easy = easy;
  connections.running.push_back(&transfer);
  bool fine = true;
  const auto set = [&](CURLoption option, auto value) {
    if (curl.easy_setopt(easy, option, value) != CURLE_OK) fine = false;
  };
  const std::string range =
      std::to_string(transfer.range.begin) + "-" + std::to_string(transfer.range.end - 1);
  const long stall_timeout = std::max(1L, static_cast<long>(options_.stall_timeout * 1000));
  set(CURLOPT_URL, escaped_.c_str());
  if (!transfer.whole) set(CURLOPT_RANGE, range.c_str());
  set(CURLOPT_PRIVATE, &transfer);
  set(CURLOPT_NOSIGNAL, 1L);
  set(CURLOPT_USERAGENT, "slf");
  set(CURLOPT_FOLLOWLOCATION, 1L);
  set(CURLOPT_MAXREDIRS, kRedirects);
  set(CURLOPT_PROTOCOLS_STR, "http,https");
  set(CURLOPT_REDIR_PROTOCOLS_STR, "http,https");
  set(CURLOPT_CONNECTTIMEOUT_MS, stall_timeout);
  // A transfer that is slower than kMinBytesPerSecond for `stall_timeout` (in whole seconds) has
  // stalled. The last limit is for a server that sends headers forever.
  set(CURLOPT_LOW_SPEED_LIMIT, kMinBytesPerSecond);
  set(CURLOPT_LOW_SPEED_TIME, std::max(1L, stall_timeout / 1000));
  const auto bytes = static_cast<long>(transfer.range.size());
  set(CURLOPT_TIMEOUT_MS, 2 * stall_timeout + 1000 * (bytes / kMinBytesPerSecond));
  if (validator_.starts_with('"')) {  // a strong ETag
    transfer.headers = curl.slist_append(nullptr, ("If-Match: " + validator_).c_str());
    set(CURLOPT_HTTPHEADER, transfer.headers);
  }
  set(CURLOPT_WRITEFUNCTION, &Transfer::write);
  set(CURLOPT_WRITEDATA, &transfer);
  // curl itself reads, and drops, the body of a redirection.
  using Count = int (*)(void*, curl_off_t, curl_off_t, curl_off_t, curl_off_t);
  const Count too_much = [](void* to, curl_off_t, curl_off_t got, curl_off_t, curl_off_t) {
    const FileRange asked = static_cast<Transfer*>(to)->range;
    return static_cast<std::uint64_t>(got) > asked.size() + kMaxIgnored ? 1 : 0;
  };
  set(CURLOPT_NOPROGRESS, 0L);
  set(CURLOPT_XFERINFOFUNCTION, too_much);
  set(CURLOPT_XFERINFODATA, &transfer);
  if (!fine || curl.multi_add_handle(connections.multi, easy) != CURLM_OK) return no_memory();
  return {};
}

Result<bool> HttpSource::evaluate(Transfer& t, int code) {
  const auto failed = [&](ErrorCode kind, const auto&... parts) -> Result<bool> {
    return fail(kind, url_, ": ", parts...);
  };
  const auto after = [](double seconds) {
    return Clock::now() +
           std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
  };
  const auto again = [&](const std::string& what) -> Result<bool> {
    resumes_ = after(std::min(t.retry_after(), kMaxPause));
    if (t.attempts >= std::max(1u, options_.attempts))
      return failed(ErrorCode::io, what, ", after ", t.attempts, " attempts");
    const double doubled = std::ldexp(options_.first_retry_delay, static_cast<int>(t.attempts) - 1);
    t.due = after(std::min(std::max(doubled, t.retry_after()), kMaxPause));
    return false;
  };
  const auto changed = [&] {
    return failed(ErrorCode::bad_file, "the file has changed on the server since it was opened");
  };

  const auto too_large = [&](const std::string& length) {
    return failed(ErrorCode::unsupported,
                  "the server does not serve parts of files (HTTP ranges), and the file has ",
                  length, " bytes; without ranges a field of at most ", kMaxWhole,
                  " is fetched whole. Download it, or use another server");
  };

  const long status = t.status();
  bytes_ += t.body.size();
  if (t.error) return failed(t.error->code, t.error->message);
  if (t.stopped) return failed(ErrorCode::cancelled, "stopped while the field was fetched");
  if (t.oversized && t.whole) return too_large("more");
  if (t.oversized || code == CURLE_ABORTED_BY_CALLBACK)
    return failed(ErrorCode::io, "the server sends more than it was asked for");
  // Whether the body of an error has come does not matter.
  if (status == 408 || status == 429 || status >= 500)
    return again("the server answers " + std::to_string(status));
  if (status == 412 || (status == 416 && size_ != kUnknown)) return changed();
  if (status == 416) return failed(ErrorCode::bad_file, "not a field: the file is empty");
  if (status >= 400)
    return failed(status == 404 ? ErrorCode::not_found : ErrorCode::io, "the server answers ",
                  status);
  if (status == 200 && !t.whole && (code == CURLE_OK || code == CURLE_WRITE_ERROR)) {
    if (size_ != kUnknown)
      return failed(ErrorCode::io, "the server no longer serves parts of the file (HTTP ranges)");
    if (const std::uint64_t length = t.stated_length(); length != kUnknown && length > kMaxWhole)
      return too_large(std::to_string(length));
    has_ranges_ = false;
    return true;
  }
  if (code == CURLE_TOO_MANY_REDIRECTS)
    return failed(ErrorCode::io, "the server redirects more than ", kRedirects, " times");
  if (code == CURLE_UNSUPPORTED_PROTOCOL && status / 100 == 3)
    return failed(ErrorCode::io, "the server redirects to an address without http or https");
  if (code == CURLE_URL_MALFORMAT || code == CURLE_PEER_FAILED_VERIFICATION ||
      code == CURLE_SSL_CACERT_BADFILE)
    return failed(ErrorCode::io, curl.easy_strerror(static_cast<CURLcode>(code)));
  if (code != CURLE_OK) return again(curl.easy_strerror(static_cast<CURLcode>(code)));
  if (t.whole && status == 200) {
    size_ = t.body.size();
    return true;
  }
  if (status != 206) return failed(ErrorCode::io, "the server answers ", status);

  const auto answered = parse_content_range(t.header("content-range"));
  if (!answered)
    return failed(ErrorCode::io, "the server does not say which part of the file it sends");
  const std::string tag = t.header("etag"),
                    validator = tag.empty() ? t.header("last-modified") : tag;
  if (size_ == kUnknown) {
    size_ = answered->total;
    validator_ = validator;
    may_store_ = t.header("cache-control").find("no-store") == std::string::npos;
  }
  if (answered->total != size_ || validator != validator_) return changed();
  if (answered->range.begin != t.range.begin || answered->range.end != t.range.end)
    return failed(ErrorCode::io, "the server sends another part of the file than it was asked for");
  if (t.body.size() != t.range.size()) return again("the server cut its answer short");
  return true;
}

}  // namespace slf
