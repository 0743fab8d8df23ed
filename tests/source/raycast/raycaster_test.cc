#include "slf/raycaster.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <memory>
#include <random>
#include <span>
#include <vector>

#include "source/medium/visible_space.h"
#include "source/raycast/prepared_volume.h"
#include "tests/instruction_set.h"

namespace slf {
namespace {

template <class T>
Volume make_volume(std::array<std::uint32_t, 3> dims, ScalarType type,
                   const std::function<double(int, int, int)>& f) {
  Volume v;
  v.dims = dims;
  v.type = type;
  v.source = "test";
  for (std::uint32_t z = 0; z < dims[2]; ++z)
    for (std::uint32_t y = 0; y < dims[1]; ++y)
      for (std::uint32_t x = 0; x < dims[0]; ++x) {
        const T value =
            static_cast<T>(f(static_cast<int>(x), static_cast<int>(y), static_cast<int>(z)));
        const auto* bytes = reinterpret_cast<const std::byte*>(&value);
        v.voxels.insert(v.voxels.end(), bytes, bytes + sizeof value);
      }
  return v;
}

TransferFunction ramp(double low, double high, double opacity) {
  TransferFunction t;
  t.colors = {{low, {0.2, 0.4, 0.6}}, {high, {1.0, 0.8, 0.5}}};
  t.opacities = {{low, 0, 0.5, 0}, {high, opacity, 0.5, 0}};
  return t;
}

TransferFunction constant(double opacity) {
  TransferFunction t;
  t.colors = {{0, {1, 0.5, 0.25}}};
  t.opacities = {{0, opacity, 0.5, 0}};
  return t;
}

std::unique_ptr<Raycaster> make(Volume v, const TransferFunction& t, const RaycastOptions& o = {}) {
  auto made = Raycaster::make(std::move(v), t, o);
  EXPECT_TRUE(made) << (made ? "" : made.error().message);
  return std::move(*made);
}

glm::dvec3 random_place(std::mt19937& random, double radius) {
  std::normal_distribution<double> normal;
  return radius * glm::normalize(glm::dvec3(normal(random), normal(random), normal(random)));
}

Volume blobs(std::uint32_t seed) {
  std::mt19937 random(seed);
  std::vector<glm::dvec4> balls;
  for (int k = 0; k < 6; ++k)
    balls.push_back({random() % 40, random() % 33, random() % 27, 2 + random() % 5});
  return make_volume<std::uint8_t>({40, 33, 27}, ScalarType::u8, [&](int x, int y, int z) {
    double value = 0;
    for (const auto& b : balls)
      value = std::max(value, 200 * (1 - glm::distance(glm::dvec3(x, y, z), glm::dvec3(b)) / b.w));
    return value;
  });
}

TEST(Raycaster, LeapingOverEmptySpaceChangesNothing) {
  for (std::uint32_t seed = 1; seed <= 4; ++seed) {
    const auto leaping = *prepare_volume(blobs(seed), ramp(20, 120, 0.6), {});
    const auto plain = *prepare_volume(blobs(seed), ramp(20, 120, 0.6), {});
    std::ranges::fill(plain->grid.distance, 0);  // then every cell is visited
    const auto large = *prepare_volume(blobs(seed), ramp(20, 120, 0.6), {});
    ASSERT_TRUE(find_visible_space(large->volume, large->grid, false, 2, 300));
    EXPECT_EQ(large->grid.brick_shift, 3);
    EXPECT_LE(large->grid.distance.size(), 300);
    const Sphere s = leaping->bounds;
    std::mt19937 random(seed);
    int visible = 0;
    for (int k = 0; k < 3000; ++k) {
      const Segment ray{s.center + random_place(random, s.radius),
                        s.center + random_place(random, s.radius)};
      RaySample a, b;
      const RayCounts leaps = trace_rays(leaping->grid, {&ray, 1}, {&a, 1});
      EXPECT_LE(leaps.steps, trace_rays(plain->grid, {&ray, 1}, {&b, 1}).steps);
      EXPECT_EQ(a.rgba, b.rgba);
      EXPECT_EQ(a.depth, b.depth);
      trace_rays(large->grid, {&ray, 1}, {&b, 1});  // from the face of a larger box: rounding
      EXPECT_LT(glm::length(a.rgba - b.rgba), 2e-5);
      EXPECT_NEAR(a.depth, b.depth, 2e-5);
      visible += a.rgba.a > 0;
    }
    EXPECT_GT(visible, 100);
  }
}

/// 10 log10 of 1 over the mean squared difference of premultiplied colours.
double psnr_between(const Raycaster& a, const Raycaster& b) {
  const Sphere sphere = a.bounds();
  double sum = 0;
  constexpr int kSide = 96;
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x) {
      const glm::dvec3 across((x + 0.5) / kSide * 2 - 1, (y + 0.5) / kSide * 2 - 1, 0.3);
      const glm::dvec3 eye = sphere.center + sphere.radius * glm::dvec3(2.1, -3.4, 1.7);
      const glm::dvec3 to =
          2.0 * sphere.center + sphere.radius * glm::dvec3(across.z, across.x, across.y) - eye;
      const glm::vec4 d = a.trace(eye, to).rgba - b.trace(eye, to).rgba;
      sum += (d.r * d.r + d.g * d.g + d.b * d.b) / 3;
    }
  return -10 * std::log10(sum / (kSide * kSide) + 1e-12);
}

TEST(Raycaster, TheDefaultStepIsConverged) {
  // A rough shell, as of bone: normals change quickly below its surface.
  const auto shell = [](int x, int y, int z) {
    const double r = glm::distance(glm::dvec3(x, y, z), glm::dvec3(24.3, 23.8, 24.1));
    const double rough = 5 * std::sin(2.1 * x + z) * std::cos(1.7 * y - 0.9 * z);
    return std::max(0.0, 200 - 28 * std::abs(r - 17.4) + rough);
  };
  const auto volume = make_volume<std::uint8_t>({48, 48, 48}, ScalarType::u8, shell);
  for (const auto& [opacity, width] : {std::pair{0.3, 20.0}, {0.3, 60.0}, {0.9, 60.0}}) {
    RaycastOptions fine;
    fine.step = 0.05;
    const TransferFunction t = ramp(100, 100 + width, opacity);
    EXPECT_GT(psnr_between(*make(volume, t), *make(volume, t, fine)), 50)
        << opacity << " over " << width;
  }
}

TEST(Raycaster, ColoursThatChangeWhereMatterBeginsAreConverged) {
  // A smooth ball whose surface is opaque within a third of a voxel, and blue outside.
  const auto volume =
      make_volume<std::uint8_t>({40, 40, 40}, ScalarType::u8, [](int x, int y, int z) {
        const double r = glm::distance(glm::dvec3(x, y, z), glm::dvec3(19.7, 20.2, 19.9));
        return std::clamp(45 * (17 - r), 0.0, 150.0);
      });
  TransferFunction t;
  t.colors = {{20, {0.2, 0.3, 0.9}}, {80, {1, 0.7, 0.3}}};
  t.opacities = {{60, 0, 0.5, 0}, {75, 1, 0.5, 0}};
  RaycastOptions options, fine;
  options.shade = fine.shade = false;
  fine.step = 0.05;
  EXPECT_GT(psnr_between(*make(volume, t, options), *make(volume, t, fine)), 48);
}

TEST(Raycaster, LabelsEndHalfwayBetweenVoxels) {
  auto v = make_volume<std::uint8_t>({12, 12, 12}, ScalarType::u8,
                                     [](int x, int, int) { return x >= 4 && x <= 6 ? 7 : 0; });
  v.labels = true;
  TransferFunction t = ramp(0.5, 1, 0.4);
  RaycastOptions options;
  options.shade = false;
  const auto caster = make(std::move(v), t, options);
  // Three voxels, whatever the phase of the ray.
  for (const double from : {-3.0, -3.3, -3.71}) {
    const RaySample s = caster->trace({from, 5.2, 5.4}, {from + 20, 5.2, 5.4});
    EXPECT_NEAR(s.rgba.a, 1 - std::pow(1 - 0.4, 3), 1e-5);
    EXPECT_LT(s.depth * 20 + from, 5);  // more of the front is seen
  }
}

TEST(Raycaster, ProjectionsShowOneValue) {
  const auto v = make_volume<std::uint8_t>({9, 9, 9}, ScalarType::u8, [](int x, int, int) {
    constexpr int kValues[] = {0, 0, 40, 80, 200, 120, 60, 0, 0};
    return kValues[x];
  });
  TransferFunction t;
  t.colors = {{0, {0, 0, 0}}, {200, {1, 0.5, 0.25}}};
  t.opacities = {{29, 0, 0.5, 0}, {30, 1, 0.5, 0}};
  RaycastOptions options;
  options.shade = false;
  const glm::dvec3 from(-1, 4.3, 4.6), to(9, 4.3, 4.6);
  options.projection = Projection::maximum;
  const RaySample most = make(v, t, options)->trace(from, to);
  EXPECT_NEAR(most.rgba.r, 1, 0.01);
  EXPECT_NEAR(most.rgba.g, 0.5, 0.01);
  EXPECT_NEAR(most.rgba.a, 1, 1e-5);
  EXPECT_NEAR(most.depth * 10 - 1, 4, 0.01);  // where it was found
  options.projection = Projection::minimum;
  const RaySample least = make(v, t, options)->trace(from, to);
  EXPECT_NEAR(least.rgba.r, 35. / 200, 0.04);
  options.projection = Projection::mean;
  const RaySample mean = make(v, t, options)->trace(from, to);
  EXPECT_NEAR(mean.rgba.r, 0.5, 0.06);
  options.shade = true;
  const auto lit = Raycaster::make(v, t, options);
  ASSERT_FALSE(lit);
  EXPECT_EQ(lit.error().code, ErrorCode::usage);
  EXPECT_EQ(raycast_options(R"({"projection":"minip"})").projection, Projection::minimum);
}

TEST(Raycaster, BoundsHoldEverythingVisible) {
  const auto caster = make(blobs(3), ramp(20, 120, 0.6));
  const Sphere s = caster->bounds();
  std::mt19937 random(3);
  for (int k = 0; k < 3000; ++k) {  // rays outside the sphere see nothing
    const glm::dvec3 n = random_place(random, 1);
    const glm::dvec3 t = glm::normalize(glm::cross(n, random_place(random, 1)));
    const glm::dvec3 at = s.center + 1.0001 * s.radius * n;
    EXPECT_EQ(caster->trace(at - 200.0 * t, at + 200.0 * t).rgba.a, 0);
  }
}

TEST(Raycaster, BoundsAreThoseOfTheVisibleCells) {
  // Around a single voxel there are eight cells, wherever it lies among the bricks of any size.
  for (const glm::ivec3 at : {glm::ivec3(7, 3, 9), glm::ivec3(8, 4, 8), glm::ivec3(13, 10, 6)}) {
    auto v = make_volume<std::uint8_t>({20, 17, 19}, ScalarType::u8, [&](int x, int y, int z) {
      return glm::ivec3(x, y, z) == at ? 100 : 0;
    });
    v.axes = glm::dmat3(2.0);
    const auto caster = make(std::move(v), ramp(50, 60, 0.9));
    const Sphere s = caster->bounds();
    EXPECT_EQ(s.center, 2.0 * glm::dvec3(at));
    EXPECT_NEAR(s.radius, 2 * std::sqrt(3), 0.01);
    EXPECT_EQ(caster->reach(s.center), s.radius);
    EXPECT_NEAR(caster->reach(s.center + glm::dvec3(10, 0, 0)), std::hypot(12, 2, 2), 0.02);
  }
}

std::vector<Segment> random_segments(const Sphere& sphere, std::size_t count, std::uint32_t seed) {
  std::mt19937 random(seed);
  std::vector<Segment> segments(count);
  for (Segment& s : segments)
    s = {sphere.center + random_place(random, sphere.radius),
         sphere.center + random_place(random, sphere.radius)};
  return segments;
}

/// Each kind of volume the kernel tells apart.
std::vector<std::unique_ptr<Raycaster>> one_of_each_kind() {
  const auto f = [](int x, int y, int z) { return (x * x + y * 3 + z * z) % 100; };
  const auto signed_f = [&](int x, int y, int z) { return f(x, y, z) - 50; };
  const auto labels = [&](int x, int y, int z) { return f(x / 4, y / 4, z / 4) % 5; };
  std::vector<std::unique_ptr<Raycaster>> casters;
  casters.push_back(make(blobs(5), ramp(20, 120, 0.6)));
  const auto add = [&]<class T>(T, ScalarType type, const auto& values, double low, double high) {
    casters.push_back(make(make_volume<T>({23, 15, 18}, type, values), ramp(low, high, 0.2)));
  };
  add(std::uint8_t{}, ScalarType::u8, f, 50, 90);
  add(std::int8_t{}, ScalarType::i8, signed_f, -10, 40);
  add(std::uint16_t{}, ScalarType::u16, f, 50, 90);
  add(std::int16_t{}, ScalarType::i16, signed_f, -10, 40);
  add(float{}, ScalarType::f32, f, 50, 90);
  add(
      float{}, ScalarType::f32, [&](int x, int y, int z) { return std::exp(-f(x, y, z)); }, 1e-30,
      1e-20);
  for (const ScalarType type : {ScalarType::u8, ScalarType::u16}) {
    auto v = type == ScalarType::u8 ? make_volume<std::uint8_t>({23, 15, 18}, type, labels)
                                    : make_volume<std::uint16_t>({23, 15, 18}, type, labels);
    v.labels = true;
    casters.push_back(make(std::move(v), ramp(1, 4, 0.3)));
  }
  RaycastOptions unshaded;
  unshaded.shade = false;
  casters.push_back(make(blobs(6), ramp(20, 120, 0.3), unshaded));
  return casters;
}

TEST(Raycaster, ATableOfLabelsEndsWithTheGreatest) {
  for (const ScalarType type : {ScalarType::u8, ScalarType::u16}) {
    const auto label = [](int x, int y, int) { return x < 3 && y < 3 ? 4 : 0; };
    auto v = type == ScalarType::u8 ? make_volume<std::uint8_t>({5, 6, 7}, type, label)
                                    : make_volume<std::uint16_t>({5, 6, 7}, type, label);
    v.labels = true;
    const auto scene = prepare_volume(std::move(v), ramp(1, 4, 0.3), {});
    ASSERT_TRUE(scene) << scene.error().message;
    EXPECT_EQ((*scene)->grid.table.colors.size(), 5u);
  }
}

TEST(Raycaster, ASampleDoesNotDependOnTheRaysItIsTracedWith) {
  for (const auto& caster : one_of_each_kind()) {
    std::vector<Segment> segments = random_segments(caster->bounds(), 700, 9);
    segments[3] = {glm::dvec3(1), glm::dvec3(1)};        // of no length
    segments[650] = {glm::dvec3(1e6), glm::dvec3(2e6)};  // past everything
    std::vector<RaySample> together(segments.size()), apart(segments.size());
    caster->trace_many(segments, together);
    // In batches of 0, 1, 2, ... rays.
    for (std::size_t begin = 0, size = 0; begin < segments.size(); begin += size++) {
      const std::size_t count = std::min(size, segments.size() - begin);
      caster->trace_many(std::span(segments).subspan(begin, count),
                         std::span(apart).subspan(begin, count));
    }
    int visible = 0;
    for (std::size_t k = 0; k < segments.size(); ++k) {
      const RaySample alone = caster->trace(segments[k].from, segments[k].to);
      EXPECT_EQ(together[k].rgba, alone.rgba);
      EXPECT_EQ(together[k].depth, alone.depth);
      EXPECT_EQ(apart[k].rgba, alone.rgba);
      EXPECT_EQ(apart[k].depth, alone.depth);
      visible += alone.rgba.a > 0;
    }
    EXPECT_GT(visible, 50);
  }
}

TEST(Raycaster, InstructionSetsAgree) {
  const auto casters = one_of_each_kind();
  const auto trace_all = [&] {
    std::vector<RaySample> all;
    for (const auto& caster : casters) {
      const auto segments = random_segments(caster->bounds(), 300, 10);
      std::vector<RaySample> samples(segments.size());
      caster->trace_many(segments, samples);
      all.insert(all.end(), samples.begin(), samples.end());
      EXPECT_EQ(caster->trace(segments[7].from, segments[7].to).rgba, samples[7].rgba);
    }
    return all;
  };
  const auto best = trace_all();
  testing::with_each_instruction_set([&](const char* name) {
    const auto samples = trace_all();
    // Rounding may decide whether one more sample is seen, but seldom. Values that span 43 orders
    // of magnitude depend much on where a ray meets the face of a cell.
    constexpr std::size_t kOrders = 6;
    int apart = 0, orders_apart = 0;
    for (std::size_t k = 0; k < best.size(); ++k)
      for (int c = 0; c < 4; ++c)
        (k / 300 == kOrders ? orders_apart : apart) +=
            !(std::abs(samples[k].rgba[c] - best[k].rgba[c]) < 1e-3);
    EXPECT_LE(apart, 4) << name;
    EXPECT_LE(orders_apart, 1200 / 20) << name;
  });
}

TEST(Raycaster, OpacityFollowsThePathLengthWhateverTheStep) {
  // A homogeneous box: transmittance is (1 - opacity)^length, in units of unit_distance.
  for (const double step : {0.2, 0.5, 1.0}) {
    for (const double unit : {1.0, 2.5}) {
      auto v =
          make_volume<std::uint8_t>({31, 31, 31}, ScalarType::u8, [](int, int, int) { return 9; });
      TransferFunction t = constant(0.04);
      t.unit_distance = unit;
      RaycastOptions options;
      options.step = step;
      options.shade = false;
      const auto caster = make(std::move(v), t, options);
      const RaySample s = caster->trace({15, 15, -40}, {15, 15, 80});
      EXPECT_NEAR(s.rgba.a, 1 - std::pow(1 - 0.04, 30 / unit), 0.04 * step / unit + 1e-4);
      EXPECT_NEAR(s.rgba.r / s.rgba.a, 1, 1e-5);
      EXPECT_NEAR(s.rgba.b / s.rgba.a, 0.25, 1e-5);
    }
  }
}

TEST(Raycaster, DepthIsWhereTheOpacityIs) {
  auto v = make_volume<std::uint8_t>({21, 21, 41}, ScalarType::u8,
                                     [](int, int, int z) { return z >= 30 && z <= 32 ? 100 : 0; });
  const auto caster = make(std::move(v), ramp(50, 60, 0.999));
  const RaySample s = caster->trace({10, 10, -10}, {10, 10, 90});
  EXPECT_GT(s.rgba.a, 0.99);
  EXPECT_NEAR(s.depth * 100 - 10, 29.5, 0.8);  // the iso-surface between 29 and 30
  const RaySample back = caster->trace({10, 10, 90}, {10, 10, -10});
  EXPECT_NEAR(90 - back.depth * 100, 32.5, 0.8);
}

TEST(Raycaster, AxesSpacingAndOriginPlaceTheVolumeInTheWorld) {
  // One bright voxel, seen from three sides, in a rotated, anisotropic, mirrored volume.
  auto v = make_volume<std::int16_t>({12, 10, 14}, ScalarType::i16, [](int x, int y, int z) {
    return x == 7 && y == 3 && z == 9 ? 1000 : -1000;
  });
  v.axes = glm::dmat3(glm::dvec3(0, 2, 0), glm::dvec3(-0.5, 0, 0), glm::dvec3(0, 0, -1.5));
  v.origin = {5, -7, 11};
  const glm::dvec3 at = v.origin + v.axes * glm::dvec3(7, 3, 9);
  RaycastOptions options;
  options.step = 0.1;
  const auto caster = make(std::move(v), ramp(400, 600, 0.9), options);
  for (int axis = 0; axis < 3; ++axis) {
    glm::dvec3 from = at, to = at;
    from[axis] -= 50;
    to[axis] += 50;
    const RaySample s = caster->trace(from, to);
    EXPECT_GT(s.rgba.a, 0.02);
    EXPECT_NEAR(s.depth, 0.5, 0.012);
    from[(axis + 1) % 3] += 4;
    to[(axis + 1) % 3] += 4;
    EXPECT_EQ(caster->trace(from, to).rgba.a, 0);
  }
}

TEST(Raycaster, SlopeAndInterceptMeanTheValuesTheySay) {
  const auto f = [](int x, int y, int z) { return (x * 7 + y * 5 + z * 3) % 50; };
  auto stored = make_volume<std::uint8_t>({20, 20, 20}, ScalarType::u8, f);
  stored.slope = -2.5;
  stored.intercept = 40;
  auto values = make_volume<float>({20, 20, 20}, ScalarType::f32,
                                   [&](int x, int y, int z) { return 40 - 2.5 * f(x, y, z); });
  RaycastOptions options;
  options.shade = true;
  const auto a = make(std::move(stored), ramp(-40, 40, 0.2), options);
  const auto b = make(std::move(values), ramp(-40, 40, 0.2), options);
  std::mt19937 random(5);
  for (int k = 0; k < 500; ++k) {
    const glm::dvec3 from = a->bounds().center + random_place(random, 30);
    const glm::dvec3 to = a->bounds().center + random_place(random, 30);
    const RaySample s = a->trace(from, to), t = b->trace(from, to);
    for (int c = 0; c < 4; ++c) EXPECT_NEAR(s.rgba[c], t.rgba[c], 0.01);
  }
}

TEST(Raycaster, AllScalarTypesAgree) {
  const auto f = [](int x, int y, int z) { return (x * x + y * 3 + z) % 100; };
  const auto reference =
      make(make_volume<float>({16, 15, 14}, ScalarType::f32, f), ramp(10, 90, 0.3));
  const auto check = [&]<class T>(T, ScalarType type) {
    const auto other = make(make_volume<T>({16, 15, 14}, type, f), ramp(10, 90, 0.3));
    std::mt19937 random(6);
    for (int k = 0; k < 200; ++k) {
      const glm::dvec3 from = reference->bounds().center + random_place(random, 20);
      const glm::dvec3 to = reference->bounds().center + random_place(random, 20);
      const RaySample s = other->trace(from, to), t = reference->trace(from, to);
      for (int c = 0; c < 4; ++c) EXPECT_NEAR(s.rgba[c], t.rgba[c], 0.01) << name(type);
    }
  };
  check(std::uint8_t{}, ScalarType::u8);
  check(std::int8_t{}, ScalarType::i8);
  check(std::uint16_t{}, ScalarType::u16);
  check(std::int16_t{}, ScalarType::i16);
  check(std::uint32_t{}, ScalarType::u32);
  check(std::int32_t{}, ScalarType::i32);
  check(std::uint64_t{}, ScalarType::u64);
  check(std::int64_t{}, ScalarType::i64);
  check(double{}, ScalarType::f64);
}

TEST(Raycaster, SmallDifferencesOfLargeValuesShow) {
  const auto f = [](int x, int y, int z) { return (x * x + y * 3 + z) % 100; };
  const auto reference =
      make(make_volume<float>({16, 15, 14}, ScalarType::f32, f), ramp(10, 90, 0.3));
  const auto check = [&]<class T>(T far, ScalarType type) {
    auto volume = make_volume<T>(
        {16, 15, 14}, type, [&](int x, int y, int z) { return far + static_cast<T>(f(x, y, z)); });
    volume.slope = 2;
    volume.intercept = 1;
    const double zero = 2 * static_cast<double>(far) + 1;
    RaycastOptions shared;
    shared.shared = share_scenes();
    make(volume, ramp(zero + 20, zero + 180, 0.3), shared);
    const auto other = make(std::move(volume), ramp(zero + 20, zero + 180, 0.3), shared);
    for (const Segment& ray : random_segments(reference->bounds(), 200, 6)) {
      const RaySample s = other->trace(ray.from, ray.to), t = reference->trace(ray.from, ray.to);
      for (int c = 0; c < 4; ++c) EXPECT_NEAR(s.rgba[c], t.rgba[c], 0.01) << name(type);
    }
  };
  check(1e9, ScalarType::f64);
  check(-1e9, ScalarType::f64);
  check(std::int64_t{1} << 40, ScalarType::i64);
  check(std::uint32_t{4'000'000'000}, ScalarType::u32);
}

TEST(Raycaster, LabelsAreNeverBlended) {
  // Label 2 lies between 1 and 3: interpolation would show it at every border of the two.
  auto v = make_volume<std::uint8_t>({24, 24, 24}, ScalarType::u8, [](int x, int y, int z) {
    const double r = glm::length(glm::dvec3(x, y, z) - 11.5);
    return r > 10 ? 0 : x < 12 ? 1 : 3;
  });
  v.labels = true;
  TransferFunction t;
  t.space = TransferFunction::Space::step;
  t.colors = {{0, {0, 0, 0}}, {1, {1, 0, 0}}, {2, {0, 1, 0}}, {3, {0, 0, 1}}};
  t.opacities = {{0, 0, 0.5, 1}, {1, 1, 0.5, 1}, {3, 1, 0.5, 1}};
  const auto caster = make(std::move(v), t);
  std::mt19937 random(7);
  int visible = 0;
  for (int k = 0; k < 2000; ++k) {
    const glm::dvec3 from = glm::dvec3(11.5) + random_place(random, 30);
    const RaySample s = caster->trace(from, glm::dvec3(23) - from);
    EXPECT_EQ(s.rgba.g, 0);
    EXPECT_TRUE(s.rgba.r == 0 || s.rgba.b == 0);
    visible += s.rgba.a > 0.9;
  }
  EXPECT_GT(visible, 1500);
}

TEST(Raycaster, LabelIdsBeyondSixteenBitsAreKeptApart) {
  const std::uint32_t far = 4000000000u;
  auto v = make_volume<std::uint32_t>({9, 9, 9}, ScalarType::u32, [&](int x, int, int) {
    return x < 3 ? 0.0 : x < 6 ? 70000.0 : static_cast<double>(far);
  });
  v.labels = true;
  TransferFunction t;
  t.space = TransferFunction::Space::step;
  t.colors = {{0, {0, 0, 0}}, {70000, {1, 0, 0}}, {4e9, {0, 0, 1}}};
  t.opacities = {{0, 0, 0.5, 1}, {70000, 1, 0.5, 1}, {4e9, 1, 0.5, 1}};
  const auto caster = make(std::move(v), t);
  EXPECT_GT(caster->trace({-20, 4, 4}, {30, 4, 4}).rgba.r, 0.1);
  EXPECT_EQ(caster->trace({-20, 4, 4}, {30, 4, 4}).rgba.b, 0);
  EXPECT_GT(caster->trace({30, 4, 4}, {-20, 4, 4}).rgba.b, 0.1);
}

TEST(Raycaster, FunctionsOverManyOrdersOfMagnitudeAreResolved) {
  // Values 1e-24 ... 1e0 along z; only the decade around 1e-12 is visible.
  auto v = make_volume<float>({9, 9, 97}, ScalarType::f32,
                              [](int, int, int z) { return std::pow(10.0, (z - 96) / 4.0); });
  TransferFunction t;
  t.colors = {{0, {1, 1, 1}}};
  t.opacities = {{0, 0, 0.5, 0},       {4e-13, 0, 0.5, 0}, {5e-13, 0.9, 0.5, 0},
                 {2e-12, 0.9, 0.5, 0}, {3e-12, 0, 0.5, 0}, {1, 0, 0.5, 0}};
  const auto caster = make(std::move(v), t);
  const RaySample s = caster->trace({4, 4, -2}, {4, 4, 98});
  EXPECT_GT(s.rgba.a, 0.8);
  EXPECT_NEAR(s.depth * 100 - 2, 47.5, 1.5);
  EXPECT_EQ(caster->trace({4, -50, 20}, {4, 60, 20}).rgba.a, 0);
}

TEST(Raycaster, NormalsAreAccurateBesideMuchLargerValues) {
  // Across a cell, values and their gradients change by up to two orders of magnitude.
  const auto f = [](int x, int y, int z) {
    const double r = glm::distance(glm::dvec3(x, y, z), glm::dvec3(12.3, 11.6, 12.1));
    return std::pow(10.0, 15 - 2 * r + std::sin(1.3 * x) * std::cos(1.7 * y + z));
  };
  const auto v = make_volume<float>({25, 25, 25}, ScalarType::f32, f);
  TransferFunction t;
  t.colors = {{0, {1, 1, 1}}};
  t.opacities = {{0, 0, 0.5, 0}, {1e-7, 0, 0.5, 0}, {1e-5, 0.5, 0.5, 0}, {1, 0.9, 0.5, 0}};
  RaycastOptions fine;
  fine.step = 0.05;
  EXPECT_GT(psnr_between(*make(v, t), *make(v, t, fine)), 50);
}

TEST(Raycaster, HugeGradientsDoNoHarm) {
  // From gradients whose squares are not finite to those whose differences are not.
  for (const Lighting lighting : {Lighting::direct, Lighting::global})
    for (const auto& [low, high] : {std::pair{0.0, 3e37}, {-1.6e38, 1.6e38}}) {
      SCOPED_TRACE(high);
      const auto v = make_volume<float>({12, 12, 12}, ScalarType::f32,
                                        [low = low, high = high](int x, int y, int) {
                                          return ((x >> 1) + (y >> 1)) % 2 ? high : low;
                                        });
      RaycastOptions options;
      options.lighting.mode = lighting;
      options.lighting.samples = 2;
      const auto caster = make(v, ramp(high / 30, high, 0.5), options);
      std::mt19937 random(8);
      float seen = 0;
      for (int k = 0; k < 500; ++k) {
        const RaySample s = caster->trace(glm::dvec3(6) + random_place(random, 20),
                                          glm::dvec3(6) + random_place(random, 20));
        EXPECT_TRUE(std::isfinite(s.rgba.r + s.rgba.g + s.rgba.b + s.rgba.a + s.depth));
        seen = std::max(seen, s.rgba.a);
      }
      EXPECT_GT(seen, 0.9);
    }
}

TEST(Raycaster, NonFiniteVoxelsDoNoHarm) {
  auto v = make_volume<float>({12, 12, 12}, ScalarType::f32, [](int x, int y, int z) {
    if (x == 3) return std::numeric_limits<double>::quiet_NaN();
    if (y == 5) return std::numeric_limits<double>::infinity();
    return double(x + y + z);
  });
  const auto caster = make(std::move(v), ramp(5, 20, 0.5));
  std::mt19937 random(8);
  for (int k = 0; k < 500; ++k) {
    const RaySample s = caster->trace(glm::dvec3(6) + random_place(random, 20),
                                      glm::dvec3(6) + random_place(random, 20));
    EXPECT_TRUE(std::isfinite(s.rgba.r + s.rgba.g + s.rgba.b + s.rgba.a + s.depth));
    EXPECT_LE(s.rgba.a, 1.0001);
  }
}

TEST(Raycaster, NothingVisibleAndBadOptionsAreErrors) {
  const auto volume = [] {
    return make_volume<std::uint8_t>({8, 8, 8}, ScalarType::u8, [](int x, int, int) { return x; });
  };
  const auto nothing = Raycaster::make(volume(), ramp(100, 200, 1));
  ASSERT_FALSE(nothing);
  EXPECT_EQ(nothing.error().code, ErrorCode::failed);
  EXPECT_NE(nothing.error().message.find("nothing visible"), std::string::npos);
  for (const double step : {0.0, -1.0, std::nan(""), 1e9}) {
    RaycastOptions options;
    options.step = step;
    EXPECT_EQ(Raycaster::make(volume(), ramp(1, 5, 1), options).error().code, ErrorCode::usage);
  }
  RaycastOptions dark;
  dark.light = glm::dvec3(0);
  EXPECT_EQ(Raycaster::make(volume(), ramp(1, 5, 1), dark).error().code, ErrorCode::usage);
}

TEST(Raycaster, AClipAtVoxelsShowsWhatACropShows) {
  const auto inside = [](int x, int y, int z) {
    const auto in = [](int v) { return v >= 4 && v < 26; };
    return in(x) && in(y) && in(z) ? 200 : 0;
  };
  const Volume box = make_volume<std::uint8_t>({30, 30, 30}, ScalarType::u8, inside);
  Volume cropped = make_volume<std::uint8_t>(
      {20, 30, 15}, ScalarType::u8, [&](int x, int y, int z) { return inside(x, y, z + 15); });
  cropped.origin.z = 15;
  for (const double opacity : {0.05, 1.0})
    for (const Lighting mode : {Lighting::direct, Lighting::global}) {
      RaycastOptions options;
      options.lighting.mode = mode;
      options.lighting.samples = 64;
      options.shade = false;
      const auto crop = make(cropped, ramp(90, 110, opacity), options);
      options.clip = {{{19, 3, 3}, {2, 0, 0}}, {{-7, 0, 15}, {0, 0, -1}}};
      const auto clip = make(box, ramp(90, 110, opacity), options);
      EXPECT_EQ(clip->bounds().center, crop->bounds().center);
      EXPECT_EQ(clip->bounds().radius, crop->bounds().radius);
      EXPECT_GT(psnr_between(*clip, *crop), mode == Lighting::direct ? 90 : 45)
          << opacity << " " << static_cast<int>(mode);
    }
}

TEST(Raycaster, ClippedRaysEndAtThePlanes) {
  const Volume block =
      make_volume<std::uint8_t>({24, 24, 24}, ScalarType::u8, [](int, int, int) { return 200; });
  RaycastOptions options;
  options.clip = {{{10.3, 0, 0}, {-1, 0, 0}}, {{13.4, 7.7, 0}, {1, 0, 0}}};
  const auto slab = make(block, constant(0.2), options);
  const glm::dvec3 from(-40, 11.2, 11.3), to(60, 11.2, 11.3);
  const RaySample seen = slab->trace(from, to), back = slab->trace(to, from);
  EXPECT_NEAR(seen.rgba.a, 1 - std::pow(0.8, 3.1), 1e-3);
  EXPECT_NEAR(back.rgba.a, seen.rgba.a, 1e-5);
  EXPECT_GT(seen.depth, 0.503);
  EXPECT_LT(seen.depth, 0.534);
  EXPECT_EQ(slab->trace({5, -40, 5}, {5, 60, 5}).rgba.a, 0);
  EXPECT_NEAR(slab->trace({11.9, -40, 5}, {11.9, 60, 5}).rgba.a, 1 - std::pow(0.8, 23), 1e-3);
  EXPECT_EQ(raycast_options(slab->provenance()).clip.size(), 2u);
  EXPECT_EQ(raycast_options(slab->provenance()).clip[1].point, glm::dvec3(13.4, 7.7, 0));

  options.clip.push_back({{11, 0, 0}, {1, 0, 0}});
  options.clip.push_back({{11.5, 0, 0}, {-1, 0, 0}});
  const auto nothing = Raycaster::make(block, constant(0.2), options);
  ASSERT_FALSE(nothing);
  EXPECT_NE(nothing.error().message.find("clip"), std::string::npos);
  options.clip = {{{0, 0, 0}, {0, 0, 0}}};
  EXPECT_EQ(Raycaster::make(block, constant(0.2), options).error().code, ErrorCode::usage);
}

TEST(Raycaster, DegenerateRaysSeeNothing) {
  const auto caster = make(blobs(1), ramp(20, 120, 0.6));
  EXPECT_EQ(caster->trace({10, 10, 10}, {10, 10, 10}).rgba.a, 0);
  EXPECT_EQ(caster->trace({1e6, 0, 0}, {1e6, 1, 0}).rgba.a, 0);
}

TEST(Raycaster, ShadingBrightensWhatFacesTheLight) {
  auto v = make_volume<std::uint8_t>({41, 41, 41}, ScalarType::u8, [](int x, int y, int z) {
    return 200 - 10 * glm::length(glm::dvec3(x, y, z) - 20.0);
  });
  RaycastOptions options;
  options.light = {1, 0, 0};
  options.ambient = 0.2f;
  const auto caster = make(std::move(v), ramp(60, 70, 0.9), options);
  const float lit = caster->trace({100, 20, 20}, {-60, 20, 20}).rgba.r;
  const float dark = caster->trace({-60, 20, 20}, {100, 20, 20}).rgba.r;
  EXPECT_NEAR(dark / lit, 0.2, 0.03);
}

}  // namespace
}  // namespace slf
