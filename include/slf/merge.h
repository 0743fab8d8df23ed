// Joins parts of a field into one: shards of a build, levels, or subfields.
//
// Streaming, in key order: no tile is decoded, and memory stays within a budget whatever the size
// and the number of the parts. The output has the same layout as that of repack_field().
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "slf/error.h"
#include "slf/progress.h"

namespace slf {

struct MergeOptions {
  std::uint64_t memory = 0;  ///< bytes of tiles in progress and records not yet written; 0:
                             ///< 256 MiB, or what the largest tile needs
  unsigned threads = 0;      ///< 0: all
  bool part = false;  ///< the first or last tiles may be missing: the output is then a part itself
  bool replace = false;  ///< replace a file at the output's path, once the new one is complete
};

struct MergeReport {
  std::uint64_t tiles = 0, payload_bytes = 0, file_bytes = 0, parts = 0;
  std::uint64_t memory = 0;  ///< the budget

  static constexpr const char* kPython = "MergeReport";
  void describe(auto& member) const {
    member("tiles", tiles, "written, stored or empty");
    member("payload_bytes", payload_bytes, "written");
    member("file_bytes", file_bytes, "of the output");
    member("parts", parts, "files");
  }
};

/// Writes to `path` the field that `parts`, in any order, make up together. All parts have the same
/// settings, source, states and codec tables. Each is a shard (Field::part()), has levels 0 to some
/// level, or has some of the subfields. A shard may also store tiles outside its part; they are not
/// merged. Progress counts tiles. The bytes depend neither on the order of the parts nor on the
/// threads.
///
/// When repack_field() cuts subfields out of a predictive field, or join_states() levels, it
/// encodes their tiles again. A merge of such fields has these tiles, not those of the original
/// field; it cannot include shards.
///
/// All parts are opened and compared before the output is created.
/// usage: no parts; two parts hold the same tiles, a part has other settings or tables than the
/// rest, or tiles are in no part; the message names the parts or tiles. `path` exists, or is one of
/// the parts. not_found: a part does not exist. failed: a part is not finished, or changed during
/// the merge. cancelled: the callback stopped it. busy: another process is writing `path`.
/// bad_file: a damaged tile; the message names it. io: disk full, or another error of reading or
/// writing. After an error `path` is unchanged and no other file remains. A killed
/// process leaves PATH.repacking, which the next merge to `path` removes.
[[nodiscard]] Result<MergeReport> merge_fields(const std::vector<std::string>& parts,
                                               const std::string& path, const MergeOptions& options,
                                               const ProgressCallback& progress = {});

}  // namespace slf
