// The hash of a volume's content.
#pragma once

#include <string>

#include "slf/volume.h"

namespace slf {

/// ContentHash::text() of the voxels, their geometry, scale and type. Equal volumes have equal
/// hashes, whatever file they were read from.
[[nodiscard]] std::string content_hash(const Volume& volume);

}  // namespace slf
