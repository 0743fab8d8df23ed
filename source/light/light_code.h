// The coded form of a light volume, which a field keeps (doc/format/optional.md, "Light").
// Private to source.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "base/bytes.h"
#include "source/light/light_grid.h"

namespace slf {

/// Begins the bytes of every version.
inline constexpr std::string_view kLightMagic = "SLG";

/// Codes a light volume without loss, with a key that identifies its inputs. No bytes if memory
/// does not suffice.
[[nodiscard]] Bytes encode_light(const std::string& key, const LightGrid& light);

/// Decodes a light volume into the nodes of `plan`, a grid without nodes. Nothing if the bytes are
/// damaged, or of another key or grid. Input is untrusted.
[[nodiscard]] std::optional<LightGrid> decode_light(ByteSpan coded, const std::string& key,
                                                    LightGrid plan);

}  // namespace slf
