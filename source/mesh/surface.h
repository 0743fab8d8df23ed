// The surface of a mesh: the nearest triangle on a ray, and the colour there. Private to
// source/mesh.
#pragma once

#include <cstdint>
#include <glm/glm.hpp>
#include <memory>
#include <optional>
#include <vector>

#include "slf/mesh.h"

struct RTCDeviceTy;
struct RTCSceneTy;

namespace slf {

/// A place on a triangle.
struct SurfacePoint {
  std::uint32_t triangle = 0;
  glm::dvec2 at{0};     ///< barycentric coordinates of its second and third corner
  double distance = 0;  ///< from the start of the ray
  bool back = false;    ///< seen from the side from which its corners run clockwise
};

/// usage: the mesh has no triangles or more than 2^28, or an index or a size is out of range.
/// bad_file: a vertex is not finite.
[[nodiscard]] Result<void> check_mesh(const Mesh& mesh);

/// Whether some triangle is not wholly transparent. REQUIRES: a mesh that check_mesh() accepts, but
/// for its positions.
[[nodiscard]] bool can_be_seen(const Mesh& mesh);

/// Thread-safety: immutable. All positions are local: those of `mesh` after make(), in which
/// everything is within about 1 of the origin, so that lengths suit single precision.
class MeshSurface {
 public:
  /// Errors as MeshScene::make().
  [[nodiscard]] static Result<std::unique_ptr<MeshSurface>> make(Mesh mesh);
  ~MeshSurface();

  [[nodiscard]] glm::dvec3 to_local(const glm::dvec3& world) const {
    return (world - center_) / unit_;
  }
  [[nodiscard]] glm::dvec3 to_world(const glm::dvec3& local) const {
    return center_ + unit_ * local;
  }
  [[nodiscard]] const Sphere& bounds() const { return bounds_; }
  [[nodiscard]] double local_radius() const { return bounds_.radius / unit_; }
  [[nodiscard]] const Mesh& mesh() const { return mesh_; }

  /// The first triangle at distances from `near` to `far`; holes of cut-out materials are none.
  /// `direction` is a unit vector.
  [[nodiscard]] std::optional<SurfacePoint> first(const glm::dvec3& from,
                                                  const glm::dvec3& direction, double near,
                                                  double far) const;
  /// Whether there is an opaque one. Translucent ones count as opaque from an alpha of 0.5.
  [[nodiscard]] bool blocked(const glm::dvec3& from, const glm::dvec3& direction, double far) const;

  /// Linear RGB, and alpha: 1 if the surface is not translucent there.
  [[nodiscard]] glm::vec4 color(const SurfacePoint& point) const;
  [[nodiscard]] glm::dvec3 position(const SurfacePoint& point) const;
  /// Unit vectors on the side from which the point is seen: interpolated, and the triangle's own.
  [[nodiscard]] glm::vec3 normal(const SurfacePoint& point) const;
  [[nodiscard]] glm::vec3 face_normal(const SurfacePoint& point) const;

 private:
  explicit MeshSurface(Mesh mesh) : mesh_(std::move(mesh)) {}
  [[nodiscard]] Result<void> place();
  void put_holes_last();
  [[nodiscard]] Result<void> make_tree();
  /// Texture × vertex colour × material: linear RGB and alpha.
  [[nodiscard]] glm::vec4 raw_color(std::uint32_t triangle, const glm::vec2& at) const;
  [[nodiscard]] const MeshMaterial& material(std::uint32_t triangle) const;
  struct Filters;

  Mesh mesh_;
  std::vector<std::uint32_t> normals_;  // of corners, packed
  std::size_t opaque_ = 0;              // triangles before this one have opaque materials
  glm::dvec3 center_{0};
  double unit_ = 1;
  Sphere bounds_;
  RTCDeviceTy* device_ = nullptr;
  RTCSceneTy* tree_ = nullptr;
};

}  // namespace slf
