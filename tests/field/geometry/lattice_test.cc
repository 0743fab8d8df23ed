#include "field/geometry/lattice.h"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <cmath>
#include <map>
#include <random>
#include <set>

#include "field/geometry/section.h"
#include "tests/field/field_testing.h"

namespace slf {
namespace {

using testing::all_vertices;

glm::dvec3 random_direction(std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  return glm::normalize(glm::dvec3(normal(random), normal(random), normal(random)));
}

/// Interpolates f over the lattice at a direction, as rendering does.
template <class F>
double interpolate(const glm::dvec3& d, std::int32_t n, const F& f) {
  const Cell cell = locate(d, n);
  const auto corners = cell.corners();
  double sum = 0;
  for (int c = 0; c < 3; ++c) sum += cell.weights[c] * f(to_vertex(cell.octant, corners[c], n));
  return sum;
}

double hash_value(const LatticeVertex& v) {
  return std::fmod(std::abs(std::sin(v.i * 12.9898 + v.j * 78.233 + v.k * 37.719) * 43758.5), 1.0);
}

TEST(Lattice, HasFourNSquaredPlusTwoVertices) {
  for (std::int32_t n : {1, 2, 3, 7, 16}) {
    const auto all = all_vertices(n);
    EXPECT_EQ(all.size(), vertex_count(n));
    EXPECT_EQ(std::set<LatticeVertex>(all.begin(), all.end()).size(), vertex_count(n));
  }
}

TEST(Lattice, VerticesAndGridPointsRoundTripFromEveryOctant) {
  for (const LatticeVertex& v : all_vertices(9)) {
    EXPECT_EQ(std::abs(v.i) + std::abs(v.j) + std::abs(v.k), 9);
    EXPECT_EQ(to_vertex(octant_of(v), to_octant_point(v), 9), v);
    for (unsigned octant = 0; octant < 8; ++octant) {
      const bool touches = (v.i == 0 || (v.i < 0) == bool(octant & 1)) &&
                           (v.j == 0 || (v.j < 0) == bool(octant & 2)) &&
                           (v.k == 0 || (v.k < 0) == bool(octant & 4));
      EXPECT_EQ(to_vertex(octant, to_octant_point(v), 9) == v, touches);
    }
  }
}

RC_GTEST_PROP(Lattice, WeightsSumToOneAndReproduceThePoint, ()) {
  const auto n = *rc::gen::inRange(1, 300);
  std::mt19937_64 random(*rc::gen::arbitrary<std::uint64_t>());
  const glm::dvec3 d = random_direction(random);
  const Cell cell = locate(d, n);
  double sum = 0;
  glm::dvec3 point(0);
  const auto corners = cell.corners();
  for (int c = 0; c < 3; ++c) {
    RC_ASSERT(cell.weights[c] >= 0 && cell.weights[c] <= 1);
    const LatticeVertex v = to_vertex(cell.octant, corners[c], n);
    RC_ASSERT(std::abs(v.i) + std::abs(v.j) + std::abs(v.k) == n);
    sum += cell.weights[c];
    point += cell.weights[c] * glm::dvec3(v.i, v.j, v.k);
  }
  RC_ASSERT(std::abs(sum - 1) < 1e-12);
  RC_ASSERT(glm::distance(glm::normalize(point), d) < 1e-12);
}

TEST(Lattice, NeighborsAreTheVerticesAnEdgeAway) {
  for (const std::int32_t n : {1, 2, 5}) {
    for (const LatticeVertex& v : all_vertices(n)) {
      const auto next = neighbors(v);
      std::set<LatticeVertex> expected;
      for (const LatticeVertex& u : all_vertices(n))
        if (std::abs(u.i - v.i) + std::abs(u.j - v.j) + std::abs(u.k - v.k) == 2 &&
            std::max({std::abs(u.i - v.i), std::abs(u.j - v.j), std::abs(u.k - v.k)}) == 1)
          expected.insert(u);
      EXPECT_EQ(std::set<LatticeVertex>(next.begin(), next.end()), expected);
      EXPECT_EQ(next.size(), expected.size());
      EXPECT_EQ(next.size(), (v.i == 0) + (v.j == 0) + (v.k == 0) == 2 ? 4u : 6u);
    }
  }
}

TEST(Lattice, VerticesLieInTheirOwnCells) {
  for (std::int32_t n : {1, 2, 5, 32})
    for (const LatticeVertex& v : all_vertices(n)) {
      const Cell cell = locate(direction(v), n);
      const auto corners = cell.corners();
      double at_vertex = 0;
      for (int c = 0; c < 3; ++c)
        if (to_vertex(cell.octant, corners[c], n) == v) at_vertex += cell.weights[c];
      EXPECT_NEAR(at_vertex, 1, 1e-9);
    }
}

TEST(Lattice, InterpolationIsContinuousAcrossEveryEdgeAndAxisPoint) {
  // Great arcs between octspheres, between sections of several levels, and the six axis points:
  // two directions a hair apart on either side must see almost the same value.
  const std::int32_t n = 24;
  const double hair = 1e-9;
  std::mt19937_64 random(7);
  std::vector<glm::dvec3> seams;
  for (int axis = 0; axis < 3; ++axis)
    for (int sign : {-1, 1}) {
      glm::dvec3 pole(0);
      pole[axis] = sign;
      seams.push_back(pole);
    }
  for (const LatticeVertex& v : all_vertices(n)) {
    seams.push_back(direction(v));
    for (const LatticeVertex& w : {LatticeVertex{v.i, -v.j, v.k}, LatticeVertex{v.j, v.k, v.i},
                                   LatticeVertex{v.i, v.k, v.j}})
      if (glm::distance(direction(v), direction(w)) > 0)
        seams.push_back(glm::normalize(direction(v) + direction(w) + glm::dvec3(1e-13)));
  }
  for (int k = 0; k < 3000; ++k) {  // points on the planes of octants and of section arcs
    glm::dvec3 d = random_direction(random);
    switch (k % 6) {
      case 0:
        d.x = 0;
        break;
      case 1:
        d.y = 0;
        break;
      case 2:
        d.z = 0;
        break;
      case 3:
        d.x = std::copysign(std::abs(d.y) + std::abs(d.z), d.x);
        break;
      case 4:
        d.y = std::copysign(std::abs(d.x) + std::abs(d.z), d.y);
        break;
      default:
        d.z = std::copysign((std::abs(d.x) + std::abs(d.y)) / 3, d.z);
        break;
    }
    seams.push_back(glm::normalize(d));
  }
  for (const glm::dvec3& d : seams) {
    const double here = interpolate(d, n, hash_value);
    for (int k = 0; k < 8; ++k) {
      const glm::dvec3 there = glm::normalize(d + hair * random_direction(random));
      EXPECT_NEAR(interpolate(there, n, hash_value), here, 1e-6) << d.x << " " << d.y << " " << d.z;
    }
  }
}

TEST(Lattice, LinearFunctionsOfTheGridAreReproduced) {
  std::mt19937_64 random(3);
  for (int k = 0; k < 1000; ++k) {
    const glm::dvec3 d = random_direction(random);
    const double l1 = std::abs(d.x) + std::abs(d.y) + std::abs(d.z);
    const auto f = [](const LatticeVertex& v) { return 3.0 * v.i - 2.0 * v.j + 0.5 * v.k; };
    EXPECT_NEAR(interpolate(d, 40, f), 40 / l1 * (3 * d.x - 2 * d.y + 0.5 * d.z), 1e-9);
  }
}

}  // namespace
}  // namespace slf
