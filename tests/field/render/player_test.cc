#include "slf/player.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>

#include "field/field_file.h"
#include "slf/camera.h"
#include "slf/image.h"
#include "slf/scene.h"
#include "tests/field/field_testing.h"

namespace slf {
namespace {

using testing::build_and_open;
using testing::lossless_options;
using testing::TemporaryFolder;

class Play : public testing::BallsTest {
 protected:
  static Camera camera(double azimuth) {
    return orbit_camera(field_->shape().sphere, azimuth, 20, 3, 160, 120);
  }
  static PlayOptions options(Loading loading, std::uint64_t memory = 64 << 20) {
    PlayOptions options;
    options.view.mode = RenderMode::depth;
    options.view.level = field_->shape().finest_level;
    options.loading = loading;
    options.renderer.memory = memory;
    options.renderer.threads = 2;
    return options;
  }
  static std::optional<Player> player(const PlayOptions& options) {
    auto player = Player::make(*field_, options);
    EXPECT_TRUE(player) << (player ? "" : player.error().message);
    if (!player) return {};
    return std::move(*player);
  }
  static FrameReport draw(Player& player, const Camera& camera, Image& image) {
    FrameReport report;
    const auto ok = player.draw(camera, image, &report);
    EXPECT_TRUE(ok) << (ok ? "" : ok.error().message);
    return report;
  }
  static Image rendered(const Camera& camera, const ViewOptions& view) {
    return *Renderer(*field_).render(camera, view);
  }
};

TEST_F(Play, TheFirstFrameIsTheCoarsestLevelAndTheNextWhatWasLoaded) {
  auto p = player(options(Loading::demand));
  ASSERT_TRUE(p);
  Image image;
  const FrameReport first = draw(*p, camera(0), image);
  EXPECT_EQ(first.pixels_full, 0u);
  EXPECT_GT(first.misses, 0u);
  ViewOptions coarsest = options(Loading::demand).view;
  coarsest.level = 0;
  EXPECT_EQ(image.rgba, rendered(camera(0), coarsest).rgba);

  // What it sees in finer tiles leads to other tiles, so it takes more than one round.
  FrameReport report;
  for (int k = 0; k < 8 && report.pixels_full != first.pixels_hit; ++k) {
    p->settle();
    report = draw(*p, camera(0), image);
  }
  EXPECT_EQ(report.pixels_full, report.pixels_hit);
  EXPECT_EQ(report.misses, 0u);
  EXPECT_EQ(report.hit_rate(), 1);
  EXPECT_EQ(image.rgba, rendered(camera(0), options(Loading::demand).view).rgba);
}

TEST_F(Play, LoadingAheadHasTheTilesOfFramesToCome) {
  // The lattice of this field is coarse: a few frames cross it all.
  std::map<Loading, std::uint64_t> misses;
  for (const Loading loading : {Loading::demand, Loading::ahead}) {
    auto p = player(options(loading));
    ASSERT_TRUE(p);
    Image image;
    for (int k = 0; k < 12; ++k) {
      const FrameReport report = draw(*p, camera(5.0 * k), image);
      if (k >= 2) misses[loading] += report.misses;  // motion is known from the second on
      p->settle();
    }
  }
  EXPECT_GT(misses[Loading::demand], 0u);
  EXPECT_LT(misses[Loading::ahead], misses[Loading::demand] / 4);
}

TEST_F(Play, AnyHorizonEnds) {
  for (const unsigned horizon : {0u, 1u << 31, ~0u}) {
    PlayOptions far = options(Loading::ahead);
    far.horizon = horizon;
    auto p = player(far);
    ASSERT_TRUE(p);
    Image image;
    for (int k = 0; k < 4; ++k) draw(*p, camera(5.0 * k), image);
    p->settle();
  }
}

TEST_F(Play, FramesThatWaitAreWhole) {
  auto p = player(options(Loading::wait));
  ASSERT_TRUE(p);
  Image image;
  for (const double azimuth : {0.0, 30.0, 60.0}) {
    const FrameReport report = draw(*p, camera(azimuth), image);
    EXPECT_EQ(report.pixels_full, report.pixels_hit);
    EXPECT_GT(report.loads, 0u);
    EXPECT_EQ(image.rgba, rendered(camera(azimuth), options(Loading::demand).view).rgba);
  }
}

TEST_F(Play, ATightBudgetIsKeptAndStillDraws) {
  for (const std::uint64_t memory : {1ull << 20, 2ull << 20}) {
    auto p = player(options(Loading::ahead, memory));
    ASSERT_TRUE(p);
    Image image;
    for (int k = 0; k < 6; ++k) {
      const FrameReport report = draw(*p, camera(4.0 * k), image);
      EXPECT_GT(report.pixels_hit, 0u);
      std::size_t drawn = 0;
      for (const glm::vec4& pixel : image.rgba) drawn += pixel.a > 0;
      EXPECT_GT(drawn, report.pixels_hit / 8);  // the balls cover more than that
      p->settle();                              // ends, though not all that is wanted fits
    }
  }
}

TEST_F(Play, LoadingEndsWhereTilesPushEachOtherOut) {
  TemporaryFolder folder;
  const auto field = build_and_open(*scene_, folder / "large.slf", lossless_options(4, 32, 1));
  ASSERT_TRUE(field);
  // Tiles have up to 42 KB, scratch 64: room for the one that stays and a part of another.
  for (const std::uint64_t memory : {116u << 10, 122u << 10, 128u << 10, 250u << 10}) {
    auto options = this->options(Loading::ahead, memory);
    options.view.level = 1;
    auto p = Player::make(*field, options);
    ASSERT_TRUE(p);
    Image image;
    for (int k = 0; k < 4; ++k) {
      draw(*p, camera(10.0 * k), image);
      p->settle();
    }
  }
}

TEST_F(Play, WhatCannotBeAViewIsNotLookedAtAhead) {
  // Upright cameras on their way to the top: the next one would look along its up.
  auto p = player(options(Loading::ahead));
  ASSERT_TRUE(p);
  Image image;
  for (const double elevation : {66.0, 74.0, 82.0, 82.0}) {
    const Camera camera = orbit_camera(field_->shape().sphere, 33, elevation, 3, 64, 64);
    ASSERT_EQ(camera.up, glm::dvec3(0, 0, 1));
    draw(*p, camera, image);
    p->settle();
  }
}

TEST_F(Play, WhatThePathLeftBehindMakesRoom) {
  // Room for one view, not for all that the path sees. A view leads to more tiles as some come.
  const auto stay = [&](Player& player, double azimuth) {
    Image image;
    FrameReport report;
    for (int k = 0; k < 8; ++k) {
      report = draw(player, camera(azimuth), image);
      player.settle();
    }
    return report;
  };
  constexpr std::uint64_t kMemory = 12 << 20;
  auto fresh = player(options(Loading::demand, kMemory));
  ASSERT_TRUE(fresh);
  ASSERT_EQ(stay(*fresh, 180).misses, 0u);

  auto moving = player(options(Loading::ahead, kMemory));
  ASSERT_TRUE(moving);
  Image image;
  for (double azimuth = 0; azimuth <= 180; azimuth += 10) {
    draw(*moving, camera(azimuth), image);
    moving->settle();
  }
  EXPECT_EQ(stay(*moving, 180).misses, 0u);
}

TEST_F(Play, AheadByNothingIsOnDemand) {
  PlayOptions none = options(Loading::ahead);
  none.horizon = 0;
  auto p = player(none);
  ASSERT_TRUE(p);
  Image image;
  for (int k = 0; k < 4; ++k) EXPECT_GT(draw(*p, camera(5.0 * k), image).pixels_hit, 0u);
  p->settle();
}

TEST_F(Play, EndsWhileLoading) {
  for (int k = 0; k < 20; ++k) {
    auto p = player(options(Loading::ahead));
    ASSERT_TRUE(p);
    Image image;
    for (int frame = 0; frame < k % 4; ++frame) draw(*p, camera(10.0 * frame), image);
  }
}

TEST_F(Play, ADamagedTileIsReported) {
  const std::string path = *folder_ / "damaged.slf";
  std::filesystem::copy_file(field_->path(), path);
  // Flip a byte of each payload at the finest level.
  {
    std::fstream file(path, std::ios::in | std::ios::out | std::ios::binary);
    const auto ok = field_->file().store().visit(
        {2, 0}, {3, 0}, [&](const storage::TileRef& tile) -> Result<void> {
          if (tile.state != storage::TileState::stored) return {};
          const auto at = static_cast<std::streamoff>(field_->file().store().range(tile).begin);
          file.seekp(at);
          file.put(static_cast<char>(~std::to_integer<int>(tile.payload[0])));
          return {};
        });
    ASSERT_TRUE(ok);
  }
  const auto field = Field::open(path);
  ASSERT_TRUE(field) << field.error().message;
  auto p = Player::make(*field, options(Loading::ahead));
  ASSERT_TRUE(p) << p.error().message;
  Image image;
  ASSERT_TRUE(p->draw(camera(0), image));
  p->settle();
  const auto second = p->draw(camera(1), image);
  ASSERT_FALSE(second);
  EXPECT_EQ(second.error().code, ErrorCode::bad_file);
  EXPECT_THAT(second.error().message, ::testing::HasSubstr("damaged.slf"));
}

TEST_F(Play, RefusesWhatTheFieldDoesNotHave) {
  PlayOptions bad = options(Loading::ahead);
  bad.view.level = 9;
  EXPECT_FALSE(Player::make(*field_, bad));
  EXPECT_FALSE(parse_loading("later"));
}

TEST(Predict, FollowsTurnsAndApproaches) {
  const Sphere sphere{{1, 2, 3}, 10};
  for (const double elevation : {-40.0, 0.0, 60.0}) {
    const Camera before = orbit_camera(sphere, 10, elevation, 3, 64, 64);
    const Camera now = orbit_camera(sphere, 12, elevation, 2.9, 64, 64);
    const Camera then = predict(sphere.center, before, now, 4);
    const Camera truth = orbit_camera(sphere, 20, elevation, 2.9 * std::pow(2.9 / 3, 4), 64, 64);
    EXPECT_LT(glm::distance(then.eye, truth.eye), 0.02 * glm::distance(now.eye, truth.eye) + 0.4)
        << elevation;
  }
}

TEST(Predict, StaysAfterACut) {
  const Sphere sphere{{0, 0, 0}, 1};
  const Camera before = orbit_camera(sphere, 0, 0, 3, 64, 64);
  const Camera now = orbit_camera(sphere, 120, 10, 3, 64, 64);
  EXPECT_EQ(predict(sphere.center, before, now, 5).eye, now.eye);
  EXPECT_EQ(predict(sphere.center, now, now, 5).eye, now.eye);
}

TEST(CameraPath, OrbitsTurnAtASteadyPace) {
  const Sphere sphere{{0, 0, 0}, 2};
  const auto path = CameraPath::orbit(sphere, 30, 20, 3, 1, 8);
  ASSERT_TRUE(path);
  for (const double t : {0.0, 1.0, 3.3, 8.0}) {
    const Camera camera = path->at(t, 64, 48);
    const Camera expected = orbit_camera(sphere, 30 + 45 * t, 20, 3, 64, 48);
    EXPECT_LT(glm::distance(camera.eye, expected.eye), 1e-9) << t;
    EXPECT_DOUBLE_EQ(camera.fov, expected.fov);
  }
  EXPECT_FALSE(CameraPath::orbit(sphere, 30, 20, 3, 1, 0));
  EXPECT_FALSE(CameraPath::orbit(sphere, 30, 20, -1, 1, 8));
  EXPECT_FALSE(CameraPath::orbit(sphere, NAN, 20, 3, 1, 8));
}

TEST(OrbitCamera, KeepsItsFieldOfViewAtAnyDistance) {
  const Sphere sphere{{1, 2, 3}, 10};
  for (const double distance : {0.5, 1.2, 2.0, 3.0, 12.0}) {
    EXPECT_DOUBLE_EQ(orbit_camera(sphere, 30, 20, distance, 64, 64).fov,
                     fitted_fov(sphere, 30, 64, 64));
    EXPECT_DOUBLE_EQ(orbit_camera(sphere, 30, 20, distance, 40, 64).fov,
                     fitted_fov(sphere, 30, 40, 64));
  }
  const Camera random = random_cameras(sphere, 2, 1, 7, 64, 64).front();
  EXPECT_DOUBLE_EQ(random.fov, fitted_fov(sphere, 20, 64, 64));
}

TEST(CameraPath, PassesThroughItsKeys) {
  const Sphere sphere{{0, 0, 0}, 100};
  const auto path = CameraPath::parse(
      R"({"keys": [{"at": 1, "orbit": [0, 0, 3]},
                   {"at": 3, "eye": [250, 0, 0], "look_at": [0, 5, 0], "fov": 20},
                   {"at": 4, "orbit": [400, 45, 2]}]})",
      "keys.json", sphere);
  ASSERT_TRUE(path) << path.error().message;
  EXPECT_DOUBLE_EQ(path->seconds(), 3);
  const Camera second = path->at(2, 64, 64), last = path->at(3, 64, 64);
  EXPECT_LT(glm::distance(second.eye, glm::dvec3(250, 0, 0)), 1e-9);
  EXPECT_EQ(second.look_at, glm::dvec3(0, 5, 0));
  EXPECT_DOUBLE_EQ(second.fov, 20);
  EXPECT_LT(glm::distance(last.eye, orbit_camera(sphere, 40, 45, 2, 64, 64).eye), 1e-9);
  // No jumps in between.
  for (double t = 0; t < 3; t += 0.01)
    EXPECT_LT(glm::distance(path->at(t, 64, 64).eye, path->at(t + 0.01, 64, 64).eye), 20) << t;
}

TEST(CameraPath, LooksStraightDownBesideTheCentreToo) {
  const auto path = CameraPath::parse(
      R"({"keys": [{"at": 0, "eye": [50, 0, 200], "look_at": [50, 0, 0]},
                   {"at": 1, "eye": [-50, 0, 200], "look_at": [-50, 0, 0]}]})",
      "keys.json", Sphere{{0, 0, 0}, 100});
  ASSERT_TRUE(path) << path.error().message;
  for (const double t : {0.0, 0.3, 1.0}) EXPECT_TRUE(RayGenerator::make(path->at(t, 64, 64))) << t;
}

TEST(CameraPath, RefusesBadKeys) {
  const Sphere sphere{{0, 0, 0}, 1};
  const std::string good = R"({"at": 0, "orbit": [0, 0, 3]})";
  for (const std::string& keys : std::initializer_list<std::string>{
           "",
           "nonsense",
           "[]",
           R"({"keys": 3})",
           R"({"keys": []})",
           R"({"keys": [)" + good + "]}",
           R"({"keys": [)" + good + "," + good + "]}",
           R"({"keys": [)" + good + R"(, {"at": 1}]})",
           R"({"keys": [)" + good + R"(, {"at": 1, "orbit": [0, 0]}]})",
           R"({"keys": [)" + good + R"(, {"at": 1, "orbit": [0, 0, -3]}]})",
           R"({"keys": [)" + good + R"(, {"at": 1, "orbit": [0, 0, 3], "eye": [1, 2, 3]}]})",
           R"({"keys": [)" + good + R"(, {"at": 1, "eye": [0, 0, 0]}]})",
           R"({"keys": [)" + good + R"(, {"at": 1, "orbit": [0, 0, 3], "fov": 180}]})",
           R"({"keys": [)" + good + R"(, {"at": 1e9, "orbit": [0, 0, 3]}]})",
           R"({"keys": [)" + good + R"(, {"at": "1", "orbit": [0, 0, 3]}]})",
       }) {
    const auto path = CameraPath::parse(keys, "keys.json", sphere);
    ASSERT_FALSE(path) << keys;
    EXPECT_EQ(path.error().code, ErrorCode::bad_file);
    EXPECT_THAT(path.error().message, ::testing::HasSubstr("keys.json"));
  }
}

TEST(Animation, WritesAnAnimatedWebP) {
  const TemporaryFolder folder;
  const std::string path = folder / "turn.webp";
  AnimationWriter writer(path, 0.1);
  Image image;
  image.width = 40, image.height = 30;
  for (int k = 0; k < 3; ++k) {
    image.rgba.assign(1200, glm::vec4(0.2f * k, 0, 0, 1));
    ASSERT_TRUE(writer.add(image));
  }
  Image other = image;
  other.width = 30, other.height = 40;
  EXPECT_FALSE(writer.add(other));
  EXPECT_FALSE(std::filesystem::exists(path));
  ASSERT_TRUE(writer.close());
  std::ifstream file(path, std::ios::binary);
  const std::string bytes(std::istreambuf_iterator<char>(file), {});
  EXPECT_EQ(bytes.substr(0, 4), "RIFF");
  EXPECT_NE(bytes.find("ANIM"), std::string::npos);
  std::size_t frames = 0;
  for (std::size_t at = bytes.find("ANMF"); at != std::string::npos;
       at = bytes.find("ANMF", at + 4))
    ++frames;
  EXPECT_EQ(frames, 3u);
}

}  // namespace
}  // namespace slf
