// Makes allocations of this process fail, and counts those that live: operator new and delete are
// replaced for the whole program.
#pragma once

#include <cstdint>

namespace slf::testing {

enum class Later { succeed, fail };

/// From now on lets `count` allocations succeed, on all threads together, and fails the next one,
/// and the later ones if these are to fail, too.
void fail_allocation(std::int64_t count, Later later);
/// Ends that. Returns whether an allocation has failed.
bool stop_failing();

/// Allocations that were not freed yet.
[[nodiscard]] std::int64_t live_allocations();

}  // namespace slf::testing
