// The JSON of light rigs. Private to source.
#pragma once

#include <string>

#include "slf/light.h"

namespace slf {

/// Parses the output of to_json(). Input is untrusted. bad_file: anything else; the message names
/// `source` and the member.
[[nodiscard]] Result<LightRig> parse_rig(const std::string& text, const std::string& source);

}  // namespace slf
