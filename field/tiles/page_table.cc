#include "field/tiles/page_table.h"

#include <sys/mman.h>

#include <bit>

namespace slf {

PageTable PageTable::make(std::uint64_t entry_sections, std::uint64_t exit_sections) {
  PageTable table;
  table.exit_bits_ = std::countr_zero(exit_sections);
  std::size_t bytes = 0;
  if (__builtin_mul_overflow(entry_sections, exit_sections * sizeof(TilePage), &bytes))
    return table;
  // The kernel provides zeros, which are pages of absent tiles, and uses no memory until a write.
  void* const at = mmap(nullptr, bytes, PROT_READ | PROT_WRITE,
                        MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (at == MAP_FAILED) return table;
  // Of a large table few tiles are in use, far apart: 4 KiB each, not the 2 MiB of huge pages.
  (void)madvise(at, bytes, MADV_NOHUGEPAGE);
  table.pages_ = {static_cast<TilePage*>(at), Unmap{bytes}};
  return table;
}

void PageTable::Unmap::operator()(TilePage* pages) const { munmap(pages, bytes); }

}  // namespace slf
