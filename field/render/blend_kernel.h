// Blending: computes the pixels of a block's rays from their samples and, in mode depth, estimates
// the depth along each ray. Compiled for several instruction sets. Private to field/render.
#pragma once

#include <glm/glm.hpp>

#include "field/render/ray_block.h"

namespace slf {

/// Blends each ray's samples (eq. 2) into its pixel of a picture: premultiplied colours.
///
/// A pass with depth also estimates the depth along each ray, and the next aim of each entry vertex
/// (doc/drawing.md, "Mode depth"). An aim is a depth along the ray, of the point through which the
/// vertex's next line passes:
///  - Without a depth tolerance, in the first pass, all three vertices aim at the ray's depth. Rays
///    that are too transparent get no further pass.
///  - With a tolerance, samples whose depth differs from the aim lose weight. Each vertex aims
///    halfway between the ray's depth and the depth of its own samples. If the ray, or the vertex's
///    samples, are too transparent to have a depth, the ray's last depth is used.
void blend(const Pass& pass, const RayBlock& rays, const EntryCells& entries,
           const BlockSamples& samples, bool half_floats, glm::vec4* picture,
           DepthEstimates& estimates);

/// The cubic pass of mode depth (doc/drawing.md, "Mode depth", step 5): adds to the rays' pixels
/// what a cubic between exit vertices differs from linear interpolation. REQUIRES: a cubic pass,
/// whose aims are those of `estimates`.
void add_cubic(const Pass& pass, const RayBlock& rays, const EntryCells& entries,
               const BlockSamples& samples, bool half_floats, const DepthEstimates& estimates,
               glm::vec4* picture);

}  // namespace slf
