// The volume as a medium for light: extinction, albedo and the scattering kernel at any point, and
// free flight through it. Private to source.
//
// Positions are in voxel indices; directions are in voxel indices per world unit, so that lengths
// along a ray are in world units. The medium ends at the box around the visible cells.
#pragma once

#include <array>
#include <cstdint>
#include <glm/glm.hpp>
#include <limits>
#include <optional>
#include <vector>

#include "base/mix.h"
#include "source/medium/ray_grid.h"

namespace slf {

/// Extinctions at successive places.
using March = std::array<float, 8>;

/// Computes those at from, from + step, …, from `extinctions`, one for each entry of the grid's
/// table. Places are clamped to the volume. REQUIRES: the grid has no labels and no structures, and
/// its table is not logarithmic. Compiled for several instruction sets.
void march(const RayGrid& grid, const std::vector<float>& extinctions, const glm::vec3& from,
           const glm::vec3& step, March& to);

/// Pseudorandom numbers in [0, 1) from a seed: splitmix64 (Steele, Lea, Flood 2014).
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed) {}
  double operator()() {
    const std::uint64_t bits = mix(state_);
    state_ += kMixStep;
    return static_cast<double>(bits >> 11) * 0x1p-53;
  }

 private:
  std::uint64_t state_;
};

/// The matter at a point. See slf/light.h for the model.
struct Matter {
  glm::dvec3 at{0.0};
  glm::dvec3 start{0.0};   ///< start of the paths of light that is scattered here
  float extinction = 0;    ///< per world unit
  glm::vec3 albedo{0};     ///< share of light that is scattered
  glm::dvec3 normal{0.0};  ///< unit, world; 0 where there is no gradient
  float surface = 0;       ///< share of the surface in the scattering kernel

  /// K(ω), per steradian; ω is a unit world direction.
  [[nodiscard]] double kernel(const glm::dvec3& direction) const;
  /// A direction with the density K/∫K. REQUIRES: choice, u and v are in [0, 1).
  [[nodiscard]] glm::dvec3 sample(double choice, double u, double v) const;
};

/// The single-scattering albedo of isotropic matter of which a thick piece has the colour `color`:
/// Chiang, Kutz, Burley, "Practical and controllable subsurface scattering for production path
/// tracing", SIGGRAPH Talks 2016; scaled so that white stays white.
[[nodiscard]] glm::vec3 albedo_of(const glm::vec3& color);

/// A uniform direction, and one with the density max(0, n·ω)/π.
[[nodiscard]] glm::dvec3 uniform_direction(double u, double v);
[[nodiscard]] glm::dvec3 cosine_direction(const glm::dvec3& normal, double u, double v);

/// Thread-safety: immutable. The grid must outlive it.
class Medium {
 public:
  /// On `threads` threads (0: all).
  explicit Medium(const RayGrid& grid, unsigned threads = 0);

  [[nodiscard]] float extinction(const glm::dvec3& at) const;
  [[nodiscard]] Matter matter(const glm::dvec3& at) const;
  /// TransferTable::albedos.
  [[nodiscard]] const std::vector<glm::vec4>& albedos() const { return albedos_; }
  /// A unit world direction as voxel indices per world unit.
  [[nodiscard]] glm::dvec3 per_world(const glm::dvec3& direction) const {
    return grid_.world_to_index * direction;
  }
  [[nodiscard]] glm::dvec3 world(const glm::dvec3& at) const {
    return grid_.origin + index_to_world_ * at;
  }
  /// Between voxels, along the axis where they are closest; world units.
  [[nodiscard]] double smallest_spacing() const { return smallest_spacing_; }
  [[nodiscard]] const RayGrid& grid() const { return grid_; }
  /// The position in what the medium fills that is nearest to `at`; where planes meet, one near it.
  [[nodiscard]] glm::dvec3 nearest_inside(const glm::dvec3& at) const;
  /// How far a position lies below the faces that end the medium: of its box, and of planes that
  /// clip it; in voxels. Negative outside.
  [[nodiscard]] double below_box(const glm::dvec3& at) const;
  [[nodiscard]] double below_clip(const glm::dvec3& at) const;

  /// The distance at which light from `from` first interacts with matter, if it is below `length`
  /// world units. Unbiased: delta tracking (Woodcock et al. 1965) with a majorant per brick, which
  /// leaps over empty bricks.
  [[nodiscard]] std::optional<double> fly(const glm::dvec3& from, const glm::dvec3& direction,
                                          double length, Random& random) const;

  /// The optical depth along `length` world units, by the midpoint rule with steps of
  /// kStep of the smallest voxel spacing; the samples are shifted by `shift`, 0 to 1, of that.
  /// Stops at kDark.
  [[nodiscard]] double optical_depth(const glm::dvec3& from, const glm::dvec3& direction,
                                     double length, double shift) const;
  /// An optical depth through which no visible light passes: e^-7 is less than 0.1 %.
  static constexpr double kDark = 7;
  static constexpr double kStep = 0.5;

 private:
  struct Brick {
    std::size_t number;
    double end;  // where the ray leaves the brick, or the empty cube around it
    bool empty;
  };
  [[nodiscard]] bool clip(const glm::dvec3& from, const glm::dvec3& direction, double& begin,
                          double& end) const;
  [[nodiscard]] Brick brick(const glm::dvec3& from, const glm::dvec3& direction,
                            const glm::dvec3& inverse, double t) const;
  /// The first `count` extinctions at from, from + step, …; all of `to` may change.
  void extinctions(const glm::dvec3& from, const glm::dvec3& step, int count, March& to) const;
  [[nodiscard]] std::size_t entry(const glm::dvec3& at) const;
  void find_majorants(unsigned threads);

  const RayGrid& grid_;
  glm::dmat3 index_to_world_;
  double smallest_spacing_ = std::numeric_limits<double>::max();
  std::vector<float> extinctions_;  // per table entry and world unit
  std::vector<glm::vec4> albedos_;  // per table entry
  std::vector<float> majorants_;    // per brick
};

}  // namespace slf
