// Blending: from the samples of a block's rays to the pixels, and in mode depth to an estimate of
// where along each ray something is seen. Compiled for several instruction sets. Private to
// field/render.
//
// A ray's result depends on the ray alone, never on its place in a block: lanes do not mix.
#pragma once

#include <glm/glm.hpp>

#include "field/render/ray_block.h"

namespace slf {

/// Blends each ray's samples (eq. 2) into its pixel of a picture: premultiplied colours.
///
/// A pass with depth also estimates the depth along each ray. Without a depth tolerance, the first
/// time, all three vertices are to be aimed at the ray's depth, or not at all where it is too
/// transparent. With one, samples whose depth differs from the aim lose weight, and each vertex is
/// to be aimed halfway between the depth of the ray and that of the vertex's own samples; where
/// they are too transparent the ray's depth stays as it was.
void blend(const Pass& pass, const RayBlock& rays, const EntryCells& entries,
           const BlockSamples& samples, bool half_floats, glm::vec4* picture,
           DepthEstimates& estimates);

}  // namespace slf
