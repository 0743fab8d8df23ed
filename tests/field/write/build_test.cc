#include "slf/build.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <stdexcept>

#include "field/field_file.h"
#include "field/write/tile_tracer.h"
#include "slf/field.h"
#include "slf/measure.h"
#include "slf/scene.h"
#include "tests/field/field_testing.h"

namespace slf {
namespace {

using testing::all_tiles;
using testing::all_vertices;
using testing::build_and_open;
using testing::FunctionScene;
using testing::lossless_options;
using testing::TemporaryFolder;

std::unique_ptr<Scene> balls() { return std::move(*make_analytic_scene("balls")); }

TEST(Build, EveryTileOfEveryLevelIsThere) {
  TemporaryFolder folder;
  const auto scene = balls();
  const auto field = build_and_open(*scene, folder / "a.slf", lossless_options(2, 4, 2));
  ASSERT_TRUE(field);
  const auto content = field->content();
  ASSERT_TRUE(content);
  EXPECT_TRUE(content->complete);
  for (const LevelContent& level : content->levels) {
    EXPECT_EQ(level.stored + level.empty, 64ull << (4 * level.level));
    EXPECT_GT(level.stored, 0);
    EXPECT_EQ(level.slabs, (4ull * (2 << level.level) * (2 << level.level) + 2) *
                               (4ull * (4 << level.level) * (4 << level.level) + 2));
  }
  EXPECT_GT(content->levels[2].empty, 0);
}

TEST(Build, IsForecast) {
  TemporaryFolder folder;
  const auto scene = balls();
  const FieldState states[]{{"one", scene.get()}, {"same", scene.get()}};
  for (const std::size_t count : {1, 2}) {
    const auto shown = std::span<const FieldState>(states).first(count);
    BuildOptions options;
    options.shape.entry_side = 4, options.shape.exit_side = 16, options.shape.finest_level = 2;
    Progress last;
    const auto forecast = forecast_build(shown, options, [&](const Progress& progress) {
      last = progress;
      return true;
    });
    ASSERT_TRUE(forecast) << forecast.error().message;
    EXPECT_EQ(last.done, last.total);
    EXPECT_EQ(last.total, forecast->sampled);
    EXPECT_LT(forecast->sampled, forecast->tiles / 16);
    EXPECT_GT(forecast->seconds, 0);
    std::uint64_t rays = 0;
    ASSERT_TRUE(build_field(shown, folder / "a.slf", options, [&](const Progress& progress) {
      rays = progress.total;
      return true;
    }));
    EXPECT_EQ(forecast->rays, rays);
    const auto bytes = static_cast<double>(std::filesystem::file_size(folder / "a.slf"));
    EXPECT_NEAR(static_cast<double>(forecast->file_bytes), bytes, 0.2 * bytes);
    std::filesystem::remove(folder / "a.slf");
  }
}

TEST(Build, AForecastStopsAndNamesWrongSettings) {
  const auto scene = balls();
  const FieldState state{"", scene.get()};
  BuildOptions options;
  const auto stopped = forecast_build({&state, 1}, options, [](const Progress&) { return false; });
  ASSERT_FALSE(stopped);
  EXPECT_EQ(stopped.error().code, ErrorCode::cancelled);
  options.codec = "mpeg";
  EXPECT_EQ(forecast_build({&state, 1}, options).error().code, ErrorCode::usage);
}

TEST(Build, ProgressCountsTheRaysThatAreTraced) {
  TemporaryFolder folder;
  std::atomic<std::uint64_t> traced = 0;
  const FunctionScene scene([&](const glm::dvec3&, const glm::dvec3&) {
    ++traced;
    return RaySample{glm::vec4(1), 0.5f};
  });
  auto options = lossless_options(2, 16, 2);
  options.threads = 1;
  std::uint64_t tiles = 0, level_0 = 0;  // what that took
  Progress last;
  ASSERT_TRUE(build_field(scene, folder / "a.slf", options, [&](const Progress& progress) {
    if (++tiles == 64) level_0 = progress.done;
    last = progress;
    return true;
  }));
  EXPECT_EQ(last.done, last.total);
  const auto all = static_cast<double>(traced);
  EXPECT_NEAR(static_cast<double>(last.total), all, 0.15 * all);
  // Of every level, not only in all: level 0 is small, but takes four rays a slab.
  const double share = 4. / (4 + 4 * 16 + 256);
  EXPECT_NEAR(static_cast<double>(level_0), share * all, 0.15 * share * all);
}

TEST(Build, TilesThatTablesAreFittedToAreTracedOnce) {
  TemporaryFolder folder;
  std::atomic<std::uint64_t> traced = 0;
  const FunctionScene scene([&](const glm::dvec3& from, const glm::dvec3&) {
    ++traced;
    return RaySample{glm::vec4(from.x > 0 ? from.x : 0, 0, 0, 1), 0.5f};
  });
  auto options = lossless_options(2, 16, 2);
  options.depth = true;
  options.threads = 1;
  std::vector<std::uint64_t> rays;
  for (const std::string codec : {"raw", "zstd:3", "jpeg:80", "predictive:80"}) {
    options.codec = codec;
    traced = 0;
    ASSERT_TRUE(build_field(scene, folder / (codec + ".slf"), options));
    rays.push_back(traced);
  }
  EXPECT_THAT(rays, ::testing::Each(rays[0]));
}

TEST(Build, SamplesAreTheScenesRays) {
  TemporaryFolder folder;
  const auto scene = balls();
  const auto field = build_and_open(*scene, folder / "a.slf", lossless_options(2, 4, 1));
  ASSERT_TRUE(field);
  std::size_t checked = 0;
  for (std::uint64_t index = 0; index < tile_count(1, 0); index += 7) {
    const TileKey key{1, index};
    const auto tile = field->file().store().find(key);
    ASSERT_TRUE(tile);
    const TileShape shape = field->file().tile_shape(key);
    std::vector<std::byte> samples(shape.bytes());
    if (tile->state == storage::TileState::stored) {
      ASSERT_TRUE(testing::read(field->file(), *tile, samples));
    } else {
      ASSERT_EQ(tile->state, storage::TileState::empty);
    }
    const TileSections sections = sections_of(key, 0);
    for (std::size_t row = 0; row < shape.rows(); ++row)
      for (std::uint16_t q = 0; q <= 4; ++q)
        for (std::uint16_t p = 0; p + q <= 4; ++p) {
          const glm::dvec3 from = direction(vertex_at(sections.entry, shape.positions[row], 2));
          const glm::dvec3 to = direction(vertex_at(sections.exit, {p, q}, 4));
          const RaySample truth = scene->trace(from, to);
          const std::byte* at = &samples[(row * shape.columns() + triangle_index(4, p, q)) * 4];
          for (int c = 0; c < 4; ++c)
            EXPECT_NEAR(std::to_integer<int>(at[c]), truth.rgba[c] * 255, 0.51);
          ++checked;
        }
  }
  EXPECT_GT(checked, 1000u);
}

/// The mean of rays around one of lattice(3), over lattice(6), by another way than the tracer's: a
/// tent is the weight that interpolation gives its vertex.
template <class World>
RaySample mean_under_tent(const Scene& scene, const World& world, const LatticeVertex& from,
                          const LatticeVertex& to) {
  glm::dvec4 rgba(0);
  double weights = 0, place = 0;
  for (const LatticeVertex& fine : all_vertices(6)) {
    const Cell cell = locate(direction(fine), 3);
    for (int c = 0; c < 3; ++c) {
      if (to_vertex(cell.octant, cell.corners()[c], 3) != to) continue;
      const RaySample ray = scene.trace(world(from), world(fine));
      weights += cell.weights[c];
      rgba += cell.weights[c] * glm::dvec4(ray.rgba);
      place += cell.weights[c] * ray.rgba.a * ray.depth;
    }
  }
  return {glm::vec4(rgba / weights), rgba.a > 0 ? static_cast<float>(place / rgba.a) : 0};
}

TEST(Build, CoarserLevelsAreMeansUnderATent) {
  TemporaryFolder folder;
  const FunctionScene scene([](const glm::dvec3& a, const glm::dvec3& b) {
    const auto wave = [](double x) { return static_cast<float>(0.5 + 0.5 * std::sin(7 * x)); };
    const float alpha = b.z > 0.9 ? 0.f : wave(b.x + a.y);
    return RaySample{{alpha * wave(b.y), alpha * wave(b.z), alpha * wave(a.x), alpha}, wave(b.x)};
  });
  const auto field = build_and_open(scene, folder / "a.slf", lossless_options(1, 3, 1));
  ASSERT_TRUE(field);
  const auto sphere = field->shape().sphere;
  const auto world = [&](const LatticeVertex& v) {
    return sphere.center + sphere.radius * direction(v);
  };
  std::size_t visible = 0;
  for (std::uint64_t index = 0; index < tile_count(0, 0); ++index) {
    const auto tile = field->file().store().find({0, index});
    ASSERT_TRUE(tile);
    const TileShape shape = field->file().tile_shape({0, index});
    std::vector<std::byte> samples(shape.bytes());
    if (tile->state == storage::TileState::stored) {
      ASSERT_TRUE(testing::read(field->file(), *tile, samples));
    }
    const std::byte* const colors = samples.data();
    const std::byte* const depths = colors + shape.color_bytes();
    const TileSections sections = sections_of({0, index}, 0);
    std::size_t sample = 0;
    for (std::size_t row = 0; row < shape.rows(); ++row)
      for (std::uint16_t q = 0; q <= 3; ++q)
        for (std::uint16_t p = 0; p + q <= 3; ++p, ++sample) {
          const LatticeVertex from = vertex_at(sections.entry, shape.positions[row], 1);
          const LatticeVertex to = vertex_at(sections.exit, {p, q}, 3);
          const auto [rgba, depth_there] = mean_under_tent(scene, world, from, to);
          for (int c = 0; c < 4; ++c)
            EXPECT_NEAR(std::to_integer<int>(colors[4 * sample + c]), rgba[c] * 255, 0.51);
          if (rgba.a == 0) continue;
          EXPECT_NEAR(std::to_integer<int>(depths[sample]), depth_there * 255, 0.51);
          ++visible;
        }
  }
  EXPECT_GT(visible, 100u);
}

TEST(Build, PrefilteredLevelsAreCloserToWhatIsSeenFromAfar) {
  TemporaryFolder folder;
  const auto scene = balls();
  const auto alone = build_and_open(*scene, folder / "a.slf", lossless_options(4, 8, 0));
  const auto below = build_and_open(*scene, folder / "b.slf", lossless_options(4, 8, 1));
  ASSERT_TRUE(alone && below);
  const auto cameras = random_cameras(alone->shape().sphere, 3, 4, 1, 16, 16);
  const ViewOptions coarse{RenderMode::depth, 0, false};
  const auto rays = evaluate_views(*alone, *scene, {cameras, coarse, {}, 8});
  const auto means = evaluate_views(*below, *scene, {cameras, coarse, {}, 8});
  ASSERT_TRUE(rays && means);
  EXPECT_GT(means->psnr, rays->psnr + 0.5);
}

TEST(Build, ContentDoesNotDependOnThreads) {
  TemporaryFolder folder;
  const auto scene = balls();
  auto options = lossless_options(2, 4, 2);
  options.codec = "jpeg:75";
  options.threads = 1;
  const auto one = build_and_open(*scene, folder / "1.slf", options);
  options.threads = 7;
  const auto seven = build_and_open(*scene, folder / "7.slf", options);
  ASSERT_TRUE(one && seven);
  EXPECT_TRUE(all_tiles(*one) == all_tiles(*seven));
}

TEST(Build, StoppedAnywhereItResumesToTheSameContent) {
  TemporaryFolder folder;
  const auto scene = balls();
  auto options = lossless_options(2, 4, 2);
  options.codec = "jpeg:75";
  const auto whole = build_and_open(*scene, folder / "whole.slf", options);
  ASSERT_TRUE(whole);
  const std::string path = folder / "parts.slf";
  int stops = 0;
  for (std::uint64_t limit = 1;; limit = limit * 2 + 37) {
    // Calls before the first tile, while codecs are trained, and after the last one do not count.
    std::uint64_t calls = 0;
    const auto report = build_field(*scene, path, options, [&](const Progress& progress) {
      return progress.done == 0 || progress.done == progress.total || ++calls < limit;
    });
    if (report) {
      EXPECT_GT(report->resumed, 0u);
      break;
    }
    ASSERT_EQ(report.error().code, ErrorCode::cancelled) << report.error().message;
    ++stops;
    EXPECT_FALSE(std::filesystem::exists(path));
    const auto partial = Field::open(path + ".unfinished");
    ASSERT_TRUE(partial) << partial.error().message;
    EXPECT_FALSE(partial->content()->complete);
  }
  EXPECT_GT(stops, 4);
  EXPECT_FALSE(std::filesystem::exists(path + ".unfinished"));
  const auto parts = Field::open(path);
  ASSERT_TRUE(parts);
  EXPECT_TRUE(all_tiles(*whole) == all_tiles(*parts));
}

TEST(Build, RefusesWhatIsNotItsOwnUnfinishedField) {
  TemporaryFolder folder;
  const auto scene = balls();
  const auto options = lossless_options(2, 4, 0);
  ASSERT_TRUE(build_field(*scene, folder / "a.slf", options));
  auto other = options;
  other.shape.exit_side = 5;
  const auto mixed = build_field(*scene, folder / "a.slf", other);
  ASSERT_FALSE(mixed);
  EXPECT_NE(mixed.error().message.find("exit_side"), std::string::npos) << mixed.error().message;

  std::ofstream(folder / "text.slf") << "not a field";
  EXPECT_EQ(build_field(*scene, folder / "text.slf", options).error().code, ErrorCode::bad_file);
  EXPECT_EQ(build_field(*scene, folder / "no/such/folder.slf", options).error().code,
            ErrorCode::not_found);
}

TEST(Build, AbsurdShapesAreRefused) {
  TemporaryFolder folder;
  const auto scene = balls();
  for (const auto& [entry, exit, levels, depth] :
       std::vector<std::array<unsigned, 4>>{{0, 4, 1, 0},
                                            {4, 0, 1, 0},
                                            {4, 4, 99, 0},
                                            {1024, 1024, 0, 0},
                                            {3, 4, 1, 1},
                                            {1024, 1, 9, 0}}) {
    auto options = lossless_options(entry, exit, levels);
    options.shape.entry_extra_levels = depth;
    const auto built = build_field(*scene, folder / "a.slf", options);
    ASSERT_FALSE(built);
    EXPECT_EQ(built.error().code, ErrorCode::usage);
    EXPECT_EQ(folder.files(), std::vector<std::string>{});
  }
  auto options = lossless_options(2, 4, 0);
  options.codec = "gif";
  EXPECT_EQ(build_field(*scene, folder / "a.slf", options).error().code, ErrorCode::usage);
  EXPECT_EQ(folder.files(), std::vector<std::string>{});
}

TEST(Build, ACompleteFieldIsLeftAloneUnlessItIsToBeReplaced) {
  TemporaryFolder folder;
  const auto scene = balls();
  auto options = lossless_options(2, 4, 1);
  ASSERT_TRUE(build_and_open(*scene, folder / "a.slf", options));
  const auto again = build_field(*scene, folder / "a.slf", options);
  ASSERT_TRUE(again) << again.error().message;
  EXPECT_EQ(again->tiles, 0u);
  EXPECT_EQ(again->resumed, 64u + 1024u);
  options.replace = true;
  EXPECT_EQ(build_field(*scene, folder / "a.slf", options)->tiles, 64u + 1024u);
  options.shape.exit_side = 5;
  std::uint64_t calls = 0;
  ASSERT_FALSE(build_field(*scene, folder / "a.slf", options,
                           [&](const Progress&) { return ++calls < 500; }));
  EXPECT_EQ(Field::open(folder / "a.slf")->shape().exit_side, 4u);
  const auto resumed = build_field(*scene, folder / "a.slf", options);
  ASSERT_TRUE(resumed) << resumed.error().message;
  EXPECT_GE(resumed->resumed, 64u);
  EXPECT_EQ(Field::open(folder / "a.slf")->shape().exit_side, 5u);
  EXPECT_EQ(folder.files(), std::vector<std::string>{"a.slf"});
}

/// What a build says that cannot succeed, after which nothing is left.
Error refusal(const Scene& scene, const BuildOptions& options = lossless_options(2, 4, 1)) {
  TemporaryFolder folder;
  const auto built = build_field(scene, folder / "a.slf", options);
  EXPECT_FALSE(built);
  EXPECT_FALSE(std::filesystem::exists(folder / "a.slf"));
  return built ? Error{} : built.error();
}

TEST(Build, AScenesExceptionIsAnErrorThatNamesTheTile) {
  for (const unsigned threads : {1u, 3u}) {
    std::atomic<int> rays = 0;
    const FunctionScene late([&](const glm::dvec3&, const glm::dvec3&) {
      if (++rays > 20000) throw std::runtime_error("the network is down");
      return RaySample{glm::vec4(1), 0.5f};
    });
    auto options = lossless_options(2, 4, 1);
    options.threads = threads;
    const Error error = refusal(late, options);
    EXPECT_EQ(error.code, ErrorCode::failed);
    EXPECT_NE(error.message.find("the network is down"), std::string::npos) << error.message;
    EXPECT_NE(error.message.find("tile "), std::string::npos) << error.message;
  }
  const FunctionScene full(
      [](const glm::dvec3&, const glm::dvec3&) -> RaySample { throw std::bad_alloc(); });
  EXPECT_NE(refusal(full).message.find("memory"), std::string::npos);
}

/// Throws in one of the calls that a build makes on its own thread.
class Throwing final : public Scene {
 public:
  enum class In { bounds, provenance, files, prepare };
  explicit Throwing(In in) : in_(in) {}
  Sphere bounds() const override {
    check(In::bounds);
    return {glm::dvec3(0), 1};
  }
  RaySample trace(const glm::dvec3&, const glm::dvec3&) const override { return {}; }
  std::string provenance() const override {
    check(In::provenance);
    return "{}";
  }
  std::vector<std::string> files() const override {
    check(In::files);
    return {};
  }
  Result<void> prepare() const override {
    check(In::prepare);
    return {};
  }

 private:
  void check(In now) const {
    if (now == in_) throw std::bad_alloc();
  }
  In in_;
};

TEST(Build, AnExceptionOutsideOfTracingIsAnErrorThatNamesTheOutput) {
  using In = Throwing::In;
  for (const In in : {In::bounds, In::provenance, In::files, In::prepare}) {
    const Error error = refusal(Throwing(in));
    EXPECT_EQ(error.code, ErrorCode::out_of_memory);
    EXPECT_NE(error.message.find("a.slf: out of memory"), std::string::npos) << error.message;
  }
}

/// Counts what a build asks of it.
class Prepared final : public Scene {
 public:
  mutable int prepared = 0;
  mutable std::atomic<bool> ready = false;
  Result<void> prepare() const override {
    ++prepared;
    ready = true;
    return {};
  }
  Sphere bounds() const override { return {glm::dvec3(0), 1}; }
  RaySample trace(const glm::dvec3&, const glm::dvec3&) const override {
    EXPECT_TRUE(ready);
    return {glm::vec4(1), 0.5f};
  }
  std::string provenance() const override { return "{}"; }
};

TEST(Build, PreparesTheSceneOnlyIfRaysAreLeft) {
  const std::string path = ::testing::TempDir() + "prepared.slf";
  std::filesystem::remove(path);
  for (const BuildOptions& options : {lossless_options(2, 4, 1), BuildOptions{}}) {
    const Prepared scene;
    auto small = options;
    small.shape = lossless_options(2, 4, 1).shape;
    small.replace = true;
    ASSERT_TRUE(build_field(scene, path, small));
    EXPECT_EQ(scene.prepared, 1);
    small.replace = false;
    const auto again = build_field(scene, path, small);
    ASSERT_TRUE(again) << again.error().message;
    EXPECT_EQ(again->tiles, 0u);
    EXPECT_EQ(scene.prepared, 1);
  }
  std::filesystem::remove(path);
}

/// A scene that says wrong things about itself.
class Odd final : public Scene {
 public:
  Sphere sphere{glm::dvec3(0), 1};
  std::string origin = "{}";
  Sphere bounds() const override { return sphere; }
  RaySample trace(const glm::dvec3&, const glm::dvec3&) const override { return {}; }
  std::string provenance() const override { return origin; }
};

// Nothing is done for each of 1.1 billion tiles before the first one is traced.
TEST(Build, AsksSoonWhetherToGoOn) {
  const TemporaryFolder folder;
  const auto begin = std::chrono::steady_clock::now();
  const auto stopped =
      build_field(*make_analytic_scene("balls").value(), folder / "a.slf",
                  lossless_options(1, 1, 6), [](const Progress&) { return false; });
  ASSERT_FALSE(stopped);
  EXPECT_EQ(stopped.error().code, ErrorCode::cancelled);
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(5));
  EXPECT_TRUE(folder.files().empty());
}

TEST(Build, WrongBoundsAndProvenanceAreUsageErrors) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  for (const Sphere& wrong : {Sphere{glm::dvec3(0), kNan}, Sphere{glm::dvec3(0), 0},
                              Sphere{glm::dvec3(0), -1}, Sphere{glm::dvec3(0, kNan, 0), 1},
                              Sphere{glm::dvec3(0), HUGE_VAL}, Sphere{glm::dvec3(0), 1e308},
                              Sphere{glm::dvec3(0), 1e-308}, Sphere{glm::dvec3(0, 1e308, 0), 1}}) {
    Odd scene;
    scene.sphere = wrong;
    for (auto options : {lossless_options(2, 4, 1), BuildOptions{}}) {
      const Error error = refusal(scene, options);
      EXPECT_EQ(error.code, ErrorCode::usage);
      EXPECT_NE(error.message.find("bounds"), std::string::npos) << error.message;
    }
    auto options = lossless_options(2, 4, 1);
    options.shape.sphere = wrong;
    if (wrong.radius != 0) {
      EXPECT_EQ(refusal(Odd(), options).code, ErrorCode::usage);
    }
  }
  for (const char* wrong : {"7", "\"text\"", "[]", "null", "", "{", "{} {}"}) {
    Odd scene;
    scene.origin = wrong;
    const Error error = refusal(scene);
    EXPECT_EQ(error.code, ErrorCode::usage);
    EXPECT_NE(error.message.find("provenance"), std::string::npos) << error.message;
  }
  Odd deep;
  for (int k = 0; k < 100; ++k) deep.origin = "{\"more\": " + deep.origin + "}";
  EXPECT_EQ(refusal(deep).code, ErrorCode::usage);
}

TEST(Build, EmptyScenesBuildToEmptyTiles) {
  TemporaryFolder folder;
  const FunctionScene nothing([](const glm::dvec3&, const glm::dvec3&) { return RaySample{}; });
  const auto field = build_and_open(nothing, folder / "a.slf", lossless_options(2, 2, 1));
  ASSERT_TRUE(field);
  const auto content = field->content();
  EXPECT_TRUE(content->complete);
  EXPECT_EQ(content->payload_bytes, 0u);
  EXPECT_EQ(content->levels[1].empty, 1024u);
}

TEST(Build, HalfFloatColourIsKeptBitForBit) {
  TemporaryFolder folder;
  const FunctionScene bright([](const glm::dvec3& a, const glm::dvec3& b) {
    return RaySample{{float(3 + a.x), float(100 * (1 + b.y)), 1e-3f, 1}, 0.5f};
  });
  auto options = lossless_options(2, 3, 1);
  options.half = true;
  const auto field = build_and_open(bright, folder / "a.slf", options);
  ASSERT_TRUE(field);
  Manifest manifest = field->file().manifest();
  const TileTracer tracer(bright, manifest);
  for (std::uint64_t index = 0; index < tile_count(1, 0); index += 31) {
    const auto tile = field->file().store().find({1, index});
    ASSERT_TRUE(tile);
    std::vector<std::byte> samples(field->file().tile_shape({1, index}).bytes());
    ASSERT_TRUE(testing::read(field->file(), *tile, samples));
    SourceTile traced;
    ASSERT_TRUE(tracer.tile({1, index}, traced));
    EXPECT_EQ(samples, traced.samples);
  }
}

TEST(BuildSize, WhatNobodyBuildsIsRefusedAtOnce) {
  TemporaryFolder folder;
  const auto scene = std::move(*make_analytic_scene("balls"));
  const auto refuse = [&](unsigned levels, const std::string& codec, const char* expected) {
    BuildOptions options = testing::lossless_options(4, 4, levels);
    options.codec = codec;
    const auto built = build_field(*scene, folder / "a.slf", options);
    ASSERT_FALSE(built);
    EXPECT_EQ(built.error().code, ErrorCode::usage);
    EXPECT_STREQ(built.error().choice, "levels");
    EXPECT_NE(built.error().message.find(expected), std::string::npos) << built.error().message;
  };
  refuse(7, "predictive:90", "levels 7: with the codec predictive:90 expected at most 6");
  refuse(7, "zstd:1", "levels 7: 18325193792 tiles of each state, expected at most 4294967296");
  refuse(10, "zstd:1", "choose fewer levels");
  EXPECT_TRUE(folder.files().empty());
}

// A shard begins where a share of all rays ends, and needs tiles of others.
TEST(BuildSize, PlansOfManyTilesCanBeStopped) {
  TemporaryFolder folder;
  const auto scene = std::move(*make_analytic_scene("balls"));
  for (const char* codec : {"zstd:1", "predictive:90"})
    for (const int calls : {1, 100}) {
      BuildOptions options = testing::lossless_options(1, 1, 4);
      options.codec = codec;
      options.shard.index = options.shard.count = 2;
      int left = calls;
      const auto built = build_field(*scene, folder / "a.slf", options, [&](const Progress& p) {
        EXPECT_EQ(p.done, 0u);
        EXPECT_EQ(p.total, 1u) << "not asked while the build is planned";
        return --left > 0;
      });
      ASSERT_FALSE(built);
      EXPECT_EQ(built.error().code, ErrorCode::cancelled);
      EXPECT_TRUE(folder.files().empty());
    }
}

}  // namespace
}  // namespace slf
