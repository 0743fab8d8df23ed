// Server: shows fields in a browser, over HTTP on this machine.
//
// Each field has a folder of its own, /TOKEN/NAME/, which holds the page and the field, as an
// exported site does (page/site.h). The server sends these files and nothing else. The token is
// random: other users and programs of the machine do not know it.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "page/http.h"
#include "page/views.h"
#include "slf/error.h"

namespace slf::page {

struct ServerOptions {
  /// A numeric address or host name of this machine. Other machines cannot reach a loopback
  /// address.
  std::string address = "127.0.0.1";
  std::uint16_t port = 0;  ///< 0: any free port
  /// Answer requests for any host name. Otherwise the server answers only to 127.0.0.1, localhost
  /// and [::1], with any port, so that a web site whose name resolves to this machine cannot read
  /// fields.
  bool any_host = false;
  /// Origins whose pages may show those of the server in frames, such as "https://example.org",
  /// beside those of this machine: notebooks at localhost, 127.0.0.1 and [::1].
  std::vector<std::string> frames{};
  ViewsFile views{};  ///< that the page of the only field shows; may be none
  First first{};      ///< what the page of the only field shows first
  /// Answers requests in a folder of its own, /TOKEN/studio/, by the rest of their path; none: not
  /// yet. Fields may then be none.
  std::function<std::optional<Response>(const Request&, std::string_view rest)> studio{};
};

/// Answers GET and HEAD, with ranges, entity tags and conditional requests. Requests are untrusted.
/// A field that is replaced while it is served changes its entity tag.
class Server {
 public:
  /// Opens the fields and binds the address. io: a field cannot be read, or the address is taken.
  /// bad_file, unsupported: a file is no field, or `views` are none. usage: no field is given, or
  /// several with views or `first`, or `frames` has no origin; or as begin_with().
  [[nodiscard]] static Result<Server> make(std::span<const std::string> fields,
                                           const ServerOptions& options);
  Server(Server&&) noexcept;
  Server& operator=(Server&&) noexcept;
  ~Server();

  /// The address of the page, "http://127.0.0.1:PORT/TOKEN/NAME/", or of a list if there are
  /// fields. A server that listens on all addresses gives one of this machine in its network.
  [[nodiscard]] const std::string& url() const;

  /// Adds a field, and returns its folder. Only on the thread of run(), in answers. Errors as
  /// make().
  [[nodiscard]] Result<std::string> add(const std::string& field);

  /// Serves until `stop` returns true; it is called about ten times a second. failed: the server
  /// ended unexpectedly.
  [[nodiscard]] Result<void> run(const std::function<bool()>& stop);

 private:
  struct State;
  explicit Server(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace slf::page
