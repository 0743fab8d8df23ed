#include "field/render/page_table.h"

#include <sys/mman.h>

#include <utility>

namespace slf {

PageTable PageTable::make(std::uint64_t entry_sections, std::uint64_t exit_sections) {
  PageTable table;
  table.chunks_across_ = (exit_sections + kChunk - 1) / kChunk;
  table.chunk_count_ = entry_sections * table.chunks_across_;
  // Zeros, and no memory until it is written.
  void* const at = mmap(nullptr, table.chunk_count_ * sizeof(*table.chunks_),
                        PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (at != MAP_FAILED) table.chunks_ = static_cast<std::atomic<Chunk*>*>(at);
  return table;
}

PageTable::PageTable(PageTable&& other) noexcept
    : chunks_(std::exchange(other.chunks_, nullptr)),
      chunks_across_(other.chunks_across_),
      chunk_count_(other.chunk_count_),
      owned_(std::move(other.owned_)) {}

PageTable& PageTable::operator=(PageTable&& other) noexcept {
  std::swap(chunks_, other.chunks_);
  std::swap(chunks_across_, other.chunks_across_);
  std::swap(chunk_count_, other.chunk_count_);
  std::swap(owned_, other.owned_);
  return *this;
}

PageTable::~PageTable() {
  if (chunks_) munmap(chunks_, chunk_count_ * sizeof(*chunks_));
}

TilePage& PageTable::make_page(std::uint32_t entry, std::uint32_t exit) {
  std::atomic<Chunk*>& place = chunks_[entry * chunks_across_ + exit / kChunk];
  Chunk* chunk = place.load(std::memory_order_relaxed);
  if (!chunk) {
    chunk = owned_.emplace_back(std::make_unique<Chunk>()).get();
    place.store(chunk, std::memory_order_release);
  }
  return chunk->pages[exit % kChunk];
}

}  // namespace slf
