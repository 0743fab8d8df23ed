// A field made small enough for its host.
#pragma once

#include <cstdint>
#include <string>

#include "slf/error.h"
#include "slf/repack.h"

namespace slf::view {

/// Repacks a field into at most `most` bytes, and as little worse as that needs: the first that
/// fits of the qualities 90, 75, 60 and 45 of all levels, then of one level less, and so on.
/// `options` may fix codecs or levels; then only the rest is chosen. Errors as repack_field().
/// usage: not even the last of them fits; the message says how large it is.
[[nodiscard]] Result<RepackReport> repack_to_fit(const Field& field, const std::string& path,
                                                 RepackOptions options, std::uint64_t most,
                                                 const ProgressCallback& progress);

}  // namespace slf::view
