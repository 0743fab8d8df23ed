// Reading and replacing whole files, renaming complete ones to their final names, and temporary
// files. Internal.
#pragma once

#include <cerrno>
#include <cstdint>
#include <fstream>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>

#include "base/bytes.h"
#include "slf/error.h"
#include "slf/progress.h"

namespace slf {

/// "PATH: DOING: ", and what the system says of `cause`. not_found if there is no such file, else
/// io.
[[nodiscard]] tl::unexpected<Error> io_error(const std::string& path, std::string_view doing,
                                             int cause = errno);

/// What to add to an error about a file that is missing: how to get it, if the path is an address.
[[nodiscard]] const char* hint_at_address(std::string_view path);

/// A file descriptor that closes itself; below 0: none. Move-only.
class Descriptor {
 public:
  explicit Descriptor(int fd = -1) : fd_(fd) {}
  Descriptor(Descriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  ~Descriptor();
  [[nodiscard]] int get() const { return fd_; }

 private:
  int fd_;
};

/// What becomes of a file that is already there.
enum class Existing { keep, replace };

/// The file that `path` leads to through symbolic links. It need not exist.
[[nodiscard]] std::string resolve_links(const std::string& path);

/// Whether both paths lead to one existing file, through symbolic or hard links.
[[nodiscard]] bool is_same_file(const std::string& a, const std::string& b);
[[nodiscard]] bool is_same_file(int descriptor, const std::string& path);
/// The same, also of a file that is yet to be made.
[[nodiscard]] bool is_same_place(const std::string& a, const std::string& b);

/// What a program may write. It may replace two kinds of files, and asks these functions first: an
/// output that the user named, and a file of its own that an earlier run left beside an output.

/// usage: writing `path` would destroy something: it leads to a folder, a device or a pipe, or to
/// one of `inputs`; or it exists and is to be kept, and then Error::choice is "replace".
[[nodiscard]] Result<void> check_output(const std::string& path,
                                        std::span<const std::string> inputs,
                                        Existing existing = Existing::replace);

/// For a name that the program has chosen itself. usage: `path` exists, and is not a regular file
/// that is empty or begins with `magic`, so it was not left by this program. A link is refused,
/// wherever it leads. `what` says what such a file is, as "a light volume".
[[nodiscard]] Result<void> check_own_file(const std::string& path, std::string_view magic,
                                          const char* what);

/// A name beside `path` that no file has and no other thread or process uses.
[[nodiscard]] std::string unused_name(const std::string& path);

/// Gives `to` the permissions of `from`, and its owner if the system permits that. If `writable`,
/// the owner may also read and write it. Does nothing if `from` does not exist.
void copy_permissions(const std::string& from, const std::string& to, bool writable);

/// Atomically renames a complete file to `to`, in the same folder. The file and its new name are
/// durable on return. If `to` is replaced, the file gets its permissions.
/// usage: `to` exists and `existing` is keep. io: names `to` and the cause; `from` then still has
/// its name, unless only the sync of the folder failed.
[[nodiscard]] Result<void> publish_file(const std::string& from, const std::string& to,
                                        Existing existing);

/// Replaces `path` by a file with `bytes`, or leaves it as it was: writes a NewFile, and publishes
/// that. If `path` is a symbolic link, replaces the file it points to.
/// The new file has the permissions of the old one. io: names the path and the cause; no temporary
/// file remains.
[[nodiscard]] Result<void> write_file(const std::string& path, ByteSpan bytes);

/// A new file, which gets its name when it is complete. Until then it has none, so that nothing
/// remains of it if the process is killed. While it replaces another, and on file systems without
/// such files, it has the name that unused_name() gave it. Move-only.
class NewFile {
 public:
  /// Creates it in the folder of `target`, whose name it is to get. io, not_found: the message
  /// begins with `name`.
  [[nodiscard]] static Result<NewFile> create(const std::string& target, const std::string& name);
  [[nodiscard]] static Result<NewFile> create(const std::string& target) {
    return create(target, target);
  }

  NewFile(NewFile&& other) noexcept;
  NewFile& operator=(NewFile&&) = delete;
  ~NewFile();

  [[nodiscard]] int descriptor() const { return file_.get(); }
  /// Opens the file while this object lives; in this process only.
  [[nodiscard]] std::string path() const;
  /// Makes it durable and gives it its name. Errors as publish_file(); the file then vanishes with
  /// this object.
  [[nodiscard]] Result<void> publish(Existing existing);

 private:
  explicit NewFile(std::string target) : target_(std::move(target)) {}

  std::string target_;
  Descriptor file_;
  std::string name_;  ///< empty: none
};

/// Copies `from`, with its permissions, to a new file that is to be named `to`; the owner may write
/// to the copy. Progress counts bytes. io, not_found: the message names `to` or `from` and the
/// cause. cancelled: stopped by `progress`.
[[nodiscard]] Result<NewFile> copy_file(const std::string& from, const std::string& to,
                                        const ProgressCallback& progress = {});

/// Judges a file by its first bytes: at least 64 KiB, or all that it has.
using StartCheck = std::function<Result<void>(ByteSpan start)>;

/// Files name other files, and such a name may be that of a FIFO or a device, which would block a
/// reader for ever. So all input goes through the next three functions, which accept regular files
/// only. not_found: no such file. io: not a regular file, or it cannot be read.

/// The size in bytes.
[[nodiscard]] Result<std::uint64_t> file_size(const std::string& path);

/// Opens a file for reading, as bytes.
[[nodiscard]] Result<std::ifstream> open_regular(const std::string& path);

/// The whole file. It is read further only if `check`, if given, accepts its start. unsupported:
/// longer than `limit` bytes. Other errors are those of `check`.
[[nodiscard]] Result<Bytes> read_file(const std::string& path, std::uint64_t limit,
                                      const StartCheck& check = {});

/// Writes all of `bytes` to a descriptor, where it stands or at an offset. Returns 0 or an errno
/// value.
[[nodiscard]] int write_all(int fd, ByteSpan bytes, std::optional<std::uint64_t> offset = {});

/// TMPDIR or, if that is not set, /tmp.
[[nodiscard]] std::string temporary_folder();

/// Opens a new file that has no name and vanishes when it is closed, in temporary_folder(). Below
/// 0: errno says why.
[[nodiscard]] Descriptor open_unnamed_file();

/// A path that opens the file of a descriptor, as long as this process has that open.
[[nodiscard]] std::string path_of_descriptor(int fd);

}  // namespace slf
