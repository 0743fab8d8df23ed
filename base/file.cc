#include "base/file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <climits>
#include <cstdlib>
#include <system_error>
#include <utility>

namespace slf {
namespace {

tl::unexpected<Error> io_error(const std::string& path, const char* doing, int cause) {
  return fail(ErrorCode::io, path, ": ", doing, ": ", std::generic_category().message(cause));
}

/// A descriptor that closes itself.
class Descriptor {
 public:
  explicit Descriptor(int fd) : fd_(fd) {}
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  ~Descriptor() {
    if (fd_ >= 0) ::close(fd_);
  }
  [[nodiscard]] int get() const { return fd_; }
  /// Late write errors appear here. 0, or the cause.
  [[nodiscard]] int close() { return ::close(std::exchange(fd_, -1)) == 0 ? 0 : errno; }

 private:
  int fd_;
};

/// Writes all of `bytes`, to the disk. 0, or the cause.
int write_all(int fd, ByteSpan bytes) {
  while (!bytes.empty()) {
    const ssize_t written = ::write(fd, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) return errno;
    bytes = bytes.subspan(static_cast<std::size_t>(written));
  }
  return ::fsync(fd) == 0 ? 0 : errno;
}

/// Where a symbolic link leads; `path` itself where there is nothing yet.
std::string resolved(const std::string& path) {
  char target[PATH_MAX];
  return ::realpath(path.c_str(), target) != nullptr ? target : path;
}

/// A name beside `path` that no other thread or process uses.
std::string temporary_name(const std::string& path) {
  static std::atomic<unsigned> count{0};
  return path + "." + std::to_string(::getpid()) + "-" + std::to_string(count++) + ".tmp";
}

}  // namespace

Result<void> write_file(const std::string& path, ByteSpan bytes) {
  const std::string target = resolved(path);
  // A rename would put a plain file in the place of a device or pipe.
  struct stat status {};
  if (::stat(target.c_str(), &status) == 0 && !S_ISREG(status.st_mode))
    return fail(ErrorCode::io, path, ": cannot write: exists and is not a regular file");

  const std::string temporary = temporary_name(target);
  Descriptor file(::open(temporary.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666));
  if (file.get() < 0) return io_error(path, "cannot write", errno);

  int cause = write_all(file.get(), bytes);
  if (const int late = file.close(); cause == 0) cause = late;
  if (cause == 0 && ::rename(temporary.c_str(), target.c_str()) != 0) cause = errno;
  if (cause == 0) return {};
  ::unlink(temporary.c_str());
  return io_error(path, "cannot write", cause);
}

Result<Bytes> read_file(const std::string& path, std::uint64_t limit) {
  const Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (file.get() < 0) return io_error(path, "cannot open", errno);

  // Reads to the end rather than a size asked for beforehand, so that pipes work too.
  constexpr std::size_t kChunk = std::size_t{1} << 20;
  Bytes bytes;
  for (;;) {
    const std::size_t had = bytes.size();
    bytes.resize(had + kChunk);
    const ssize_t got = ::read(file.get(), bytes.data() + had, kChunk);
    const int cause = errno;
    bytes.resize(had + static_cast<std::size_t>(std::max<ssize_t>(got, 0)));
    if (got < 0 && cause == EINTR) continue;
    if (got < 0) return io_error(path, "cannot read", cause);
    if (got == 0) return bytes;
    if (bytes.size() > limit)
      return fail(ErrorCode::unsupported, path, ": longer than ", limit, " bytes");
  }
}

}  // namespace slf
