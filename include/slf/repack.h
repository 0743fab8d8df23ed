// Rewrites a field into another form: another codec, other levels, subfields or
// colour type, no depth.
//
// Streaming and parallel: memory stays within a budget whatever the field's size. The input does
// not change. The output is compact, in key order, and gets its name only when it is complete.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "slf/error.h"
#include "slf/field.h"
#include "slf/progress.h"

namespace slf {

struct RepackOptions {
  std::string codec;                     ///< empty: as it is
  bool depth = true;                     ///< keep depths, if the field has them
  std::optional<unsigned> finest_level;  ///< the finest level to keep; none: all
  std::vector<std::uint8_t> subfields;   ///< level-0 subfields to keep, ascending; empty: all
  std::optional<bool> half;              ///< colour as half floats (or 8 bits); none: as it is.
                                         ///< Half floats go to zstd where their codec was JPEG
  bool light = true;                     ///< keep the light of the copy's first state, if the
                                         ///< input has it; no other is kept
  bool reveal = true;                    ///< keep the reveal of the first state that has one
  std::uint64_t memory = 0;  ///< bytes of tiles in progress and records not yet written; 0:
                             ///< 256 MiB, or what the largest tile needs
  unsigned threads = 0;      ///< 0: all
  bool replace = false;      ///< replace a file at the output's path, once the new one is complete
};

struct RepackReport {
  std::uint64_t tiles = 0, copied = 0, recoded = 0, missing = 0, payload_bytes = 0, file_bytes = 0,
                input_bytes = 0;
  std::uint64_t memory = 0;  ///< the budget

  static constexpr const char* kPython = "RepackReport";
  void describe(auto& member) const {
    member("tiles", tiles, "written, stored or empty");
    member("copied", copied, "tiles whose bytes were taken over");
    member("recoded", recoded, "tiles decoded and encoded again");
    member("missing", missing, "tiles that the input lacks, and so the output");
    member("payload_bytes", payload_bytes, "written");
    member("file_bytes", file_bytes, "of the output");
    member("input_bytes", input_bytes, "of the first input");
  }
};

/// Writes the field, in the state that it shows or composed, to `path`, which must not exist unless
/// `replace` is set. Progress counts tiles. The bytes depend on the input and the options only,
/// never on the threads.
///
/// If codec and format stay the same, payloads are copied byte for byte, so JPEG to JPEG at the
/// same quality loses nothing. Lossless to lossless is bit-exact. Colour outside of [0, alpha] is
/// clamped when half floats become 8 bits; 8 bits to half floats and back is exact.
///
/// If `path` is a symbolic link, the file it points to is written. A new file that replaces another
/// gets its permissions.
///
/// usage: a codec, level or subfield that the field cannot have; `path` exists, or is the
/// input. unsupported: a codec that cannot hold the samples. bad_file: a damaged tile; the message
/// names it. io: disk full or a write error. cancelled: the callback stopped the
/// repack. busy: another process is writing `path`. failed: one has removed the new file. After an
/// error `path` is unchanged and no other file remains. A killed process leaves PATH.repacking,
/// which the next repack to `path` removes.
[[nodiscard]] Result<RepackReport> repack_field(const Field& field, const std::string& path,
                                                const RepackOptions& options,
                                                const ProgressCallback& progress = {});

/// A state for a field of several, and the field that shows it (Field::in_state()).
struct StateSource {
  std::string name;
  Field field;
};

/// The states of `field` that are `chosen` by their names or numbers, or all. A field without
/// states, or a composed one, is one, with the name of its file. usage: there is no such state.
[[nodiscard]] Result<std::vector<StateSource>> state_sources(const Field& field,
                                                             std::span<const std::string> chosen);

/// Writes a field of some states, of one or several fields with one sphere, lattice and format. One
/// state: repack_field(). All states of one field, as they are: payloads are copied. Else all tiles
/// are encoded again, as by repack_field(), which has the options and errors; those whose decoded
/// samples are equal are stored once. usage: fields that do not fit together; a state without a
/// name, or with that of another.
[[nodiscard]] Result<RepackReport> join_states(std::span<const StateSource> states,
                                               const std::string& path,
                                               const RepackOptions& options,
                                               const ProgressCallback& progress = {});

/// The size that a repack would have.
struct RepackEstimate {
  std::uint64_t tiles = 0, sampled = 0, payload_bytes = 0, payload_error_bytes = 0, file_bytes = 0,
                file_error_bytes = 0, input_bytes = 0;

  void describe(auto& member) const {
    member("tiles", tiles, "stored, empty or missing");
    member("tiles_sampled", sampled, "of them, encoded to estimate the others");
    member("payload_bytes", payload_bytes, "estimate");
    member("payload_error_bytes", payload_error_bytes,
           "half of a 95 % confidence interval; 0: exact");
    member("file_bytes", file_bytes, "estimate");
    member("file_error_bytes", file_error_bytes, "the same");
    member("input_bytes", input_bytes, "of the input");
  }
};

/// Estimates the size from a sample of a few hundred tiles of each level, which depends on the
/// tiles' numbers alone. Copied payloads are counted exactly. A predictive codec predicts from the
/// input's samples here, not from its own decoded ones, so the error is a little larger than
/// stated. Progress counts sampled tiles. Errors as repack_field(), except those of writing.
[[nodiscard]] Result<RepackEstimate> estimate_repack(const Field& field,
                                                     const RepackOptions& options,
                                                     const ProgressCallback& progress = {});

}  // namespace slf
