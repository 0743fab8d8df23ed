#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "base/half.h"
#include "field/tiles/compose_samples.h"
#include "slf/measure.h"
#include "slf/player.h"
#include "tests/field/field_testing.h"

namespace slf {
namespace {

using testing::draw;
using testing::FunctionScene;
using ::testing::HasSubstr;

struct Ball {
  glm::dvec3 center;
  double radius;
  glm::vec3 color;
};

const Ball kLeft{{-0.35, 0, 0.1}, 0.3, {1, 0.5, 0}}, kRight{{0.4, 0.1, 0}, 0.4, {0, 0.25, 1}};

/// The nearest of opaque balls.
FunctionScene balls(std::vector<Ball> all) {
  return FunctionScene([all](const glm::dvec3& from, const glm::dvec3& to) {
    RaySample nearest;
    nearest.depth = std::numeric_limits<float>::infinity();
    for (const Ball& ball : all) {
      const glm::dvec3 d = to - from, o = from - ball.center;
      const double a = dot(d, d), b = dot(o, d), c = dot(o, o) - ball.radius * ball.radius;
      if (b * b <= a * c) continue;
      const auto depth = static_cast<float>((-b - std::sqrt(b * b - a * c)) / a);
      if (depth < nearest.depth) nearest = {glm::vec4(ball.color, 1), depth};
    }
    return nearest.rgba.a > 0 ? nearest : RaySample();
  });
}

class Compose : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new testing::TemporaryFolder;
    left_ = new Field(build(balls({kLeft}), "left.slf"));
    right_ = new Field(build(balls({kRight}), "right.slf"));
    both_ = new Field(build(balls({kLeft, kRight}), "both.slf"));
  }
  static void TearDownTestSuite() {
    for (const Field* field : {left_, right_, both_}) delete field;
    delete folder_;
  }
  static Field build(const Scene& scene, const std::string& name,
                     const std::function<void(BuildOptions&)>& change = {}) {
    auto options = testing::lossless_options(4, 16, 1);
    options.depth = true;
    if (change) change(options);
    return *testing::build_and_open(scene, *folder_ / name, options);
  }
  static Field composed(std::vector<Structure> structures) {
    auto field = compose(*left_, std::move(structures));
    EXPECT_TRUE(field) << field.error().message;
    return *field;
  }
  static Camera camera(double azimuth, std::uint32_t size = 96) {
    return orbit_camera(left_->shape().sphere, azimuth, 20, 3, size, size);
  }

  static inline testing::TemporaryFolder* folder_ = nullptr;
  static inline Field *left_ = nullptr, *right_ = nullptr, *both_ = nullptr;
};

const ViewOptions kView{RenderMode::depth, 1, true};

TEST_F(Compose, OpaqueStructuresAreTheFieldOfAllOfThem) {
  const Field field = composed({{*left_}, {*right_}}), other = composed({{*right_}, {*left_}});
  for (const double azimuth : {0.0, 80.0, 100.0, 260.0}) {
    const Image expected = draw(*both_, camera(azimuth), kView);
    for (const auto& [image, order] :
         {std::pair{draw(field, camera(azimuth), kView), "left, right"},
          {draw(other, camera(azimuth), kView), "right, left"}}) {
      EXPECT_EQ(image.rgba, expected.rgba) << azimuth << " " << order;
      EXPECT_EQ(image.depth, expected.depth) << azimuth << " " << order;
    }
  }
}

TEST_F(Compose, PicturesDoNotDependOnThreadsOrBudget) {
  const Field field = composed({{*left_, 0.5f}, {*right_}});
  const Image expected = draw(field, camera(80), kView);
  for (const RendererOptions& options :
       {RendererOptions{1ull << 30, 5}, RendererOptions{1ull << 20, 2}, RendererOptions{1, 3}}) {
    const Image image = draw(field, camera(80), kView, options);
    EXPECT_EQ(image.rgba, expected.rgba) << options.memory;
    EXPECT_EQ(image.depth, expected.depth) << options.memory;
  }
}

TEST_F(Compose, OpacityAndTintApplyToWholeStructures) {
  const Image plain = draw(*left_, camera(40), kView);
  const Image image =
      draw(composed({{*left_, 0.5f, {0.5f, 1, 0}}}), camera(40), {RenderMode::bitri, 1});
  const Image bitri = draw(*left_, camera(40), {RenderMode::bitri, 1});
  for (std::size_t k = 0; k < image.pixels(); ++k) {
    const glm::vec4 expected = bitri.rgba[k] * glm::vec4(0.25f, 0.5f, 0, 0.5f);
    for (int c = 0; c < 4; ++c) ASSERT_NEAR(image.rgba[k][c], expected[c], 1 / 255.f) << k;
  }
  // Where the left ball is before the right one, it is over it.
  const auto at = [](const Image& of) { return of.rgba[of.pixels() / 2 + of.width / 2]; };
  const Image over = draw(composed({{*left_, 0.5f}, {*right_}}), camera(270), kView);
  EXPECT_NEAR(at(over).r, 0.5f, 0.01f);
  EXPECT_NEAR(at(over).g, 0.375f, 0.01f);
  EXPECT_NEAR(at(over).b, 0.5f, 0.01f);
  EXPECT_NEAR(at(over).a, 1, 0.01f);
}

TEST_F(Compose, HiddenStructuresCostNothing) {
  const auto cost = [&](const Field& field) {
    ViewStatistics statistics;
    const Image image = draw(field, camera(40), kView, {}, &statistics);
    return std::pair(statistics, *footprint(field, statistics.tiles));
  };
  const auto [alone, alone_file] = cost(*left_);
  const auto [right, right_file] = cost(*right_);
  const auto [hidden, hidden_file] = cost(composed({{*left_}, {*right_, 0}}));
  const auto [all, all_file] = cost(composed({{*left_}, {*right_}}));
  EXPECT_EQ(hidden.decodes, alone.decodes);
  EXPECT_EQ(hidden_file.compressed_bytes, alone_file.compressed_bytes);
  EXPECT_EQ(hidden_file.pages, alone_file.pages);
  EXPECT_GT(all.decodes, std::max(alone.decodes, right.decodes));
  EXPECT_GT(all_file.compressed_bytes, alone_file.compressed_bytes);
  EXPECT_GT(all_file.pages.size(), alone_file.pages.size());

  const auto [none, none_file] = cost(composed({{*left_, 0}}));
  EXPECT_EQ(none.decodes, 0);
  EXPECT_EQ(none_file.compressed_bytes, 0);
  for (const glm::vec4& pixel : draw(composed({}), camera(40), kView).rgba)
    ASSERT_EQ(pixel, glm::vec4(0));
}

TEST_F(Compose, TwoLooksOfOneFileAreReadOnce) {
  const auto file = footprint(composed({{*left_}, {*left_, 0.5f}}), std::array{TileKey{0, 0}});
  EXPECT_EQ(file->pages, footprint(*left_, std::array{TileKey{0, 0}})->pages);
}

TEST_F(Compose, PlayersAndMeasuresTakeThem) {
  const Field field = composed({{*left_}, {*right_}});
  PlayOptions options;
  options.view = {RenderMode::depth, 1};
  auto player = Player::make(field, options);
  ASSERT_TRUE(player);
  Image image;
  for (int frame = 0; frame < 2; ++frame) {
    ASSERT_TRUE(player->draw(camera(40), image));
    player->settle();
  }
  ASSERT_TRUE(player->draw(camera(40), image));
  EXPECT_EQ(image.rgba, draw(*both_, camera(40), {RenderMode::depth, 1}).rgba);

  MeasureOptions measured{{camera(40)}, RenderMode::depth, {1}, {}};
  const auto one = measure_views(*left_, measured), two = measure_views(field, measured);
  ASSERT_TRUE(two) << two.error().message;
  EXPECT_GT(two->total.compressed_bytes.mean, one->total.compressed_bytes.mean);
  EXPECT_GT(two->total.map_pages.mean, one->total.map_pages.mean);
}

TEST_F(Compose, RefusesWhatDoesNotFit) {
  const auto refused = [&](const Structure& structure) {
    const auto field = compose(*left_, {{*right_}, structure});
    EXPECT_FALSE(field);
    if (field) return std::string();
    EXPECT_EQ(field.error().code, ErrorCode::usage);
    EXPECT_THAT(field.error().message, HasSubstr(structure.field.path()));
    return field.error().message;
  };
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THAT(refused({*left_, 1.5f}), HasSubstr("opacity or tint 1.5: expected 0 to 1"));
  EXPECT_THAT(refused({*left_, nan}), HasSubstr("expected 0 to 1"));
  EXPECT_THAT(refused({*left_, 0, {0, -1, 0}}), HasSubstr("opacity or tint -1"));
  EXPECT_THAT(refused({composed({})}), HasSubstr("is composed itself"));
  const auto other = [&](const std::string& name,
                         const std::function<void(BuildOptions&)>& change) {
    return build(balls({kLeft}), name, change);
  };
  EXPECT_THAT(refused({other("flat.slf", [](auto& o) { o.depth = false; })}),
              HasSubstr("has no depth"));
  EXPECT_THAT(refused({other("large.slf", [](auto& o) { o.shape.sphere.radius = 2; })}),
              HasSubstr("has a sphere of radius 2, but "));
  EXPECT_THAT(refused({other("aside.slf",
                             [](auto& o) {
                               o.shape.sphere = {{0, 1, 0}, 1};
                             })}),
              HasSubstr("has a sphere around 1, but "));
  EXPECT_THAT(refused({other("coarse.slf", [](auto& o) { o.shape.finest_level = 0; })}),
              HasSubstr("has finest level 0, but "));
  EXPECT_THAT(refused({other("entry.slf", [](auto& o) { o.shape.entry_side = 2; })}),
              HasSubstr("has entry cells 2, but "));
  EXPECT_THAT(refused({other("half.slf", [](auto& o) { o.half = true; })}),
              HasSubstr("has samples rgba16f_depth8, but "));
}

// ---- samples -----------------------------------------------------------------------------------

using Samples = std::vector<std::byte>;

/// One sample of rgba8_depth8.
Samples sample(std::array<int, 5> bytes) {
  Samples samples;
  for (const int byte : bytes) samples.push_back(static_cast<std::byte>(byte));
  return samples;
}

std::array<int, 5> compose_bytes(const std::vector<TileLayer>& layers) {
  Samples out(5);
  compose_samples(layers, SampleFormat::rgba8_depth8, out);
  std::array<int, 5> bytes{};
  for (std::size_t k = 0; k < 5; ++k) bytes[k] = static_cast<int>(out[k]);
  return bytes;
}

TEST(ComposeSamples, TheNearestIsOverOthersAndTheFirstAtOneDepth) {
  using Bytes = std::array<int, 5>;
  const Samples near = sample({10, 20, 30, 255, 100}), far = sample({200, 0, 0, 255, 101});
  const Samples same = sample({7, 7, 7, 255, 100}), clear = sample({0, 0, 0, 0, 3});
  const Samples thin = sample({0, 60, 0, 128, 50});
  EXPECT_EQ(compose_bytes({{near}, {far}}), (Bytes{10, 20, 30, 255, 100}));
  EXPECT_EQ(compose_bytes({{far}, {near}}), (Bytes{10, 20, 30, 255, 100}));
  EXPECT_EQ(compose_bytes({{near}, {same}}), (Bytes{10, 20, 30, 255, 100}));
  EXPECT_EQ(compose_bytes({{same}, {near}}), (Bytes{7, 7, 7, 255, 100}));
  EXPECT_EQ(compose_bytes({{clear}, {far}}), (Bytes{200, 0, 0, 255, 101}));
  EXPECT_EQ(compose_bytes({{clear}, {clear}}), (Bytes{0, 0, 0, 0, 3}));
  // 128 / 255 of the first is seen, at 50, and the rest of the second, at 100.
  EXPECT_EQ(compose_bytes({{near}, {thin}}), (Bytes{5, 70, 15, 255, 75}));
  EXPECT_EQ(compose_bytes({{far, glm::vec4(0.5f, 1, 1, 0.5f)}}), (Bytes{100, 0, 0, 128, 101}));
}

TEST(ComposeSamples, ASingleLayerIsItselfInEveryFormat) {
  for (const SampleFormat format : {SampleFormat::rgba8_depth8, SampleFormat::rgba16f_depth8}) {
    Samples samples;
    constexpr int kCount = 256;
    for (int k = 0; k < 4 * kCount; ++k) {
      const float value = static_cast<float>(k % 4 == 3 ? 255 : k / 4) / 255;
      if (is_half(format))
        append_le<std::uint16_t>(samples, half_from_float(4 * value));
      else
        samples.push_back(static_cast<std::byte>(byte_from_float(value)));
    }
    for (int k = 0; k < kCount; ++k) samples.push_back(static_cast<std::byte>(k));
    Samples out(samples.size());
    compose_samples(std::vector<TileLayer>{{samples}}, format, out);
    EXPECT_EQ(out, samples) << name(format);
  }
}

}  // namespace
}  // namespace slf
