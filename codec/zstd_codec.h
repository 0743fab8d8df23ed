// ZstdCodec: lossless, for every format. Samples are predicted from their neighbours and what is
// left is compressed with zstd (FORMAT.md, "The zstd codec").
#pragma once

#include <memory>

#include "codec/codec.h"

namespace slf::codec {

/// REQUIRES: 1 <= level <= 22.
[[nodiscard]] std::unique_ptr<Codec> make_zstd_codec(SampleFormat format, int level);

}  // namespace slf::codec
