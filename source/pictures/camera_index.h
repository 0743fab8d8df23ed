// Which cameras see a point from the nearest directions. Internal.
#pragma once

#include <cstddef>
#include <cstdint>
#include <glm/glm.hpp>
#include <span>
#include <vector>

namespace slf {

/// A tree of balls around eyes. Its answers are those of comparing all cameras.
/// Thread-safety: any thread.
class CameraIndex {
 public:
  struct Near {
    double penalty = 0;
    std::size_t camera = 0;
    /// Equal penalties: the lower number first.
    bool operator<(const Near& other) const {
      return penalty != other.penalty ? penalty < other.penalty : camera < other.camera;
    }
  };

  CameraIndex() = default;
  /// `coarseness` is added to the penalty of each camera.
  CameraIndex(const std::vector<glm::dvec3>& eyes, const std::vector<double>& coarseness);

  /// Fills `out` with the cameras of the least penalties, ascending, and returns their number,
  /// which is less than out.size() only if there are no more. The penalty is the distance of the
  /// unit vectors `back` and from `point` to the eye, which orders as the angle does, and the
  /// coarseness.
  std::size_t nearest(const glm::dvec3& point, const glm::dvec3& back, std::span<Near> out) const;

 private:
  struct Leaf {
    glm::dvec3 eye{0.0};
    double coarseness = 0;
    std::size_t camera = 0;
  };
  /// Of the leaves [first, end). An inner node is followed by one half; `other` is the second.
  struct Node {
    glm::dvec3 center{0.0};
    double radius = 0;
    double coarseness = 0;  ///< the least
    std::uint32_t first = 0, end = 0;
    std::uint32_t other = 0;  ///< 0: has no halves
  };
  void split(std::uint32_t first, std::uint32_t end);
  [[nodiscard]] static double least_penalty(const Node& node, const glm::dvec3& point,
                                            const glm::dvec3& back);

  std::vector<Leaf> leaves_;
  std::vector<Node> nodes_;
};

}  // namespace slf
