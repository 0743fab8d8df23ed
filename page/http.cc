#include "page/http.h"

#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <cstring>
#include <deque>
#include <list>
#include <memory>
#include <utility>

#include "base/ascii.h"
#include "base/guarded.h"

namespace slf::page {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::seconds kStall(5);       // that a peer may stall in a request or an answer
constexpr std::chrono::seconds kIdle(60);       // that it may take to the next request
constexpr int kTick = 100;                      // milliseconds between two calls of `stop`
constexpr int kSoon = 5;                        // and while a request waits for its answer
constexpr std::size_t kMaxHead = 16 << 10;      // bytes of a request
constexpr std::size_t kMaxBody = 1 << 20;       // and of what follows it
constexpr std::size_t kChunkBytes = 128 << 10;  // bytes read from a file at once
constexpr const char* kTokens = "!#$%&'*+-.^_`|~";  // beside letters and digits

/// Removes the text up to `end` from `text`, and `end`, and returns that text.
std::string_view take_until(std::string_view& text, std::string_view end) {
  const std::size_t at = text.find(end);
  const std::string_view taken = text.substr(0, at);
  text.remove_prefix(at == std::string_view::npos ? text.size() : at + end.size());
  return taken;
}

bool is_name(std::string_view text) {
  return !text.empty() && std::ranges::all_of(text, [](char c) {
    return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') ||
           (c != '\0' && std::strchr(kTokens, c) != nullptr);
  });
}

bool has_controls(std::string_view line) {
  return std::ranges::any_of(line, [](char c) {
    return (static_cast<unsigned char>(c) < ' ' && c != '\t') || c == '\x7f';
  });
}

/// A connection reads a request, sends the answer, and so on. After the last answer it drops what
/// comes until the peer closes it, because the kernel would drop the answer otherwise.
class Connection {
 public:
  explicit Connection(int socket) : socket_(socket) {
    const int yes = 1;
    (void)setsockopt(socket_, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
  }
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;
  ~Connection() { ::close(socket_); }

  [[nodiscard]] pollfd events() const {
    const short wanted = state_ == State::sending ? POLLOUT : POLLIN;
    return {socket_, waits() ? static_cast<short>(0) : wanted, 0};
  }
  [[nodiscard]] bool expired(Clock::time_point now) const {
    return !waits() && now - since_ > (state_ == State::reading && in_.empty() ? kIdle : kStall);
  }
  /// Whether a request has come whose answer has not.
  [[nodiscard]] bool waits() const { return request_.has_value(); }
  /// The order in which connections are given up: idle ones first, the longest idle of all first.
  [[nodiscard]] std::pair<bool, Clock::time_point> worth() const {
    return {state_ == State::sending, since_};
  }

  /// Receives or sends something. Returns false if the connection is to be closed.
  bool advance(const HttpServer::Answer& answer) {
    return state_ == State::sending ? send(answer) : receive(answer);
  }
  /// Answers the request that waits, if its answer is there.
  void resume(const HttpServer::Answer& answer) {
    if (auto response = answer(*request_)) begin(std::move(*response));
  }

 private:
  enum class State { reading, sending, ending };

  static bool again() { return errno == EAGAIN || errno == EINTR; }

  bool receive(const HttpServer::Answer& answer) {
    std::array<char, 4096> bytes;
    const ssize_t got = ::recv(socket_, bytes.data(), bytes.size(), 0);
    if (got <= 0) return got < 0 && again();
    if (state_ == State::ending) return true;
    if (in_.empty()) since_ = Clock::now();
    in_.append(bytes.data(), static_cast<std::size_t>(got));
    begin_answer(answer);
    return true;
  }

  /// Answers the next request if all of it has come.
  void begin_answer(const HttpServer::Answer& answer) {
    const std::size_t end = in_.find("\r\n\r\n");
    if (end == std::string::npos && in_.size() <= kMaxHead) return;
    request_ = parse_request(std::string_view(in_).substr(0, end));
    int refused = end == std::string::npos ? 431 : request_ ? 0 : 400;
    std::size_t body = 0;
    const bool has_body =
        request_ && request_->count("content-length") + request_->count("transfer-encoding") > 0;
    // Other methods have no use for one. What follows it is not read, since others may see its end
    // elsewhere.
    if (!refused && has_body && request_->method == "POST") {
      const std::string_view text = request_->header("content-length");
      const auto [rest, error] = std::from_chars(text.data(), text.data() + text.size(), body);
      if (error != std::errc() || rest != text.data() + text.size() || body > kMaxBody ||
          request_->count("content-length") + request_->count("transfer-encoding") > 1)
        refused = 413;
      else if (in_.size() < end + 4 + body)
        return request_.reset();
      else
        request_->body = in_.substr(end + 4, body);
    }
    in_.erase(0, end == std::string::npos ? end : end + 4 + body);
    closes_ = refused || has_body || !request_->keeps;
    since_ = Clock::now();
    if (!refused) return resume(answer);
    Response response;
    response.status = refused;
    begin(std::move(response));
  }
  void begin(Response response) {
    std::uint64_t size = 0;
    for (const Response::Piece& piece : response.body) size += piece.text.size() + piece.part.size;
    if (response.status != 304) response.set("Content-Length", std::to_string(size));
    if (closes_) response.set("Connection", "close");
    out_ = "HTTP/1.1 " + std::to_string(response.status) + " \r\n" + response.headers + "\r\n";
    sent_ = 0;
    body_.clear();
    if (request_ && request_->method != "HEAD")
      body_.assign(response.body.begin(), response.body.end());
    read_ = std::move(response.read);
    request_.reset();
    state_ = State::sending;
    since_ = Clock::now();
  }

  /// Adds bytes of the body to those that are to be sent. Returns false if the file has shrunk.
  bool fill() {
    while (!body_.empty() && out_.size() < kChunkBytes) {
      auto& [text, part] = body_.front();
      out_ += std::exchange(text, {});
      if (part.size > 0) {
        const std::size_t before = out_.size();
        out_.resize(before + std::min<std::uint64_t>(part.size, kChunkBytes));
        const std::size_t got = read_(part.first, std::span(out_).subspan(before));
        if (got == 0) return false;
        out_.resize(before + got);
        part.first += got;
        part.size -= got;
      }
      if (part.size == 0) body_.pop_front();
    }
    return true;
  }

  bool send(const HttpServer::Answer& answer) {
    if (!fill()) return false;
    const ssize_t put = ::send(socket_, out_.data() + sent_, out_.size() - sent_, MSG_NOSIGNAL);
    if (put < 0) return again();
    since_ = Clock::now();
    sent_ += static_cast<std::size_t>(put);
    if (sent_ < out_.size()) return true;
    out_.clear();
    sent_ = 0;
    if (!body_.empty()) return true;
    read_ = {};
    if (closes_) {
      state_ = State::ending;
      return ::shutdown(socket_, SHUT_WR) == 0;
    }
    state_ = State::reading;
    begin_answer(answer);  // to a request that came with the last one
    return true;
  }

  const int socket_;
  State state_ = State::reading;
  Clock::time_point since_ = Clock::now();  ///< of the last progress that counts
  std::string in_;                          ///< what was received and not answered
  std::optional<Request> request_;          ///< that waits for its answer
  std::string out_;                         ///< bytes of the answer, of which sent_ were sent
  std::size_t sent_ = 0;
  std::deque<Response::Piece> body_;  ///< the rest of it
  Response::Read read_;
  bool closes_ = false;  ///< after this answer
};

}  // namespace

std::size_t Request::count(std::string_view name) const {
  return static_cast<std::size_t>(
      std::ranges::count_if(headers, [&](const auto& header) { return header.first == name; }));
}

std::string_view Request::header(std::string_view name) const {
  for (const auto& [key, value] : headers)
    if (key == name) return value;
  return {};
}

std::optional<Request> parse_request(std::string_view head) {
  Request request;
  std::string_view line = take_until(head, "\r\n");
  if (line.empty()) line = take_until(head, "\r\n");  // some peers end a body with one
  if (has_controls(line)) return std::nullopt;
  request.method = take_until(line, " ");
  std::string_view target = take_until(line, " ");
  request.path = take_until(target, "?");
  if (!is_name(request.method) || request.path.empty() ||
      (line != "HTTP/1.1" && line != "HTTP/1.0"))
    return std::nullopt;
  request.keeps = line == "HTTP/1.1";
  while (!head.empty()) {
    std::string_view value = take_until(head, "\r\n");
    if (has_controls(value) || value.find(':') == std::string_view::npos) return std::nullopt;
    const std::string_view name = take_until(value, ":");
    if (!is_name(name)) return std::nullopt;
    request.headers.emplace_back(lower_case(name), trim(value));
    if (request.headers.back().first == "connection" &&
        lower_case(value).find("close") != std::string::npos)
      request.keeps = false;
  }
  return request;
}

void Response::set(std::string_view name, std::string_view value) {
  ((headers += name) += ": ") += value;
  headers += "\r\n";
}

HttpServer::~HttpServer() {
  if (listener_ >= 0) ::close(listener_);
}

Result<std::uint16_t> HttpServer::bind(const std::string& address, std::uint16_t port) {
  const addrinfo wanted = {AI_PASSIVE, AF_UNSPEC, SOCK_STREAM, 0, 0, nullptr, nullptr, nullptr};
  addrinfo* found = nullptr;
  (void)getaddrinfo(address.c_str(), std::to_string(port).c_str(), &wanted, &found);
  const std::unique_ptr<addrinfo, decltype(&freeaddrinfo)> owner(found, freeaddrinfo);
  std::string problem = "no such address";
  for (const addrinfo* at = found; at != nullptr; at = at->ai_next) {
    if (listener_ >= 0) ::close(listener_);
    listener_ = ::socket(at->ai_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    const int yes = 1, no = 0;
    (void)setsockopt(listener_, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    if (at->ai_family == AF_INET6)
      (void)setsockopt(listener_, IPPROTO_IPV6, IPV6_V6ONLY, &no, sizeof no);
    sockaddr_in6 bound = {};  // its port is where that of sockaddr_in is
    socklen_t size = sizeof bound;
    if (listener_ >= 0 && ::bind(listener_, at->ai_addr, at->ai_addrlen) == 0 &&
        ::listen(listener_, SOMAXCONN) == 0 &&
        ::getsockname(listener_, reinterpret_cast<sockaddr*>(&bound), &size) == 0)
      return ntohs(bound.sin6_port);
    problem = std::strerror(errno);
  }
  return fail(ErrorCode::io, "cannot listen on ", address, ":", port, ": ", problem,
              "; try another port or address");
}

Result<void> HttpServer::run(const Answer& answer, const std::function<bool()>& stop) {
  return guarded([&]() -> Result<void> {
    std::list<Connection> connections;
    std::vector<pollfd> polled;
    const auto give_up_one = [&] {
      connections.erase(std::ranges::min_element(
          connections,
          [](const Connection& a, const Connection& b) { return a.worth() < b.worth(); }));
    };
    while (!stop()) {
      polled.assign(1, {listener_, POLLIN, 0});
      for (const Connection& connection : connections) polled.push_back(connection.events());
      const bool waits = std::ranges::any_of(connections, &Connection::waits);
      if (poll(polled.data(), polled.size(), waits ? kSoon : kTick) < 0 && errno != EINTR)
        return fail(ErrorCode::failed, "the server ended: ", std::strerror(errno));
      const auto now = Clock::now();
      std::size_t i = 0;
      connections.remove_if([&](Connection& connection) {
        bool goes_on = true;
        const bool ready = polled[++i].revents != 0;
        if (connection.waits())
          goes_on = guarded([&] { connection.resume(answer); }).has_value() &&
                    (polled[i].revents & (POLLHUP | POLLERR)) == 0;
        else if (ready)
          goes_on = guarded([&] { goes_on = connection.advance(answer); }) && goes_on;
        return !goes_on || connection.expired(now);
      });
      if (polled[0].revents == 0) continue;
      for (int peer;
           (peer = accept4(listener_, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC)) >= 0;) {
        if (connections.size() == kMaxConnections) give_up_one();
        connections.emplace_back(peer);
      }
      if (errno == EAGAIN || errno == ECONNABORTED || errno == EINTR) continue;
      if (connections.empty())  // this process has no descriptor left
        poll(nullptr, 0, kTick);
      else
        give_up_one();
    }
    ::close(std::exchange(listener_, -1));  // or else peers would wait for answers
    return {};
  });
}

}  // namespace slf::page
