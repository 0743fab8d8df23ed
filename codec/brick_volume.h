// Codes a volume of bytes, in bricks (doc/format/optional.md, "Reveal").
#pragma once

#include <array>
#include <cstdint>

#include "base/bytes.h"
#include "slf/error.h"

namespace slf::codec {

/// Edge of a brick, in voxels.
inline constexpr std::uint32_t kVolumeBrick = 32;
/// Of the coarse volume, which comes first: every fourth voxel along each axis.
inline constexpr std::uint32_t kCoarseStep = 4;

/// Codes voxels, x fastest, on `threads` threads (0: all); the bytes do not depend on them. Decoded
/// ones differ by `loss` at most. REQUIRES: as many voxels as the dims say, at least 1 along each
/// axis; loss 0 to 127.
[[nodiscard]] Result<Bytes> encode_volume(const std::array<std::uint32_t, 3>& dims, ByteSpan voxels,
                                          int loss, unsigned threads);

/// The voxels. Input is untrusted. bad_file: it is damaged. REQUIRES: dims and loss as of
/// encode_volume().
[[nodiscard]] Result<Bytes> decode_volume(const std::array<std::uint32_t, 3>& dims, ByteSpan coded,
                                          int loss, unsigned threads);

}  // namespace slf::codec
