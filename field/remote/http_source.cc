#include "field/remote/http_source.h"

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstring>
#include <deque>
#include <optional>
#include <thread>
#include <utility>

#include "field/remote/curl_library.h"

namespace slf {
namespace {

using storage::FileRange;
using Clock = std::chrono::steady_clock;

constexpr std::uint64_t kUnknown = ~std::uint64_t{0};
constexpr long kMinBytesPerSecond = 256;  // a transfer that is slower has stalled
constexpr double kMaxPause = 8;           // seconds
constexpr long kRedirects = 5;
constexpr std::uint64_t kPiece = 4 << 20;        // most bytes that one request asks for
constexpr std::uint64_t kMaxWhole = 64 << 20;    // most bytes of a field that is fetched whole
constexpr std::uint64_t kMaxIgnored = 64 << 10;  // bytes of an answer that nothing needs

std::string_view trimmed(std::string_view text) {
  while (!text.empty() && (text.front() == ' ' || text.front() == '\t')) text.remove_prefix(1);
  while (!text.empty() && std::strchr(" \t\r\n", text.back()) != nullptr) text.remove_suffix(1);
  return text;
}

bool same_letters(std::string_view a, std::string_view b) {
  return a.size() == b.size() && std::equal(a.begin(), a.end(), b.begin(), [](char x, char y) {
           return std::tolower(static_cast<unsigned char>(x)) ==
                  std::tolower(static_cast<unsigned char>(y));
         });
}

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
/// malformed, unchanged; the request then reports it.
std::string escaped(const std::string& url) {
  CURLU* const parts = curl.url();
  char* text = nullptr;
  std::string result = url;
  if (curl.url_set(parts, CURLUPART_URL, url.c_str(), CURLU_URLENCODE | CURLU_ALLOW_SPACE) ==
          CURLUE_OK &&
      curl.url_get(parts, CURLUPART_URL, &text, 0) == CURLUE_OK)
    result = text;
  curl.free(text);
  curl.url_cleanup(parts);
  return result;
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

/// curl handles that keep their connections between uses. Thread-safety: one thread at a time.
class HttpSource::Connections {
 public:
  Connections() : multi(curl.multi_init()) {}
  Connections(const Connections&) = delete;
  Connections& operator=(const Connections&) = delete;
  ~Connections() {
    for (CURL* easy : free) curl.easy_cleanup(easy);
    curl.multi_cleanup(multi);
  }

  CURLM* multi;
  std::vector<CURL*> free;
};

/// Exclusive use of Connections, which the destructor returns.
class HttpSource::ConnectionLease {
 public:
  explicit ConnectionLease(HttpSource& source) : source_(source) {
    const std::lock_guard lock(source_.mutex_);
    if (source_.idle_.empty()) {
      connections_ = std::make_unique<Connections>();
    } else {
      connections_ = std::move(source_.idle_.back());
      source_.idle_.pop_back();
    }
  }
  ConnectionLease(const ConnectionLease&) = delete;
  ConnectionLease& operator=(const ConnectionLease&) = delete;
  ~ConnectionLease() {
    const std::lock_guard lock(source_.mutex_);
    source_.idle_.push_back(std::move(connections_));
  }
  [[nodiscard]] Connections& connections() { return *connections_; }

 private:
  HttpSource& source_;
  std::unique_ptr<Connections> connections_;
};

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
  std::string tag, date, content_range;
  double retry_after = 0;  ///< seconds
  bool oversized = false;  ///< the answer has more bytes than requested
  bool stopped = false;    ///< by `progress`

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
  /// Takes a piece of the body. Returns false to end the transfer.
  bool take_body(ByteSpan bytes);
};

bool HttpSource::Transfer::take_body(ByteSpan bytes) {
  // Nothing reads the text of an error, which may be endless.
  if (status() != (whole ? 200 : 206)) return false;
  oversized = bytes.size() > range.end - range.begin - body.size();
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
  if (const auto ready = load_curl(); !ready)
    return fail(ready.error().code, url, ": ", ready.error().message);
  std::shared_ptr<HttpSource> source(new HttpSource(url, options));
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

// Runs transfers until all are complete, or one has failed at its last attempt.
Result<void> HttpSource::run(std::vector<Transfer>& transfers, const Sink& sink) {
  ConnectionLease lease(*this);
  Connections& connections = lease.connections();
  std::deque<Transfer*> waiting;
  for (Transfer& transfer : transfers) waiting.push_back(&transfer);
  std::vector<Transfer*> running;
  const auto stop = [&](Transfer* transfer) {
    curl.multi_remove_handle(connections.multi, transfer->easy);
    connections.free.push_back(std::exchange(transfer->easy, nullptr));
    curl.slist_free_all(std::exchange(transfer->headers, nullptr));
    std::erase(running, transfer);
  };
  Result<void> result;
  while (result && !(waiting.empty() && running.empty())) {
    const auto now = Clock::now();
    auto next_due = now + std::chrono::seconds(1);
    for (std::size_t k = waiting.size(); k > 0 && running.size() < std::max(1u, options_.parallel);
         --k) {
      Transfer* const transfer = waiting.front();
      waiting.pop_front();
      if (transfer->due > now) {
        next_due = std::min(next_due, transfer->due);
        waiting.push_back(transfer);
        continue;
      }
      result = start(*transfer, connections);
      if (!result) break;
      running.push_back(transfer);
    }
    if (!result) break;
    int active = 0;
    curl.multi_perform(connections.multi, &active);
    int left = 0;
    while (const CURLMsg* message = curl.multi_info_read(connections.multi, &left)) {
      if (message->msg != CURLMSG_DONE || !result) continue;
      char* owner = nullptr;
      curl.easy_getinfo(message->easy_handle, CURLINFO_PRIVATE, &owner);
      auto* const transfer = reinterpret_cast<Transfer*>(owner);
      const auto done = evaluate(*transfer, message->data.result);
      stop(transfer);
      if (!done) {
        result = tl::unexpected(done.error());
      } else if (*done) {
        result = sink(transfer->range.begin, transfer->body);
        transfer->body = {};
      } else {
        ++repeated_;
        waiting.push_back(transfer);
      }
    }
    if (!result || (waiting.empty() && running.empty())) break;
    const auto pause = std::chrono::duration_cast<std::chrono::milliseconds>(next_due - now);
    curl.multi_poll(connections.multi, nullptr, 0,
                    static_cast<int>(std::max<long long>(1, pause.count())), nullptr);
  }
  while (!running.empty()) stop(running.back());
  return result;
}

Result<void> HttpSource::start(Transfer& transfer, Connections& connections) {
  ++transfer.attempts;
  ++requests_;
  transfer.body.clear();
  transfer.tag.clear(), transfer.date.clear(), transfer.content_range.clear();
  transfer.retry_after = 0;
  transfer.oversized = transfer.stopped = false;
  CURL* easy = nullptr;
  if (connections.free.empty()) {
    easy = curl.easy_init();
  } else {
    easy = connections.free.back();
    connections.free.pop_back();
    curl.easy_reset(easy);
  }
  if (!easy) return fail(ErrorCode::failed, url_, ": libcurl has no memory for another transfer");
  transfer.easy = easy;
  const std::string range =
      std::to_string(transfer.range.begin) + "-" + std::to_string(transfer.range.end - 1);
  const long stall_timeout = std::max(1L, static_cast<long>(options_.stall_timeout * 1000));
  curl.easy_setopt(easy, CURLOPT_URL, escaped_.c_str());
  if (!transfer.whole) curl.easy_setopt(easy, CURLOPT_RANGE, range.c_str());
  curl.easy_setopt(easy, CURLOPT_PRIVATE, &transfer);
  curl.easy_setopt(easy, CURLOPT_NOSIGNAL, 1L);
  curl.easy_setopt(easy, CURLOPT_USERAGENT, "slf");
  curl.easy_setopt(easy, CURLOPT_FOLLOWLOCATION, 1L);
  curl.easy_setopt(easy, CURLOPT_MAXREDIRS, kRedirects);
  curl.easy_setopt(easy, CURLOPT_PROTOCOLS_STR, "http,https");
  curl.easy_setopt(easy, CURLOPT_REDIR_PROTOCOLS_STR, "http,https");
  curl.easy_setopt(easy, CURLOPT_CONNECTTIMEOUT_MS, stall_timeout);
  // A transfer that is slower than kMinBytesPerSecond for `stall_timeout` (in whole seconds) has
  // stalled. The last limit is for a server that sends headers forever.
  curl.easy_setopt(easy, CURLOPT_LOW_SPEED_LIMIT, kMinBytesPerSecond);
  curl.easy_setopt(easy, CURLOPT_LOW_SPEED_TIME, std::max(1L, stall_timeout / 1000));
  const auto bytes = static_cast<long>(transfer.range.end - transfer.range.begin);
  curl.easy_setopt(easy, CURLOPT_TIMEOUT_MS,
                   2 * stall_timeout + 1000 * (bytes / kMinBytesPerSecond));
  if (validator_.starts_with('"')) {  // a strong ETag
    transfer.headers = curl.slist_append(nullptr, ("If-Match: " + validator_).c_str());
    curl.easy_setopt(easy, CURLOPT_HTTPHEADER, transfer.headers);
  }
  using Write = std::size_t (*)(char*, std::size_t, std::size_t, void*);
  const Write write = [](char* data, std::size_t, std::size_t count, void* to) -> std::size_t {
    return static_cast<Transfer*>(to)->take_body(std::as_bytes(std::span(data, count))) ? count : 0;
  };
  curl.easy_setopt(easy, CURLOPT_WRITEFUNCTION, write);
  curl.easy_setopt(easy, CURLOPT_WRITEDATA, &transfer);
  // curl itself reads, and drops, the body of a redirection.
  using Count = int (*)(void*, curl_off_t, curl_off_t, curl_off_t, curl_off_t);
  const Count too_much = [](void* to, curl_off_t, curl_off_t got, curl_off_t, curl_off_t) {
    const FileRange asked = static_cast<Transfer*>(to)->range;
    return static_cast<std::uint64_t>(got) > asked.end - asked.begin + kMaxIgnored ? 1 : 0;
  };
  curl.easy_setopt(easy, CURLOPT_NOPROGRESS, 0L);
  curl.easy_setopt(easy, CURLOPT_XFERINFOFUNCTION, too_much);
  curl.easy_setopt(easy, CURLOPT_XFERINFODATA, &transfer);
  const Write header = [](char* data, std::size_t, std::size_t count, void* to) -> std::size_t {
    auto& t = *static_cast<Transfer*>(to);
    const std::string_view line(data, count);
    if (line.starts_with("HTTP/")) {  // the next answer in a chain of redirections
      t.tag.clear(), t.date.clear(), t.content_range.clear();
      return count;
    }
    const std::size_t colon = line.find(':');
    if (colon == std::string_view::npos) return count;
    const std::string_view name = line.substr(0, colon), value = trimmed(line.substr(colon + 1));
    if (same_letters(name, "etag")) t.tag = value;
    if (same_letters(name, "last-modified")) t.date = value;
    if (same_letters(name, "content-range")) t.content_range = value;
    if (std::uint64_t seconds = 0; same_letters(name, "retry-after"))
      if (std::string_view rest = value; take_number(rest, seconds) && rest.empty())
        t.retry_after = static_cast<double>(seconds);
    return count;
  };
  curl.easy_setopt(easy, CURLOPT_HEADERFUNCTION, header);
  curl.easy_setopt(easy, CURLOPT_HEADERDATA, &transfer);
  curl.multi_add_handle(connections.multi, easy);
  return {};
}

Result<bool> HttpSource::evaluate(Transfer& t, int code) {
  const auto failed = [&](ErrorCode kind, const auto&... parts) -> Result<bool> {
    return fail(kind, url_, ": ", parts...);
  };
  const auto again = [&](const std::string& what) -> Result<bool> {
    if (t.attempts >= std::max(1u, options_.attempts))
      return failed(ErrorCode::io, what, ", after ", t.attempts, " attempts");
    const double doubled = std::ldexp(options_.first_retry_delay, static_cast<int>(t.attempts) - 1);
    const double pause = std::min(std::max(doubled, t.retry_after), kMaxPause);
    t.due = Clock::now() +
            std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(pause));
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

  const auto answered = parse_content_range(t.content_range);
  if (!answered)
    return failed(ErrorCode::io, "the server does not say which part of the file it sends");
  const std::string& validator = t.tag.empty() ? t.date : t.tag;
  if (size_ == kUnknown) {
    size_ = answered->total;
    validator_ = validator;
  }
  if (answered->total != size_ || validator != validator_) return changed();
  if (answered->range.begin != t.range.begin || answered->range.end != t.range.end)
    return failed(ErrorCode::io, "the server sends another part of the file than it was asked for");
  if (t.body.size() != t.range.end - t.range.begin) return again("the server cut its answer short");
  return true;
}

}  // namespace slf
