// The JSON of light rigs. Private to this room.
#pragma once

#include <string>

#include "slf/light.h"

namespace slf {

/// Reads what to_json() writes. Input is untrusted. bad_file: names `source` and the member.
[[nodiscard]] Result<LightRig> parse_rig(const std::string& text, const std::string& source);

}  // namespace slf
