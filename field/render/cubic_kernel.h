// The cubic pass of mode depth (doc/drawing.md, "Mode depth", step 5). Compiled for several
// instruction sets. Private to field/render.
#pragma once

#include <glm/glm.hpp>

#include "field/render/ray_block.h"

namespace slf {

/// Adds to the rays' pixels what a cubic between exit vertices differs from linear interpolation.
/// REQUIRES: a cubic pass, whose aims are those of `estimates`.
void add_cubic(const Pass& pass, const RayBlock& rays, const EntryCells& entries,
               const BlockSamples& samples, bool half_floats, const DepthEstimates& estimates,
               glm::vec4* picture);

}  // namespace slf
