// The normals of a mesh's corners, packed. Private to source/mesh.
#pragma once

#include <cstdint>
#include <glm/glm.hpp>
#include <vector>

#include "slf/mesh.h"

namespace slf {

/// A unit vector in 32 bits: octahedral coordinates (Cigolle et al. 2014), to 0.004 degrees.
[[nodiscard]] std::uint32_t pack_normal(const glm::vec3& normal);
[[nodiscard]] glm::vec3 unpack_normal(std::uint32_t packed);

/// Three for each triangle, on the side of the triangle from which its corners run anticlockwise.
/// Where the mesh has no normal, it is the mean of the triangles around, weighted by their angles,
/// that meet the corner's own at less than 60 degrees.
[[nodiscard]] std::vector<std::uint32_t> corner_normals(const Mesh& mesh);

}  // namespace slf
