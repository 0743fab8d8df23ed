#include "source/mesh/normals.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numeric>
#include <span>
#include <tuple>

namespace slf {
namespace {

constexpr float kCrease = 0.5f;  // cosine of 60 degrees
/// Corners at one place whose angles are compared in pairs. In larger fans all count as smooth, and
/// are added up by their direction, in 8x8 bins, so that time does not grow with their square.
constexpr std::size_t kMaxCompared = 128;

float sign(float v) { return v < 0 ? -1.f : 1.f; }

bool is_direction(const glm::vec3& v) {
  const float length = glm::dot(v, v);
  return length > 0 && std::isfinite(length);
}

/// For each vertex, the first one at the same place.
std::vector<std::uint32_t> weld(const std::vector<glm::vec3>& positions) {
  std::vector<std::uint32_t> order(positions.size()), first(positions.size());
  std::iota(order.begin(), order.end(), 0u);
  const auto key = [&](std::uint32_t k) {
    const glm::vec3& p = positions[k];
    return std::tuple(p.x, p.y, p.z);
  };
  std::ranges::sort(order, [&](std::uint32_t a, std::uint32_t b) {
    return std::tuple_cat(key(a), std::tuple(a)) < std::tuple_cat(key(b), std::tuple(b));
  });
  for (std::size_t k = 0; k < order.size(); ++k)
    first[order[k]] = k > 0 && key(order[k]) == key(order[k - 1]) ? first[order[k - 1]] : order[k];
  return first;
}

/// Makes normals from the triangles around.
class Smoother {
 public:
  explicit Smoother(const Mesh& mesh) : mesh_(mesh), place_(weld(mesh.positions)) {
    start_.assign(mesh.positions.size() + 1, 0);
    for (const glm::uvec3& t : mesh.triangles)
      for (int c = 0; c < 3; ++c) ++start_[place_[t[c]] + 1];
    std::partial_sum(start_.begin(), start_.end(), start_.begin());
    corners_.resize(3 * mesh.triangles.size());
    std::vector<std::uint32_t> next(start_.begin(), start_.end() - 1);
    for (std::uint32_t k = 0; k < corners_.size(); ++k)
      corners_[next[place_[mesh.triangles[k / 3][static_cast<int>(k % 3)]]]++] = k;
  }

  glm::vec3 normal(std::uint32_t triangle, int corner, const glm::vec3& own) {
    const std::uint32_t place = place_[mesh_.triangles[triangle][corner]];
    const std::span around(corners_.data() + start_[place], start_[place + 1] - start_[place]);
    glm::vec3 sum(0);
    // Files do not agree on the order of corners, and surfaces are two-sided.
    if (around.size() > kMaxCompared) {
      for (const glm::vec3& faces : directions(place, around))
        sum += sign(glm::dot(faces, own)) * faces;
    } else {
      for (const std::uint32_t other : around) {
        const auto [face, angle] = corner_of(other);
        const float cosine = glm::dot(face, own);
        if (std::abs(cosine) >= kCrease) sum += angle * sign(cosine) * face;
      }
    }
    return is_direction(sum) ? glm::normalize(sum) : own;
  }

 private:
  using Directions = std::array<glm::vec3, 64>;

  /// The normals of the triangles around a place, weighted by their angles and added up by bins.
  const Directions& directions(std::uint32_t place, std::span<const std::uint32_t> around) {
    const auto [found, is_new] = directions_.try_emplace(place, Directions{});
    for (std::size_t k = 0; is_new && k < around.size(); ++k) {
      const auto [face, angle] = corner_of(around[k]);
      if (!(angle > 0)) continue;
      const std::uint32_t packed = pack_normal(face);
      found->second[(packed >> 13 & 7) + 8 * (packed >> 29 & 7)] += angle * face;
    }
    return found->second;
  }

  /// The triangle's unit normal, and its angle at the corner.
  std::pair<glm::vec3, float> corner_of(std::uint32_t corner) const {
    const glm::uvec3& t = mesh_.triangles[corner / 3];
    const auto c = static_cast<int>(corner % 3);
    const glm::vec3& p = mesh_.positions[t[c]];
    const glm::vec3 a = mesh_.positions[t[(c + 1) % 3]] - p,
                    b = mesh_.positions[t[(c + 2) % 3]] - p;
    const glm::vec3 across = glm::cross(a, b);
    const float length = glm::length(across);
    if (!(length > 0)) return {glm::vec3(0), 0.f};
    return {across / length, std::atan2(length, glm::dot(a, b))};
  }

  const Mesh& mesh_;
  std::vector<std::uint32_t> place_;                // of each vertex
  std::vector<std::uint32_t> start_;                // in corners_, of each place
  std::vector<std::uint32_t> corners_;              // 3 * triangle + corner
  std::map<std::uint32_t, Directions> directions_;  // of places with large fans
};

}  // namespace

std::uint32_t pack_normal(const glm::vec3& normal) {
  glm::vec3 n = normal / (std::abs(normal.x) + std::abs(normal.y) + std::abs(normal.z));
  if (n.z < 0) n = {(1 - std::abs(n.y)) * sign(n.x), (1 - std::abs(n.x)) * sign(n.y), n.z};
  const auto part = [](float v) {
    return static_cast<std::uint32_t>(std::lround((std::clamp(v, -1.f, 1.f) + 1) * 32767));
  };
  return part(n.x) | part(n.y) << 16;
}

glm::vec3 unpack_normal(std::uint32_t packed) {
  const float x = static_cast<float>(packed & 0xFFFF) / 32767 - 1;
  const float y = static_cast<float>(packed >> 16) / 32767 - 1;
  const float z = 1 - std::abs(x) - std::abs(y);
  const float fold = std::max(-z, 0.f);
  return glm::normalize(glm::vec3(x - sign(x) * fold, y - sign(y) * fold, z));
}

std::vector<std::uint32_t> corner_normals(const Mesh& mesh) {
  const bool missing = mesh.normals.empty() || !std::ranges::all_of(mesh.normals, is_direction);
  std::optional<Smoother> smoother;
  if (missing) smoother.emplace(mesh);
  std::vector<std::uint32_t> packed;
  packed.reserve(3 * mesh.triangles.size());
  for (std::uint32_t k = 0; k < mesh.triangles.size(); ++k) {
    const glm::uvec3& t = mesh.triangles[k];
    const glm::vec3& p = mesh.positions[t[0]];
    glm::vec3 face = glm::cross(mesh.positions[t[1]] - p, mesh.positions[t[2]] - p);
    face = is_direction(face) ? glm::normalize(face) : glm::vec3(0, 0, 1);
    for (int c = 0; c < 3; ++c) {
      const bool given = !mesh.normals.empty() && is_direction(mesh.normals[t[c]]);
      const glm::vec3 n = given ? glm::normalize(mesh.normals[t[c]]) : smoother->normal(k, c, face);
      packed.push_back(pack_normal(sign(glm::dot(n, face)) * n));
    }
  }
  return packed;
}

}  // namespace slf
