// The content of a volume, as one short text.
#pragma once

#include <string>

#include "slf/volume.h"

namespace slf {

/// "xxh3-128:" and 32 hexadecimal digits: a hash of the voxels and of all that says where they lie
/// and what they mean. Equal for equal volumes, wherever they were read from.
[[nodiscard]] std::string content_hash(const Volume& volume);

}  // namespace slf
