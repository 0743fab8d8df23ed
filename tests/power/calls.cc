#include "tests/power/calls.h"

#include <cxxabi.h>
#include <dlfcn.h>
#include <execinfo.h>
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

#include <atomic>
#include <cstdarg>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <map>
#include <mutex>
#include <optional>

namespace slf::testing {
namespace {

std::atomic<bool> recording = false;
std::mutex mutex;  // held from a call to its record, so that these are in order
std::string folder;
std::vector<Call> calls;
std::map<std::pair<dev_t, ino_t>, int> files;
int file_count = 0;

using Kind = Call::Kind;

/// The name of a path in the folder.
std::optional<std::string> name_in_folder(const char* path) {
  const std::string_view text(path);
  if (text.size() <= folder.size() || !text.starts_with(folder) || text[folder.size()] != '/')
    return std::nullopt;
  return std::string(text.substr(folder.size() + 1));
}

struct stat status_of(int file) {
  struct stat status = {};
  syscall(SYS_newfstatat, file, "", &status, AT_EMPTY_PATH);
  return status;
}

std::pair<dev_t, ino_t> identity(const struct stat& status) {
  return {status.st_dev, status.st_ino};
}

std::optional<int> number_of(int file) {
  const auto found = files.find(identity(status_of(file)));
  return found == files.end() ? std::nullopt : std::optional(found->second);
}

int add_file(int file) {
  const int number = file_count++;
  files[identity(status_of(file))] = number;
  calls.push_back({Kind::create, number});
  return number;
}

/// Where the caller of LMDB is, or else the caller of this library's function.
const void* site_of(const void* caller) {
  const auto is_lmdb = [](const void* at) {
    Dl_info info = {};
    return dladdr(at, &info) != 0 && info.dli_fname && std::strstr(info.dli_fname, "lmdb");
  };
  if (!is_lmdb(caller)) return caller;
  void* frames[32];
  const int count = backtrace(frames, 32);
  bool inside = false;
  for (int k = 0; k < count; ++k) {
    if (inside && !is_lmdb(frames[k])) return frames[k];
    inside = inside || is_lmdb(frames[k]);
  }
  return caller;
}

[[noreturn]] void give_up(const char* what) {
  std::fprintf(stderr, "%s: the disk of this test does not know it\n", what);
  std::abort();
}

/// Runs a call that writes `bytes`, as far as `run` says it does, and records it.
template <class Run>
ssize_t write_call(int file, std::optional<off_t> at, const iovec* from, int count,
                   const Run& run) {
  if (!recording) return run();
  const std::lock_guard lock(mutex);
  const auto number = number_of(file);
  const off_t begin = at ? *at : number ? static_cast<off_t>(syscall(SYS_lseek, file, 0, 1)) : 0;
  const ssize_t done = run();
  if (!number || done <= 0) return done;
  Call call{Kind::write, *number, static_cast<std::uint64_t>(begin)};
  for (int k = 0; k < count; ++k) {
    const auto* bytes = static_cast<const std::byte*>(from[k].iov_base);
    call.bytes.insert(call.bytes.end(), bytes, bytes + from[k].iov_len);
  }
  call.bytes.resize(static_cast<std::size_t>(done));
  call.durable = (syscall(SYS_fcntl, file, F_GETFL) & O_DSYNC) != 0;
  calls.push_back(std::move(call));
  return done;
}

int open_call(int at, const char* path, int flags, mode_t mode) {
  const auto run = [&] { return static_cast<int>(syscall(SYS_openat, at, path, flags, mode)); };
  if (!recording) return run();
  const std::lock_guard lock(mutex);
  const bool unnamed = (flags & O_TMPFILE) == O_TMPFILE;
  const auto name = name_in_folder((std::string(path) + (unnamed ? "/." : "")).c_str());
  struct stat before = {};
  const bool is_new =
      name &&
      (unnamed || ((flags & O_CREAT) != 0 && syscall(SYS_newfstatat, at, path, &before, 0) != 0));
  const int file = run();
  if (file < 0) return file;
  if (is_new) {
    const int number = add_file(file);
    if (!unnamed) calls.push_back({.kind = Kind::link, .file = number, .name = *name});
  } else if (const auto number = number_of(file); number && (flags & O_TRUNC) != 0) {
    calls.push_back({Kind::truncate, *number});
  }
  return file;
}

int truncate_call(int file, off_t size) {
  const auto run = [&] { return static_cast<int>(syscall(SYS_ftruncate, file, size)); };
  if (!recording) return run();
  const std::lock_guard lock(mutex);
  const int result = run();
  if (const auto number = number_of(file); number && result == 0)
    calls.push_back({Kind::truncate, *number, static_cast<std::uint64_t>(size)});
  return result;
}

int sync_call(int file, long call, const void* caller) {
  if (!recording) return static_cast<int>(syscall(call, file));
  const std::lock_guard lock(mutex);
  const struct stat status = status_of(file);
  struct stat own = {};
  if (S_ISDIR(status.st_mode)) {
    syscall(SYS_newfstatat, AT_FDCWD, folder.c_str(), &own, 0);
    if (identity(own) == identity(status))
      calls.push_back({.kind = Kind::sync_folder, .site = site_of(caller)});
  } else if (const auto number = number_of(file)) {
    calls.push_back({.kind = Kind::sync, .file = *number, .site = site_of(caller)});
  }
  return 0;
}

template <class Run>
int name_call(Call call, const char* from, const char* to, const Run& run) {
  if (!recording) return run();
  const std::lock_guard lock(mutex);
  const auto name = name_in_folder(to), old = name_in_folder(from);
  struct stat status = {};
  if (call.kind == Kind::link) syscall(SYS_newfstatat, AT_FDCWD, from, &status, 0);
  const int result = run();
  if (result != 0 || !name) return result;
  call.name = *name;
  if (call.kind == Kind::rename) call.from = old.value();
  if (call.kind == Kind::link) call.file = files.at(identity(status));
  calls.push_back(std::move(call));
  return result;
}

}  // namespace

void begin_calls(const std::string& path) {
  void* frame = nullptr;
  backtrace(&frame, 1);  // which opens a library the first time
  const std::lock_guard lock(mutex);
  folder = path;
  calls.clear();
  files.clear();
  file_count = 0;
  recording = true;
}

void note_done() {
  const std::lock_guard lock(mutex);
  calls.push_back({Kind::done});
}

std::vector<Call> end_calls() {
  const std::lock_guard lock(mutex);
  recording = false;
  return std::move(calls);
}

std::string name_of_site(const void* site) {
  Dl_info info = {};
  if (dladdr(site, &info) == 0) return "?";
  const auto distance = [&](const void* from) {
    return "+" + std::to_string(static_cast<const char*>(site) - static_cast<const char*>(from));
  };
  if (!info.dli_sname) return info.dli_fname + distance(info.dli_fbase);
  int failed = 0;
  char* const readable = abi::__cxa_demangle(info.dli_sname, nullptr, nullptr, &failed);
  std::string name = readable ? readable : info.dli_sname;
  std::free(readable);
  return name.substr(0, name.find('(')) + distance(info.dli_saddr);
}

}  // namespace slf::testing

using namespace slf::testing;  // NOLINT(google-build-using-namespace): what follows are C functions

extern "C" {

int open(const char* path, int flags, ...) {
  va_list rest;
  va_start(rest, flags);
  const mode_t mode = (flags & (O_CREAT | O_TMPFILE)) != 0 ? va_arg(rest, mode_t) : 0;
  va_end(rest);
  return open_call(AT_FDCWD, path, flags, mode);
}

ssize_t write(int file, const void* from, size_t size) {
  const iovec bytes{const_cast<void*>(from), size};
  return write_call(file, {}, &bytes, 1, [&] { return syscall(SYS_write, file, from, size); });
}

ssize_t pwrite(int file, const void* from, size_t size, off_t at) {
  const iovec bytes{const_cast<void*>(from), size};
  return write_call(file, at, &bytes, 1,
                    [&] { return syscall(SYS_pwrite64, file, from, size, at); });
}

ssize_t writev(int file, const iovec* from, int count) {
  return write_call(file, {}, from, count, [&] { return syscall(SYS_writev, file, from, count); });
}

int ftruncate(int file, off_t size) noexcept { return truncate_call(file, size); }

int fsync(int file) { return sync_call(file, SYS_fsync, __builtin_return_address(0)); }
int fdatasync(int file) { return sync_call(file, SYS_fdatasync, __builtin_return_address(0)); }

int rename(const char* from, const char* to) noexcept {
  return name_call({Kind::rename}, from, to, [&] {
    return static_cast<int>(syscall(SYS_renameat2, AT_FDCWD, from, AT_FDCWD, to, 0));
  });
}

int renameat2(int at, const char* from, int to_at, const char* to, unsigned flags) noexcept {
  return name_call({Kind::rename}, from, to, [&] {
    return static_cast<int>(syscall(SYS_renameat2, at, from, to_at, to, flags));
  });
}

int linkat(int at, const char* from, int to_at, const char* to, int flags) noexcept {
  return name_call({Kind::link}, from, to, [&] {
    return static_cast<int>(syscall(SYS_linkat, at, from, to_at, to, flags));
  });
}

int unlink(const char* path) noexcept {
  return name_call({Kind::unlink}, "", path,
                   [&] { return static_cast<int>(syscall(SYS_unlinkat, AT_FDCWD, path, 0)); });
}
int remove(const char* path) noexcept {
  struct stat status = {};
  if (lstat(path, &status) == 0 && S_ISDIR(status.st_mode)) return rmdir(path);
  return unlink(path);
}

void* mmap(void* at, size_t size, int protection, int flags, int file, off_t offset) noexcept {
  if (recording && file >= 0 && (protection & PROT_WRITE) && (flags & MAP_TYPE) == MAP_SHARED) {
    const std::lock_guard lock(slf::testing::mutex);
    if (number_of(file)) give_up("a map that is written to");
  }
  return reinterpret_cast<void*>(syscall(SYS_mmap, at, size, protection, flags, file, offset));
}

int truncate(const char*, off_t) noexcept { give_up("truncate"); }
ssize_t pwritev(int, const iovec*, int, off_t) { give_up("pwritev"); }
int fallocate(int, int, off_t, off_t) { give_up("fallocate"); }

}  // extern "C"
