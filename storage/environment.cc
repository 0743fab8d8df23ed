#include "storage/internal/environment.h"

#include <fcntl.h>
#include <lmdb.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <map>
#include <memory>

#include "base/file.h"
#include "base/try.h"
#include "storage/internal/pages.h"

namespace slf::storage::internal {
namespace {

constexpr std::uint64_t kMapIncrement = std::uint64_t{16} << 20;
constexpr unsigned kTrees = 2;  // of records and of blobs

static_assert(MDB_VERSION_MAJOR == 0, "the files of LMDB 1.x are no slf fields: build with 0.9");

// unsupported: the program runs with another LMDB than the one that it was built with.
Result<void> check_library(const std::string& path) {
  int major = 0;
  const char* const found = mdb_version(&major, nullptr, nullptr);
  if (major == MDB_VERSION_MAJOR) return {};
  return unsupported(path, "cannot be written with ", found,
                     ", whose files differ from those of LMDB 0.9; install that");
}

MDB_val value_of(ByteSpan bytes) { return {bytes.size(), const_cast<std::byte*>(bytes.data())}; }

// Opens LMDB on a descriptor. LMDB also needs a lock file beside the container, whose name somebody
// else's file or link may have, and which would remain if the process were killed. Nobody shares
// it: there is one writer, and its readers have other locks (locked_file.h). So LMDB gets a folder
// of its own that has links to the container and to a lock file in memory, and that vanishes once
// both are open. Returns 0 or an error.
int open_alone(MDB_env* environment, const std::string& path, int descriptor) {
  struct Folder {
    std::string name, container{}, lock{};
    Descriptor memory{};
    ~Folder() {
      unlink(container.c_str());
      unlink(lock.c_str());
      rmdir(name.c_str());
    }
  };
  Folder folder{temporary_folder() + "/slf-XXXXXX"};
  if (mkdtemp(folder.name.data()) == nullptr) {
    folder.name = path + ".XXXXXX";
    if (mkdtemp(folder.name.data()) == nullptr) return errno;
  }
  folder.container = folder.name + "/container";
  folder.lock = folder.container + "-lock";
  folder.memory = Descriptor(memfd_create("slf-lock", MFD_CLOEXEC));
  if (folder.memory.get() < 0 ||
      symlink(path_of_descriptor(folder.memory.get()).c_str(), folder.lock.c_str()) != 0 ||
      symlink(path_of_descriptor(descriptor).c_str(), folder.container.c_str()) != 0)
    return errno;
  return mdb_env_open(environment, folder.container.c_str(),
                      MDB_NOSUBDIR | MDB_NOTLS | MDB_NORDAHEAD, 0666);
}

// LMDB reports a short write as EIO. On a full disk, that is what happens first.
bool is_full(MDB_env* environment) {
  constexpr std::uint64_t kAlmostNothing = std::uint64_t{1} << 20;
  mdb_filehandle_t file = -1;
  struct statvfs status = {};
  return mdb_env_get_fd(environment, &file) == 0 && fstatvfs(file, &status) == 0 &&
         std::uint64_t{status.f_bavail} * status.f_frsize < kAlmostNothing;
}

const char* remedy(int code) {
  switch (code) {
    case ENOSPC:
    case EDQUOT:
    case EFBIG:
    case EIO:  // a short write, as at a limit of the size of files
      return "; the disk may be full: free some space and try again";
    case MDB_PANIC:
      return "; close the field and open it again";
    default:
      return "";
  }
}

}  // namespace

Environment::~Environment() {
  if (reader_ != nullptr) mdb_txn_abort(reader_);
  map_ = {};
  if (environment_ != nullptr) mdb_env_close(environment_);
}

Result<std::unique_ptr<Environment>> Environment::open(const std::string& path, int descriptor) {
  SLF_TRY(check_library(path));
  std::unique_ptr<Environment> result(new Environment(path));
  struct stat status = {};
  if (fstat(descriptor, &status) != 0) return result->error(errno, "read its size");
  result->map_bytes_ =
      (static_cast<std::uint64_t>(status.st_size) / kMapIncrement + 1) * kMapIncrement;
  if (const int code = mdb_env_create(&result->environment_); code != 0)
    return result->error(code, "open");
  MDB_env* environment = result->environment_;
  int code = mdb_env_set_mapsize(environment, result->map_bytes_);
  if (code == 0) code = mdb_env_set_maxdbs(environment, kTrees);
  if (code == 0) code = open_alone(environment, path, descriptor);
  if (code != 0) return result->error(code, "open to write");
  MDB_stat pages = {};
  if (mdb_env_stat(environment, &pages) != 0 || pages.ms_psize != kPageSize)
    return unsupported(path, "LMDB makes pages of ", pages.ms_psize,
                       " bytes on this system, expected ", kPageSize);
  result->guard();
  int dead = 0;
  (void)mdb_reader_check(environment, &dead);
  code = mdb_txn_begin(environment, nullptr, MDB_RDONLY, &result->reader_);
  if (code != 0) return result->error(code, "read");
  return result;
}

std::uint64_t Environment::transaction() const {
  MDB_envinfo info = {};
  return mdb_env_info(environment_, &info) == 0 ? info.me_last_txnid : 0;
}

// Must be called whenever LMDB has moved its map. LMDB does not report the map's address, so this
// computes it from an entry of the main tree: the entry's page begins with the page's number. A
// file without entries stays unguarded.
void Environment::guard() {
  map_ = {};
  MDB_txn* transaction = nullptr;
  if (mdb_txn_begin(environment_, nullptr, MDB_RDONLY, &transaction) != 0) return;
  MDB_dbi tree = 0;
  MDB_cursor* cursor = nullptr;
  MDB_val key, value;
  if (mdb_dbi_open(transaction, nullptr, 0, &tree) == 0 &&
      mdb_cursor_open(transaction, tree, &cursor) == 0 &&
      mdb_cursor_get(cursor, &key, &value, MDB_FIRST) == 0) {
    const auto entry = reinterpret_cast<std::uintptr_t>(value.mv_data);
    // NOLINTNEXTLINE(performance-no-int-to-ptr)
    const auto* page = reinterpret_cast<const std::byte*>(entry / kPageSize * kPageSize);
    map_ = GuardedRange({page - load_le<std::uint64_t>(page) * kPageSize, map_bytes_});
  }
  if (cursor != nullptr) mdb_cursor_close(cursor);
  mdb_txn_abort(transaction);
}

Result<Environment::Length> Environment::length() const {
  MDB_envinfo info = {};
  mdb_filehandle_t file = -1;
  struct stat status = {};
  if (mdb_env_info(environment_, &info) != 0 || mdb_env_get_fd(environment_, &file) != 0 ||
      fstat(file, &status) != 0)
    return error(errno, "read its size");
  return Length{file, static_cast<std::uint64_t>(status.st_size),
                (info.me_last_pgno + 1) * kPageSize};
}

Result<void> Environment::check_length() const {
  const auto [file, bytes, expected] = SLF_TRY(length());
  if (bytes >= expected) {
    if (!map_.changed()) return {};
    return fail(ErrorCode::io, path_, ": ", kUnreadablePage, "; nothing more is written to it");
  }
  return bad_file(path_, "changed while open: it has become shorter than its ", expected,
                  " bytes; nothing more is written to it");
}

Result<void> Environment::put(std::span<const Put> puts) {
  while (true) {
    SLF_TRY(check_length());
    const int code = try_put(puts);
    if (map_.changed()) return check_length();
    if (code == 0) {
      start_writeback();
      return {};
    }
    if (code != MDB_MAP_FULL) return error(code, "write");
    SLF_TRY(grow());
  }
}

int Environment::try_put(std::span<const Put> puts) {
  MDB_txn* begun = nullptr;
  int code = mdb_txn_begin(environment_, nullptr, 0, &begun);
  if (code != 0) return code;
  std::unique_ptr<MDB_txn, void (*)(MDB_txn*)> transaction(begun, mdb_txn_abort);
  std::map<std::string, MDB_dbi> trees;
  for (const Put& put : puts) {
    auto [tree, unknown] = trees.try_emplace(put.tree, 0);
    if (unknown) code = mdb_dbi_open(begun, put.tree.c_str(), MDB_CREATE, &tree->second);
    MDB_val key = value_of(put.key);
    MDB_val value{put.bytes, nullptr};
    const unsigned append = put.append ? MDB_APPEND : 0;
    if (code == 0 && !put.key.empty()) {
      code = mdb_put(begun, tree->second, &key, &value, MDB_RESERVE | append);
      if (code == 0) put.write({static_cast<std::byte*>(value.mv_data), put.bytes});
    }
    if (code != 0) return code;
  }
  if (map_.changed()) return MDB_CORRUPTED;  // put() reports it
  return mdb_txn_commit(transaction.release());
}

// LMDB does not write pages that it allocates and frees in the same transaction. If these are the
// last pages, the file ends before them and would seem truncated.
Result<void> Environment::extend() {
  const auto [file, bytes, needed] = SLF_TRY(length());
  if (bytes < needed && ftruncate(file, static_cast<off_t>(needed)) != 0)
    return error(errno, "extend");
  if (map_.changed()) return check_length();
  return {};
}

void Environment::defer_sync() { deferred_ = mdb_env_set_flags(environment_, MDB_NOSYNC, 1) == 0; }

// Starts writing early, so that the disk works while the next records are encoded.
void Environment::start_writeback() const {
  mdb_filehandle_t file = -1;
  if (deferred_ && mdb_env_get_fd(environment_, &file) == 0)
    (void)sync_file_range(file, 0, 0, SYNC_FILE_RANGE_WRITE);
}

Result<void> Environment::sync() {
  if (const int code = mdb_env_sync(environment_, /*force=*/1); code != 0)
    return error(code, "write");
  return {};
}

// LMDB forbids this while transactions are active, because their data would move with the map.
// reader_ reads no data: it only occupies a slot.
Result<void> Environment::grow() {
  map_bytes_ += std::max(map_bytes_, kMapIncrement);
  map_ = {};
  const int code = mdb_env_set_mapsize(environment_, map_bytes_);
  guard();
  if (code != 0) return error(code, "grow the map");
  return {};
}

Result<void> Environment::allow_reuse() {
  mdb_txn_reset(reader_);
  const int code = mdb_txn_renew(reader_);
  if (code != 0) return error(code, "read");
  return {};
}

tl::unexpected<Error> Environment::error(int code, const char* doing) const {
  if (code == EIO && is_full(environment_)) code = ENOSPC;
  ErrorCode kind = code == ENOENT   ? ErrorCode::not_found
                   : code == ENOMEM ? ErrorCode::out_of_memory
                   : code > 0       ? ErrorCode::io
                                    : ErrorCode::failed;
  // MDB_KEYEXIST: the tree has records after its last one.
  if (code == MDB_CORRUPTED || code == MDB_PAGE_NOTFOUND || code == MDB_INVALID ||
      code == MDB_KEYEXIST)
    kind = ErrorCode::bad_file;
  return fail(kind, path_, ": cannot ", doing, ": ", mdb_strerror(code), remedy(code));
}

}  // namespace slf::storage::internal
