// The questions that storage_peers asks, one function and one file each.
#pragma once

#include <string>
#include <vector>

#include "benchmarks/storage/report.h"
#include "benchmarks/storage/tile_set.h"

namespace slf::bench {

struct Settings {
  std::string field;            ///< with jpeg colour
  std::string folder;           ///< for the stores; on the disk to be measured
  std::string slf;              ///< the slf command
  int rounds = 5;               ///< of writes; the best counts
  std::size_t megabytes = 256;  ///< payloads of each set that is read
  std::size_t reads = 1024;     ///< tiles read of each, at random
};

/// Random get and decode, hot and cold, by 1 and 8 threads, in every store.
void measure_reads(const Settings& settings, const TileSet& set, Report& report);

/// Building and repacking against encoding alone.
void measure_writes(const Settings& settings, Report& report);

/// Opening stores of 1 k, 32 k and 1 M tiles.
void measure_opens(const Settings& settings, Report& report);

/// Peak anonymous memory of `slf repack` on a field many times larger than its budget.
void measure_memory(const Settings& settings, Report& report);

}  // namespace slf::bench
