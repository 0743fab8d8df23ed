// The filter of the light volume: noise out, edges and shadows kept. Private to source.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <glm/glm.hpp>
#include <limits>
#include <vector>

#include "base/reporter.h"
#include "slf/error.h"
#include "source/light/light_grid.h"
#include "source/medium/medium.h"

namespace slf {

/// The light at one node, and the properties that the filter compares.
struct NodeLight {
  std::array<ArrivingLight, 2> indirect;  // its mean and change, of each pass
  glm::vec3 direct{0};           // of each light of the grid, by how the matter scatters it
  glm::vec3 unshadowed{0};       // as direct, without shadows
  glm::vec3 normal{0};           // mean, times the share of the surface
  float depth = 0;               // optical, below the visible surface
  float seen = 0;                // extinction of what is visible from outside, mean around the node
  float opacity = 0;             // of the visible matter, across one spacing
  bool lit = false;              // there is matter
  std::array<bool, 2> solved{};  // by each pass
  // How much each node around this one, x fastest, counts where rays look up the light of the
  // matter that this one stands for.
  std::array<std::uint8_t, 27> look_ups{};
};
static_assert(sizeof(NodeLight) == 176);

inline constexpr std::uint32_t kNoNode = std::numeric_limits<std::uint32_t>::max();

/// A filtered node depends on nodes up to so many places away, along a chain of neighbours that all
/// have light: two rounds of the filter, and three means in the step of Jacobi's method.
inline constexpr int kFilterReach = 5;

/// Filters the light that a pass solved, as light_volume.h says, and sets the light of the nodes
/// `wanted`, numbers in the grid. They depend on `around`: nodes[k] is what was solved at node
/// around[k], and index[around[k]] is k; index is kNoNode at all other nodes. Errors as
/// parallel_for(). cancelled: stopped by `progress`.
[[nodiscard]] Result<void> filter_light(const Medium& medium, LightGrid& light,
                                        const std::vector<std::uint32_t>& index,
                                        const std::vector<std::size_t>& around,
                                        const std::vector<std::size_t>& wanted,
                                        const std::vector<const NodeLight*>& nodes,
                                        std::size_t pass, unsigned threads, Reporter& progress);

}  // namespace slf
