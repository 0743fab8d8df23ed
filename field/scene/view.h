// Views of a scene itself, without a field: the ground truth that fields are compared with.
#pragma once

#include <cstdint>

#include "slf/camera.h"
#include "slf/error.h"
#include "slf/image.h"
#include "slf/scene.h"

namespace slf {

/// Traces every pixel's ray through `sphere`, from the eye where that is inside it, on `threads`
/// threads (0: all). Image::depth is filled. The result does not depend on the threads.
/// usage: a bad camera.
[[nodiscard]] Result<Image> trace_view(const Scene& scene, const Sphere& sphere,
                                       const Camera& camera, unsigned threads = 0);

}  // namespace slf
