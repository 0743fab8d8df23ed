#include "storage/internal/locked_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

namespace slf::storage::internal {
namespace {

constexpr std::uint64_t kFirstPin = std::uint64_t{1} << 62;
constexpr std::uint64_t kWriterByte = kFirstPin - 1;

struct flock lock_of(short type, std::uint64_t byte, std::uint64_t length) {
  struct flock lock = {};
  lock.l_type = type;
  lock.l_whence = SEEK_SET;
  lock.l_start = static_cast<off_t>(byte);
  lock.l_len = static_cast<off_t>(length);
  return lock;
}

}  // namespace

Result<LockedFile> LockedFile::open(const std::string& path, Access access) {
  // O_NONBLOCK: if the path is a pipe, do not wait for its other end.
  const int mode = access == Access::read ? O_RDONLY : O_RDWR;
  Descriptor file(::open(path.c_str(), mode | O_CLOEXEC | O_NONBLOCK));
  if (file.get() < 0)
    return io_error(path, access == Access::read ? "cannot open" : "cannot open to write");
  struct stat status = {};
  if (fstat(file.get(), &status) != 0) return fail(ErrorCode::io, path, ": ", std::strerror(errno));
  if (!S_ISREG(status.st_mode)) return fail(ErrorCode::io, path, ": not a regular file");
  return LockedFile(std::move(file));
}

Result<std::uint64_t> LockedFile::size(const std::string& path) const {
  struct stat status = {};
  if (fstat(descriptor(), &status) != 0)
    return fail(ErrorCode::io, path, ": ", std::strerror(errno));
  return static_cast<std::uint64_t>(status.st_size);
}

void LockedFile::pin(std::uint64_t transaction, bool pins) const {
  if (transaction >= kFirstPin) return;
  struct flock lock = lock_of(pins ? F_RDLCK : F_UNLCK, kFirstPin + transaction, 1);
  (void)fcntl(descriptor(), F_OFD_SETLK, &lock);
}

Result<void> LockedFile::lock_writer(const std::string& path) const {
  struct flock lock = lock_of(F_WRLCK, kWriterByte, 1);
  if (fcntl(descriptor(), F_OFD_SETLK, &lock) == 0) return {};
  if (errno == EAGAIN || errno == EACCES)
    return fail(ErrorCode::busy, path, ": another writer has it open");
  return io_error(path, "cannot be locked for writing");
}

bool LockedFile::has_writer() const {
  struct flock lock = lock_of(F_WRLCK, kWriterByte, 1);
  return fcntl(descriptor(), F_OFD_GETLK, &lock) == 0 && lock.l_type != F_UNLCK;
}

bool LockedFile::pinned_before(std::uint64_t transaction) const {
  if (transaction == 0) return false;
  struct flock lock = lock_of(F_WRLCK, kFirstPin, transaction);
  // If the query fails, assume a pin: that wastes space, but never harms a reader.
  return fcntl(descriptor(), F_OFD_GETLK, &lock) != 0 || lock.l_type != F_UNLCK;
}

}  // namespace slf::storage::internal
