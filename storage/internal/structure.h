// The check of a container's every page.
#pragma once

#include <vector>

#include "base/error.h"
#include "storage/internal/pages.h"

namespace slf::storage::internal {

enum class Depth {
  trees,       ///< branch and leaf pages and the free list; values by their extent only
  everything,  ///< also the head of every run of overflow pages, and that no page is lost
};

/// Appends one error per finding, at most a few hundred; the last then says that it gave up.
/// Takes time linear in the pages looked at and one bit of memory per page of the file.
void check_pages(const Pages& pages, Depth depth, std::vector<Error>& findings);

}  // namespace slf::storage::internal
