// Repacks a field to a given size, for hosts and files with a limit.
#pragma once

#include <cstdint>
#include <string>

#include "slf/error.h"
#include "slf/repack.h"

namespace slf::view {

/// Repacks a field into at most `most` bytes, with the least loss of quality. Tries qualities 90,
/// 75, 60 and 45 with all levels, then with one level less, and so on, and keeps the first result
/// that fits. Codecs or levels that `options` sets are not changed. Errors as repack_field().
/// usage: even the last result is too large; the message states its size.
[[nodiscard]] Result<RepackReport> repack_to_fit(const Field& field, const std::string& path,
                                                 RepackOptions options, std::uint64_t most,
                                                 const ProgressCallback& progress);

}  // namespace slf::view
