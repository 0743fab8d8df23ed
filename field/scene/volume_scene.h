// VolumeScene: a volume, its transfer function and its light, ready for rays. Private to
// field/scene.
#pragma once

#include <memory>
#include <string>

#include "field/scene/raycaster_kernel.h"
#include "slf/raycaster.h"

namespace slf {

/// The data that ray-caster and path tracer share. The grid points into the volume.
struct VolumeScene {
  Volume volume;
  RayGrid grid;
  Sphere bounds;
  LightOptions lighting;
  std::string provenance;
};

/// Converts the voxels, makes the tables and finds the visible space; no light volume yet. Errors
/// as Raycaster::make.
[[nodiscard]] Result<std::unique_ptr<VolumeScene>> make_volume_scene(
    Volume volume, const TransferFunction& transfer, const RaycastOptions& options);

}  // namespace slf
