// Joins fields that were built or repacked apart into one: shards of a build, levels, subfields.
//
// Streaming, in key order: nothing is decoded, and memory stays within a budget whatever the size
// and the number of the parts. The output is laid out as repack_field() lays it out.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "slf/build.h"
#include "slf/error.h"

namespace slf {

struct MergeOptions {
  std::uint64_t memory = 256ull << 20;  ///< bytes of tiles under way and records not yet written
  unsigned threads = 0;                 ///< 0: all
  bool part = false;  ///< tiles may be left out at the beginning or the end: the output is a part
  bool replace = false;  ///< what is at the output's path, in the last moment
};

struct MergeReport {
  std::uint64_t tiles = 0;  ///< written, stored or empty, of all layers
  std::uint64_t payload_bytes = 0;
  std::uint64_t file_bytes = 0;
};

/// Writes to `path` the field that `parts`, in any order, make up together. Parts have the
/// settings, the source and the tables of one field; each is a part of it (Field::part()), some of
/// its levels from 0 on, or some of its subfields. Tiles that a shard stores besides its part are
/// left out. Subfields of a predictive field were encoded anew by repack_field(), among
/// themselves: the merged field has their tiles, not those of the field from which they were cut,
/// and they do not go together with shards. Progress counts tiles. The bytes do not depend on the
/// order of the parts, nor on the threads.
///
/// Before anything is written, all parts are opened and compared.
/// usage: no parts; two hold the same tiles, one differs in settings or tables from the others, or
/// together they leave tiles out; the message names them. `path` exists, or is one of the parts.
/// failed: a part was not finished; stopped by the callback; a part was changed meanwhile.
/// bad_file: a damaged tile, named. io: disk full, or another error of reading or writing.
/// In each case `path` is as it was, and nothing is left beside it; what is left when the process
/// is killed, PATH.repacking, goes with the next merge to `path`.
[[nodiscard]] Result<MergeReport> merge_fields(const std::vector<std::string>& parts,
                                               const std::string& path, const MergeOptions& options,
                                               const ProgressCallback& progress = {});

}  // namespace slf
