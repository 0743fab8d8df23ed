// The surface of the object in pictures, as a grid of signed distances. Internal.
#pragma once

#include <cstdint>
#include <glm/glm.hpp>
#include <optional>
#include <vector>

#include "slf/shape.h"

namespace slf {

/// A cube of voxels around a sphere. Values are positive outside the object and negative inside;
/// they are distances near the surface, in units of kTruncation voxels, and ±1 further away.
class DistanceField {
 public:
  static constexpr double kTruncation = 4;  ///< voxels

  DistanceField() = default;
  /// All voxels are outside.
  DistanceField(const Sphere& sphere, std::uint32_t side);

  [[nodiscard]] std::uint32_t side() const { return side_; }
  [[nodiscard]] double voxel() const { return voxel_; }
  [[nodiscard]] glm::dvec3 center(std::uint32_t x, std::uint32_t y, std::uint32_t z) const {
    return origin_ + voxel_ * glm::dvec3(x, y, z);
  }
  [[nodiscard]] std::size_t index(std::uint32_t x, std::uint32_t y, std::uint32_t z) const {
    return (std::size_t{z} * side_ + y) * side_ + x;
  }
  /// Sets a value in -1 to 1. After the last one, call finish().
  void set(std::size_t voxel, double value) {
    values_[voxel] = static_cast<std::int8_t>(value * 127 + (value < 0 ? -0.5 : 0.5));
  }
  [[nodiscard]] double get(std::size_t voxel) const { return values_[voxel] / 127.0; }
  void finish();

  /// The smallest sphere around the centre of the box of all voxels inside the object. Radius 0:
  /// there are none.
  [[nodiscard]] Sphere bounds() const;

  /// Where a ray meets the object.
  struct Meeting {
    enum class Kind : std::uint8_t { none, near, hit } kind = Kind::none;
    double t = 0;  ///< of from + t (to - from): the first crossing, or the nearest place
  };
  /// Rays that miss, but come nearer than about a voxel, are `near`.
  [[nodiscard]] Meeting meet(const glm::dvec3& from, const glm::dvec3& to) const;
  /// Where a ray from `eye` first hits the object within a sphere, in lengths of `way`.
  [[nodiscard]] std::optional<double> first_hit(const Sphere& sphere, const glm::dvec3& eye,
                                                const glm::dvec3& way) const;

 private:
  static constexpr std::uint32_t kBlock = 8;
  [[nodiscard]] double at(const glm::dvec3& grid) const;

  std::uint32_t side_ = 0, blocks_ = 0;
  double voxel_ = 1;
  glm::dvec3 origin_{0.0};
  std::vector<std::int8_t> values_;
  std::vector<std::uint8_t> busy_;  ///< per block: some value in or around it is below 1
};

}  // namespace slf
