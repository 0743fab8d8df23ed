// The light that arrives at a mesh: computed at nodes on its triangles, where a ray first needs it.
// Private to source/mesh.
#pragma once

#include <cstdint>
#include <cstdlib>
#include <glm/glm.hpp>
#include <memory>
#include <vector>

#include "source/light/illumination.h"
#include "source/mesh/surface.h"

namespace slf {

/// Surfaces are Lambertian, so light depends on the place and the side, not on the view. A triangle
/// has a grid of nodes on each side, or one node if it is smaller than half their distance. Light
/// that surfaces reflect is gathered from a coarser choice of the nodes.
///
/// All nodes use the same directions, so the light of a node is a function of the node: threads
/// that compute it at the same time write the same bits. Thread-safety: any thread.
class SurfaceLight {
 public:
  SurfaceLight(const MeshSurface& surface, const LightOptions& options);

  /// What a white surface would radiate there.
  [[nodiscard]] glm::vec3 at(const SurfacePoint& point) const;

 private:
  struct Node {
    std::uint32_t triangle;
    bool back;
    int i, j;        // column and row, of which one more than `resolution` are on the long edges
    int resolution;  // 0: the only node, in the middle
  };
  struct Place {
    glm::dvec3 from;  // a little above the surface
    glm::dvec3 normal, face;
  };
  struct Ray {
    glm::dvec3 direction;
    glm::vec3 radiance;
  };

  void place_nodes(double spacing, std::uint64_t memory);
  void choose_coarse_nodes();
  [[nodiscard]] int resolution(std::uint32_t triangle) const;
  [[nodiscard]] Place place(const Node& node) const;
  /// The node from which light that this point reflects is taken.
  [[nodiscard]] Node coarse(const SurfacePoint& point) const;
  /// The light at a node, with `bounces` reflections: kept, or computed.
  [[nodiscard]] glm::vec3 at(const Node& node, unsigned bounces) const;
  [[nodiscard]] glm::vec3 from_lights(const Place& place) const;
  [[nodiscard]] glm::vec3 from_around(const Place& place, unsigned bounces) const;

  const MeshSurface& surface_;
  unsigned bounces_;
  std::vector<PlacedLight> near_lights_;
  std::vector<Ray> far_lights_;  // and samples of a sky with peaks; × 1/π
  std::vector<Ray> around_;      // evenly distributed, with the radiance of a sky without peaks
  double spacing_ = 0;
  std::vector<std::uint64_t> first_;   // node of each triangle, and their number at the end
  std::vector<std::uint32_t> coarse_;  // of each triangle, one that stands for it
  struct Free {
    void operator()(void* memory) const { std::free(memory); }
  };
  /// By bounces, side and node: three half floats, and 1 if they are known. Allocated as zeros, so
  /// that parts that no ray needs use no memory.
  std::unique_ptr<std::uint64_t[], Free> known_;
};

}  // namespace slf
