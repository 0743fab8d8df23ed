// The memory of this process, and files in the memory of the system.
#pragma once

#include <cstdint>
#include <string>

#include "slf/error.h"

namespace slf {

/// Asks the kernel to drop a file from its cache, so that later reads come from the disk. Pages
/// that a process has mapped remain. io: the file cannot be opened or synced.
[[nodiscard]] Result<void> drop_page_cache(const std::string& path);

/// The resident memory of this process, in bytes, from /proc/self/status.
struct ResidentMemory {
  std::uint64_t anonymous = 0;
  std::uint64_t file = 0;
};
[[nodiscard]] ResidentMemory resident_memory();

}  // namespace slf
