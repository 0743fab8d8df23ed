#include "source/light/light_filter.h"

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
              const std::vector<const NodeLight*>& nodes, std::size_t number, const F& value) {
  const NodeLight& center = *nodes[index[number]];
  decltype(value(0)) sum{};
  float total = 0;
  for_each_neighbour(light, number, [&](std::size_t other, glm::ivec3 offset) {
    if (index[other] == kNoNode || !nodes[index[other]]->lit) return;
    const NodeLight& node = *nodes[index[other]];
    const glm::vec3 turn = node.normal - center.normal;
    const float deeper = node.depth - center.depth;
    const float weight =
        closeness(offset) * std::exp(-16 * glm::dot(turn, turn) - 0.5f * deeper * deeper);
    sum += weight * value(index[other]);
    total += weight;
  });
  return 1 / total * sum;
}

/// The light of a node and its neighbours, by what can be seen of each. Below an opaque surface,
/// light falls off within less than a spacing. A surface that passes between nodes would show as
/// rings, so each takes from those above and below it. To the side it takes almost nothing, for
/// folds to stay sharp. `axes` turns offsets in nodes into world directions.
ArrivingLight as_seen(const LightGrid& light, const std::vector<std::uint32_t>& index,
                      const std::vector<const NodeLight*>& nodes,
                      const std::vector<ArrivingLight>& values, std::size_t number,
                      const glm::mat3& axes) {
  constexpr float kAround = 0.01f;
  const NodeLight& center = *nodes[index[number]];
  const auto unit = [](const glm::vec3& n) { return n / std::max(glm::length(n), 1e-6f); };
  const glm::vec3 normal = unit(center.normal);
  ArrivingLight sum;
  float total = 0;
  for_each_neighbour(light, number, [&](std::size_t other, glm::ivec3 offset) {
    if (index[other] == kNoNode || !nodes[index[other]]->lit) return;
    const NodeLight& node = *nodes[index[other]];
    float weight = closeness(offset);
    if (center.lit && other != number) {
      const glm::vec3 way = axes * glm::vec3(offset);
      const glm::vec3 aside = way - glm::dot(way, normal) * normal;
      const float turn = 1 - glm::dot(normal, unit(node.normal));
      weight = center.opacity * (kAround * weight + std::exp(-4 * (glm::dot(aside, aside) + turn)));
    }
    sum += weight * node.seen * values[index[other]];
    total += weight * node.seen;
  });
  return total > 0 ? 1 / total * sum : values[index[number]];
}

/// What rays that show the matter of a node find, given what all nodes have.
ArrivingLight found_at(const LightGrid& light, const std::vector<std::uint32_t>& index,
                       const std::vector<const NodeLight*>& nodes,
                       const std::vector<ArrivingLight>& values, std::size_t number) {
  const std::uint8_t* weight = nodes[index[number]]->look_ups.data();
  ArrivingLight sum;
  float total = 0;
  for_each_neighbour(light, number, [&](std::size_t other, glm::ivec3 offset) {
    if (index[other] == kNoNode) return;
    const auto share = static_cast<float>(weight[neighbour_number(offset)]);
    sum += share * values[index[other]];
    total += share;
  });
  return total > 0 ? 1 / total * sum : values[index[number]];
}

}  // namespace

Result<void> filter_light(const Medium& medium, LightGrid& light,
                          const std::vector<std::uint32_t>& index,
                          const std::vector<std::size_t>& around,
                          const std::vector<std::size_t>& wanted,
                          const std::vector<const NodeLight*>& nodes, std::size_t pass,
                          unsigned threads, Reporter& progress) {
  const glm::mat3 axes(glm::inverse(medium.grid().world_to_index) / medium.smallest_spacing());
  std::vector<ArrivingLight> values(nodes.size()), next(nodes.size());
  // Calls work(number, place in `nodes`).
  const auto for_nodes = [&](const std::vector<std::size_t>& numbers,
                             const auto& work) -> Result<void> {
    constexpr std::size_t kNodes = std::size_t{1} << 17;  // between two reports
    for (std::size_t begin = 0; begin < numbers.size(); begin += kNodes) {
      SLF_TRY(progress.add(0));
      SLF_TRY(parallel_for(
          std::min(kNodes, numbers.size() - begin), threads,
          [&, begin](std::uint64_t k) { work(numbers[begin + k], index[numbers[begin + k]]); }));
    }
    return {};
  };
  const auto for_lit = [&](const auto& work) {
    return for_nodes(around, [&](std::size_t number, std::uint32_t k) {
      if (nodes[k]->lit) work(number, k);
    });
  };
  for (std::size_t k = 0; k < nodes.size(); ++k) values[k] = nodes[k]->indirect[pass];
  for (int round = 0; round < 2; ++round) {
    SLF_TRY(for_lit([&](std::size_t number, std::uint32_t k) {
      next[k] =
          filtered(light, index, nodes, number, [&](std::size_t other) { return values[other]; });
    }));
    std::swap(values, next);
  }
  // Shadows are filtered as a share of the light that would arrive without them.
  SLF_TRY(for_lit([&](std::size_t number, std::uint32_t k) {
    const auto mean = filtered(light, index, nodes, number, [&](std::size_t other) {
      return glm::mat2x3(nodes[other]->direct, nodes[other]->unshadowed);
    });
    values[k].arrives = mean[0] / glm::max(mean[1], glm::vec3(1e-12f));
  }));
  // A node's light is a mean, and rays interpolate between nodes: both blur. This step of Jacobi's
  // method makes rays find the means.
  SLF_TRY(for_nodes(around, [&](std::size_t number, std::uint32_t k) {
    next[k] = as_seen(light, index, nodes, values, number, axes);
  }));
  SLF_TRY(for_lit([&](std::size_t number, std::uint32_t k) {
    values[k] += values[k] - found_at(light, index, nodes, next, number);
    values[k].mean = glm::max(values[k].mean, 0.f);
    values[k].arrives = glm::clamp(values[k].arrives, 0.f, kMaxArrives);
  }));
  return for_nodes(wanted, [&](std::size_t number, std::uint32_t) {
    const ArrivingLight value = as_seen(light, index, nodes, values, number, axes);
    std::uint8_t* node = light.node(number);
    std::fill_n(node, LightGrid::kNodeBytes, std::uint8_t{0});
    if (value.mean != glm::vec3(0) || value.arrives != glm::vec3(0)) pack_light(value, node);
  });
}

}  // namespace slf
