// The check of a container's every page.
#pragma once

#include <vector>

#include "slf/error.h"
#include "storage/internal/pages.h"

namespace slf::storage::internal {

enum class Depth {
  /// All that LMDB relies on when it appends records and changes blobs: branch and leaf pages, the
  /// free list, and blobs; of records their extents only.
  trees,
  /// Also the head of every record's overflow pages, and that no page is lost.
  everything,
};

/// Appends one error per finding, at most a few hundred; the last then says that it gave up.
/// Takes time linear in the pages looked at and one bit of memory per page of the file.
void check_pages(const Pages& pages, Depth depth, std::vector<Error>& findings);

}  // namespace slf::storage::internal
