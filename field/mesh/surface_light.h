// The light that arrives at a mesh: computed at nodes on its triangles, where it is needed first.
// Private to field/mesh.
#pragma once

#include <cstdint>
#include <cstdlib>
#include <glm/glm.hpp>
#include <memory>
#include <vector>

#include "field/mesh/surface.h"
#include "field/scene/illumination.h"

namespace slf {

/// Surfaces are Lambertian, so that light depends on the place and the side, not on the view.
/// Each side of a triangle has a grid of nodes, no further apart than the spacing. Every node uses
/// the same directions, so its light is a function of the node: threads that compute it at the same
/// time write the same bits. Thread-safety: any thread.
class SurfaceLight {
 public:
  SurfaceLight(const Surface& surface, const LightOptions& options);

  /// What a white surface would radiate there.
  [[nodiscard]] glm::vec3 at(const SurfacePoint& point) const { return at(point, bounces_); }

 private:
  struct Node {
    std::uint32_t triangle;
    bool back;
    int i, j, resolution;
  };
  struct Source {
    PlacedLight light;
    unsigned samples;
  };
  struct Ray {
    glm::dvec3 direction;
    glm::vec3 radiance;  // × 1/(π density), for rays to the sky
  };

  void place_nodes(const LightOptions& options);
  [[nodiscard]] int resolution(std::uint32_t triangle) const;
  [[nodiscard]] glm::vec3 at(const SurfacePoint& point, unsigned bounces) const;
  [[nodiscard]] glm::vec3 at(const Node& node, unsigned bounces) const;
  [[nodiscard]] glm::vec3 direct(const Node& node) const;
  [[nodiscard]] glm::vec3 reflected(const Node& node, unsigned bounces) const;
  struct Place {
    glm::dvec3 from;  // a little above the surface
    glm::vec3 normal, face;
  };
  [[nodiscard]] Place place(const Node& node) const;

  const Surface& surface_;
  unsigned bounces_;
  double spacing_ = 0;
  std::vector<std::uint64_t> first_;  // node of each triangle, and their number at the end
  std::vector<Source> sources_;
  std::vector<Ray> sky_;
  bool even_sky_ = true;            // whether sky_ are directions of equal weight
  std::vector<glm::dvec3> sphere_;  // evenly distributed directions, where reflected light is from
  struct Free {
    void operator()(void* memory) const { std::free(memory); }
  };
  /// By bounces, side and node: three half floats, and 1 if they are known. Allocated as zeros, so
  /// that parts that no ray needs use no memory.
  std::unique_ptr<std::uint64_t[], Free> known_;
};

}  // namespace slf
