// HttpServer: files over HTTP/1.1.
//
// It takes bodies of up to 1 MiB whose length is stated. One thread serves all connections with
// poll(), so a peer that stalls costs nothing but its connection.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "page/ranges.h"
#include "slf/error.h"

namespace slf::page {

struct Request {
  std::string method, path;  ///< the path as it was sent, without a query
  bool keeps = true;         ///< more requests may follow on the connection
  std::vector<std::pair<std::string, std::string>> headers;  ///< names in lower case
  std::string body{};

  [[nodiscard]] std::size_t count(std::string_view name) const;
  /// The value of a header, the first one if there are several; empty if there is none.
  [[nodiscard]] std::string_view header(std::string_view name) const;
};

/// Parses a request up to the blank line that ends it. Returns none if it is malformed: it has
/// another control character than a tab, or spaces in a name.
[[nodiscard]] std::optional<Request> parse_request(std::string_view head);

struct Response {
  /// Text, then a part of a file.
  struct Piece {
    std::string text;
    FilePart part{};
  };
  /// Reads up to to.size() bytes at an offset of a file. Returns how many; 0: it cannot be read.
  using Read = std::function<std::size_t(std::uint64_t offset, std::span<char> to)>;

  int status = 200;
  std::string headers;  ///< whole lines; without Content-Length
  std::vector<Piece> body;
  Read read;  ///< of the file of the parts

  void set(std::string_view name, std::string_view value);
};

/// Requests are untrusted. Of more than kMaxConnections connections, the one that was idle for the
/// longest time is closed.
class HttpServer {
 public:
  static constexpr std::size_t kMaxConnections = 128;
  /// Returns no response if it does not have one yet: the request is asked again within 10 ms.
  using Answer = std::function<std::optional<Response>(const Request&)>;

  HttpServer() = default;
  HttpServer(const HttpServer&) = delete;
  HttpServer& operator=(const HttpServer&) = delete;
  ~HttpServer();

  /// Listens on a port, or on any free one if it is 0, and returns it. io: it is taken, or the
  /// address is not one of this machine.
  [[nodiscard]] Result<std::uint16_t> bind(const std::string& address, std::uint16_t port);

  /// Serves until `stop` returns true; it is called at least ten times a second. Then nobody can
  /// connect any more.
  [[nodiscard]] Result<void> run(const Answer& answer, const std::function<bool()>& stop);

 private:
  int listener_ = -1;
};

}  // namespace slf::page
