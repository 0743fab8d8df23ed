// Prediction from the coarser level: the vector kernels against the definition in FORMAT.md, one
// sample at a time, on every instruction set.
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <random>
#include <vector>

#include "codec/codec.h"
#include "field/predict/predictor.h"
#include "tests/instruction_set.h"

namespace slf {
namespace {

struct Vec {
  float x, y, z;
};
Vec operator-(const Vec& a, const Vec& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
float dot(const Vec& a, const Vec& b) { return (a.x * b.x + a.y * b.y) + a.z * b.z; }
float norm(const Vec& a) { return (std::abs(a.x) + std::abs(a.y)) + std::abs(a.z); }
Vec vec(const glm::vec3& v) { return {v.x, v.y, v.z}; }

/// Three weighted samples: what LevelGeometry finds, with weights in 1/256.
struct Taps {
  std::uint32_t section = 0;
  std::array<std::uint32_t, 3> columns{};
  std::array<int, 3> weights{};
};

Taps find_taps(const LevelGeometry& coarser, const Vec& q) {
  const int n = coarser.exit_resolution();
  const float scale = static_cast<float>(n) / norm(q);
  const float x = std::abs(q.x) * scale, y = std::abs(q.y) * scale;
  Cell cell;
  cell.octant = (q.x < 0 ? 1u : 0u) | (q.y < 0 ? 2u : 0u) | (q.z < 0 ? 4u : 0u);
  cell.base.x = std::min(static_cast<int>(x), n - 1);
  cell.base.y = std::min(static_cast<int>(y), n - 1 - cell.base.x);
  const auto steps = [](float of, int base) {
    return static_cast<int>(std::min(of - static_cast<float>(base), 1.f) * 256.f + 0.5f);
  };
  const int f = steps(x, cell.base.x), g = steps(y, cell.base.y);
  cell.inverted = f + g > 256 && cell.base.x + cell.base.y != n - 1;
  const LevelGeometry::ExitCell exit = coarser.exit_cell(cell);
  Taps taps{exit.section, exit.columns, {}};
  if (cell.inverted) {
    taps.weights = {f + g - 256, 256 - f, 256 - g};
  } else {
    const int v = std::min(g, 256 - f);
    taps.weights = {256 - f - v, f, v};
  }
  return taps;
}

struct Aim {
  float ev, vv;
  Taps taps;
};
Aim aim(const LevelGeometry& coarser, const Vec& from, const Vec& w, const Vec& r, const Vec& leave,
        float d) {
  const Vec v{w.x + r.x * d, w.y + r.y * d, w.z + r.z * d};
  const float vv = dot(v, v), ev = dot(from, v), two = ev + ev;
  Vec q{from.x * vv - v.x * two, from.y * vv - v.y * two, from.z * vv - v.z * two};
  if (!(norm(q) > 0x1p-40f)) q = leave;
  return {ev, vv, find_taps(coarser, q)};
}

/// A coarser level with its samples, all of it made up.
struct Level {
  std::vector<Bytes> tiles;
  std::vector<ReferenceTile> from;
};

Level random_level(const LevelGeometry& coarser, const References& references, std::uint32_t seed) {
  std::mt19937 random(seed);
  Level level;
  for (std::size_t k = 0; k < references.sections.size() * section_count(coarser.level()); ++k) {
    const TileShape shape = coarser.tile(references.sections[k / section_count(coarser.level())],
                                         codec::SampleFormat::rgba8);
    const std::size_t samples = shape.rows() * shape.columns();
    Bytes& bytes = level.tiles.emplace_back(8 + 5 * samples);
    const int empty = static_cast<int>(random() % 4);
    for (std::size_t s = 0; s < samples; ++s) {
      // Patches of nothing, so that opacities vary.
      const bool visible = s / 5 % 3 != 0;
      for (std::size_t c = 0; c < 4; ++c)
        bytes[8 + 4 * s + c] = visible ? static_cast<std::byte>(random()) : std::byte{0};
      bytes[8 + 4 * samples + s] = static_cast<std::byte>(random() % 128);
    }
    level.from.push_back(empty == 0
                             ? ReferenceTile{}
                             : ReferenceTile{bytes.data() + 8, bytes.data() + 8 + 4 * samples});
  }
  return level;
}

int byte_at(const std::byte* from, std::size_t at) { return std::to_integer<int>(from[at]); }

class PredictTest : public ::testing::TestWithParam<std::uint32_t> {
 protected:
  FieldShape shape{{}, 4, GetParam(), 2, 0, {}};
  LevelGeometry coarser{shape, 1}, finer{shape, 2};
  TileSections sections{finer.entry_section(37), finer.exit_section(100)};
  References references = find_references(coarser, finer, sections.entry.index);
  TilePredictor predictor{coarser, finer, sections, references};
  std::size_t exits = section_count(1);
  std::size_t columns = triangle_size(shape.exit_side);
  std::size_t samples = references.rows.size() * columns;

  void check_predictions(bool four_taps) const;
  Vec leave(LocalPoint local) const {
    return vec(exact_direction(vertex_at(sections.exit, local, shape.exit_side)));
  }
};

/// What is known of a column of a row: opacity, depth and straight colour.
struct Shown {
  int alpha = 0, depth = 0;
  std::array<int, 3> color{};
  bool seen = false;  // whether the references show a colour
};

int mean(int a, int b) { return (a + b + 1) / 2; }

Shown between(const Shown& a, const Shown& b) {
  Shown to;
  to.alpha = mean(a.alpha, b.alpha);
  to.depth = b.alpha == 0 ? a.depth : a.alpha == 0 ? b.depth : mean(a.depth, b.depth);
  to.seen = a.seen || b.seen;
  for (std::size_t c = 0; c < 3; ++c)
    to.color[c] = a.seen == b.seen ? mean(a.color[c], b.color[c]) : (a.seen ? a : b).color[c];
  return to;
}

using Columns = std::map<std::pair<int, int>, Shown>;

/// From columns `stride` apart to those half as far apart.
Columns upsample(const Columns& coarse, int side, int stride, bool four_taps = false) {
  Columns fine = coarse;
  const int half = stride / 2;
  // Between (p - dp, q - dq) and (p + dp, q + dq).
  const auto middle = [&](int p, int q, int dp, int dq) {
    const auto at = [&](int steps) {
      const auto found = coarse.find({p + steps * dp, q + steps * dq});
      return found == coarse.end() ? Shown() : found->second;
    };
    Shown to = between(at(-1), at(1));
    const bool all = at(-3).seen && at(-1).seen && at(1).seen && at(3).seen;
    for (std::size_t c = 0; c < 3 && all && four_taps; ++c) {
      const auto of = [&](int steps) { return at(steps).color[c]; };
      to.color[c] = std::clamp((9 * (of(-1) + of(1)) - of(-3) - of(3) + 8) >> 4, 0, 255);
    }
    return to;
  };
  for (int q = 0; q <= side; q += half)
    for (int p = 0; p + q <= side; p += half) {
      const bool odd_p = p % stride != 0, odd_q = q % stride != 0;
      if (odd_p && odd_q)
        fine[{p, q}] = middle(p, q, -half, half);
      else if (odd_p)
        fine[{p, q}] = middle(p, q, half, 0);
      else if (odd_q)
        fine[{p, q}] = middle(p, q, 0, half);
    }
  return fine;
}

void PredictTest::check_predictions(bool four_taps) const {
  const Level level = random_level(coarser, references, 1);
  const int side = static_cast<int>(shape.exit_side);
  const int stride = side % 2 == 0 ? 2 : 1;
  int sparse = stride;
  while (sparse < 8 && side % (2 * sparse) == 0) sparse *= 2;
  std::vector<Columns> expected;
  for (const References::Row& row : references.rows) {
    const Vec e = vec(row.direction);
    // What the references show of a ray at depth t, which becomes that at which they show it.
    const auto look_up = [&](int p, int q, float& t) {
      const Vec out = leave({static_cast<std::uint16_t>(p), static_cast<std::uint16_t>(q)});
      const Vec r = out - e;
      const float rr = dot(r, r), inverse = 1.f / (rr > 0x1p-40f ? rr : 1.f);
      float opacity = 0, place = 0, color[3] = {};
      for (std::size_t c = 0; c < row.count; ++c) {
        const References::Vertex& vertex = row.vertex[c];
        const Vec w = e - vec(vertex.direction);
        const Aim to = aim(coarser, vec(vertex.direction), w, r, out, t);
        const ReferenceTile& tile = level.from[vertex.slot * exits + to.taps.section];
        float a = 0, n = 0;
        for (std::size_t tap = 0; tap < 3 && tile.color; ++tap) {
          const std::size_t at = vertex.row * columns + to.taps.columns[tap];
          const int share = to.taps.weights[tap] * byte_at(tile.color, 4 * at + 3);
          a += static_cast<float>(share);
          n += static_cast<float>(share * byte_at(tile.depth, at));
          for (std::size_t channel = 0; channel < 3; ++channel)
            color[channel] +=
                static_cast<float>(to.taps.weights[tap] * byte_at(tile.color, 4 * at + channel));
        }
        const float own = n / ((a > 0 ? a : 1.f) * 255.f);
        const float reach = -(to.ev + to.ev) / (to.vv > 0x1p-40f ? to.vv : 1.f);
        const float wr = dot(w, r);
        const float along = ((own * reach) * (wr + t * rr) - wr) * inverse;
        opacity += a;
        place += a * along;
      }
      Shown shown;
      shown.seen = opacity > 0;
      if (shown.seen) {
        t = std::min(std::max(place / opacity, 0.f), 1.f);
        for (std::size_t channel = 0; channel < 3; ++channel)
          shown.color[channel] =
              static_cast<int>(std::min(color[channel] * (255.f / opacity), 255.f) + 0.5f);
      }
      shown.alpha = static_cast<int>(opacity * (row.count == 1 ? 0x1p-8f : 0x1p-9f) + 0.5f);
      shown.depth = static_cast<int>(t * 255.f + 0.5f);
      return shown;
    };
    Columns found;
    if (row.count == 2) {
      for (int q = 0; q <= side; q += sparse)
        for (int p = 0; p + q <= side; p += sparse) {
          float t = 1;
          for (int round = 0; round < 3; ++round) found[{p, q}] = look_up(p, q, t);
        }
      for (auto& [at, shown] : found) shown.seen = false, shown.color = {};
      for (int at = sparse; at > stride; at /= 2) found = upsample(found, side, at);
    }
    std::array<int, 3> last{128, 128, 128};
    for (int q = 0; q <= side; q += stride)
      for (int p = 0; p + q <= side; p += stride) {
        float t = row.count == 1 ? 1.f : static_cast<float>(found[{p, q}].depth) / 255.f;
        Shown& shown = found[{p, q}] = look_up(p, q, t);
        if (shown.seen)
          last = shown.color;
        else
          shown.color = last;
      }
    expected.push_back(stride == 2 ? upsample(found, side, 2, four_taps) : found);
  }
  testing::with_each_instruction_set([&](const char* set) {
    PredictedSamples predicted;
    predictor.predict(level.from, four_taps, predicted);
    const auto& [alpha, depth, color] = predicted;
    ASSERT_EQ(color.size(), samples);
    std::size_t s = 0;
    for (const Columns& row : expected)
      for (int q = 0; q <= side; ++q)
        for (int p = 0; p + q <= side; ++p, ++s) {
          const Shown& shown = row.at({p, q});
          const std::array<int, 3>& c = shown.color;
          ASSERT_EQ(alpha[s], shown.alpha) << set << ", sample " << s;
          ASSERT_EQ(depth[s], shown.depth) << set << ", sample " << s;
          ASSERT_EQ(color[s],
                    0xFF000000u | static_cast<std::uint32_t>(c[0] | c[1] << 8 | c[2] << 16))
              << set << ", sample " << s;
        }
  });
}

TEST_P(PredictTest, PredictionsAreAsDefinedOnEveryInstructionSet) { check_predictions(false); }
TEST_P(PredictTest, PredictionsOfFourTapsAre) { check_predictions(true); }

TEST_P(PredictTest, UsesCountTheLookUpsOfVisibleSamples) {
  std::vector<std::uint8_t> alpha(samples, 255), depth(samples, 40);
  const auto uses = predictor.uses(alpha, depth);
  std::size_t expected = 0, counted = 0;
  const std::uint32_t looked_up = shape.exit_side / (shape.exit_side % 2 == 0 ? 2 : 1);
  for (const References::Row& row : references.rows)
    expected += row.count * triangle_size(looked_up);
  for (const std::uint32_t count : uses) counted += count;
  EXPECT_EQ(counted, expected);
  alpha.assign(samples, 0);
  for (const std::uint32_t count : predictor.uses(alpha, depth)) EXPECT_EQ(count, 0u);
}

INSTANTIATE_TEST_SUITE_P(ExitSides, PredictTest, ::testing::Values(1u, 5u, 8u, 32u));

TEST(StepScale, IsAsDefinedAndGrowsTowardsTheAxes) {
  for (const std::uint8_t level : {1, 2, 5})
    for (const std::uint32_t entry : {0u, 1u, 5u, 31u, 8191u})
      for (const std::uint32_t exit : {0u, 3u, 6u, 31u}) {
        const auto count = static_cast<std::uint32_t>(section_count(level));
        const TileSections sections{{level, entry % count}, {level, exit}};
        const auto squared = [](const Section& section) {
          glm::dvec3 sum(0.0);
          for (const LocalPoint corner : {LocalPoint{0, 0}, LocalPoint{1, 0}, LocalPoint{0, 1}}) {
            const LatticeVertex v = vertex_at(section, corner, 1);
            sum += glm::dvec3(std::abs(v.i), std::abs(v.j), std::abs(v.k)) /
                   (3.0 * (1 << section.level));
          }
          EXPECT_NEAR(sum.x + sum.y + sum.z, 1, 1e-12);
          return glm::dot(sum, sum);
        };
        const double q = squared(sections.entry) * squared(sections.exit);
        EXPECT_NEAR(step_scale(sections), 16 * 3.58 * std::pow(q, 0.75), 0.51)
            << int{level} << " " << entry << " " << exit;
      }
  const Section axis{5, 0}, middle{5, 0x3FF};
  EXPECT_EQ(step_scale({axis, axis}), 54);
  EXPECT_EQ(step_scale({middle, middle}), 11);
}

TEST(References, AreTheVertexItselfOrItsTwoNeighbours) {
  const FieldShape shape{{}, 4, 8, 2, 0, {}};
  const LevelGeometry coarser(shape, 1), finer(shape, 2);
  for (std::uint32_t section = 0; section < section_count(2); ++section) {
    const References references = find_references(coarser, finer, section);
    ASSERT_EQ(references.rows.size(), finer.rows(section).size());
    for (std::size_t k = 0; k < references.rows.size(); ++k) {
      const References::Row& row = references.rows[k];
      const LatticeVertex v = vertex_at(finer.entry_section(section), finer.rows(section)[k], 4);
      const bool even = v.i % 2 == 0 && v.j % 2 == 0 && v.k % 2 == 0;
      EXPECT_EQ(row.count, even ? 1 : 2);
      glm::dvec3 middle(0.0);
      for (std::size_t c = 0; c < row.count; ++c) {
        const std::uint32_t owner = references.sections[row.vertex[c].slot];
        const LatticeVertex parent =
            vertex_at(coarser.entry_section(owner), coarser.rows(owner)[row.vertex[c].row], 4);
        EXPECT_EQ(row.vertex[c].direction, exact_direction(parent));
        middle += glm::dvec3(parent.i, parent.j, parent.k);
      }
      EXPECT_EQ(middle * 2.0 / static_cast<double>(row.count), glm::dvec3(v.i, v.j, v.k));
    }
  }
}

}  // namespace
}  // namespace slf
