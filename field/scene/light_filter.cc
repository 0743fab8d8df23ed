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

/// The light that rays interpolate at a node. They end at surfaces above it, so the deeper its own
/// matter is hidden, the more it takes from neighbours that show more. Otherwise a surface that
/// passes between the nodes shows them as rings, which this makes fainter.
glm::vec3 as_seen(const LightGrid& light, const std::vector<std::uint32_t>& index,
                  const std::vector<NodeLight>& nodes, const std::vector<glm::vec3>& values,
                  std::size_t number) {
  const NodeLight& center = nodes[index[number]];
  glm::vec4 sum(0);
  for_each_neighbour(light, number, [&](std::size_t other, glm::ivec3 offset) {
    if (index[other] == kNoNode || !nodes[index[other]].lit) return;
    const NodeLight& node = nodes[index[other]];
    const glm::vec3 turn = center.lit ? node.normal - center.normal : glm::vec3(0);
    const float weight =
        closeness(offset) * node.seen * std::exp(-node.depth - 2 * glm::dot(turn, turn));
    sum += weight * glm::vec4(values[index[other]], 1);
  });
  const glm::vec3 own = values[index[number]];
  if (!(sum.w > 0)) return own;
  const float hidden = center.lit ? std::pow(-std::expm1(-center.depth), 6.f) : 1;
  return glm::mix(own, glm::vec3(sum) / sum.w, hidden);
}

}  // namespace

Result<void> filter_light(LightGrid& light, const std::vector<std::uint32_t>& index,
                          const std::vector<std::size_t>& numbers,
                          const std::vector<NodeLight>& nodes, unsigned threads,
                          Reporter& progress) {
  std::vector<glm::vec3> values(numbers.size()), next(numbers.size());
  const auto for_nodes = [&](const auto& work) -> Result<void> {
    constexpr std::size_t kNodes = std::size_t{1} << 17;  // between two reports
    for (std::size_t begin = 0; begin < numbers.size(); begin += kNodes) {
      SLF_TRY(progress.add(0));
      SLF_TRY(parallel_for(std::min(kNodes, numbers.size() - begin), threads,
                           [&, begin](std::uint64_t k) { work(begin + k); }));
    }
    return {};
  };
  const auto for_lit = [&](const auto& work) {
    return for_nodes([&](std::uint64_t k) {
      if (nodes[k].lit) work(k);
    });
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
  light.nodes.assign(light.size(), 0);
  return for_nodes([&](std::uint64_t k) {
    const glm::vec3 value = as_seen(light, index, nodes, values, numbers[k]);
    if (value != glm::vec3(0)) light.nodes[numbers[k]] = pack_light(value);
  });
}

}  // namespace slf
