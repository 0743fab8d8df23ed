#include "field/write/write_budget.h"

#include <algorithm>

#include "base/try.h"

namespace slf {

Result<void> check_memory(std::uint64_t memory, std::uint64_t least, const std::string& path) {
  if (memory >= least) return {};
  return fail_without("memory", ErrorCode::usage, path, ": needs at least ", (least + 1023) / 1024,
                      "KiB of memory for its tiles, not ", memory, " bytes");
}

Result<WriteBudget> WriteBudget::divide(std::uint64_t memory, const FieldShape& shape,
                                        unsigned threads, const std::string& path) {
  // Each tile under way is at most decoded twice and encoded once.
  const std::uint64_t least = 6 * (shape.max_tile_samples() * 24 + 4096);
  SLF_TRY(check_memory(memory, least, path));
  const std::uint64_t tiles = memory / least;
  WriteBudget budget{memory / 3, memory / 12};
  budget.threads = static_cast<unsigned>(std::min<std::uint64_t>(tiles, threads));
  budget.window = std::min<std::uint64_t>(tiles, 8 * budget.threads);
  return budget;
}

}  // namespace slf
