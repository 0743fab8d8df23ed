// Checks every page of a container.
#pragma once

#include <vector>

#include "slf/error.h"
#include "storage/internal/pages.h"

namespace slf::storage::internal {

enum class CheckScope {
  /// What LMDB relies on to append records and change blobs: branch and leaf pages, the free list
  /// and the blobs. Of records, only their extents.
  trees,
  /// Also the first overflow page of every record, and that no page is lost.
  everything,
};

/// Checks the pages, and appends one error per finding. After a few hundred it gives up, and the
/// last error says so. Takes time linear in the number of pages checked, and one bit of memory per
/// page of the file.
void check_pages(const Pages& pages, CheckScope scope, std::vector<Error>& findings);

}  // namespace slf::storage::internal
