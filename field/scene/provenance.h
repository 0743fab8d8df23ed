// What a field's manifest records of a scene. Private to this room.
#pragma once

#include <string>

#include "slf/raycaster.h"

namespace slf {

/// Scene::provenance() of a volume: a JSON object of every setting that changes its rays.
/// raycast_options() reads the options back.
[[nodiscard]] std::string describe(const Volume& volume, const TransferFunction& transfer,
                                   const RaycastOptions& options);

/// Of such an object, what a light volume depends on: not its path, nor how colours are shown.
[[nodiscard]] std::string light_key(const std::string& provenance);

}  // namespace slf
