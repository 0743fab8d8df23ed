// ZstdCodec: lossless, for every format. Predicts samples from their neighbours and compresses the
// residuals with zstd (FORMAT.md, "The zstd codec").
#pragma once

#include <memory>

#include "codec/codec.h"

namespace slf::codec {

/// REQUIRES: 1 <= level <= 22.
[[nodiscard]] std::unique_ptr<Codec> make_zstd_codec(SampleFormat format, int level);

}  // namespace slf::codec
