// The kernel's page cache, as far as the files of a benchmark are in it.
#pragma once

#include <cstdint>
#include <string>

namespace slf::bench {

/// Writes the files of `path` and its siblings by prefix (a file, `path`.index, or a folder's
/// files) to the disk and drops them from the cache. REQUIRES: nobody has them open or mapped.
/// Returns the pages that stayed, as mincore counts them: 0 is cold.
std::uint64_t drop_from_cache(const std::string& path);

/// Pages of the same files that are in the cache.
[[nodiscard]] std::uint64_t cached_pages(const std::string& path);

/// Bytes of the same files.
[[nodiscard]] std::uint64_t disk_bytes(const std::string& path);

/// Removes them.
void remove_files(const std::string& path);

}  // namespace slf::bench
