#include "source/light/light_depth.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "base/parallel.h"
#include "base/try.h"

namespace slf {
namespace {

/// The 13 neighbours that a raster scan visits before a node, and their distances in world units.
struct Neighbourhood {
  std::array<glm::ivec3, 13> offset;
  std::array<float, 13> length;
};

Neighbourhood neighbours(const Medium& medium, const LightGrid& light) {
  const glm::dmat3 axes = glm::inverse(medium.grid().world_to_index);
  Neighbourhood n;
  for (int k = 0; k < 13; ++k) {
    const glm::ivec3 offset(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1);
    n.offset[k] = offset;
    n.length[k] = static_cast<float>(light.spacing * glm::length(axes * glm::dvec3(offset)));
  }
  return n;
}

/// The depths of nodes that planes lay open, right below these; of others, more than any has.
std::vector<float> depth_below_clip(const Medium& medium, const LightGrid& light,
                                    const std::vector<float>& extinction) {
  std::vector<float> depth(light.size(), 1e30f);
  for (std::size_t k = 0; k < depth.size() && !medium.grid().clip.empty(); ++k) {
    const double below =
        medium.below_clip(light.low + light.spacing * glm::dvec3(node_at(light, k)));
    if (below < light.spacing)
      depth[k] =
          extinction[k] * static_cast<float>(std::max(0.0, below) * medium.smallest_spacing());
  }
  return depth;
}

/// Calls visit(place) for all nodes, in raster order or in reverse.
template <class Visit>
void visit_nodes(const LightGrid& light, bool reverse, const Visit& visit) {
  const std::size_t count = light.size();
  for (std::size_t k = 0; k < count; ++k) visit(node_at(light, reverse ? count - 1 - k : k));
}

}  // namespace

Result<std::vector<float>> node_extinctions(const Medium& medium, const LightGrid& light,
                                            unsigned threads) {
  const RayGrid& grid = medium.grid();
  std::vector<float> extinction(light.size(), 0);
  const int side = std::clamp(static_cast<int>(std::ceil(light.spacing)), 2, 4);
  const double width = 1.0 / side;
  const auto rows = static_cast<std::uint64_t>(light.dims[1]) * light.dims[2];
  const auto nx = static_cast<std::size_t>(light.dims[0]);
  SLF_TRY(parallel_for(rows, threads, [&](std::uint64_t row) {
    for (std::size_t x = 0; x < nx; ++x) {
      const std::size_t number = row * nx + x;
      const glm::ivec3 node = node_at(light, number);
      if (!near_matter(grid, light, node)) continue;
      float sum = 0;
      for (int k = 0; k < side * side * side; ++k) {
        const glm::dvec3 cell(k % side, k / side % side, k / (side * side));
        const glm::dvec3 at = glm::dvec3(node) + (cell + 0.5) * width - 0.5;
        sum += medium.extinction(medium.nearest_inside(light.low + light.spacing * at));
      }
      extinction[number] = sum / static_cast<float>(side * side * side);
    }
  }));
  return extinction;
}

std::vector<float> openness(const Medium& medium, const LightGrid& light,
                            const std::vector<float>& extinction) {
  const glm::ivec3 dims(light.dims[0], light.dims[1], light.dims[2]);
  const Neighbourhood near = neighbours(medium, light);
  const auto below_clip = depth_below_clip(medium, light, extinction);
  std::vector<float> open(light.size()), depth(light.size());
  for (int way = 0; way < 26; ++way) {
    const bool reverse = way >= 13;
    const int n = way % 13;
    visit_nodes(light, reverse, [&](const glm::ivec3& at) {
      const glm::ivec3 from = reverse ? at - near.offset[n] : at + near.offset[n];
      const std::size_t here = number_in(light.dims, at);
      depth[here] = 0;  // where the box around the matter ends
      if (!glm::any(glm::lessThan(from, glm::ivec3(0))) &&
          !glm::any(glm::greaterThanEqual(from, dims))) {
        const std::size_t before = number_in(light.dims, from);
        const float between = 0.5f * (extinction[here] + extinction[before]);
        depth[here] = std::min(below_clip[here], depth[before] + between * near.length[n]);
      }
      open[here] += std::exp(-depth[here]) / 26;
    });
  }
  return open;
}

std::vector<float> depth_from_outside(const Medium& medium, const LightGrid& light,
                                      const std::vector<float>& extinction) {
  const glm::ivec3 dims(light.dims[0], light.dims[1], light.dims[2]);
  const Neighbourhood near = neighbours(medium, light);
  const auto number = [&](const glm::ivec3& at) { return number_in(light.dims, at); };
  auto depth = depth_below_clip(medium, light, extinction);
  const auto relax = [&](const glm::ivec3& at, int sign) {
    const std::size_t here = number(at);
    float best = depth[here];
    for (int n = 0; n < 13; ++n) {
      const glm::ivec3 from = at + sign * near.offset[n];
      const bool inside = !glm::any(glm::lessThan(from, glm::ivec3(0))) &&
                          !glm::any(glm::greaterThanEqual(from, dims));
      if (!inside) {  // the box around the matter ends here
        best = 0;
        break;
      }
      const float between = 0.5f * (extinction[here] + extinction[number(from)]);
      best = std::min(best, depth[number(from)] + between * near.length[n]);
    }
    depth[here] = best;
  };
  for (int round = 0; round < 2; ++round)  // the second round finds paths that turn back
    for (const bool reverse : {false, true})
      visit_nodes(light, reverse, [&](const glm::ivec3& at) { relax(at, reverse ? -1 : 1); });
  return depth;
}

bool near_matter(const RayGrid& grid, const LightGrid& light, const glm::ivec3& node) {
  const glm::dvec3 at = light.low + light.spacing * glm::dvec3(node);
  const glm::ivec3 last(grid.bricks[0] - 1, grid.bricks[1] - 1, grid.bricks[2] - 1);
  const auto brick = [&](const glm::dvec3& p) {
    return glm::clamp(glm::ivec3(glm::floor(p)) >> grid.brick_shift, glm::ivec3(0), last);
  };
  const double reach = (1 + kLookUpBeside) * light.spacing;
  const glm::ivec3 from = brick(at - reach), to = brick(at + reach);
  for (int z = from.z; z <= to.z; ++z)
    for (int y = from.y; y <= to.y; ++y)
      for (int x = from.x; x <= to.x;) {
        const int distance = grid.distance[number_in(grid.bricks, {x, y, z})];
        if (distance == 0) return true;
        x += distance;
      }
  return false;
}

}  // namespace slf
