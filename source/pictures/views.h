// The pictures as the search for the surface uses them: small and undistorted. Internal.
#pragma once

#include <cstdint>
#include <glm/glm.hpp>
#include <optional>
#include <vector>

#include "slf/pictures.h"
#include "source/pictures/distance_field.h"

namespace slf {

/// A picture as by a pinhole camera, in 8 bits, about as fine as the grid of the surface.
struct SmallView {
  std::uint32_t width = 0, height = 0;
  double fx = 0, fy = 0, cx = 0, cy = 0;  ///< pixels
  glm::dmat3 axes{1.0};                   ///< as Picture's
  glm::dvec3 eye{0.0};
  std::vector<glm::u8vec4> rgba;        ///< premultiplied
  std::vector<float> depth;             ///< along z, in world units; 0: not known; or empty
  bool whole = false;                   ///< the silhouette ends within the picture
  std::vector<std::uint8_t> confirmed;  ///< number of other views that confirm the depth; or empty

  /// Place in pixels and depth along z. REQUIRES: nothing; z <= 0 is behind the camera.
  [[nodiscard]] glm::dvec3 project(const glm::dvec3& world) const {
    const glm::dvec3 v = (world - eye) * axes;
    return {fx * v.x / v.z + cx, fy * v.y / v.z + cy, v.z};
  }
  /// The number of the pixel at a place that project() found; none outside of the picture.
  [[nodiscard]] std::optional<std::size_t> pixel_at(const glm::dvec3& place) const {
    if (!(place.z > 0 && place.x >= 0 && place.y >= 0 && place.x < width && place.y < height))
      return std::nullopt;
    return static_cast<std::size_t>(place.y) * width + static_cast<std::size_t>(place.x);
  }
  /// Directions of z 1, in the camera's axes and in the world.
  [[nodiscard]] glm::dvec3 in_camera(double x, double y) const {
    return {(x - cx) / fx, (y - cy) / fy, 1};
  }
  [[nodiscard]] glm::dvec3 direction(double x, double y) const { return axes * in_camera(x, y); }
};

/// Shrinks and undistorts a picture: its pixels become `factor` times as large.
[[nodiscard]] SmallView make_small_view(const Picture& picture, const Image& image,
                                        std::uint32_t factor);

/// Sets the values of the grid to the visual hull: what is in the silhouettes of all views that see
/// it, if these are a quarter of all. Views whose silhouettes are whole also show what is not the
/// object beside their pictures: a third of them suffice, as single ones may show a part only.
[[nodiscard]] Result<void> carve(const std::vector<SmallView>& views, unsigned threads,
                                 DistanceField& surface);

/// Fills `depth` of each view by comparing it with views from nearby directions (plane sweep):
/// of the 8 nearest, the half that agrees best counts, so that occlusion does not spoil it. Only
/// depths remain that those of other views confirm and, with a hull, no other depth is as likely
/// as; `confirmed` counts these. Searches within the sphere, behind the hull if `hull` is given.
/// So many threads search at a time as `memory` has room for, at least one.
[[nodiscard]] Result<void> estimate_depth(const Sphere& sphere, const DistanceField* hull,
                                          unsigned threads, std::uint64_t memory,
                                          const ProgressCallback& progress,
                                          std::vector<SmallView>& views);

/// Sets `confirmed` of each view, whose depths are known. Compares with the views that
/// estimate_depth() takes.
[[nodiscard]] Result<void> count_confirmations(const glm::dvec3& center, unsigned threads,
                                               std::vector<SmallView>& views);

/// Adds depths to the grid: the mean of the truncated distances to them (Curless and Levoy 1996),
/// where that is further inside than the value so far. With `hull`, what no depth is known of
/// stays as it is, and its value counts as that many depths; else it becomes empty.
[[nodiscard]] Result<void> fuse(const std::vector<SmallView>& views, bool hull, double hull_weight,
                                unsigned threads, DistanceField& surface);

}  // namespace slf
