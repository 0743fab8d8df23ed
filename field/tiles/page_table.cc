#include "field/tiles/page_table.h"

#include <sys/mman.h>

#include <bit>
#include <utility>

namespace slf {

PageTable PageTable::make(std::uint64_t entry_sections, std::uint64_t exit_sections) {
  PageTable table;
  table.exit_bits_ = std::countr_zero(exit_sections);
  if (__builtin_mul_overflow(entry_sections, exit_sections * sizeof(TilePage), &table.bytes_))
    return table;
  // The kernel provides zeros, which are pages of absent tiles, and uses no memory until a write.
  void* const at = mmap(nullptr, table.bytes_, PROT_READ | PROT_WRITE,
                        MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (at != MAP_FAILED) table.pages_ = static_cast<TilePage*>(at);
  return table;
}

PageTable::PageTable(PageTable&& other) noexcept
    : pages_(std::exchange(other.pages_, nullptr)),
      exit_bits_(other.exit_bits_),
      bytes_(other.bytes_) {}

PageTable& PageTable::operator=(PageTable&& other) noexcept {
  std::swap(pages_, other.pages_);
  std::swap(exit_bits_, other.exit_bits_);
  std::swap(bytes_, other.bytes_);
  return *this;
}

PageTable::~PageTable() {
  if (pages_) munmap(pages_, bytes_);
}

}  // namespace slf
