// TileMemory: memory for decoded tiles, in one piece of address space.
//
// Tiles are contiguous, in huge pages if the system provides them, so that gathers from many tiles
// rarely miss the TLB. Freed pieces merge with free neighbours and are reused.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <utility>

namespace slf {

/// Thread-safety: any thread.
class TileMemory {
 public:
  /// Reserves `capacity` bytes of address space. Tiles that do not fit come from the heap.
  explicit TileMemory(std::uint64_t capacity);
  ~TileMemory();
  TileMemory(const TileMemory&) = delete;
  TileMemory& operator=(const TileMemory&) = delete;

  class Free;
  /// Must not outlive its TileMemory. To free it takes no memory.
  using Block = std::unique_ptr<std::byte, Free>;

  /// Uninitialised memory, aligned to cache lines. REQUIRES: bytes > 0.
  [[nodiscard]] Block allocate(std::size_t bytes);

 private:
  using ByBegin = std::map<std::uint64_t, std::uint64_t>;            // size by begin
  using BySize = std::set<std::pair<std::uint64_t, std::uint64_t>>;  // (size, begin)
  /// The memory of a free piece's entries. A block has it from the start, so that its end needs
  /// none: whoever frees a block may be a destructor, at a time when memory is short.
  struct Entries {
    ByBegin::node_type by_begin;
    BySize::node_type by_size;
  };

  [[nodiscard]] static Entries new_entries();
  void add_free(std::uint64_t begin, std::uint64_t size, Entries entries) noexcept;

  std::byte* base_ = nullptr;
  std::uint64_t capacity_ = 0;
  std::mutex mutex_;  // guards what follows
  ByBegin free_;
  BySize free_by_size_;
};

class TileMemory::Free {
 public:
  void operator()(std::byte* block) noexcept;

 private:
  friend class TileMemory;
  TileMemory* memory_ = nullptr;  // null: the block is in `heap_`
  std::unique_ptr<std::byte[]> heap_;
  std::size_t bytes_ = 0;
  Entries entries_;
};

}  // namespace slf
