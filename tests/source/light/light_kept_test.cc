// Light volumes that are packed, coded, and kept in files and fields.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <memory>
#include <random>
#include <utility>
#include <vector>

#include "slf/raycaster.h"
#include "source/light/illumination.h"
#include "source/light/light_code.h"
#include "source/light/light_grid.h"
#include "source/light/light_rig.h"
#include "source/light/light_volume.h"
#include "source/medium/medium.h"
#include "source/raycast/prepared_volume.h"
#include "tests/source/light/light_samples.h"

namespace slf {
namespace {

using namespace samples;

TEST(LightKept, IsKeptInAFile) {
  const std::string path = ::testing::TempDir() + "kept.light";
  std::filesystem::remove(path);
  const TransferFunction t = material({0.9, 0.7, 0.5}, {{100, 0}, {160, 0.6}});
  RaycastOptions options = lit(kWhiteSky);
  options.lighting.samples = 2;
  const auto make = [&] {
    bool computed = false;
    const auto made = Raycaster::make(ball(20), t, options,
                                      {1, [&](const Progress&) { return computed = true; }, path});
    EXPECT_TRUE(made) << made.error().message;
    return std::pair(computed, (*made)->trace({-30, 9, 9}, {50, 9, 9}).rgba);
  };
  const auto first = make();
  EXPECT_TRUE(first.first);
  const auto second = make();
  EXPECT_FALSE(second.first);
  EXPECT_EQ(second.second, first.second);
  options.lighting.seed = 7;  // other light
  EXPECT_TRUE(make().first);
  // Damage is found.
  const auto size = std::filesystem::file_size(path);
  for (const std::uintmax_t keep : {size - 1, size / 2, std::uintmax_t{20}, std::uintmax_t{0}}) {
    std::filesystem::resize_file(path, keep);
    EXPECT_TRUE(make().first) << keep;
  }
  // A file of an earlier version is replaced; somebody else's is kept.
  std::ofstream(path) << "slf light v5\n";
  EXPECT_TRUE(make().first);
  EXPECT_FALSE(make().first);
  std::ofstream(path) << "slf knows nothing of this";
  EXPECT_FALSE(Raycaster::make(ball(20), t, options, {1, {}, path}));
  std::filesystem::remove(path);
}

/// A light volume of a few thousand nodes, with the inputs that it was computed from.
struct Computed {
  std::unique_ptr<PreparedVolume> scene;
  LightGrid light;
};

Computed computed_light() {
  RaycastOptions options = lit(built_in_rigs().front());
  options.lighting.samples = 2;
  auto scene = prepare_volume(ball(20), material({0.9, 0.7, 0.5}, {{100, 0}, {160, 0.6}}), options);
  EXPECT_TRUE(scene) << scene.error().message;
  auto light = compute_light(Medium((*scene)->grid), illuminate(options.lighting, (*scene)->bounds),
                             options.lighting, 0, {});
  EXPECT_TRUE(light) << light.error().message;
  return {std::move(*scene), std::move(*light)};
}

TEST(LightKept, CodedLightIsTheSame) {
  const Computed made = computed_light();
  const Bytes coded = encode_light("key", made.light);
  EXPECT_LT(coded.size(), made.light.nodes.size());
  LightGrid plan = made.light;
  plan.nodes.clear();
  const auto decoded = decode_light(coded, "key", plan);
  ASSERT_TRUE(decoded);
  EXPECT_EQ(decoded->nodes, made.light.nodes);
  EXPECT_FALSE(decode_light(coded, "another", plan));
  LightGrid larger = plan;
  ++larger.dims[2];
  EXPECT_FALSE(decode_light(coded, "key", larger));
}

TEST(LightKept, DamagedCodedLightIsRefused) {
  const Computed made = computed_light();
  const Bytes coded = encode_light("key", made.light);
  LightGrid plan = made.light;
  plan.nodes.clear();
  for (std::size_t size = 0; size < coded.size(); size += 1 + size / 16)
    EXPECT_FALSE(decode_light(ByteSpan(coded).first(size), "key", plan)) << size;
  std::mt19937 random(1);
  for (int k = 0; k < 200; ++k) {
    Bytes flipped = coded;
    flipped[random() % flipped.size()] ^= std::byte{1} << random() % 8;
    const auto decoded = decode_light(flipped, "key", plan);
    EXPECT_TRUE(!decoded || decoded->nodes == made.light.nodes);  // a bit that zstd ignores
  }
}

TEST(LightKept, IsTakenFromAnEqualScene) {
  const TransferFunction t = material({0.9, 0.7, 0.5}, {{100, 0}, {160, 0.6}});
  RaycastOptions options = lit(kWhiteSky);
  options.lighting.samples = 2;
  const auto first = Raycaster::make(ball(20), t, options);
  ASSERT_TRUE(first) << first.error().message;
  const std::vector<std::byte> light = (*first)->light();
  ASSERT_FALSE(light.empty());
  bool computed = false;
  const LightVolumeOptions deferred{1, [&](const Progress&) { return computed = true; }, {}, true};
  options.lighting.linear = false;  // tones do not change the light
  const auto second = Raycaster::make(ball(20), t, options, deferred);
  ASSERT_TRUE(second) << second.error().message;
  EXPECT_FALSE((*second)->set_light({}));
  EXPECT_TRUE((*second)->set_light(light));
  ASSERT_TRUE((*second)->prepare());
  EXPECT_FALSE(computed);
  EXPECT_EQ((*second)->light(), light);
  options.lighting.bounces = 3;
  const auto other = Raycaster::make(ball(20), t, options, deferred);
  ASSERT_TRUE(other) << other.error().message;
  EXPECT_FALSE((*other)->set_light(light));
}

TEST(LightKept, ProvenanceHoldsEverySetting) {
  RaycastOptions options = lit(built_in_rigs()[1], Lighting::shadowed);
  options.lighting.samples = 3;
  options.lighting.bounces = 5;
  options.lighting.spacing = 2;
  options.lighting.seed = 9;
  options.lighting.linear = false;
  options.lighting.tone = {1.5f, ToneCurve::srgb};
  const auto scene = prepare_volume(ball(12), fog(glm::dvec3(1), 0.1), options);
  ASSERT_TRUE(scene) << scene.error().message;
  const RaycastOptions back = raycast_options((*scene)->provenance);
  EXPECT_EQ(back.lighting.mode, options.lighting.mode);
  EXPECT_EQ(to_json(back.lighting.rig), to_json(options.lighting.rig));
  EXPECT_EQ(back.lighting.samples, 3u);
  EXPECT_EQ(back.lighting.bounces, 5u);
  EXPECT_EQ(back.lighting.spacing, 2);
  EXPECT_EQ(back.lighting.seed, 9u);
  EXPECT_EQ(back.lighting.linear, false);
  EXPECT_EQ(back.lighting.tone, options.lighting.tone);
}

TEST(LightKept, PackedLightIsCloseToItsOwn) {
  std::mt19937 random(1);
  std::uniform_real_distribution<float> exponent(-16, 15), side(-1, 1), part(0, 1.2f);
  for (int k = 0; k < 10000; ++k) {
    const float size = std::exp2(exponent(random));
    const ArrivingLight light{{size * part(random), size, 0},
                              size * glm::vec3(side(random), side(random), side(random)),
                              {part(random), 1, part(random)},
                              {part(random), part(random), part(random)}};
    std::array<std::uint8_t, LightGrid::kNodeBytes> node{};
    pack_light(light, node.data());
    const ArrivingLight back = unpack_light(node.data());
    const float unit = std::max({light.mean.r, size}) / 127;
    for (int c = 0; c < 3; ++c) {
      EXPECT_NEAR(back.mean[c], light.mean[c], unit / 2 + 0x1p-24f);
      EXPECT_NEAR(back.change[c], light.change[c], unit + 0x1p-24f);
      EXPECT_NEAR(back.arrives[c], light.arrives[c], 0.003f);
      EXPECT_NEAR(back.tint[c], with_unit_luminance(light.tint)[c], 0.01f);
    }
  }
}

}  // namespace
}  // namespace slf
