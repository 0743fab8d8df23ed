#include "field/geometry/section.h"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <map>
#include <random>
#include <set>

namespace slf {
namespace {

glm::dvec3 random_exit(std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  return glm::normalize(glm::dvec3(normal(random), normal(random), normal(random)));
}

Section any_section(unsigned level, std::mt19937_64& random) {
  return {static_cast<std::uint8_t>(level),
          static_cast<std::uint32_t>(random() % section_count(level))};
}

TEST(Section, ThereAreEightTimesFourToTheLevelEachInItsOwnPlace) {
  for (unsigned level = 0; level <= 5; ++level) {
    std::set<std::tuple<unsigned, int, int, bool>> places;
    for (std::uint32_t s = 0; s < section_count(level); ++s) {
      const Section section{static_cast<std::uint8_t>(level), s};
      const SectionPlace place = place_of(section);
      EXPECT_EQ(section_at(section.octant(), place, level), section);
      places.insert({section.octant(), place.x, place.y, place.inverted});
    }
    EXPECT_EQ(places.size(), section_count(level));
  }
}

TEST(Section, ChildrenTileTheirParent) {
  std::mt19937_64 random(1);
  for (int k = 0; k < 20000; ++k) {
    const glm::dvec3 d = random_exit(random);
    Section coarse = locate_section(d, 0);
    EXPECT_EQ(coarse.octant(), octant_of(d));
    for (unsigned level = 1; level <= kMaxSectionLevel; ++level) {
      const Section fine = locate_section(d, level);
      EXPECT_EQ(fine.parent(), coarse);
      coarse = fine;
    }
  }
}

TEST(Section, CellsLieInTheSectionThatTheirPointsLieIn) {
  std::mt19937_64 random(2);
  for (unsigned level = 0; level <= 5; ++level)
    for (std::uint32_t side : {1u, 2u, 3u, 8u, 32u})
      for (int k = 0; k < 500; ++k) {
        const glm::dvec3 d = random_exit(random);
        const Cell cell = locate(d, static_cast<std::int32_t>(side << level));
        const Section section = locate_section(d, level);
        for (const OctantPoint& corner : cell.corners()) {
          const LocalPoint local = to_local(corner, section, side);
          EXPECT_LE(local.p + local.q, side);
          EXPECT_EQ(from_local(local, section, side), corner);
        }
      }
}

TEST(Section, LocalCoordinatesRoundTripAtEveryLevel) {
  std::mt19937_64 random(3);
  for (unsigned level = 0; level <= 6; ++level)
    for (int k = 0; k < 50; ++k) {
      const Section section = any_section(level, random);
      const std::uint32_t side = 1 + random() % 9;
      for (std::uint16_t q = 0; q <= side; ++q)
        for (std::uint16_t p = 0; p + q <= side; ++p) {
          const OctantPoint point = from_local({p, q}, section, side);
          EXPECT_EQ(to_local(point, section, side), (LocalPoint{p, q}));
          const LatticeVertex v = vertex_at(section, {p, q}, side);
          EXPECT_EQ(std::abs(v.i) + std::abs(v.j) + std::abs(v.k),
                    static_cast<std::int32_t>(side << level));
        }
    }
}

TEST(Section, LatticesNest) {
  // A section's vertices are among its children's, one level down.
  std::mt19937_64 random(4);
  for (int k = 0; k < 100; ++k) {
    const Section section = any_section(random() % 4, random);
    std::set<LatticeVertex> fine;
    for (unsigned c = 0; c < 4; ++c)
      for (std::uint16_t q = 0; q <= 4; ++q)
        for (std::uint16_t p = 0; p + q <= 4; ++p) {
          fine.insert(vertex_at(section.child(c), {p, q}, 4));
        }
    EXPECT_EQ(fine.size(), triangle_size(8));
    for (std::uint16_t q = 0; q <= 4; ++q)
      for (std::uint16_t p = 0; p + q <= 4; ++p) {
        const LatticeVertex v = vertex_at(section, {p, q}, 4);
        EXPECT_TRUE(fine.contains({2 * v.i, 2 * v.j, 2 * v.k}));
      }
  }
}

TEST(Section, EveryVertexIsOwnedExactlyOnce) {
  for (unsigned level = 0; level <= 4; ++level)
    for (std::uint32_t side : {1u, 2u, 4u, 5u}) {
      std::map<LatticeVertex, Section> owners;
      for (std::uint32_t s = 0; s < section_count(level); ++s) {
        const Section section{static_cast<std::uint8_t>(level), s};
        const auto owned = owned_vertices(section, side);
        EXPECT_TRUE(std::is_sorted(owned.begin(), owned.end(), [](auto a, auto b) {
          return std::pair(a.q, a.p) < std::pair(b.q, b.p);
        }));
        for (const LocalPoint& local : owned) {
          const LatticeVertex v = vertex_at(section, local, side);
          EXPECT_TRUE(owners.emplace(v, section).second);
          EXPECT_EQ(owner_of(v, level), section);
        }
      }
      EXPECT_EQ(owners.size(), vertex_count(side << level));
    }
}

TEST(Section, OwnersAtACoarseLevelAreAncestorsOfOwnersAtAFineOne) {
  for (std::int32_t i = -16; i <= 16; ++i)
    for (std::int32_t j = -(16 - std::abs(i)); j <= 16 - std::abs(i); ++j) {
      const LatticeVertex v{i, j, 16 - std::abs(i) - std::abs(j)};
      for (unsigned level = 1; level <= 4; ++level)
        EXPECT_EQ(owner_of(v, level).parent(), owner_of(v, level - 1));
    }
}

RC_GTEST_PROP(TileKeys, RoundTripAndKeepSubfieldsTogether, ()) {
  std::mt19937_64 random(*rc::gen::arbitrary<std::uint64_t>());
  const auto level = *rc::gen::inRange<unsigned>(0, 7);
  const auto depth = *rc::gen::inRange<unsigned>(0, 3);
  const TileSections tile{any_section(level + depth, random), any_section(level, random)};
  const TileKey key = tile_key(tile);
  RC_ASSERT(key.level == level);
  RC_ASSERT(key.index < tile_count(level, depth));
  RC_ASSERT(sections_of(key, depth) == tile);
  if (level > 0) {
    // The parent subfield's tiles are one contiguous range: 16 keys to each of its own.
    TileSections parent{tile.entry.parent(), tile.exit.parent()};
    RC_ASSERT(tile_key(parent).index >> (2 * depth) == key.index >> (4 + 2 * depth));
  }
}

TEST(TileKeys, OrderIsSubfieldOrder) {
  // Level 0: the paper's L_ij, entry octsphere major. Level 1: all children of L_00 first.
  for (std::uint64_t index = 0; index < tile_count(0, 0); ++index) {
    const TileSections tile = sections_of({0, index}, 0);
    EXPECT_EQ(tile.entry.octant() * 8 + tile.exit.octant(), index);
  }
  for (std::uint64_t index = 0; index < tile_count(1, 0); ++index) {
    const TileSections tile = sections_of({1, index}, 0);
    EXPECT_EQ(tile_key({tile.entry.parent(), tile.exit.parent()}).index, index / 16);
  }
}

}  // namespace
}  // namespace slf
