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
  add_free(0, capacity_, new_entries());
}

TileMemory::~TileMemory() {
  if (base_) munmap(base_, capacity_);
}

TileMemory::Entries TileMemory::new_entries() {
  ByBegin by_begin{{0, 0}};
  BySize by_size{{0, 0}};
  return {by_begin.extract(by_begin.begin()), by_size.extract(by_size.begin())};
}

TileMemory::Block TileMemory::allocate(std::size_t bytes) {
  Free free;
  free.bytes_ = whole_lines(bytes);
  free.entries_ = new_entries();
  const std::lock_guard lock(mutex_);
  const auto found = free_by_size_.lower_bound({free.bytes_, 0});  // the smallest that fits
  if (found == free_by_size_.end()) {
    // Not aligned_alloc(): glibc before 2.38 cannot reuse what that frees for a block of equal
    // size.
    free.heap_ = std::make_unique_for_overwrite<std::byte[]>(free.bytes_ + kLine);
    const auto at = reinterpret_cast<std::uintptr_t>(free.heap_.get());
    std::byte* const block = free.heap_.get() + (whole_lines(at) - at);
    return {block, std::move(free)};
  }
  free.memory_ = this;
  const auto [had, begin] = *found;
  Entries entries{free_.extract(begin), free_by_size_.extract(found)};
  if (had > free.bytes_) add_free(begin + free.bytes_, had - free.bytes_, std::move(entries));
  return {base_ + begin, std::move(free)};
}

void TileMemory::Free::operator()(std::byte* block) noexcept {
  if (!memory_) return heap_.reset();
  const std::lock_guard lock(memory_->mutex_);
  memory_->add_free(static_cast<std::uint64_t>(block - memory_->base_), bytes_,
                    std::move(entries_));
}

void TileMemory::add_free(std::uint64_t begin, std::uint64_t size, Entries entries) noexcept {
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
  entries.by_begin.key() = begin;
  entries.by_begin.mapped() = size;
  entries.by_size.value() = {size, begin};
  free_.insert(std::move(entries.by_begin));
  free_by_size_.insert(std::move(entries.by_size));
}

}  // namespace slf
