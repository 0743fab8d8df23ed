// Checks a whole field, and drops damaged tiles so that a build can make them again.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "slf/error.h"
#include "slf/field.h"
#include "slf/progress.h"

namespace slf {

/// The kinds of faults. Their ids (S1 …) are stable: scripts may rely on them.
enum class FindingKind {
  structure,  ///< S1: a page of the file is damaged, lost or used twice, or the file is no
              ///< container
  manifest,   ///< M1: the manifest or a codec's tables are damaged
  light,      ///< L1: the light that the field keeps is damaged; views do not need it
  reveal,     ///< V1: the reveal of the field is damaged; views without cuts do not need it
  record,     ///< R1: a record of tiles cannot be read
  key,        ///< K1: a tile whose key does not belong to this field
  checksum,   ///< T1: a tile's bytes do not match their checksum
  decode,     ///< T2: a tile's bytes match their checksum but do not decode
  reference,  ///< T3: a tile that this one is predicted from, or the same as, is damaged or missing
  missing,    ///< C1: tiles of the field, or of its part, were never built, or were dropped
};
[[nodiscard]] const char* id(FindingKind kind);

struct Finding {
  FindingKind kind = FindingKind::structure;
  std::string message{};

  static constexpr const char* kPython = "Finding";
  void describe(auto& member) const {
    member({"id", "kind"}, id(kind), "as slf verify prints it; stable",
           R"("enum": ["S1", "M1", "L1", "V1", "R1", "K1", "T1", "T2", "T3", "C1"])");
    member("message", message, "file, place and cause");
  }
};

struct VerifyOptions {
  bool quick = false;  ///< check structure and counts only: no payload is read
  bool fix = false;    ///< drop records with R1, tiles with K1, T1, T2, and what has L1 or V1
  std::uint64_t memory = 256ull << 20;  ///< bytes of decoded tiles and records under way
  unsigned threads = 0;                 ///< 0: all
};

struct VerifyReport {
  std::vector<Finding> findings;
  std::uint64_t found = 0, damaged = 0, unfixed = 0, tiles = 0, payload_bytes = 0, dropped = 0;
  bool complete = false;

  static constexpr const char* kPython = "VerifyReport";
  void describe(auto& member) const {
    member("findings", findings, "the first 1000; their order does not depend on the threads");
    member("found", found, "all findings");
    member("damaged", damaged, "findings of damage: all but C1 and T3");
    member("unfixed", unfixed, "of those, still in the file");
    member("tiles", tiles, "visited");
    member("payload_bytes", payload_bytes, "of them");
    member("dropped", dropped, "tiles, and whole records, that fix dropped");
    member("complete", complete, "no tile is missing, after dropping");
  }
};

/// Checks every page, record and tile. Progress counts tiles. Damage is not an error but a finding
/// in the report, if the bytes prove it. not_found, io: the file cannot be read (or, with fix,
/// written). unsupported: another version of the format, or levels too large for such a file.
/// out_of_memory. cancelled: the callback stopped the check. busy: with fix, another process is
/// writing the file. After an error nothing is dropped.
///
/// With fix, the file stays a valid field even if the process is killed. If the structure is
/// damaged (S1), nothing is dropped, because no page can be trusted.
[[nodiscard]] Result<VerifyReport> verify_field(const std::string& path,
                                                const VerifyOptions& options,
                                                const ProgressCallback& progress = {});
/// Checks an open field, such as a remote one. usage: options.fix is set.
[[nodiscard]] Result<VerifyReport> verify_field(const Field& field, const VerifyOptions& options,
                                                const ProgressCallback& progress = {});

}  // namespace slf
