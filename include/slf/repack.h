// Rewrites a field into another form: other codecs, layers, levels, subfields or colour type.
//
// Streaming and parallel: memory stays within a budget whatever the field's size. The input is not
// touched. The output is compact, in key order, and appears under its name only when it is whole.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "slf/build.h"
#include "slf/error.h"
#include "slf/field.h"

namespace slf {

struct RepackOptions {
  std::string color_codec;              ///< empty: as it is
  std::string depth_codec;              ///< empty: as it is
  std::vector<std::string> layers;      ///< names to keep; empty: all
  std::optional<unsigned> levels;       ///< the finest level to keep; none: all
  std::vector<std::uint8_t> subfields;  ///< level-0 subfields to keep, ascending; empty: all
  std::optional<bool> half;             ///< colour as half floats (or 8 bits); none: as it is.
                                        ///< Half floats go to zstd where their codec was JPEG
  std::uint64_t memory = 256ull << 20;  ///< bytes of tiles under way and records not yet written
  unsigned threads = 0;                 ///< 0: all
  bool replace = false;                 ///< what is at the output's path, in the last moment
};

struct RepackReport {
  std::uint64_t tiles = 0;    ///< written, stored or empty, of all layers
  std::uint64_t copied = 0;   ///< of tiles: payloads taken over as they were
  std::uint64_t recoded = 0;  ///< of tiles: decoded and encoded anew
  std::uint64_t missing = 0;  ///< never built in the input; missing in the output too
  std::uint64_t payload_bytes = 0;
  std::uint64_t file_bytes = 0;
};

/// Writes the field to `path`, which must not exist unless it is to be replaced. Progress counts
/// tiles. The bytes depend on the input and the options only, never on the threads.
/// A layer whose codec and format stay the same has its payloads copied, byte for byte: JPEG to
/// JPEG at the same quality loses nothing. Lossless to lossless is bit-exact. Colour outside of
/// [0, alpha] is clamped when half floats become 8 bits; 8 bits to half floats and back is exact.
/// A symbolic link at `path` is written through; a file that is replaced passes its permissions on.
/// usage: a codec, layer, level or subfield that makes no sense; `path` exists, or is the input.
/// unsupported: a codec that cannot hold the colour type. bad_file: a damaged tile, named.
/// io: disk full or a write error. failed: stopped by the callback; another process is writing
/// `path`, or has removed the new file. In each case `path` is as it was, and nothing is left
/// beside it; what is left when the process is killed, PATH.repacking, goes with the next repack to
/// `path`.
[[nodiscard]] Result<RepackReport> repack_field(const Field& field, const std::string& path,
                                                const RepackOptions& options,
                                                const ProgressCallback& progress = {});

/// What a repack would write.
struct RepackEstimate {
  std::uint64_t tiles = 0;    ///< stored, empty or missing, of all layers
  std::uint64_t sampled = 0;  ///< of tiles: encoded to estimate the others
  std::uint64_t payload_bytes = 0;
  std::uint64_t payload_error_bytes = 0;  ///< half of a 95 % confidence interval; 0: exact
  std::uint64_t file_bytes = 0;
  std::uint64_t file_error_bytes = 0;  ///< the same
};

/// Estimates it from a sample of a few hundred tiles of each level, chosen by their numbers alone.
/// Layers that are copied are counted. A predictive codec is given the samples of the input to
/// predict from, not those that it would decode itself, so its error is a little larger than
/// stated. Progress counts sampled tiles. Errors as repack_field(), but for those of writing.
[[nodiscard]] Result<RepackEstimate> estimate_repack(const Field& field,
                                                     const RepackOptions& options,
                                                     const ProgressCallback& progress = {});

}  // namespace slf
