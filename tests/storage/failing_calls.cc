// These definitions stand before the C library's for the whole process, LMDB included.
#include "tests/storage/failing_calls.h"

#include <dlfcn.h>
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdarg>

namespace slf::storage::testing {
namespace {

std::atomic<int> left = -1;
std::atomic<int> code = 0;
std::atomic<bool> later = false;
std::atomic<bool> failed = false;
std::atomic<bool> names_only = false;
std::atomic<int> lmdb_major = 0;

bool fails() {
  if (left.load() < 0) return false;
  if (left.load() > 0) {
    --left;
    return false;
  }
  if (failed && !later) return false;
  failed = true;
  errno = code;
  return true;
}

template <class Function>
Function* next(const char* name) {
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name));
}

}  // namespace

void fail_after(int calls, int error, bool all_later) {
  failed = false;
  code = error;
  later = all_later;
  left = calls;
}

bool has_failed() { return failed; }

void pretend_lmdb(int major) { lmdb_major = major; }

void refuse_unnamed_files(bool refuse) { names_only = refuse; }

bool refuses(int flags) {
  if (!names_only || (flags & O_TMPFILE) != O_TMPFILE) return false;
  errno = EOPNOTSUPP;
  return true;
}

}  // namespace slf::storage::testing

using slf::storage::testing::fails;
using slf::storage::testing::next;

extern "C" {

int open(const char* path, int flags, ...) {
  va_list rest;
  va_start(rest, flags);
  const mode_t mode = (flags & (O_CREAT | O_TMPFILE)) != 0 ? va_arg(rest, mode_t) : 0;
  va_end(rest);
  if (slf::storage::testing::refuses(flags)) return -1;
  return static_cast<int>(syscall(SYS_openat, AT_FDCWD, path, flags, mode));
}

ssize_t pwrite(int file, const void* from, size_t size, off_t at) {
  static auto* real = next<ssize_t(int, const void*, size_t, off_t)>("pwrite");
  if (!fails()) return real(file, from, size, at);
  return errno == EIO && size > 1 ? real(file, from, size / 2, at) : -1;  // half a write, too
}

ssize_t writev(int file, const struct iovec* from, int count) {
  static auto* real = next<ssize_t(int, const struct iovec*, int)>("writev");
  return fails() ? -1 : real(file, from, count);
}

int fdatasync(int file) {
  static auto* real = next<int(int)>("fdatasync");
  return fails() ? -1 : real(file);
}

int fsync(int file) {
  static auto* real = next<int(int)>("fsync");
  return fails() ? -1 : real(file);
}

int msync(void* from, size_t size, int flags) {
  static auto* real = next<int(void*, size_t, int)>("msync");
  return fails() ? -1 : real(from, size, flags);
}

void* mmap(void* at, size_t size, int protection, int flags, int file, off_t offset) noexcept {
  if (file < 0)  // memory, perhaps for a sanitizer that is not ready yet
    return reinterpret_cast<void*>(syscall(SYS_mmap, at, size, protection, flags, file, offset));
  static auto* real = next<void*(void*, size_t, int, int, int, off_t)>("mmap");
  return fails() ? MAP_FAILED : real(at, size, protection, flags, file, offset);
}

int ftruncate(int file, off_t size) noexcept {
  static auto* real = next<int(int, off_t)>("ftruncate");
  return fails() ? -1 : real(file, size);
}

char* mdb_version(int* major, int* minor, int* patch) {
  const int found = slf::storage::testing::lmdb_major;
  if (major != nullptr) *major = found;
  for (int* const other : {minor, patch})
    if (other != nullptr) *other = 0;
  static char names[2][9] = {"LMDB 0.9", "LMDB 1.0"};
  return names[found];
}

}  // extern "C"
