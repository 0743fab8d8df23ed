#include "view/server.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <httplib.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstring>
#include <filesystem>
#include <functional>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>

#include "base/try.h"
#include "slf/field.h"
#include "view/page.h"
#include "view/ranges.h"

namespace slf::view {
namespace {

constexpr int kTimeoutSeconds = 5;  // seconds that a peer may stall
constexpr int kIdleSeconds = 2;     // seconds that an idle connection stays open, also when ending
constexpr std::size_t kMaxRequests = 1000;      // on one connection
constexpr std::size_t kChunkBytes = 256 << 10;  // bytes read from a field at once
constexpr const char* kPolicy =
    "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; style-src 'self'; "
    "img-src 'self' blob: data:; connect-src 'self'; worker-src 'self'; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'self'";

/// Serves at most kMaxConnections connections at once, and blocks the accepting thread meanwhile.
/// httplib's own pool queues connections without limit.
class BoundedTaskQueue final : public httplib::TaskQueue {
 public:
  BoundedTaskQueue() : pool_(Server::kMaxConnections) {}

  void enqueue(std::function<void()> task) override {
    {
      std::unique_lock lock(mutex_);
      finished_.wait(lock, [&] { return running_ < Server::kMaxConnections; });
      ++running_;
    }
    pool_.enqueue([this, task = std::move(task)] {
      task();
      const std::lock_guard lock(mutex_);
      --running_;
      finished_.notify_one();
    });
  }
  void shutdown() override { pool_.shutdown(); }

 private:
  httplib::ThreadPool pool_;
  std::mutex mutex_;
  std::condition_variable finished_;
  unsigned running_ = 0;
};

/// The bytes of one connection. Bytes that arrive with a request, but belong to the next one, stay
/// in its buffer; httplib's own streams drop them.
class Connection final : public httplib::Stream {
 public:
  explicit Connection(socket_t socket) : socket_(socket) {}

  /// Whether a request begins within kIdleSeconds.
  [[nodiscard]] bool await_request() const { return begin_ < end_ || ready(POLLIN, kIdleSeconds); }

  [[nodiscard]] bool is_readable() const override { return ready(POLLIN, kTimeoutSeconds); }
  [[nodiscard]] bool is_writable() const override { return ready(POLLOUT, kTimeoutSeconds); }
  [[nodiscard]] socket_t socket() const override { return socket_; }

  ssize_t read(char* to, std::size_t size) override {
    if (begin_ == end_) {
      const ssize_t got = is_readable() ? recv(socket_, buffer_.data(), buffer_.size(), 0) : -1;
      if (got <= 0) return got;
      begin_ = 0;
      end_ = static_cast<std::size_t>(got);
    }
    const std::size_t count = std::min(size, end_ - begin_);
    std::memcpy(to, buffer_.data() + begin_, count);
    begin_ += count;
    return static_cast<ssize_t>(count);
  }
  ssize_t write(const char* from, std::size_t size) override {
    return is_writable() ? ::send(socket_, from, size, MSG_NOSIGNAL) : -1;
  }

  void get_remote_ip_and_port(std::string&, int&) const override {}  // nothing needs them
  void get_local_ip_and_port(std::string&, int&) const override {}

 private:
  [[nodiscard]] bool ready(short events, int seconds) const {
    pollfd entry = {socket_, events, 0};
    return poll(&entry, 1, 1000 * seconds) > 0;
  }

  const socket_t socket_;
  std::array<char, 4096> buffer_;
  std::size_t begin_ = 0, end_ = 0;  ///< of the bytes in the buffer that were not read
};

/// httplib's server, but it answers all requests that a peer sends without waiting for answers, and
/// does not refuse connections that arrive at once.
class HttpServer final : public httplib::Server {
 public:
  /// After binding: httplib lets 5 connections wait, and the kernel drops more.
  void lengthen_queue() { ::listen(svr_sock_, SOMAXCONN); }

 private:
  bool process_and_close_socket(socket_t socket) override {
    Connection connection(socket);
    bool fine = true;
    for (std::size_t left = kMaxRequests;
         fine && left > 0 && svr_sock_ != INVALID_SOCKET && connection.await_request(); --left) {
      bool closes = false, next = false;  // next: where the next request begins is known
      fine = process_request(connection, left == 1, closes, [&](const httplib::Request& request) {
        next = !request.has_header("Content-Length") && !request.has_header("Transfer-Encoding");
      });
      fine = fine && next && !closes;
    }
    ::shutdown(socket, SHUT_RDWR);
    ::close(socket);
    return fine;
  }
};

/// A file as requests see it.
struct Content {
  std::uint64_t size;
  std::string tag;   ///< entity tag
  std::string type;  ///< media type
  /// Sends a part. Returns false if that fails.
  std::function<bool(std::uint64_t offset, std::uint64_t size, httplib::DataSink& sink)> send;
};

/// A field that is served from its file. Each request opens the file that has its name now.
class ServedField {
 public:
  /// Checks that the file is a field. Errors as Field::open().
  static Result<ServedField> make(const std::string& path) {
    SLF_TRY(Field::open(path));
    return ServedField(path);
  }

  std::string name;  ///< its folder

  /// The current content; none if it cannot be read.
  [[nodiscard]] std::optional<Content> content() const;

 private:
  explicit ServedField(std::string path) : path_(std::move(path)) {}
  std::string path_;
};

/// A file that is open for reading.
class OpenFile {
 public:
  explicit OpenFile(const std::string& path) : file_(::open(path.c_str(), O_RDONLY | O_CLOEXEC)) {}
  OpenFile(const OpenFile&) = delete;
  OpenFile& operator=(const OpenFile&) = delete;
  ~OpenFile() {
    if (file_ >= 0) ::close(file_);
  }

  /// The size and entity tag. Returns false if the file cannot be read.
  bool state(std::uint64_t& size, std::string& tag) const {
    struct stat status = {};
    if (file_ < 0 || fstat(file_, &status) != 0 || !S_ISREG(status.st_mode)) return false;
    size = static_cast<std::uint64_t>(status.st_size);
    std::array<char, 100> text;
    std::snprintf(text.data(), text.size(), "\"%llx-%llx-%llx-%lx\"",
                  static_cast<unsigned long long>(status.st_ino),
                  static_cast<unsigned long long>(status.st_size),
                  static_cast<unsigned long long>(status.st_mtim.tv_sec), status.st_mtim.tv_nsec);
    tag = text.data();
    return true;
  }

  /// Sends a part of the file. Returns false if the peer is gone or the file has shrunk.
  bool send(std::uint64_t offset, std::uint64_t size, httplib::DataSink& sink) const {
    std::vector<char> piece(std::min<std::uint64_t>(size, kChunkBytes));
    while (size > 0) {
      const ssize_t got = pread(file_, piece.data(), std::min<std::uint64_t>(size, piece.size()),
                                static_cast<off_t>(offset));
      if (got <= 0 || !sink.write(piece.data(), static_cast<std::size_t>(got))) return false;
      offset += static_cast<std::uint64_t>(got);
      size -= static_cast<std::uint64_t>(got);
    }
    return true;
  }

 private:
  const int file_;
};

std::optional<Content> ServedField::content() const {
  const auto file = std::make_shared<OpenFile>(path_);
  Content content;
  if (!file->state(content.size, content.tag) || content.size == 0) return std::nullopt;
  content.type = "application/octet-stream";
  content.send = [file](std::uint64_t offset, std::uint64_t size, httplib::DataSink& sink) {
    return file->send(offset, size, sink);
  };
  return content;
}

/// A field's name as part of an address: letters, digits, '.', '-' and '_'.
std::string folder_name(const std::string& path) {
  std::string name = std::filesystem::path(path).stem().string();
  for (char& c : name)
    if (!std::isalnum(static_cast<unsigned char>(c)) && c != '.' && c != '-') c = '_';
  if (name.empty() || name[0] == '.') name.insert(0, "_");
  return name;
}

std::string content_range(const FilePart& part, std::uint64_t file) {
  return "bytes " + std::to_string(part.first) + "-" + std::to_string(part.first + part.size - 1) +
         "/" + std::to_string(file);
}

/// The body of an answer with several parts: text, then a part of the file, and so on.
class Multipart {
 public:
  static constexpr std::string_view kType = "multipart/byteranges; boundary=slf-part";

  Multipart(const std::vector<FilePart>& parts, const Content& content) {
    for (const FilePart& part : parts)
      add("\r\n--slf-part\r\nContent-Type: " + content.type +
              "\r\nContent-Range: " + content_range(part, content.size) + "\r\n\r\n",
          part);
    add("\r\n--slf-part--\r\n", {});
  }
  [[nodiscard]] std::uint64_t size() const { return size_; }

  /// Sends one or more bytes of the body, from an offset on.
  bool send(const Content& content, std::uint64_t offset, httplib::DataSink& sink) const {
    const auto next =
        std::upper_bound(pieces_.begin(), pieces_.end(), offset,
                         [](std::uint64_t at, const Piece& piece) { return at < piece.offset; });
    const Piece& piece = *std::prev(next);
    const std::uint64_t within = offset - piece.offset;
    if (within < piece.text.size())
      return sink.write(piece.text.data() + within, piece.text.size() - within);
    const std::uint64_t sent = within - piece.text.size();
    return content.send(piece.part.first + sent,
                        std::min<std::uint64_t>(piece.part.size - sent, kChunkBytes), sink);
  }

 private:
  struct Piece {
    std::uint64_t offset;  ///< in the body
    std::string text;
    FilePart part;
  };
  void add(std::string text, FilePart part) {
    pieces_.push_back({size_, std::move(text), part});
    size_ += pieces_.back().text.size() + part.size;
  }
  std::vector<Piece> pieces_;
  std::uint64_t size_ = 0;
};

/// Whether a list of entity tags contains `tag`, even as a weak tag.
bool contains_tag(std::string_view header, std::string_view tag) {
  return header == "*" || header.find(tag) != std::string_view::npos;
}

/// Whether a header Host names this machine. The port may be another one, which something else
/// forwards here.
bool is_loopback(std::string_view host) {
  for (const std::string_view name : {"127.0.0.1", "localhost", "[::1]"}) {
    if (!host.starts_with(name)) continue;
    const std::string_view port = host.substr(name.size());
    return port.empty() ||
           (port[0] == ':' && port.find_first_not_of("0123456789", 1) == std::string_view::npos);
  }
  return false;
}

/// An address for browsers of a server that listens on `address`: of this machine in its network,
/// if that is all addresses.
std::string reachable_address(const std::string& address) {
  if (address != "0.0.0.0" && address != "::") return address;
  std::string found = address == "::" ? "::1" : "127.0.0.1";
  ifaddrs* all = nullptr;
  if (getifaddrs(&all) != 0) return found;
  for (const ifaddrs* at = all; at != nullptr; at = at->ifa_next) {
    if (at->ifa_addr == nullptr || at->ifa_addr->sa_family != AF_INET ||
        (at->ifa_flags & IFF_LOOPBACK) != 0 || (at->ifa_flags & IFF_UP) == 0)
      continue;
    std::array<char, INET_ADDRSTRLEN> text;
    const auto& ipv4 = *reinterpret_cast<const sockaddr_in*>(at->ifa_addr);
    found = inet_ntop(AF_INET, &ipv4.sin_addr, text.data(), text.size());
    break;
  }
  freeifaddrs(all);
  return found;
}

void answer_text(httplib::Response& response, int status, const std::string& text) {
  response.status = status;
  response.set_content(text + "\n", "text/plain; charset=utf-8");
}

Content page_content(const PageFile& file, const std::string& tag) {
  return {file.bytes.size(), tag, std::string(file.type),
          [bytes = file.bytes](std::uint64_t offset, std::uint64_t size, httplib::DataSink& sink) {
            return sink.write(bytes.data() + offset, size);
          }};
}

/// Answers a request whose header Range is `range`.
void answer_content(const httplib::Request& request, httplib::Response& response,
                    const std::string& range, const Content& content) {
  const auto& [size, tag, type, send] = content;
  response.set_header("ETag", tag);
  response.set_header("Accept-Ranges", "bytes");
  if (request.has_header("If-Match") && !contains_tag(request.get_header_value("If-Match"), tag))
    return answer_text(response, 412, "The file has changed.");
  if (contains_tag(request.get_header_value("If-None-Match"), tag)) {
    response.status = 304;
    return;
  }
  const bool same = !request.has_header("If-Range") || request.get_header_value("If-Range") == tag;
  const auto parts = select_ranges(same ? range : "", size);
  if (parts && parts->empty()) {
    response.set_header("Content-Range", "bytes */" + std::to_string(size));
    return answer_text(response, 416, "The file has " + std::to_string(size) + " bytes.");
  }
  response.status = parts ? 206 : 200;
  if (parts && parts->size() > 1) {
    const Multipart body(*parts, content);
    response.set_content_provider(
        body.size(), std::string(Multipart::kType),
        [content, body](std::size_t offset, std::size_t, httplib::DataSink& sink) {
          return body.send(content, offset, sink);
        });
    return;
  }
  const FilePart part = parts ? parts->front() : FilePart{0, size};
  if (parts) response.set_header("Content-Range", content_range(part, size));
  response.set_content_provider(part.size, type,
                                [content, first = part.first](std::size_t offset, std::size_t count,
                                                              httplib::DataSink& sink) {
                                  return content.send(first + offset, std::min(count, kChunkBytes),
                                                      sink);
                                });
}

}  // namespace

struct Server::State {
  HttpServer http;
  std::vector<ServedField> fields;
  std::string url, tag;  // tag: the entity tag of the page's files
  bool any_host = false;

  void answer(httplib::Request& request, httplib::Response& response) const;
  void answer_list(httplib::Response& response) const;
};

void Server::State::answer(httplib::Request& request, httplib::Response& response) const {
  response.set_header("Content-Security-Policy", kPolicy);
  response.set_header("X-Content-Type-Options", "nosniff");
  response.set_header("Referrer-Policy", "no-referrer");
  response.set_header("Cross-Origin-Resource-Policy", "same-origin");
  response.set_header("Cache-Control", "no-cache");
  // httplib applies ranges without comparing them with the size, so select_ranges() does it
  // instead.
  const std::string range = request.get_header_value("Range");
  request.ranges.clear();

  if (!any_host && (request.get_header_value_count("Host") != 1 ||
                    !is_loopback(request.get_header_value("Host"))))
    return answer_text(response, 403,
                       "Host not allowed: this server answers only to 127.0.0.1, localhost and "
                       "[::1]. slf view --bind ADDRESS answers to any name.");
  if (request.method != "GET" && request.method != "HEAD") {
    response.set_header("Allow", "GET, HEAD");
    return answer_text(response, 405, "Only GET and HEAD work here.");
  }
  if (request.path == "/") {
    if (fields.size() > 1) return answer_list(response);
    response.status = 302;
    response.set_header("Location", fields[0].name + "/");
    return;
  }
  for (const ServedField& field : fields) {
    const std::string folder = "/" + field.name;
    if (request.path == folder) {
      response.status = 302;
      response.set_header("Location", field.name + "/");
      return;
    }
    if (!request.path.starts_with(folder + "/")) continue;
    const std::string_view name = std::string_view(request.path).substr(folder.size() + 1);
    if (name == "field.slf") {
      if (const auto content = field.content())
        return answer_content(request, response, range, *content);
      return answer_text(response, 500, "The field cannot be read.");
    }
    for (const PageFile& file : page_files()) {
      if (name != file.name && !(name.empty() && file.name == "index.html")) continue;
      return answer_content(request, response, range, page_content(file, tag));
    }
  }
  answer_text(response, 404, "Not here. The fields are listed at /.");
}

void Server::State::answer_list(httplib::Response& response) const {
  std::string html =
      "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>Fields</title>"
      "<h1>Fields</h1><ul>";
  for (const ServedField& field : fields)  // names need no escaping in HTML
    html += "<li><a href=\"" + field.name + "/\">" + field.name + "</a></li>";
  response.status = 200;
  response.set_content(html + "</ul></html>", "text/html; charset=utf-8");
}

Server::Server(std::unique_ptr<State> state) : state_(std::move(state)) {}
Server::Server(Server&&) noexcept = default;
Server& Server::operator=(Server&&) noexcept = default;
Server::~Server() = default;

const std::string& Server::url() const { return state_->url; }

Result<Server> Server::make(std::span<const std::string> fields, const ServerOptions& options) {
  if (fields.empty()) return fail(ErrorCode::usage, "view: name at least one field");
  auto state = std::make_unique<State>();
  for (const std::string& path : fields) {
    auto field = SLF_TRY(ServedField::make(path));
    const std::string name = folder_name(path);
    field.name = name;
    for (int copy = 2;
         std::any_of(state->fields.begin(), state->fields.end(),
                     [&](const ServedField& other) { return other.name == field.name; });
         ++copy)
      field.name = name + "-" + std::to_string(copy);
    state->fields.push_back(std::move(field));
  }
  std::size_t hash = 0;
  for (const PageFile& file : page_files())
    hash = hash * 31 + std::hash<std::string_view>()(file.bytes);
  state->tag = "\"" + std::to_string(hash) + "\"";

  HttpServer& http = state->http;
  http.new_task_queue = [] { return new BoundedTaskQueue; };  // httplib deletes it
  http.set_read_timeout(kTimeoutSeconds);
  http.set_write_timeout(kTimeoutSeconds);
  http.set_keep_alive_timeout(kIdleSeconds);    // as HttpServer does it, for the header
  http.set_keep_alive_max_count(kMaxRequests);  // Keep-Alive
  http.set_payload_max_length(0);
  // httplib would set SO_REUSEPORT, but two programs must not share a port.
  http.set_socket_options([](socket_t socket) {
    const int yes = 1;
    setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
  });
  http.set_pre_routing_handler(
      [s = state.get()](const httplib::Request& request, httplib::Response& response) {
        s->answer(const_cast<httplib::Request&>(request), response);  // httplib's own, not const
        return httplib::Server::HandlerResponse::Handled;
      });
  // httplib answers 416 where it cannot read a header Range, which must be ignored.
  http.set_error_handler(httplib::Server::HandlerWithResponse(
      [s = state.get()](const httplib::Request& request, httplib::Response& response) {
        if (response.status != 416 || response.has_header("Content-Range"))
          return httplib::Server::HandlerResponse::Unhandled;
        s->answer(const_cast<httplib::Request&>(request), response);
        return httplib::Server::HandlerResponse::Handled;
      }));

  int port = options.port;
  errno = 0;
  if (port == 0)
    port = http.bind_to_any_port(options.address);
  else if (!http.bind_to_port(options.address, port))
    port = -1;
  if (port <= 0)
    return fail(ErrorCode::io, "cannot listen on ", options.address, ":", options.port, ": ",
                errno != 0 ? std::strerror(errno) : "no such address",
                "; try another port or address");
  http.lengthen_queue();
  state->any_host = options.any_host;
  const std::string address = reachable_address(options.address);
  const bool ipv6 = address.find(':') != std::string::npos;
  state->url = "http://" + (ipv6 ? "[" + address + "]" : address) + ":" + std::to_string(port) +
               "/" + (fields.size() == 1 ? state->fields[0].name + "/" : "");
  return Server(std::move(state));
}

Result<void> Server::run(const std::function<bool()>& stop) {
  std::atomic<bool> ended = false;
  bool fine = true;
  std::thread listener([&] {
    fine = state_->http.listen_after_bind();
    ended = true;
  });
  while (!ended && !(state_->http.is_running() && stop()))
    std::this_thread::sleep_for(std::chrono::milliseconds(state_->http.is_running() ? 100 : 1));
  if (!ended) state_->http.stop();
  listener.join();
  if (!fine) return fail(ErrorCode::failed, state_->url, ": the server ended unexpectedly");
  return {};
}

}  // namespace slf::view
