#include "base/file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <climits>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <system_error>
#include <utility>

#include "base/reporter.h"
#include "base/try.h"

namespace slf {
namespace {

std::string folder_of(const std::string& path) {
  const std::size_t slash = path.rfind('/');
  return slash == std::string::npos ? "./" : path.substr(0, slash + 1);
}

/// Returns 0 or an errno value. A file system that cannot sync folders (EINVAL, ENOTSUP) is not an
/// error: it orders its own updates.
int sync_folder(const std::string& folder) {
  const Descriptor directory(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (directory.get() < 0) return errno == EACCES ? 0 : errno;  // writable, but not readable
  return ::fsync(directory.get()) == 0 || errno == EINVAL || errno == ENOTSUP ? 0 : errno;
}

int open_unnamed(const std::string& folder, mode_t mode) {
  return ::open(folder.c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, mode);
}

/// Whether the file system has no unnamed files, by the error of open_unnamed().
bool names_are_needed(int error) { return error == EOPNOTSUPP || error == EISDIR; }

int rename_to(const std::string& from, const std::string& to, Existing existing) {
  const unsigned flags = existing == Existing::keep ? RENAME_NOREPLACE : 0;
  if (renameat2(AT_FDCWD, from.c_str(), AT_FDCWD, to.c_str(), flags) == 0) return 0;
  if (errno != EINVAL && errno != ENOSYS) return errno;
  // Not every file system supports the flag.
  struct stat status {};
  if (existing == Existing::keep && ::lstat(to.c_str(), &status) == 0) return EEXIST;
  return std::rename(from.c_str(), to.c_str()) == 0 ? 0 : errno;
}

/// Gives a file without a name this one. Returns 0 or an errno value.
int link_to(int fd, const std::string& name) {
  const std::string path = path_of_descriptor(fd);
  return ::linkat(AT_FDCWD, path.c_str(), AT_FDCWD, name.c_str(), AT_SYMLINK_FOLLOW) == 0 ? 0
                                                                                          : errno;
}

/// `cause`: 0 if a file has got the name `to`, in `folder`, or an errno value.
Result<void> end_of_publishing(const std::string& to, const std::string& folder, int cause) {
  if (cause == EEXIST) return misuse(to, "exists already");
  if (cause != 0) return io_error(to, "cannot write", cause);
  if (const int late = sync_folder(folder); late != 0)
    return io_error(to, "is written, but its folder could not be synced", late);
  return {};
}

}  // namespace

tl::unexpected<Error> io_error(const std::string& path, std::string_view doing, int cause) {
  const ErrorCode code = cause == ENOENT   ? ErrorCode::not_found
                         : cause == ENOMEM ? ErrorCode::out_of_memory
                                           : ErrorCode::io;
  return fail(code, path, ": ", doing, ": ", std::generic_category().message(cause),
              cause == ENOENT ? hint_at_address(path) : "");
}

const char* hint_at_address(std::string_view path) {
  if (path.find("://") == std::string_view::npos) return "";
  return "; this takes no address but a file: fetch it before, as with `curl -LO ADDRESS`";
}

Descriptor::~Descriptor() {
  if (fd_ >= 0) ::close(fd_);
}

std::string resolve_links(const std::string& path) {
  std::string at = path;
  for (int links = 0; links < 40; ++links) {  // as many as the kernel follows
    char target[PATH_MAX];
    const ssize_t length = ::readlink(at.c_str(), target, sizeof target);
    if (length < 0) return at;
    const std::string next(target, static_cast<std::size_t>(length));
    if (next.starts_with('/'))
      at = next;
    else
      at.replace(at.rfind('/') + 1, std::string::npos, next);
  }
  return path;
}

bool is_same_file(int descriptor, const std::string& path) {
  struct stat x {
  }, y{};
  return ::fstat(descriptor, &x) == 0 && ::stat(path.c_str(), &y) == 0 && x.st_dev == y.st_dev &&
         x.st_ino == y.st_ino;
}

bool is_same_file(const std::string& a, const std::string& b) {
  return is_same_file(Descriptor(::open(a.c_str(), O_PATH | O_CLOEXEC)).get(), b);
}

bool is_same_place(const std::string& a, const std::string& b) {
  const auto place = [](const std::string& path) {
    std::error_code ignored;
    return std::filesystem::weakly_canonical(resolve_links(path), ignored);
  };
  return is_same_file(a, b) || place(a) == place(b);
}

Result<void> check_output(const std::string& path, std::span<const std::string> inputs,
                          Existing existing) {
  const std::string target = resolve_links(path);
  struct stat status {};
  const bool exists = ::stat(target.c_str(), &status) == 0;
  if (exists && S_ISDIR(status.st_mode)) return misuse(path, "is a folder; name a file in it");
  if (exists && !S_ISREG(status.st_mode)) return misuse(path, "is not a regular file");
  for (const std::string& input : inputs) {
    if (!input.empty() && is_same_place(target, input))
      return misuse(path, "is the input", input == path ? std::string() : " (" + input + ")",
                    ", which would be lost; choose another output");
  }
  if (exists && existing == Existing::keep)
    return fail_without("replace", ErrorCode::usage, path, ": exists");
  return {};
}

Result<void> check_own_file(const std::string& path, std::string_view magic, const char* what) {
  struct stat status {};
  if (::lstat(path.c_str(), &status) != 0) return {};  // writing it says what is wrong
  bool own = false;
  if (S_ISREG(status.st_mode)) {
    const Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOFOLLOW));
    std::string start(magic.size(), '\0');
    const ssize_t got = ::read(file.get(), start.data(), start.size());
    own = got == 0 || (got > 0 && start == magic);
  }
  if (own) return {};
  return misuse(path, "exists and is not ", what,
                ", so it is not replaced; move it away, or choose another name");
}

std::string unused_name(const std::string& path) {
  static std::atomic<unsigned> count{0};
  for (;;) {
    std::string name =
        path + "." + std::to_string(::getpid()) + "-" + std::to_string(count++) + ".tmp";
    struct stat status {};
    if (::lstat(name.c_str(), &status) != 0) return name;
  }
}

void copy_permissions(const std::string& from, const std::string& to, bool writable) {
  struct stat status {};
  if (::stat(from.c_str(), &status) != 0) return;
  // The owner first, because a change of owner may clear permission bits. Failures are ignored.
  if (::chown(to.c_str(), status.st_uid, status.st_gid) != 0)
    (void)!::chown(to.c_str(), static_cast<uid_t>(-1), status.st_gid);
  (void)::chmod(to.c_str(), (status.st_mode & 0777) | (writable ? S_IRUSR | S_IWUSR : 0));
}

Result<void> publish_file(const std::string& from, const std::string& to, Existing existing) {
  {
    const Descriptor file(::open(from.c_str(), O_RDONLY | O_CLOEXEC));
    if (file.get() < 0 || ::fsync(file.get()) != 0) return io_error(to, "cannot write");
  }
  if (existing == Existing::replace) copy_permissions(to, from, /*writable=*/false);
  const std::string folder = folder_of(to);  // memory may run out: not once it has its name
  return end_of_publishing(to, folder, rename_to(from, to, existing));
}

NewFile::NewFile(NewFile&& other) noexcept
    : target_(std::move(other.target_)),
      file_(std::move(other.file_)),
      name_(std::exchange(other.name_, {})) {}

NewFile::~NewFile() {
  if (!name_.empty()) ::unlink(name_.c_str());
}

Result<NewFile> NewFile::create(const std::string& target, const std::string& name) {
  NewFile file(target);
  file.file_ = Descriptor(open_unnamed(folder_of(target), 0666));
  int cause = file.descriptor() < 0 ? errno : 0;
  // Without /proc, it would never get a name.
  if (cause == 0 && ::access(file.path().c_str(), F_OK) != 0) cause = EOPNOTSUPP;
  if (cause != 0 && names_are_needed(cause)) {
    std::string temporary = unused_name(target);
    file.file_ = Descriptor(::open(temporary.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0666));
    cause = file.descriptor() < 0 ? errno : 0;
    if (cause == 0) {
      file.name_ = std::move(temporary);
      // What replaces a private file is private.
      copy_permissions(target, file.name_, /*writable=*/true);
    }
  }
  if (cause != 0) return io_error(name, "cannot write", cause);
  return file;
}

std::string NewFile::path() const {
  return name_.empty() ? path_of_descriptor(descriptor()) : name_;
}

Result<void> NewFile::publish(Existing existing) {
  if (::fsync(descriptor()) != 0) return io_error(target_, "cannot write");
  if (existing == Existing::replace) copy_permissions(target_, path(), /*writable=*/false);
  const std::string folder = folder_of(target_);
  int cause = name_.empty() ? link_to(descriptor(), target_) : rename_to(name_, target_, existing);
  if (cause == EEXIST && existing == Existing::replace) {  // a link replaces nothing
    name_ = unused_name(target_);
    cause = link_to(descriptor(), name_);
    if (cause == 0) cause = rename_to(name_, target_, existing);
  }
  if (cause == 0) name_.clear();
  return end_of_publishing(target_, folder, cause);
}

Result<void> write_file(const std::string& path, ByteSpan bytes) {
  const std::string target = resolve_links(path);
  // A rename would put a plain file in the place of a device or pipe.
  struct stat status {};
  if (::stat(target.c_str(), &status) == 0 ? !S_ISREG(status.st_mode) : errno == ELOOP)
    return fail(ErrorCode::io, path, ": cannot write: exists and is not a regular file");

  auto file = SLF_TRY(NewFile::create(target));
  if (const int cause = write_all(file.descriptor(), bytes); cause != 0)
    return io_error(path, "cannot write", cause);
  return file.publish(Existing::replace);
}

Result<NewFile> copy_file(const std::string& from, const std::string& to,
                          const ProgressCallback& progress) {
  constexpr std::size_t kChunk = std::size_t{1} << 20;
  const Descriptor source(::open(from.c_str(), O_RDONLY | O_CLOEXEC));
  struct stat status {};
  if (source.get() < 0 || ::fstat(source.get(), &status) != 0) return io_error(from, "cannot open");
  auto copy = SLF_TRY(NewFile::create(to));
  copy_permissions(from, copy.path(), /*writable=*/true);

  Reporter reporter(progress, {0, static_cast<std::uint64_t>(status.st_size), 0},
                    to + ": interrupted");
  Bytes chunk(kChunk);
  for (;;) {
    const ssize_t got = ::read(source.get(), chunk.data(), chunk.size());
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return io_error(from, "cannot read");
    if (got == 0) return copy;
    const auto bytes = static_cast<std::size_t>(got);
    if (const int cause = write_all(copy.descriptor(), ByteSpan(chunk).first(bytes)); cause != 0)
      return io_error(to, "cannot write", cause);
    SLF_TRY(reporter.add(bytes));
  }
}

Result<std::uint64_t> file_size(const std::string& path) {
  struct stat status {};
  if (::stat(path.c_str(), &status) != 0)
    return errno == ENOENT
               ? fail(ErrorCode::not_found, path, ": no such file", hint_at_address(path))
               : io_error(path, "cannot open");
  if (!S_ISREG(status.st_mode)) return fail(ErrorCode::io, path, ": not a regular file");
  return static_cast<std::uint64_t>(status.st_size);
}

Result<std::ifstream> open_regular(const std::string& path) {
  SLF_TRY(file_size(path));
  std::ifstream file(path, std::ios::binary);
  if (!file) return io_error(path, "cannot open");
  return file;
}

Result<Bytes> read_file(const std::string& path, std::uint64_t limit, const StartCheck& check) {
  const std::uint64_t size = SLF_TRY(file_size(path));
  const auto too_long = [&] { return unsupported(path, "longer than ", limit, " bytes"); };
  if (!check && size > limit) return too_long();
  // What took the file's place meanwhile may be a pipe, which must not be waited for.
  const Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (file.get() < 0) return io_error(path, "cannot open");

  // Reads to the end instead of relying on the size, which is 0 for the files of /proc.
  constexpr std::size_t kChunk = std::size_t{1} << 20, kStart = std::size_t{1} << 16;
  Bytes bytes;
  bytes.reserve(std::min(size, limit) + kChunk);
  for (bool checked = !check;;) {
    const std::size_t had = bytes.size();
    bytes.resize(had + kChunk);
    const ssize_t got = ::read(file.get(), bytes.data() + had, kChunk);
    const int cause = errno;
    bytes.resize(had + static_cast<std::size_t>(std::max<ssize_t>(got, 0)));
    if (got < 0 && cause == EINTR) continue;
    if (got < 0) return io_error(path, "cannot read", cause);
    if (!checked && (got == 0 || bytes.size() >= kStart)) {
      SLF_TRY(check(bytes));
      checked = true;
    }
    if (got == 0) return bytes;
    if (bytes.size() > limit) return too_long();
  }
}

int write_all(int fd, ByteSpan bytes, std::optional<std::uint64_t> offset) {
  while (!bytes.empty()) {
    const ssize_t written =
        offset ? ::pwrite(fd, bytes.data(), bytes.size(), static_cast<off_t>(*offset))
               : ::write(fd, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) return written < 0 ? errno : EIO;
    bytes = bytes.subspan(static_cast<std::size_t>(written));
    if (offset) *offset += static_cast<std::uint64_t>(written);
  }
  return 0;
}

std::string temporary_folder() {
  const char* const given = std::getenv("TMPDIR");
  return given != nullptr && *given != '\0' ? given : "/tmp";
}

Descriptor open_unnamed_file() {
  const int file = open_unnamed(temporary_folder(), 0600);
  if (file >= 0 || !names_are_needed(errno)) return Descriptor(file);
  std::string name = temporary_folder() + "/slf-XXXXXX";
  const int named = ::mkostemp(name.data(), O_CLOEXEC);
  if (named >= 0) ::unlink(name.c_str());
  return Descriptor(named);
}

std::string path_of_descriptor(int fd) { return "/proc/self/fd/" + std::to_string(fd); }

}  // namespace slf
