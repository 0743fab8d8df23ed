// Checks a field from end to end, and drops what is damaged so that a build can refill it.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "slf/build.h"
#include "slf/error.h"
#include "slf/field.h"

namespace slf {

/// What can be wrong. The ids are stable: scripts may rely on them.
enum class FindingKind {
  structure,  ///< S1: a page of the file is damaged, lost or used twice; or it is no container
  manifest,   ///< M1: the manifest or a codec's tables are damaged
  record,     ///< R1: a record of tiles cannot be read
  key,        ///< K1: a tile that this field does not have
  checksum,   ///< T1: a tile's bytes are not what was written
  decode,     ///< T2: a tile's bytes are as written but do not decode
  reference,  ///< T3: a tile is sound, but one that it is predicted from is damaged or missing
  missing,    ///< C1: tiles that the manifest promises were never built, or were dropped
  mismatch,   ///< C2: a tile is stored in one layer and empty in another
};
[[nodiscard]] const char* id(FindingKind kind);

struct Finding {
  FindingKind kind;
  std::string message;
};

struct VerifyOptions {
  bool quick = false;    ///< structure and counts only: no payload is read
  bool fix = false;      ///< drop tiles and records with R1, K1, T1, T2; and C2, in all layers
  unsigned threads = 0;  ///< 0: all
};

struct VerifyReport {
  std::vector<Finding> findings;    ///< the first thousand, in the same order whatever the threads
  std::uint64_t found = 0;          ///< all
  std::uint64_t damaged = 0;        ///< of found: all but C1
  std::uint64_t unfixed = 0;        ///< of damaged: still in the file. Without fix, all
  std::uint64_t tiles = 0;          ///< visited, all layers
  std::uint64_t payload_bytes = 0;  ///< of them
  std::uint64_t dropped = 0;        ///< tiles, and records as a whole, by fix
  bool complete = false;            ///< every tile is there, now
};

/// Progress counts tiles. A damaged file is not an error but a report with findings.
/// io: the file cannot be read at all (or, with fix, written). unsupported: a newer format.
/// failed: stopped by the callback; with fix, another process is using the file.
/// With fix, the file is a field whenever it is stopped.
/// Nothing is dropped where the structure is damaged (S1), since no page can then be trusted.
[[nodiscard]] Result<VerifyReport> verify_field(const std::string& path,
                                                const VerifyOptions& options,
                                                const ProgressCallback& progress = {});
/// The same of an open field, such as a distant one; it opened, so its manifest is sound. usage:
/// options.fix.
[[nodiscard]] Result<VerifyReport> verify_field(const Field& field, const VerifyOptions& options,
                                                const ProgressCallback& progress = {});

}  // namespace slf
