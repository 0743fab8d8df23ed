// The record of a scene in a field's manifest. Private to field/scene.
#pragma once

#include <string>

#include "slf/raycaster.h"

namespace slf {

/// Scene::provenance() of a volume: a JSON object of every setting that changes its rays.
/// raycast_options() reads the options back.
[[nodiscard]] std::string describe(const Volume& volume, const TransferFunction& transfer,
                                   const RaycastOptions& options);

/// The members of such an object on which a light volume depends: not the source's path, nor tone
/// mapping.
[[nodiscard]] std::string light_key(const std::string& provenance);

}  // namespace slf
