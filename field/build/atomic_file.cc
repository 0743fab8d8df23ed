#include "field/build/atomic_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>

#include "storage/tile_store.h"
#include "storage/tile_writer.h"

namespace slf {
namespace {

bool exists(const std::string& path) {
  std::error_code ignored;
  return std::filesystem::exists(std::filesystem::symlink_status(path, ignored));
}

/// A container and what LMDB leaves beside it when it is killed.
void remove_container(const std::string& path) {
  unlink(path.c_str());
  unlink((path + "-lock").c_str());
}

/// Removes what a killed process left. A live one holds the writer's lock.
Result<void> clear_away(const std::string& left_over, const std::string& path) {
  if (!exists(left_over)) return {};
  if (auto writer = storage::TileWriter::resume(left_over); !writer) {
    if (writer.error().code == ErrorCode::failed)
      return fail(ErrorCode::failed, path, ": another process is writing it (", left_over, ")");
    return fail(writer.error().code, writer.error().message,
                "; it is in the way of a new file: remove it");
  }
  remove_container(left_over);
  return {};
}

void sync_folder_of(const std::string& path) {
  const std::size_t slash = path.rfind('/');
  const std::string folder = slash == std::string::npos ? "." : path.substr(0, slash + 1);
  const int directory = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (directory < 0) return;
  (void)fsync(directory);
  ::close(directory);
}

}  // namespace

Result<AtomicFile> AtomicFile::at(const std::string& path, bool replace) {
  if (!replace && exists(path))
    return fail(ErrorCode::usage, path, ": exists; choose another output or -f");
  if (std::error_code ignored; std::filesystem::is_directory(path, ignored))
    return fail(ErrorCode::usage, path, ": is a folder; name a file in it");
  AtomicFile file(path, replace);
  if (auto ok = clear_away(file.temporary_, path); !ok) {
    file.mine_ = false;
    return tl::unexpected(ok.error());
  }
  return file;
}

AtomicFile::AtomicFile(AtomicFile&& other) noexcept
    : path_(std::move(other.path_)),
      temporary_(std::move(other.temporary_)),
      replace_(other.replace_),
      mine_(std::exchange(other.mine_, false)) {}

AtomicFile::~AtomicFile() {
  if (mine_) remove_container(temporary_);
}

Result<void> AtomicFile::publish() {
  int failed = renameat2(AT_FDCWD, temporary_.c_str(), AT_FDCWD, path_.c_str(),
                         replace_ ? 0 : RENAME_NOREPLACE);
  if (failed != 0 && (errno == EINVAL || errno == ENOSYS)) {  // not on every file system
    if (!replace_ && exists(path_))
      errno = EEXIST;
    else
      failed = std::rename(temporary_.c_str(), path_.c_str());
  }
  if (failed != 0)
    return fail(errno == EEXIST ? ErrorCode::usage : ErrorCode::io, path_, ": ",
                std::strerror(errno));
  mine_ = false;
  sync_folder_of(path_);
  return {};
}

}  // namespace slf
