#include "field/scene/light_filter.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace slf {
namespace {

/// 1 in the middle, 1/2, 1/4, 1/8 at faces, edges and corners.
float closeness(const glm::ivec3& offset) {
  return std::exp2(
      -static_cast<float>(std::abs(offset.x) + std::abs(offset.y) + std::abs(offset.z)));
}

/// The mean of value(place in `nodes`) over a node and its neighbours, which count less the more
/// they differ.
template <class F>
auto filtered(const LightGrid& light, const std::vector<std::uint32_t>& index,
              const std::vector<NodeLight>& nodes, std::size_t number, const F& value) {
  const NodeLight& center = nodes[index[number]];
  decltype(value(0)) sum(0);
  float total = 0;
  for_each_neighbour(light, number, [&](std::size_t other, glm::ivec3 offset) {
    if (index[other] == kNoNode || !nodes[index[other]].lit) return;
    const NodeLight& node = nodes[index[other]];
    const glm::vec3 turn = node.normal - center.normal;
    const float deeper = node.depth - center.depth;
    const float weight =
        closeness(offset) * std::exp(-16 * glm::dot(turn, turn) - 0.5f * deeper * deeper);
    sum += weight * value(index[other]);
    total += weight;
  });
  return sum / total;
}

/// For a node without matter of its own: the mean of its lit neighbours, since rays near them
/// interpolate between both.
glm::vec3 mean_around(const LightGrid& light, const std::vector<std::uint32_t>& index,
                      const std::vector<NodeLight>& nodes, const std::vector<glm::vec3>& values,
                      std::size_t number) {
  glm::vec4 sum(0);
  for_each_neighbour(light, number, [&](std::size_t other, glm::ivec3) {
    if (index[other] != kNoNode && nodes[index[other]].lit)
      sum += glm::vec4(values[index[other]], 1);
  });
  return sum.w > 0 ? glm::vec3(sum) / sum.w : glm::vec3(0);
}

/// The light that rays interpolate at a node. Rays end at surfaces above it, so the deeper its own
/// matter is hidden, the more it takes from neighbours that are seen; otherwise a surface that
/// passes between the nodes shows them as rings.
glm::vec3 as_seen(const LightGrid& light, const std::vector<std::uint32_t>& index,
                  const std::vector<NodeLight>& nodes, const std::vector<glm::vec3>& values,
                  std::size_t number) {
  const NodeLight& center = nodes[index[number]];
  glm::vec4 sum(0);
  for_each_neighbour(light, number, [&](std::size_t other, glm::ivec3 offset) {
    if (index[other] == kNoNode || !nodes[index[other]].lit) return;
    const NodeLight& node = nodes[index[other]];
    const glm::vec3 turn = node.normal - center.normal;
    const float weight = closeness(offset) * std::exp(-2 * (node.depth + glm::dot(turn, turn)));
    sum += weight * glm::vec4(values[index[other]], 1);
  });
  const float hidden = std::pow(-std::expm1(-center.depth), 6.f);
  const glm::vec3 own = values[index[number]];
  return sum.w > 0 ? glm::mix(own, glm::vec3(sum) / sum.w, hidden) : own;
}

}  // namespace

Result<void> filter_light(LightGrid& light, const std::vector<std::uint32_t>& index,
                          const std::vector<std::size_t>& numbers,
                          const std::vector<NodeLight>& nodes, unsigned threads,
                          Reporter& progress) {
  std::vector<glm::vec3> values(numbers.size()), next(numbers.size());
  const auto for_lit = [&](const auto& work) -> Result<void> {
    constexpr std::size_t kNodes = std::size_t{1} << 17;  // between two reports
    for (std::size_t begin = 0; begin < numbers.size(); begin += kNodes) {
      SLF_TRY(progress.add(0));
      SLF_TRY(parallel_for(std::min(kNodes, numbers.size() - begin), threads,
                           [&, begin](std::uint64_t k) {
                             if (nodes[begin + k].lit) work(begin + k);
                           }));
    }
    return {};
  };
  for (std::size_t k = 0; k < numbers.size(); ++k) values[k] = nodes[k].indirect;
  for (int round = 0; round < 2; ++round) {
    SLF_TRY(for_lit([&](std::uint64_t k) {
      next[k] = filtered(light, index, nodes, numbers[k],
                         [&](std::size_t other) { return values[other]; });
    }));
    std::swap(values, next);
  }
  // Shadows are filtered as a share of the light that would arrive without them, so that shading by
  // normals stays sharp.
  SLF_TRY(for_lit([&](std::uint64_t k) {
    const auto mean = filtered(light, index, nodes, numbers[k], [&](std::size_t other) {
      return glm::mat2x3(nodes[other].direct, nodes[other].unshadowed);
    });
    values[k] += nodes[k].unshadowed * mean[0] / glm::max(mean[1], glm::vec3(1e-30f));
  }));
  SLF_TRY(for_lit(
      [&](std::uint64_t k) { next[k] = as_seen(light, index, nodes, values, numbers[k]); }));
  std::swap(values, next);
  light.nodes.assign(light.size(), 0);
  for (std::size_t k = 0; k < numbers.size(); ++k) {
    const glm::vec3 value =
        nodes[k].lit ? values[k] : mean_around(light, index, nodes, values, numbers[k]);
    if (value != glm::vec3(0)) light.nodes[numbers[k]] = pack_light(value);
  }
  return {};
}

}  // namespace slf
