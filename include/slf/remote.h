// Fields on a web server: read in ranges over HTTP, without downloading them.
//
//   auto remote = slf::RemoteField::open("https://example.org/head.slf");
//   if (!remote) return report(remote.error());
//   slf::Renderer renderer(remote->field());
//
// The bytes that come are kept in a temporary file without a name (in TMPDIR, or /tmp), at most as
// long as the field. So nothing is fetched twice, and memory is bounded as for a local field.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "slf/error.h"
#include "slf/field.h"

namespace slf {

struct RemoteOptions {
  unsigned parallel = 6;      ///< requests at once, at least 1
  unsigned attempts = 5;      ///< for each request, at least 1; the pauses between them double
  double patience = 20;       ///< seconds that a connection may take, or a transfer may stall
  double first_pause = 0.25;  ///< seconds before the second attempt
};

/// What came from the server so far.
struct RemoteTraffic {
  std::uint64_t requests = 0;  ///< sent, including those that were repeated
  std::uint64_t repeated = 0;  ///< because an answer was late, short, or 408, 429 or 5xx
  std::uint64_t bytes = 0;     ///< of answers, without their headers
};

/// Whether a path is an address: it begins with http:// or https://.
[[nodiscard]] bool is_address(std::string_view path);

/// A field on a web server. A handle: copies are cheap and share one connection. The server and
/// what it sends are untrusted.
/// Thread-safety: any thread.
class RemoteField {
 public:
  /// Opens the field with a few small requests. unsupported: the server does not serve parts of
  /// files (HTTP ranges). io: it does not answer, or with an error, and kept doing so. bad_file: as
  /// Field::open().
  ///
  /// Any use of the field may then fail in the same ways. bad_file: the file has changed on the
  /// server since it was opened (by its ETag, date or length).
  [[nodiscard]] static Result<RemoteField> open(const std::string& url,
                                                const RemoteOptions& options = {});

  [[nodiscard]] const Field& field() const { return field_; }
  [[nodiscard]] RemoteTraffic traffic() const;

 private:
  struct State;
  RemoteField(std::shared_ptr<const State> state, Field field)
      : state_(std::move(state)), field_(std::move(field)) {}
  std::shared_ptr<const State> state_;
  Field field_;
};

}  // namespace slf
