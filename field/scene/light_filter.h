// The filter of the light volume: noise out, edges and shadows kept. Private to field/scene.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <glm/glm.hpp>
#include <limits>
#include <vector>

#include "base/reporter.h"
#include "field/scene/light_grid.h"
#include "field/scene/medium.h"
#include "slf/error.h"

namespace slf {

/// The light at one node, and the properties that the filter compares.
struct NodeLight {
  ArrivingLight indirect;   // its mean and change
  glm::vec3 direct{0};      // of each light of the grid, by how the matter scatters it
  glm::vec3 unshadowed{0};  // as direct, without shadows
  glm::vec3 normal{0};      // mean, times the share of the surface
  float depth = 0;          // optical, below the visible surface
  float seen = 0;           // extinction of what is visible from outside, mean around the node
  float opacity = 0;        // of the visible matter, across one spacing
  bool lit = false;         // there is matter
  // How much each node around this one, x fastest, counts where rays look up the light of the
  // matter that this one stands for.
  std::array<std::uint8_t, 27> look_ups{};
};
static_assert(sizeof(NodeLight) == 124);

inline constexpr std::uint32_t kNoNode = std::numeric_limits<std::uint32_t>::max();

/// Filters the light that was solved at some nodes, as light_volume.h says, and sets the light of
/// all nodes of the grid. nodes[k] is that of node numbers[k], and index[numbers[k]] is k; index is
/// kNoNode at all other nodes, which become dark. Errors as parallel_for(). cancelled: stopped by
/// `progress`.
[[nodiscard]] Result<void> filter_light(const Medium& medium, LightGrid& light,
                                        const std::vector<std::uint32_t>& index,
                                        const std::vector<std::size_t>& numbers,
                                        const std::vector<NodeLight>& nodes, unsigned threads,
                                        Reporter& progress);

}  // namespace slf
