#include "source/pictures/camera_index.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace slf {
namespace {

constexpr std::uint32_t kLeaves = 8;  // of a node without halves

}  // namespace

CameraIndex::CameraIndex(const std::vector<glm::dvec3>& eyes,
                         const std::vector<double>& coarseness) {
  for (std::size_t k = 0; k < eyes.size(); ++k) leaves_.push_back({eyes[k], coarseness[k], k});
  if (!leaves_.empty()) split(0, static_cast<std::uint32_t>(leaves_.size()));
}

void CameraIndex::split(std::uint32_t first, std::uint32_t end) {
  glm::dvec3 low = leaves_[first].eye, high = low;
  for (std::uint32_t k = first; k < end; ++k) {
    low = glm::min(low, leaves_[k].eye);
    high = glm::max(high, leaves_[k].eye);
  }
  Node node{.center = 0.5 * (low + high),
            .coarseness = leaves_[first].coarseness,
            .first = first,
            .end = end};
  for (std::uint32_t k = first; k < end; ++k) {
    node.radius = std::max(node.radius, glm::distance(node.center, leaves_[k].eye));
    node.coarseness = std::min(node.coarseness, leaves_[k].coarseness);
  }
  const std::size_t number = nodes_.size();
  nodes_.push_back(node);
  if (end - first <= kLeaves) return;
  const glm::dvec3 size = high - low;
  const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
  const std::uint32_t middle = first + (end - first) / 2;
  std::nth_element(leaves_.begin() + first, leaves_.begin() + middle, leaves_.begin() + end,
                   [&](const Leaf& a, const Leaf& b) {
                     return a.eye[axis] != b.eye[axis] ? a.eye[axis] < b.eye[axis]
                                                       : a.camera < b.camera;
                   });
  split(first, middle);
  nodes_[number].other = static_cast<std::uint32_t>(nodes_.size());
  split(middle, end);
}

double CameraIndex::least_penalty(const Node& node, const glm::dvec3& point,
                                  const glm::dvec3& back) {
  const glm::dvec3 toward = node.center - point;
  const double distance = glm::length(toward);
  if (!(distance > node.radius)) return node.coarseness;
  // The ball covers directions up to `half` from its centre's, which is `angle` from `back`.
  const double cos_angle = std::clamp(glm::dot(toward, back) / distance, -1.0, 1.0);
  const double sin_half = node.radius / distance;
  const double cos_half = std::sqrt(1 - sin_half * sin_half);
  if (cos_angle >= cos_half) return node.coarseness;
  const double cosine = cos_angle * cos_half + std::sqrt(1 - cos_angle * cos_angle) * sin_half;
  return std::sqrt(std::max(0.0, 2 - 2 * cosine)) + node.coarseness;
}

std::size_t CameraIndex::nearest(const glm::dvec3& point, const glm::dvec3& back,
                                 std::span<Near> out) const {
  // Rounding must not hide a camera that is nearest by less.
  constexpr double kRounding = 1e-6;
  std::size_t count = 0;
  if (out.empty() || nodes_.empty()) return 0;
  struct Open {
    double least;
    std::uint32_t node;
  };
  std::array<Open, 64> open;  // halves of up to 2^32 leaves
  std::size_t opened = 0;
  open[opened++] = {0, 0};
  while (opened > 0) {
    const auto [least, number] = open[--opened];
    if (count == out.size() && least - kRounding > out[count - 1].penalty) continue;
    const Node& node = nodes_[number];
    if (node.other != 0) {
      const Open one{least_penalty(nodes_[number + 1], point, back), number + 1},
          other{least_penalty(nodes_[node.other], point, back), node.other};
      // The nearer half comes first.
      open[opened++] = one.least <= other.least ? other : one;
      open[opened++] = one.least <= other.least ? one : other;
      continue;
    }
    for (std::uint32_t k = node.first; k < node.end; ++k) {
      const Leaf& leaf = leaves_[k];
      const glm::dvec3 toward = leaf.eye - point;
      const double cosine = glm::dot(toward, back) / glm::length(toward);
      const Near near{std::sqrt(std::max(0.0, 2 - 2 * cosine)) + leaf.coarseness, leaf.camera};
      if (count == out.size() && !(near < out[count - 1])) continue;
      if (count < out.size()) ++count;
      std::size_t at = count - 1;
      for (; at > 0 && near < out[at - 1]; --at) out[at] = out[at - 1];
      out[at] = near;
    }
  }
  return count;
}

}  // namespace slf
