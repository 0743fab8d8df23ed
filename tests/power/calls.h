// Calls: what this process asks of the file system, in one folder, in order. Definitions in
// calls.cc stand before the C library's for the whole process, LMDB included.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/bytes.h"

namespace slf::testing {

struct Call {
  enum class Kind {
    create,       // `file`, without a name
    write,        // `bytes` at `at` of `file`
    truncate,     // `file`, to `at` bytes
    sync,         // `file`
    link,         // `name` becomes `file`
    unlink,       // `name`
    rename,       // `from` becomes `name`
    sync_folder,  // all names
    done          // what was promised is kept from here on; see note_done()
  };
  Kind kind{};
  int file = -1;
  std::uint64_t at = 0;
  Bytes bytes{};
  bool durable = false;  // a write that waits for the disk (O_DSYNC)
  std::string name{}, from{};
  const void* site = nullptr;  // of a sync: where slf asked for it, directly or through LMDB
};

/// From now on records calls that concern files in a folder, which is empty. Syncs only are
/// recorded: they do nothing.
void begin_calls(const std::string& folder);
/// Says that a function of slf has returned.
void note_done();
[[nodiscard]] std::vector<Call> end_calls();

/// The function that a site is in or, if that has no name, its file, and the bytes behind its
/// start.
[[nodiscard]] std::string name_of_site(const void* site);

}  // namespace slf::testing
