#include "tests/memory/allocations.h"

#include <atomic>
#include <cstdlib>
#include <new>

namespace slf::testing {
namespace {

constexpr std::int64_t kNever = std::int64_t{1} << 62;

std::atomic<std::int64_t> left{kNever};  // allocations until the one that fails
std::atomic<bool> all_later{false};
std::atomic<bool> failed{false};
std::atomic<std::int64_t> live{0};

void* allocate(std::size_t bytes, std::size_t alignment) {
  const std::int64_t mine = left.fetch_sub(1);
  if (mine == 0 || (mine < 0 && all_later)) {
    failed = true;
    throw std::bad_alloc();
  }
  void* const at = std::aligned_alloc(alignment, (bytes + alignment - 1) / alignment * alignment);
  if (!at) throw std::bad_alloc();
  ++live;
  return at;
}

void release(void* at) {
  if (at) --live;
  std::free(at);
}

}  // namespace

void fail_allocation(std::int64_t count, Later later) {
  failed = false;
  all_later = later == Later::fail;
  left = count;
}

bool stop_failing() {
  all_later = false;
  left = kNever;
  return failed;
}

std::int64_t live_allocations() { return live; }

}  // namespace slf::testing

using slf::testing::allocate;
using slf::testing::release;

// The other forms, of arrays and nothrow, call these.
void* operator new(std::size_t bytes) { return allocate(bytes, __STDCPP_DEFAULT_NEW_ALIGNMENT__); }
void* operator new(std::size_t bytes, std::align_val_t alignment) {
  return allocate(bytes, static_cast<std::size_t>(alignment));
}
void operator delete(void* at) noexcept { release(at); }
void operator delete(void* at, std::size_t) noexcept { release(at); }
void operator delete(void* at, std::align_val_t) noexcept { release(at); }
void operator delete(void* at, std::size_t, std::align_val_t) noexcept { release(at); }
