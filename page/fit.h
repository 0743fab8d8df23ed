// Repacks a field to a given size, for hosts and files with a limit.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "slf/error.h"
#include "slf/repack.h"

namespace slf::page {

/// Repacks states into a field of at most `max_bytes` bytes, with the least loss of quality: with
/// all levels, tries the field's own codecs, then qualities 90, 75, 60 and 45; then the qualities
/// with one level less, and so on. Keeps the first result that fits, and leaves out what is too
/// large by the estimate of estimate_repack(). Codecs or levels that `options` sets are not
/// changed. Errors as join_states(). usage: even the last result is too large; the message states
/// its size. After an error, no file remains.
[[nodiscard]] Result<RepackReport> repack_to_fit(std::span<const StateSource> states,
                                                 const std::string& path,
                                                 const RepackOptions& options,
                                                 std::uint64_t max_bytes,
                                                 const ProgressCallback& progress);

}  // namespace slf::page
