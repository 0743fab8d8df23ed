// The physics of light transport: what must hold whatever the noise.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstring>
#include <functional>
#include <memory>
#include <numbers>
#include <random>
#include <utility>
#include <vector>

#include "slf/path_tracer.h"
#include "slf/raycaster.h"
#include "source/light/illumination.h"
#include "source/light/light_grid.h"
#include "source/light/light_rig.h"
#include "source/light/light_volume.h"
#include "source/medium/medium.h"
#include "source/medium/visible_space.h"
#include "source/raycast/prepared_volume.h"
#include "tests/instruction_set.h"
#include "tests/source/light/light_samples.h"

namespace slf {
namespace {

using namespace samples;

constexpr double kForever = std::numeric_limits<double>::infinity();

glm::dvec3 random_point(std::mt19937& random, double radius) {
  std::normal_distribution<double> normal;
  return radius * glm::normalize(glm::dvec3(normal(random), normal(random), normal(random)));
}

/// Straight colours of random rays that see something.
std::vector<glm::vec3> colors(const Scene& scene, int rays) {
  std::mt19937 random(1);
  const Sphere s = scene.bounds();
  std::vector<glm::vec3> seen;
  for (int k = 0; k < rays; ++k) {
    const RaySample sample = scene.trace(s.center + random_point(random, s.radius),
                                         s.center + random_point(random, s.radius));
    if (sample.rgba.a > 0.2f) seen.push_back(glm::vec3(sample.rgba) / sample.rgba.a);
  }
  EXPECT_GT(seen.size(), 20u);
  return seen;
}

TEST(Light, FurnaceIsInvisible) {
  // White matter under an even sky has the radiance of the sky everywhere: surfaces (a ball with
  // an edge) and fog alike.
  for (const TransferFunction& t :
       {material(glm::dvec3(1), {{100, 0}, {160, 0.9}}), fog(glm::dvec3(1), 0.1)}) {
    RaycastOptions options = lit(kWhiteSky);
    options.lighting.samples = 1024;  // of few, the change with the normal is noisy
    const auto light = Raycaster::make(ball(20), t, options);
    ASSERT_TRUE(light) << light.error().message;
    for (const glm::vec3& c : colors(**light, 200))
      for (int k = 0; k < 3; ++k) EXPECT_NEAR(c[k], 1, 0.01);
    const auto reference = PathTracer::make(ball(20), t, lit(kWhiteSky), {16, 1});
    ASSERT_TRUE(reference) << reference.error().message;
    for (const glm::vec3& c : colors(**reference, 200))
      for (int k = 0; k < 3; ++k) EXPECT_NEAR(c[k], 1, 1e-4);
  }
}

/// How much the colours of a ball under an even sky differ from ray to ray, with nodes two voxels
/// apart: the standard deviation, divided by the mean.
double unevenness(const Volume& volume) {
  RaycastOptions options = lit(kWhiteSky);
  options.lighting.spacing = 2;
  options.lighting.samples = 256;
  const auto scene =
      Raycaster::make(volume, material(glm::dvec3(0.7), {{120, 0}, {136, 1}}), options);
  EXPECT_TRUE(scene) << scene.error().message;
  if (!scene) return 1;
  const Sphere s = (*scene)->bounds();
  std::mt19937 random(1);
  double sum = 0, squares = 0;
  constexpr int kRays = 1000;
  for (int k = 0; k < kRays; ++k) {
    const glm::dvec3 from = random_point(random, s.radius);
    const double seen = (*scene)->trace(s.center + from, s.center - from).rgba.g;
    sum += seen / kRays;
    squares += seen * seen / kRays;
  }
  return std::sqrt(squares - sum * sum) / sum;
}

TEST(Light, NodesHardlyShowOnASurface) {
  // Every point of an opaque ball has the same colour, wherever it passes between the nodes.
  EXPECT_LT(unevenness(ball(48)), 0.015);
}

TEST(Light, ThinWallsHideTheDarkBehindThem) {
  // The same of a hollow ball, although nodes just below its surface lie in the dark.
  const Volume shell = volume_of(glm::uvec3(48), [](glm::ivec3 at) {
    const double r = glm::distance(glm::dvec3(at), glm::dvec3(23.5));
    return std::clamp(128 + 40 * (1.5 - std::abs(r - 15)), 0.0, 255.0);
  });
  EXPECT_LT(unevenness(shell), 0.014);
}

TEST(Light, DoesNotDependOnTheAxesOfTheVolume) {
  // A wavy ball, and the same ball from voxels that run along other axes.
  constexpr int kSide = 48;
  const auto value = [](glm::dvec3 at) {
    at -= glm::dvec3((kSide - 1) / 2.0);
    const double r = 0.3 * kSide + 3 * std::sin(0.4 * at.x);
    return std::clamp(128 + 16 * (r - glm::length(at)), 0.0, 255.0);
  };
  const auto scene_of = [](const Volume& volume) {
    RaycastOptions options = lit(sun(glm::normalize(glm::dvec3(1, -2, 3))));
    options.lighting.spacing = 2;
    options.lighting.samples = 256;
    return Raycaster::make(volume, material(glm::dvec3(0.7), {{120, 0}, {136, 1}}), options);
  };
  const glm::uvec3 dims(kSide);
  const auto plain = scene_of(volume_of(dims, value));
  Volume turned = volume_of(dims, [&](glm::ivec3 at) { return value({at.z, at.y, at.x}); });
  std::swap(turned.axes[0], turned.axes[2]);
  const auto other = scene_of(turned);
  ASSERT_TRUE(plain && other);
  std::mt19937 random(1);
  const Sphere s = (*plain)->bounds();
  double difference = 0, sum = 0;
  for (int k = 0; k < 2000; ++k) {
    const glm::dvec3 from = random_point(random, s.radius), to = random_point(random, s.radius);
    const auto seen = [&](const Scene& scene) {
      return scene.trace(s.center + from, s.center + to);
    };
    sum += seen(**plain).rgba.g;
    difference += std::abs(seen(**plain).rgba.g - seen(**other).rgba.g);
  }
  EXPECT_LT(difference / sum, 0.035);
}

TEST(Light, NothingGetsBrighterThanItsSky) {
  // White matter that faces straight up reflects the mean of the sky's radiance, weighted by the
  // cosine. The radiance is (1 + z) / 2 at height z, its mean 5/6.
  constexpr double kMostReflected = 5.0 / 6;
  const LightRig half{"half", "", {}, {glm::vec3(1), glm::vec3(0.5f), glm::vec3(0)}};
  for (const double srgb : {0.5, 0.9, 1.0}) {
    const auto light =
        Raycaster::make(ball(20), material(glm::dvec3(srgb), {{100, 0}, {160, 0.9}}), lit(half));
    ASSERT_TRUE(light) << light.error().message;
    for (const glm::vec3& c : colors(**light, 2000)) EXPECT_LE(c.r, kMostReflected + 0.01);
  }
}

TEST(Light, FogReturnsNoMorePowerThanItGets) {
  // The power that leaves a ball of white fog is the mean of its radiance over all lines, times
  // their measure, and must equal what the sun puts in: its irradiance on the ball's shadow.
  constexpr int kSide = 20;
  const Volume round = volume_of(glm::uvec3(kSide), [](glm::ivec3 at) {
    return glm::distance(glm::dvec3(at), glm::dvec3((kSide - 1) / 2.0)) < 7 ? 200 : 0;
  });
  TransferFunction t = material(glm::dvec3(1), {{0, 0}, {199, 0}, {200, 0.3}});
  t.opacities.insert(t.opacities.begin() + 2, {199.5, 0, 0.5, 0});
  const auto scene = prepare_volume(round, t, lit(sun({0, 0, 1})));
  ASSERT_TRUE(scene) << scene.error().message;
  const Medium medium((*scene)->grid);
  const Sphere s = (*scene)->bounds;
  // In: parallel rays that interact. Irradiance π.
  Random random(1);
  std::mt19937 points(1);
  constexpr int kRays = 60000;
  int caught = 0;
  for (int k = 0; k < kRays; ++k) {
    const double r = s.radius * std::sqrt(random()), a = 2 * std::numbers::pi * random();
    const glm::dvec3 at = s.center + glm::dvec3(r * std::cos(a), r * std::sin(a), s.radius);
    const glm::dvec3 index = (*scene)->grid.world_to_index * (at - (*scene)->grid.origin);
    caught += medium.fly(index, medium.per_world({0, 0, -1}), kForever, random).has_value();
  }
  const double in = std::numbers::pi * (std::numbers::pi * s.radius * s.radius) * caught / kRays;
  // Out: lines through the sphere, uniform in direction and in the plane across it.
  const auto tracer = PathTracer::make(round, t, lit(sun({0, 0, 1})), {4, 1});
  ASSERT_TRUE(tracer) << tracer.error().message;
  double radiance = 0;
  for (int k = 0; k < kRays; ++k) {
    const glm::dvec3 d = uniform_direction(random(), random());
    const glm::dvec3 across = glm::normalize(glm::cross(d, random_point(points, 1)));
    const glm::dvec3 at = s.center + s.radius * std::sqrt(random()) * across;
    radiance += (*tracer)->trace(at - 2 * s.radius * d, at + 2 * s.radius * d).rgba.r;
  }
  const double out =
      radiance / kRays * (4 * std::numbers::pi) * (std::numbers::pi * s.radius * s.radius);
  EXPECT_NEAR(out / in, 1, 0.04);
}

TEST(Light, TransmittanceFollowsBeerAndLambert) {
  // Through 10 world units of fog of opacity o per unit, (1 - o)^10 passes.
  for (const double opacity : {0.02, 0.1, 0.4}) {
    const auto scene = prepare_volume(volume_of({11, 11, 11}, [](glm::ivec3) { return 100; }),
                                      fog(glm::dvec3(1), opacity), lit(kWhiteSky));
    ASSERT_TRUE(scene) << scene.error().message;
    const Medium medium((*scene)->grid);
    const double expected = std::pow(1 - opacity, 10);
    const glm::dvec3 from(5.2, 4.7, -3), along = medium.per_world({0, 0, 1});
    const double depth = medium.optical_depth(from, along, kForever, 0.5);
    EXPECT_NEAR(depth, std::min(-std::log(expected), Medium::kDark), 0.06 * -std::log(expected));
    Random random(1);
    constexpr int kFlights = 100000;
    int passed = 0;
    for (int k = 0; k < kFlights; ++k)
      passed += !medium.fly(from, along, kForever, random).has_value();
    const double noise = std::sqrt(expected * (1 - expected) / kFlights);
    EXPECT_NEAR(static_cast<double>(passed) / kFlights, expected, 4 * noise + 1e-6);
  }
}

TEST(Light, FlightsAreTheSameThroughLargeBricks) {
  for (const bool labels : {false, true}) {
    Volume cloud = volume_of(glm::uvec3(33), [&](glm::ivec3 at) {
      const int value = (at.x * at.x + 3 * at.y + at.z * at.z) % 200;
      return glm::distance(glm::dvec3(at), glm::dvec3(16)) > 13 ? 0 : labels ? value % 4 : value;
    });
    cloud.labels = labels;
    const auto scene =
        prepare_volume(cloud,
                       labels ? material({1, 1, 1}, {{0, 0}, {1, 0.05}, {2, 0.2}, {3, 0}})
                              : material({1, 1, 1}, {{80, 0}, {120, 0.2}, {200, 0.3}}),
                       lit(kWhiteSky));
    ASSERT_TRUE(scene) << scene.error().message;
    for (const std::uint64_t max_bricks : {kMaxBricks, std::uint64_t{600}, std::uint64_t{1}}) {
      RayGrid& grid = (*scene)->grid;
      ASSERT_TRUE(find_visible_space((*scene)->volume, grid, false, 2, max_bricks));
      EXPECT_LE(grid.distance.size(), max_bricks);
      const Medium medium(grid, 2);
      std::mt19937 places(5);
      Random random(1);
      for (int k = 0; k < 12; ++k) {
        const glm::dvec3 from = glm::dvec3(16) + random_point(places, 8);
        const glm::dvec3 along = medium.per_world(random_point(places, 1));
        constexpr double kLength = 5;
        constexpr int kSteps = 2000, kFlights = 20000;
        double depth = 0;
        for (int step = 0; step < kSteps; ++step)
          depth +=
              kLength / kSteps * medium.extinction(from + kLength / kSteps * (step + 0.5) * along);
        int passed = 0;
        for (int flight = 0; flight < kFlights; ++flight)
          passed += !medium.fly(from, along, kLength, random).has_value();
        const double expected = std::exp(-depth);
        EXPECT_NEAR(static_cast<double>(passed) / kFlights, expected,
                    5 * std::sqrt(expected * (1 - expected) / kFlights) + 1e-3)
            << labels << " " << max_bricks;
      }
    }
  }
}

TEST(Light, OpticalDepthsAddUpExtinctionsOfEveryKindOfVoxel) {
  const auto check = [&]<class T>(T, ScalarType type, double low, bool labels = false) {
    Volume volume;
    volume.dims = {17, 15, 13};
    volume.type = type;
    volume.labels = labels;
    volume.source = "test";
    for (int k = 0; k < 17 * 15 * 13; ++k) {
      const int x = k % 17, y = k / 17 % 15, z = k / (17 * 15);
      const auto voxel = static_cast<T>(low + (labels ? x / 3 % 3 : (x * x + 3 * y + z * z) % 60));
      const auto* bytes = reinterpret_cast<const std::byte*>(&voxel);
      volume.voxels.insert(volume.voxels.end(), bytes, bytes + sizeof voxel);
    }
    const double visible = low + (labels ? 1 : 25);
    const auto scene = prepare_volume(
        volume, material({1, 1, 1}, {{visible - 1, 0}, {visible, 0.1}, {low + 60, 0.4}}),
        lit(kWhiteSky));
    ASSERT_TRUE(scene) << scene.error().message;
    const Medium medium((*scene)->grid);
    testing::with_each_instruction_set([&](const char* instruction_set) {
      std::mt19937 random(3);
      int thin = 0;
      for (int k = 0; k < 200; ++k) {
        const glm::dvec3 from = glm::dvec3(8, 7, 6) + random_point(random, 5);
        const glm::dvec3 along = medium.per_world(random_point(random, 1));
        double expected = 0;
        for (double t = 0.3 * Medium::kStep; t < 6; t += Medium::kStep) {
          const glm::dvec3 at = from + t * along;
          if (glm::all(glm::greaterThanEqual(at, (*scene)->grid.visible_low)) &&
              glm::all(glm::lessThan(at, (*scene)->grid.visible_high)))
            expected += Medium::kStep * medium.extinction(at);
        }
        const double depth = medium.optical_depth(from, along, 6, 0.3);
        thin += depth > 0 && depth < Medium::kDark;
        EXPECT_NEAR(std::min(depth, Medium::kDark), std::min(expected, Medium::kDark),
                    1e-2 * expected + 1e-5)
            << name(type) << " " << instruction_set;
      }
      EXPECT_GT(thin, 100);
    });
  };
  check(std::uint8_t{}, ScalarType::u8, 150);
  check(std::int8_t{}, ScalarType::i8, -30);
  check(std::uint16_t{}, ScalarType::u16, 40000);
  check(std::int16_t{}, ScalarType::i16, -30);
  check(float{}, ScalarType::f32, -30);
  check(std::uint8_t{}, ScalarType::u8, 0, true);
}

TEST(Light, SingleScatteringInASlabHasAClosedForm) {
  // A slab of fog of optical thickness T, lit along the eye's line of sight by irradiance π: what
  // is scattered once at optical depth t was attenuated by e^-t on both ways, so the radiance is
  // albedo/4π · π · ∫ e^-2t dt = albedo/8 · (1 - e^-2T). The fog is thin, because the box of the
  // volume cuts it, and the cut face of what is dense is a surface.
  constexpr int kSide = 15;
  const float color = 0.2f;
  const double albedo = albedo_of(glm::vec3(color)).r;
  const Volume slab = volume_of({61, 61, kSide}, [](glm::ivec3) { return 100; });
  const double srgb = srgb_from_linear(color);
  RaycastOptions options = lit(sun({0, 0, 1}), Lighting::shadowed);
  options.step = 0.05;
  const glm::dvec3 from(30, 30, 40), to(30, 30, -40);
  for (const double opacity : {0.02, 0.04}) {
    const double thickness = -(kSide - 1) * std::log(1 - opacity);
    const double expected = albedo / 8 * (1 - std::exp(-2 * thickness));
    const TransferFunction t = fog(glm::dvec3(srgb), opacity);
    const auto reference = PathTracer::make(slab, t, options, {40000, 1});
    ASSERT_TRUE(reference) << reference.error().message;
    EXPECT_NEAR((*reference)->trace(from, to).rgba.r / expected, 1, 0.02) << opacity;
    const auto light = Raycaster::make(slab, t, options);
    ASSERT_TRUE(light) << light.error().message;
    EXPECT_NEAR((*light)->trace(from, to).rgba.r / expected, 1, 0.04) << opacity;
  }
}

TEST(Light, ACutFaceIsASurface) {
  // Values that rise sideways have a gradient along the face; what shows is the face.
  Volume block = volume_of({24, 24, 24}, [](glm::ivec3 at) { return 150 + 4 * at.x; });
  block.axes[2] = {0, 0, 2};
  const TransferFunction t = material(glm::dvec3(1), {{90, 0}, {91, 1}});
  // The face of the volume; that of a clip; and that of a clip that is oblique.
  const std::vector<ClipPlane> clips[]{
      {}, {{{0, 0, 20.7}, {0, 0, 3}}}, {{{11.3, 11.6, 20.7}, {0, 0.6, 0.8}}}};
  for (const std::vector<ClipPlane>& clip : clips)
    for (const double cosine : {1.0, 0.5, -1.0}) {
      const glm::dvec3 normal = clip.empty() ? glm::dvec3(0, 0, 1) : glm::normalize(clip[0].normal);
      const glm::dvec3 side(0, normal.z, -normal.y);
      RaycastOptions options =
          lit(sun(cosine * normal + std::sqrt(1 - cosine * cosine) * side), Lighting::shadowed);
      options.clip = clip;
      const auto reference = PathTracer::make(block, t, options, {64, 1});
      const auto volume = Raycaster::make(block, t, options);
      options.light = options.lighting.rig.lights[0].direction;
      options.lighting.mode = Lighting::direct;
      options.ambient = 0;
      const auto direct = Raycaster::make(block, t, options);
      ASSERT_TRUE(reference && volume && direct);
      std::vector<const Scene*> scenes{reference->get(), volume->get()};
      if (!clip.empty()) scenes.push_back(direct->get());
      for (const Scene* scene : scenes)
        EXPECT_NEAR(scene->trace({11.3, 11.6, 60}, {11.3, 11.6, -30}).rgba.r, std::max(cosine, 0.0),
                    0.06)
            << cosine << " " << normal.y;
    }
}

TEST(Light, ASurfaceThatFacesTheLightIsWhite) {
  // That is what an intensity of 1 means; one that faces away is black without other light.
  const Volume block = volume_of({30, 30, 30}, [](glm::ivec3 at) { return at.z < 15 ? 200 : 0; });
  const TransferFunction t = material(glm::dvec3(1), {{90, 0}, {91, 1}});
  for (const double z : {1.0, -1.0}) {
    const auto scene = PathTracer::make(block, t, lit(sun({0, 0, z}), Lighting::shadowed), {64, 1});
    ASSERT_TRUE(scene) << scene.error().message;
    const RaySample s = (*scene)->trace({14, 14, 60}, {14, 14, -30});
    EXPECT_NEAR(s.rgba.a, 1, 1e-4);
    EXPECT_NEAR(s.rgba.r, z > 0 ? 1 : 0, 0.08);
  }
}

/// The colours of a volume under a rig, from its light volume and from path tracing the same rays.
/// Empty, with a failure, where one cannot be made.
std::pair<std::vector<glm::vec3>, std::vector<glm::vec3>> with_volume_and_reference(
    const TransferFunction& t, const LightRig& rig, const Volume& volume = ball(24)) {
  RaycastOptions options = lit(rig);
  options.step = 0.3;
  const auto light = Raycaster::make(volume, t, options);
  const auto reference = PathTracer::make(volume, t, options, {256, 1});
  if (!light || !reference) {
    ADD_FAILURE() << (light ? reference.error() : light.error()).message;
    return {};
  }
  std::mt19937 random(1);
  const Sphere s = (*light)->bounds();
  std::pair<std::vector<glm::vec3>, std::vector<glm::vec3>> seen;
  for (int k = 0; k < 150; ++k) {
    const glm::dvec3 from = s.center + random_point(random, s.radius);
    const glm::dvec3 to = s.center + random_point(random, s.radius);
    const glm::vec4 a = (*light)->trace(from, to).rgba, b = (*reference)->trace(from, to).rgba;
    if (!(a.a > 0.2f && b.a > 0)) continue;
    seen.first.push_back(glm::vec3(a) / a.a);
    seen.second.push_back(glm::vec3(b) / b.a);
  }
  EXPECT_GT(seen.first.size(), 20u);
  return seen;
}

/// Expects that colours under a rig differ from the reference by less than a share of the mean.
void expect_as_in_the_reference(const LightRig& rig, double max_difference) {
  SCOPED_TRACE(rig.name);
  const TransferFunction t = material({0.9, 0.7, 0.5}, {{100, 0}, {160, 0.6}});
  const auto [a, b] = with_volume_and_reference(t, rig);
  ASSERT_FALSE(b.empty());
  double difference = 0, sum = 0, bias = 0;
  for (std::size_t k = 0; k < a.size(); ++k) {
    difference += std::abs(a[k].g - b[k].g);
    bias += a[k].g - b[k].g;
    sum += b[k].g;
  }
  EXPECT_LT(difference / sum, max_difference);
  EXPECT_LT(std::abs(bias) / sum, 0.03);
}

TEST(Light, VolumeAndReferenceAgreeUnderEveryRig) {
  for (const LightRig& rig : built_in_rigs()) expect_as_in_the_reference(rig, 0.08);
}

TEST(Light, ALightNearbyAndManyLightsAreAsInTheReference) {
  // Rays compute the direction and the falling off of near lights; a fourth light counts as
  // surroundings.
  LightRig many{"many", "", {}};
  for (const double angle : {0.0, 1.3, 2.6, 3.9, 5.2})
    many.lights.push_back({{std::cos(angle), std::sin(angle), 0.5}, glm::vec3(1), 0.4f, 10});
  expect_as_in_the_reference({"near", "", {{{1, -2, 1}, glm::vec3(1), 2, 5, 1.5f}}}, 0.1);
  expect_as_in_the_reference(many, 0.1);
}

TEST(Light, ColoursThatChangeWithinAVoxelAreAsInTheReference) {
  // From dark red to white within two voxels below the surface: a node has points of all colours.
  TransferFunction t = material({0.5, 0.1, 0.1}, {{100, 0}, {160, 0.6}});
  t.colors = {{120, {0.5, 0.1, 0.1}}, {200, {1, 1, 1}}};
  const auto [a, b] = with_volume_and_reference(t, built_in_rigs().front());
  ASSERT_FALSE(b.empty());
  glm::vec3 sum(0), expected(0);
  for (std::size_t k = 0; k < a.size(); ++k) sum += a[k], expected += b[k];
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(sum[c] / expected[c], 1, 0.03) << c;
}

TEST(Light, LightThatScattersOftenIsAsInTheReference) {
  // In thin matter most light comes from far away, where the paths of the second pass end.
  const auto [a, b] =
      with_volume_and_reference(fog({0.8, 0.6, 0.4}, 0.08), built_in_rigs().front());
  ASSERT_FALSE(b.empty());
  glm::vec3 sum(0), expected(0);
  for (std::size_t k = 0; k < a.size(); ++k) sum += a[k], expected += b[k];
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(sum[c] / expected[c], 1, 0.015) << c;
}

TEST(Light, AFewPeaksDoNotFlattenWhatIsBelow) {
  // A bright voxel deep inside opaque matter changes the range of values, and nothing that shows.
  const TransferFunction t = material({0.9, 0.7, 0.5}, {{100, 0}, {160, 0.9}});
  const auto volume = [](float peak) {
    Volume v = ball(24);
    std::vector<float> values;
    for (const std::byte b : v.voxels) values.push_back(static_cast<float>(b));
    values[(12 * 24 + 12) * 24 + 12] = peak;
    v.type = ScalarType::f32;
    v.voxels.resize(values.size() * sizeof(float));
    std::memcpy(v.voxels.data(), values.data(), v.voxels.size());
    return v;
  };
  for (const Lighting mode : {Lighting::direct, Lighting::shadowed}) {
    const auto plain = Raycaster::make(volume(255), t, lit(sun({1, -1, 1}), mode));
    const auto peaked = Raycaster::make(volume(1e5f), t, lit(sun({1, -1, 1}), mode));
    ASSERT_TRUE(plain && peaked);
    const auto a = colors(**plain, 100), b = colors(**peaked, 100);
    ASSERT_EQ(a.size(), b.size());
    for (std::size_t k = 0; k < a.size(); ++k) EXPECT_NEAR(a[k].g, b[k].g, 0.05);
  }
}

TEST(Light, DoesNotDependOnTheThreads) {
  RaycastOptions options = lit(built_in_rigs().front());
  options.lighting.samples = 8;
  const TransferFunction t = material({0.9, 0.7, 0.5}, {{100, 0}, {160, 0.6}});
  const auto scene = prepare_volume(ball(20), t, options);
  ASSERT_TRUE(scene) << scene.error().message;
  const Medium medium((*scene)->grid);
  const Illumination illumination = illuminate(options.lighting, (*scene)->bounds);
  const auto one = compute_light(medium, illumination, options.lighting, 1, {});
  const auto three = compute_light(medium, illumination, options.lighting, 3, {});
  ASSERT_TRUE(one && three);
  EXPECT_EQ(one->nodes, three->nodes);
  options.lighting.seed = 2;
  EXPECT_NE(compute_light(medium, illumination, options.lighting, 3, {})->nodes, one->nodes);
}

TEST(Light, MemoryBoundsTheGrid) {
  RaycastOptions options = lit(kWhiteSky);
  options.lighting.memory = 1 << 20;
  options.lighting.samples = 1;
  const auto scene = prepare_volume(volume_of(glm::uvec3(60), [](glm::ivec3) { return 100; }),
                                    fog(glm::dvec3(1), 0.01), options);
  ASSERT_TRUE(scene) << scene.error().message;
  const auto light =
      compute_light(Medium((*scene)->grid), illuminate(options.lighting, (*scene)->bounds),
                    options.lighting, 0, {});
  ASSERT_TRUE(light);
  EXPECT_GT(light->spacing, 1);
  EXPECT_LE(light->size() * 56, options.lighting.memory);
}

TEST(Light, StopsWhenAsked) {
  const TransferFunction t = material({0.9, 0.7, 0.5}, {{100, 0}, {160, 0.6}});
  const auto made =
      Raycaster::make(ball(24), t, lit(kWhiteSky), {1, [](const Progress&) { return false; }, {}});
  ASSERT_FALSE(made);
  EXPECT_EQ(made.error().code, ErrorCode::cancelled);
}

TEST(Light, WaitsUntilItIsNeeded) {
  const TransferFunction t = material({0.9, 0.7, 0.5}, {{100, 0}, {160, 0.6}});
  RaycastOptions options = lit(kWhiteSky);
  options.lighting.samples = 2;
  int reports = 0;
  const auto count = [&](const Progress&) { return ++reports > 0; };
  const auto made = Raycaster::make(ball(20), t, options, {1, count, {}, true});
  ASSERT_TRUE(made) << made.error().message;
  EXPECT_EQ(reports, 0);
  ASSERT_TRUE((*made)->prepare());
  const int computed = reports;
  EXPECT_GT(computed, 0);
  ASSERT_TRUE((*made)->prepare());
  EXPECT_EQ(reports, computed);
}

TEST(Light, RaysComputeWhatTheyNeed) {
  const TransferFunction t = material({0.9, 0.7, 0.5}, {{100, 0}, {160, 0.6}});
  for (const Lighting mode : {Lighting::global, Lighting::shadowed}) {
    RaycastOptions options = lit(built_in_rigs().front(), mode);
    options.lighting.samples = 4;
    std::uint64_t most = 0;
    const auto count = [&](const Progress& p) {
      most = std::max(most, p.total);
      return true;
    };
    const auto whole = Raycaster::make(ball(48), t, options, {0, count});
    ASSERT_TRUE(whole) << whole.error().message;
    const std::uint64_t all = std::exchange(most, 0);
    const Sphere bounds = (*whole)->bounds();
    const Camera camera = orbit_camera(bounds, 30, 20, 3, 60, 40);
    const Image truth = *trace_view(**whole, bounds, camera);
    // A view, and rays alone.
    const auto some = Raycaster::make(ball(48), t, options, {3, count, {}, true});
    ASSERT_TRUE(some) << some.error().message;
    const auto view = trace_view(**some, bounds, camera, 3);
    ASSERT_TRUE(view) << view.error().message;
    EXPECT_EQ(view->rgba, truth.rgba);
    EXPECT_GT(most, 0u);
    EXPECT_LT(most, all * 4 / 5);
    EXPECT_TRUE((*some)->light().empty());
    const auto alone = Raycaster::make(ball(48), t, options, {1, {}, {}, true});
    ASSERT_TRUE(alone) << alone.error().message;
    std::mt19937 random(1);
    for (int k = 0; k < 20; ++k) {
      const glm::dvec3 from = bounds.center + random_point(random, bounds.radius),
                       to = bounds.center + random_point(random, bounds.radius);
      EXPECT_EQ((*alone)->trace(from, to).rgba, (*whole)->trace(from, to).rgba);
    }
    ASSERT_TRUE((*some)->prepare());
    EXPECT_EQ((*some)->light(), (*whole)->light());
  }
}

TEST(Light, BadSettingsAreRefused) {
  const auto error = [](const std::function<void(LightOptions&)>& change) {
    RaycastOptions options = lit(built_in_rigs().front());
    change(options.lighting);
    const auto made = Raycaster::make(ball(12), fog(glm::dvec3(1), 0.1), options);
    EXPECT_FALSE(made);
    EXPECT_EQ(made.error().code, ErrorCode::usage);
    return made.error().message;
  };
  const auto picture = [](float value) {
    Image image;
    image.width = 2, image.height = 1;
    image.rgba = {glm::vec4(1), glm::vec4(value, 0, 0, 1)};
    return std::make_shared<const Image>(image);
  };
  EXPECT_NE(error([](auto& o) { o.rig.lights[1].intensity = -1; }).find("light 1: intensity"),
            std::string::npos);
  EXPECT_NE(error([](auto& o) { o.rig.lights[0].direction = glm::dvec3(0); }).find("direction"),
            std::string::npos);
  EXPECT_NE(error([](auto& o) { o.rig.sky.up.g = NAN; }).find("sky"), std::string::npos);
  EXPECT_NE(error([](auto& o) { o.samples = 0; }).find("samples 0"), std::string::npos);
  EXPECT_NE(error([](auto& o) { o.spacing = NAN; }).find("spacing"), std::string::npos);
  EXPECT_NE(error([&](auto& o) { o.environment = picture(NAN); }).find("pixel 1,0"),
            std::string::npos);
  EXPECT_NE(error([&](auto& o) { o.environment = picture(-1); }).find("pixel 1,0"),
            std::string::npos);
}

}  // namespace
}  // namespace slf
