// One light volume for several scenes of a volume, which differ by what is cut away. Private to
// source/raycast.
#pragma once

#include <string>

#include "source/light/light_volume.h"
#include "source/raycast/volume_scene.h"

namespace slf {

/// usage: `scene` cannot have the light of `from`, because they differ by more than planes that
/// clip, structures, the step and the tone, or `scene` shows matter outside of the box of that
/// light.
[[nodiscard]] Result<void> check_shared_light(const VolumeScene& scene, const VolumeScene& from);

/// The provenance of a scene that has the light of another one: its member `light_of` has the
/// members that the provenance of the other has otherwise.
[[nodiscard]] std::string with_light_of(const std::string& provenance, const std::string& from);

/// `lit`, the light volume of `from`, for `scene`. Nodes that `scene` lays open, which lie less
/// deep below what can be seen than in `from`, get the light of `scene` itself: where that is not
/// so, they would be black. In between, both are blended. All others keep their bytes. REQUIRES:
/// check_shared_light(). Errors as LightComputer.
[[nodiscard]] Result<LightGrid> shared_light(const LightGrid& lit, const VolumeScene& from,
                                             const VolumeScene& scene, const Medium& medium,
                                             unsigned threads, const ProgressCallback& progress);

}  // namespace slf
