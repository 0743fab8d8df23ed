// How much of each light reaches a place: transmittance that is swept through a grid, front to
// back, instead of marched from every place. Private to field/scene.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "field/scene/illumination.h"
#include "field/scene/light_grid.h"
#include "field/scene/medium.h"
#include "slf/error.h"

namespace slf {

/// Mean extinction around each node of a grid, per world unit. Errors as parallel_for().
[[nodiscard]] Result<std::vector<float>> node_extinctions(const Medium& medium,
                                                          const LightGrid& light, unsigned threads);

/// Thread-safety: immutable. Medium and grid must outlive it.
class LightReach {
 public:
  /// Bytes that a node takes for each light, and for all lights while they are swept.
  static constexpr std::uint64_t kBytesPerLight = 2, kBytesOfSweep = 17;

  /// `extinction` is that of the nodes. Lights at a finite distance are not swept: their rays are
  /// not parallel. Errors as parallel_for().
  [[nodiscard]] static Result<LightReach> make(const Medium& medium,
                                               const Illumination& illumination,
                                               const LightGrid& light,
                                               const std::vector<float>& extinction,
                                               unsigned threads);

  /// The share of the light `arrival`, from light number `light`, that reaches a position, in voxel
  /// indices. Marched for the first few nodes, by samples shifted by `shift` as optical_depth()
  /// says; from there on, the mean over the light's disc.
  [[nodiscard]] float operator()(std::size_t light, const IncidentLight& arrival,
                                 const glm::dvec3& from, double shift) const;

 private:
  LightReach(const Medium& medium, const LightGrid& light);

  const Medium& medium_;
  const LightGrid& light_;
  double near_;                     // world units that are marched
  std::vector<std::uint8_t> open_;  // how much each node counts, 1 to 255
  /// Per light, the transmittance at each node times how much it counts; empty if it is not swept.
  std::vector<std::vector<std::uint16_t>> swept_;
};

}  // namespace slf
