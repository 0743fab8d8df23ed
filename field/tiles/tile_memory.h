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

  struct Free {
    TileMemory* memory = nullptr;
    std::size_t bytes = 0;
    void operator()(std::byte* block) const { memory->free(block, bytes); }
  };
  /// Must not outlive its TileMemory.
  using Block = std::unique_ptr<std::byte, Free>;

  /// Uninitialised memory, aligned to cache lines. REQUIRES: bytes > 0.
  [[nodiscard]] Block allocate(std::size_t bytes);

 private:
  void free(std::byte* block, std::size_t bytes);
  void add_free(std::uint64_t begin, std::uint64_t size);

  std::byte* base_ = nullptr;
  std::uint64_t capacity_ = 0;
  std::mutex mutex_;                                                // guards what follows
  std::map<std::uint64_t, std::uint64_t> free_;                     // size by begin
  std::set<std::pair<std::uint64_t, std::uint64_t>> free_by_size_;  // (size, begin)
};

}  // namespace slf
