#include "field/tiles/tile_memory.h"

#include <sys/mman.h>

#include <algorithm>
#include <new>

namespace slf {

namespace {
constexpr std::uint64_t kLine = 64, kHugePage = 2 << 20;
// Larger than any cache. Address space that is never written takes no memory.
constexpr std::uint64_t kMaxReserved = 1ull << 40;

constexpr std::uint64_t whole_lines(std::uint64_t bytes) {
  return (bytes + kLine - 1) / kLine * kLine;
}
}  // namespace

TileMemory::TileMemory(std::uint64_t capacity)
    : capacity_(std::min(capacity, kMaxReserved) / kHugePage * kHugePage) {
  if (capacity_ == 0) return;
  void* const at = mmap(nullptr, capacity_ + kHugePage, PROT_READ | PROT_WRITE,
                        MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (at == MAP_FAILED) {
    capacity_ = 0;
    return;
  }
  // Keep the part that begins with a huge page.
  auto* const begin = static_cast<std::byte*>(at);
  const std::uint64_t skip = -reinterpret_cast<std::uintptr_t>(at) % kHugePage;
  base_ = begin + skip;
  if (skip > 0) munmap(begin, skip);
  if (skip < kHugePage) munmap(base_ + capacity_, kHugePage - skip);
  madvise(base_, capacity_, MADV_HUGEPAGE);
  add_free(0, capacity_);
}

TileMemory::~TileMemory() {
  if (base_) munmap(base_, capacity_);
}

TileMemory::Block TileMemory::allocate(std::size_t bytes) {
  const std::uint64_t size = whole_lines(bytes);
  const Free deleter{this, bytes};
  const std::lock_guard lock(mutex_);
  const auto found = free_by_size_.lower_bound({size, 0});  // the smallest that fits
  if (found == free_by_size_.end())
    return {static_cast<std::byte*>(::operator new(size, std::align_val_t(kLine))), deleter};
  const auto [had, begin] = *found;
  free_by_size_.erase(found);
  free_.erase(begin);
  if (had > size) {
    free_.emplace(begin + size, had - size);
    free_by_size_.emplace(had - size, begin + size);
  }
  return {base_ + begin, deleter};
}

void TileMemory::free(std::byte* block, std::size_t bytes) {
  if (!base_ || block < base_ || block >= base_ + capacity_)
    return ::operator delete(block, std::align_val_t(kLine));
  const std::lock_guard lock(mutex_);
  add_free(static_cast<std::uint64_t>(block - base_), whole_lines(bytes));
}

void TileMemory::add_free(std::uint64_t begin, std::uint64_t size) {
  auto next = free_.lower_bound(begin);
  if (next != free_.end() && begin + size == next->first) {
    size += next->second;
    free_by_size_.erase({next->second, next->first});
    next = free_.erase(next);
  }
  if (next != free_.begin()) {
    const auto before = std::prev(next);
    if (before->first + before->second == begin) {
      begin = before->first;
      size += before->second;
      free_by_size_.erase({before->second, before->first});
      free_.erase(before);
    }
  }
  free_.emplace(begin, size);
  free_by_size_.emplace(size, begin);
}

}  // namespace slf
