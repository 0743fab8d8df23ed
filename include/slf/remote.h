// RemoteField: a field on a web server, read in ranges over HTTP without downloading the whole.
//
//   auto remote = slf::RemoteField::open("https://example.org/head.slf");
//   if (!remote) return report(remote.error());
//   slf::Renderer renderer(remote->field());
//
// Fetched bytes are cached in an unnamed temporary file (in TMPDIR, or /tmp), at most as long as
// the field. So no byte is fetched twice, and memory is bounded as for a local field. A folder can
// keep them for later programs.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "slf/error.h"
#include "slf/field.h"
#include "slf/progress.h"

namespace slf {

class RemoteFile;  // internal

struct RemoteOptions {
  unsigned parallel = 6;      ///< requests at once, at least 1
  unsigned attempts = 5;      ///< for each request, at least 1; the pauses between them double
  double stall_timeout = 20;  ///< seconds to wait for a connection, or for a stalled transfer
  double first_retry_delay = 0.25;  ///< seconds before the second attempt
  /// A folder that keeps fetched bytes of files whose server tells their version (ETag, or date).
  /// Made if it does not exist; other users must not be able to write to it. Empty: none. Any
  /// number of processes may share it. Entries are checked when they are read.
  std::string cache{};
  std::uint64_t cache_bytes = 1 << 30;  ///< the least recently used entries beyond are removed
};

/// Traffic with the server since RemoteField::open().
struct RemoteTraffic {
  std::uint64_t requests = 0, repeated = 0, bytes = 0;

  void describe(auto& member) const {
    member("requests", requests, "requests sent, with repeated ones");
    member("repeated", repeated, "of them, sent after a late, short or failed answer");
    member("bytes", bytes, "of the answers, without their headers");
  }
};

/// Whether a path is an address: it begins with http:// or https://, in letters of any case.
[[nodiscard]] inline bool is_address(std::string_view path) {
  std::string scheme(path.substr(0, path.find("://")));
  for (char& c : scheme) c |= 0x20;  // lower case
  return scheme.size() < path.size() && (scheme == "http" || scheme == "https");
}

/// A field on a web server. A handle: copies are cheap and share one connection. The server and
/// what it sends are untrusted.
/// Thread-safety: any thread.
class RemoteField {
 public:
  /// Opens the field with a few small requests. `url` may be several addresses of one file, with
  /// blanks between: a request that fails at one goes to the next, unless the file there has
  /// another length, or differs in its meta pages or in the footer of its index. Characters that an
  /// address must not have, such as blanks, are escaped. If the server does not serve parts of
  /// files (HTTP ranges), a field of at most 64 MiB is fetched whole, with progress in bytes, and a
  /// larger one is unsupported. cancelled: `progress` stopped that. not_found: the server has no
  /// such file. io: at every attempt the server did not answer, or answered with another error.
  /// bad_file: as Field::open().
  ///
  /// Any later use of the field may fail with these errors. It also fails with bad_file if the file
  /// has changed on the server (in its ETag, date or length) since it was opened.
  [[nodiscard]] static Result<RemoteField> open(const std::string& url,
                                                const RemoteOptions& options = {},
                                                const ProgressCallback& progress = {});

  [[nodiscard]] const Field& field() const { return field_; }
  [[nodiscard]] RemoteTraffic traffic() const;

 private:
  RemoteField(std::shared_ptr<const RemoteFile> source, Field field)
      : source_(std::move(source)), field_(std::move(field)) {}
  std::shared_ptr<const RemoteFile> source_;
  Field field_;
};

/// Opens a field by its path or its address. Adds a remote one to `remote`, for its traffic. Errors
/// of Field::open() or RemoteField::open().
[[nodiscard]] Result<Field> open_field(const std::string& place,
                                       const ProgressCallback& progress = {},
                                       std::vector<RemoteField>* remote = nullptr,
                                       const RemoteOptions& options = {});

}  // namespace slf
