#include "field/write/write_budget.h"

#include <algorithm>

#include "base/try.h"

namespace slf {

constexpr std::uint64_t kMaxBatch = 128;

Result<WriteBudget> WriteBudget::divide(std::uint64_t given, const FieldShape& shape,
                                        unsigned threads, bool copies, const std::string& path) {
  // Each tile under way is at most mapped, or decoded twice and encoded once. The caches beside
  // those that are encoded take as much as these.
  const std::uint64_t samples = shape.max_tile_samples();
  const std::uint64_t tile = copies ? samples * 8 + 4096 : 2 * (samples * 24 + 4096);
  const std::uint64_t least = 3 * tile;
  const std::uint64_t memory = given ? given : std::max(kUsualMemory, least);
  const std::uint64_t tiles = memory / least;
  if (tiles == 0)
    return fail_without("memory", ErrorCode::usage, path, ": needs at least ",
                        (least + 1023) / 1024, "KiB of memory for its tiles, not ", memory,
                        " bytes");
  WriteBudget budget{memory, memory / 3, cache_share(memory)};
  if (copies) budget.batch = std::clamp<std::uint64_t>(tiles / 4, 1, kMaxBatch);
  const std::uint64_t batches = tiles / budget.batch;
  budget.threads = static_cast<unsigned>(std::min<std::uint64_t>(batches, threads));
  budget.window = std::min<std::uint64_t>(batches, 8 * budget.threads);
  return budget;
}

}  // namespace slf
