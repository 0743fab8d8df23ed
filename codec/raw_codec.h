// RawCodec: stores the samples unchanged. A reader may use the payload in place.
#pragma once

#include <memory>

#include "codec/codec.h"

namespace slf::codec {

[[nodiscard]] std::unique_ptr<Codec> make_raw_codec();

}  // namespace slf::codec
