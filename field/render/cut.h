// What planes leave of rays and of their samples. Private to field/render.
#pragma once

#include <glm/glm.hpp>
#include <span>
#include <vector>

#include "field/render/ray_block.h"
#include "slf/shape.h"

namespace slf {

/// Half-spaces in the coordinates of a RayBlock; what lies in all of them is kept.
struct KeptSpace {
  struct Plane {
    glm::dvec3 inwards;
    double offset;
  };
  std::vector<Plane> planes{};
  glm::dvec3 eye{0.0};
  bool eye_inside = false;  ///< the sphere: what lies behind the eye is not kept either

  KeptSpace() = default;
  KeptSpace(std::span<const ClipPlane> clip, const Sphere& sphere, const glm::dvec3& world_eye);

  [[nodiscard]] bool all() const { return planes.empty(); }

  /// The part of a ray that is kept, 0 where it enters the sphere and 1 where it leaves; none if
  /// begin >= end.
  struct Part {
    double begin = 0, end = 1;
  };
  [[nodiscard]] Part of(const glm::dvec3& enter, const glm::dvec3& leave) const;
};

/// What became of the samples of a ray.
enum class CutRay : std::uint32_t {
  whole,  ///< they are all kept
  cut,    ///< some are not
  /// a sample has, or may have, matter on both sides of a plane, or one hides behind it, or all
  /// that has matter is translucent: light from the removed side reaches it
  divided
};

/// Makes samples empty that are not kept, by where their depths are along the ray. REQUIRES: the
/// pass has depths.
void cut_samples(const Pass& pass, const RayBlock& rays, const EntryCells& entries,
                 const KeptSpace& kept, bool half_floats, BlockSamples& samples,
                 RayArray<std::uint32_t>& became);

}  // namespace slf
