// The state of a benchmark's files in the kernel's page cache.
#pragma once

#include <cstdint>
#include <string>

namespace slf::bench {

/// Writes the files whose names begin with `path` (a file, `path`.index, or the files of a folder)
/// to the disk and drops them from the cache. REQUIRES: no process has them open or mapped.
/// Returns the number of pages that stayed, as counted by mincore: 0 if all are cold.
std::uint64_t drop_from_cache(const std::string& path);

/// The number of pages of these files in the cache.
[[nodiscard]] std::uint64_t cached_pages(const std::string& path);

/// The size of these files.
[[nodiscard]] std::uint64_t disk_bytes(const std::string& path);

/// Removes these files.
void remove_files(const std::string& path);

}  // namespace slf::bench
