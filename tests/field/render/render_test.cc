#include "slf/render.h"

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <cmath>
#include <filesystem>
#include <limits>
#include <set>
#include <thread>
#include <vector>

#include "field/field_file.h"
#include "slf/measure.h"
#include "slf/scene.h"
#include "tests/field/field_testing.h"
#include "tests/instruction_set.h"
#include "tests/sanitized.h"

namespace slf {
namespace {

using testing::build_and_open;
using testing::draw;
using testing::FunctionScene;
using testing::lossless_options;
using testing::TemporaryFolder;

constexpr RenderMode kModes[] = {RenderMode::nearest, RenderMode::uv, RenderMode::st,
                                 RenderMode::bitri, RenderMode::depth};

class Render : public testing::BallsTest {};

TEST_F(Render, QualityRisesFromNearestToBiTriangleToDepth) {
  const auto cameras = random_cameras(field_->shape().sphere, 3, 4, 5, 128, 128);
  double last = 0;
  for (const RenderMode mode :
       {RenderMode::nearest, RenderMode::uv, RenderMode::bitri, RenderMode::depth}) {
    const auto quality = evaluate_views(*field_, *scene_, {cameras, {mode, 2, false}});
    ASSERT_TRUE(quality);
    EXPECT_GT(quality->psnr, last) << name(mode);
    last = quality->psnr;
  }
}

TEST_F(Render, FinerLevelsAreSharper) {
  const auto cameras = random_cameras(field_->shape().sphere, 3, 4, 5, 128, 128);
  double last = 0;
  for (unsigned level = 0; level <= 2; ++level) {
    const auto quality =
        evaluate_views(*field_, *scene_, {cameras, {RenderMode::bitri, level, false}});
    EXPECT_GT(quality->psnr, last);
    last = quality->psnr;
  }
}

TEST_F(Render, ThePictureDoesNotDependOnBudgetThreadsOrCache) {
  const Camera camera = orbit_camera(field_->shape().sphere, 40, 25, 2.5, 150, 131);
  for (const RenderMode mode : kModes) {
    const Image reference = draw(*field_, camera, {mode, 2, true}, {1ull << 30, 1});
    for (const RendererOptions& options :
         {RendererOptions{1ull << 30, 5}, RendererOptions{1ull << 20, 2}, RendererOptions{1, 3}}) {
      const Image image = draw(*field_, camera, {mode, 2, true}, options);
      EXPECT_EQ(image.rgba, reference.rgba) << name(mode) << " " << options.memory;
      EXPECT_EQ(image.depth, reference.depth) << name(mode) << " " << options.memory;
    }
  }
  Renderer renderer(*field_, {64ull << 20, 2});
  const auto first = renderer.render(camera, {RenderMode::bitri, 2, false});
  ASSERT_TRUE(renderer.render(orbit_camera(field_->shape().sphere, 0, 0, 3, 99, 99),
                              {RenderMode::depth, 1, false}));
  const auto second = renderer.render(camera, {RenderMode::bitri, 2, false});
  EXPECT_EQ(first->rgba, second->rgba);
}

TEST_F(Render, NothingStaysOfWhatThePictureHeldBefore) {
  const Camera camera = orbit_camera(field_->shape().sphere, 40, 25, 2.5, 150, 131);
  Renderer renderer(*field_, {});
  for (const RenderMode mode : kModes) {
    Image image{1, 1, std::vector<glm::vec4>(150 * 131, glm::vec4(7)),
                std::vector<float>(150 * 131, 7)};
    ASSERT_TRUE(renderer.render(camera, {mode, 2, true}, image));
    const Image fresh = draw(*field_, camera, {mode, 2, true});
    EXPECT_EQ(image.rgba, fresh.rgba) << name(mode);
    EXPECT_EQ(image.depth, fresh.depth) << name(mode);
  }
}

TEST_F(Render, DepthIsLoadedBesideColorThatIsHereAlready) {
  const Camera camera = orbit_camera(field_->shape().sphere, 20, 50, 3, 61, 60);
  const ViewOptions deep{RenderMode::depth, 2, false};
  Renderer renderer(*field_, {});
  ASSERT_TRUE(renderer.render(camera, {RenderMode::bitri, 2, false}));
  const auto image = renderer.render(camera, deep);
  ASSERT_TRUE(image);
  EXPECT_EQ(image->rgba, draw(*field_, camera, deep).rgba);
}

/// The most that any channel of any pixel differs.
float largest_difference(const Image& a, const Image& b) {
  float max = 0;
  for (std::size_t k = 0; k < a.rgba.size(); ++k)
    for (int c = 0; c < 4; ++c) max = std::max(max, std::abs(a.rgba[k][c] - b.rgba[k][c]));
  return max;
}

/// Draws a view with each instruction set, with room for every tile and for hardly any, and expects
/// the same picture.
void expect_same_on_every_target(const Field& field, const Camera& camera,
                                 const ViewOptions& view) {
  const Image best = draw(field, camera, view);
  testing::with_each_instruction_set([&](const char* set) {
    const Image image = draw(field, camera, view);
    EXPECT_LT(largest_difference(image, best), 1.f / 255) << name(view.mode) << " " << set;
    EXPECT_EQ(draw(field, camera, view, {1, 1}).rgba, image.rgba);
  });
}

TEST_F(Render, EveryInstructionSetDrawsTheSamePicture) {
  const Camera camera = orbit_camera(field_->shape().sphere, 40, 25, 2.5, 150, 131);
  for (const RenderMode mode : {RenderMode::bitri, RenderMode::depth})
    expect_same_on_every_target(*field_, camera, {mode, 2, false});
}

TEST(RenderSmallTiles, AnyShapeFormatAndCodecDrawsTheSamePictureEverywhere) {
  // Something to see that moves with both ends of a ray, and a depth that does.
  const FunctionScene scene([](const glm::dvec3& from, const glm::dvec3& to) {
    const glm::vec3 a = 0.5 + 0.5 * from, b = 0.5 + 0.5 * to;
    return RaySample{glm::vec4(a.x, b.y, a.z * b.x, 1) * (0.2f + 0.8f * b.z), 0.3f + 0.4f * a.y};
  });
  for (const std::uint32_t exit : {1u, 2u, 3u})
    for (const char* codec : {"raw", "zstd:1"})
      for (const bool half : {false, true}) {
        TemporaryFolder folder;
        auto options = lossless_options(2, exit, 1);
        options.codec = codec;
        options.half = half;
        const auto field = build_and_open(scene, folder / "a.slf", options);
        ASSERT_TRUE(field);
        const Camera camera = orbit_camera(field->shape().sphere, 40, 25, 2.5, 61, 50);
        for (const RenderMode mode : kModes)
          expect_same_on_every_target(*field, camera, {mode, 1, false});
      }
}

TEST_F(Render, DecodedTilesStayWithinTheBudget) {
  const Camera camera = orbit_camera(field_->shape().sphere, 40, 25, 2.5, 256, 256);
  ViewStatistics statistics;
  for (const std::uint64_t memory : {1ull << 20, 2ull << 20, 8ull << 20}) {
    draw(*field_, camera, {RenderMode::depth, 2, false}, {memory, 2}, &statistics);
    EXPECT_LE(statistics.decoded_peak_bytes, memory);
    EXPECT_GT(statistics.decoded_peak_bytes, 0u);
  }
}

TEST_F(Render, StatisticsCountWhatWasTouched) {
  const Camera camera = orbit_camera(field_->shape().sphere, 10, -35, 3, 200, 200);
  ViewStatistics statistics;
  draw(*field_, camera, {RenderMode::bitri, 1, false}, {}, &statistics);
  const auto pairs = crossed_pairs(field_->shape(), camera, 1);
  ASSERT_TRUE(pairs);
  // A cell's vertices may all belong to neighbours of the section it lies in, but what a ray exits
  // through is what is touched.
  std::set<Section> exits;
  for (const TileKey& key : statistics.tiles) exits.insert(sections_of(key, 0).exit);
  for (const TileKey& key : *pairs) EXPECT_TRUE(exits.contains(sections_of(key, 0).exit));
  std::uint64_t bytes = 0, stored = 0;
  for (const TileKey& key : statistics.tiles) {
    const auto tile = field_->file().store().find(key);
    bytes += tile->payload.size();
    stored += tile->state == storage::TileState::stored;
  }
  const auto file = footprint(*field_, statistics.tiles);
  ASSERT_TRUE(file);
  EXPECT_EQ(file->compressed_bytes, bytes);
  EXPECT_EQ(file->stored_tiles, stored);
  EXPECT_EQ(statistics.decodes, stored);
  EXPECT_GE(file->pages.size(), bytes / 4096);
  EXPECT_LE(file->pages.size(), bytes / 4096 + 4 * stored);
  EXPECT_EQ(statistics.fallback_pixels(), 0u);
}

TEST_F(Render, AViewInLittleMemoryListsTheSameTiles) {
  const Camera camera = orbit_camera(field_->shape().sphere, 40, 25, 2.5, 256, 256);
  ViewStatistics ample, little;
  draw(*field_, camera, {RenderMode::depth, 2, false}, {1ull << 30, 1}, &ample);
  draw(*field_, camera, {RenderMode::depth, 2, false}, {1ull << 20, 2}, &little);
  EXPECT_EQ(little.tiles, ample.tiles);
  EXPECT_GT(little.decodes, ample.decodes);
}

TEST_F(Render, TheMatchingLevelIsCoarserFromAfarAndInSmallPictures) {
  const FieldShape& shape = field_->shape();
  const auto level = [&](double distance, std::uint32_t size) {
    const Camera camera = orbit_camera(shape.sphere, 10, 20, distance, size, size);
    const unsigned matching = matching_level(shape, camera, RenderMode::depth);
    // Without depth the entry lattice, which is coarse here, must match as well.
    EXPECT_GE(matching_level(shape, camera, RenderMode::bitri), matching);
    return matching;
  };
  EXPECT_EQ(level(3, 2000), shape.finest_level);
  EXPECT_EQ(level(3, 8), 0u);
  for (std::uint32_t size = 16; size < 1024; size *= 2)
    EXPECT_LE(level(3, size), level(3, 2 * size));
  // Through the same lens, from further away.
  Camera camera = orbit_camera(shape.sphere, 10, 20, 3, 200, 200);
  unsigned last = matching_level(shape, camera, RenderMode::depth);
  for (int k = 0; k < 5; ++k) {
    camera.eye = shape.sphere.center + 2.0 * (camera.eye - shape.sphere.center);
    const unsigned now = matching_level(shape, camera, RenderMode::depth);
    EXPECT_LE(now, last);
    last = now;
  }
  EXPECT_EQ(last, 0u);
  // Rendering takes it.
  const Camera small = orbit_camera(shape.sphere, 10, 20, 3, 40, 40);
  ASSERT_LT(matching_level(shape, small, RenderMode::depth), shape.finest_level);
  EXPECT_GT(matching_level(shape, small, RenderMode::bitri),
            matching_level(shape, small, RenderMode::depth));
  EXPECT_EQ(
      draw(*field_, small, {RenderMode::bitri, kMatchingLevel}).rgba,
      draw(*field_, small, {RenderMode::bitri, matching_level(shape, small, RenderMode::bitri)})
          .rgba);
}

TEST_F(Render, ReportsProgressAndStopsWhenTold) {
  const Camera camera = orbit_camera(field_->shape().sphere, 10, 20, 3, 640, 480);
  const ViewOptions view{RenderMode::depth, 2};
  for (const unsigned threads : {1u, 3u}) {
    Renderer renderer(*field_, {.threads = threads});
    Progress last;
    const auto whole = renderer.render(camera, view, nullptr, [&](const Progress& progress) {
      EXPECT_GE(progress.done, last.done);
      last = progress;
      return true;
    });
    ASSERT_TRUE(whole);
    EXPECT_EQ(last.done, last.total);
    EXPECT_EQ(whole->rgba, draw(*field_, camera, view).rgba);
    std::uint64_t done = 0;
    const auto stopped = renderer.render(camera, view, nullptr, [&](const Progress& progress) {
      done = progress.done;
      return false;
    });
    ASSERT_FALSE(stopped);
    EXPECT_EQ(stopped.error().code, ErrorCode::cancelled);
    EXPECT_LE(done, threads == 1 ? last.total - 1 : last.total);
    EXPECT_EQ(renderer.render(camera, view)->rgba, whole->rgba);  // as if nothing had happened
  }
}

TEST_F(Render, ThePagesTheEngineCountsAreThoseTheKernelReads) {
  // In memory file systems forget nothing: on the disk, where there is one.
  const std::string path = std::filesystem::path(SLF_COMMAND).parent_path() / "pages-test.slf";
  std::filesystem::copy_file(field_->path(), path,
                             std::filesystem::copy_options::overwrite_existing);
  const auto field = Field::open(path);
  ASSERT_TRUE(field) << field.error().message;
  MeasureOptions options;
  options.cameras = random_cameras(field->shape().sphere, 3, 3, 1, 200, 200);
  options.mode = RenderMode::depth;
  const auto m = measure_views(*field, options);
  std::filesystem::remove(path);
  ASSERT_TRUE(m) << m.error().message;
  if (!m->kernel_counted) GTEST_SKIP() << "this file system does not forget";
  for (const LevelMeasure& level : m->levels) {
    EXPECT_NEAR(level.cached_pages.mean, level.map_pages.mean, 0.05 * level.map_pages.mean + 2);
    EXPECT_NEAR(level.mapped_pages.mean, level.map_pages.mean, 0.05 * level.map_pages.mean + 2);
  }
}

TEST_F(Render, MeasuringCountsViewsAndStopsWhenAsked) {
  MeasureOptions options;
  options.cameras = random_cameras(field_->shape().sphere, 3, 3, 1, 20, 20);
  const std::uint64_t all = 3 * (field_->shape().finest_level + 1);
  std::vector<std::uint64_t> seen;
  const auto whole = measure_views(*field_, options, [&](const Progress& progress) {
    EXPECT_EQ(progress.total, all);
    seen.push_back(progress.done);
    return true;
  });
  EXPECT_TRUE(whole);
  EXPECT_EQ(seen.size(), all);
  EXPECT_EQ(seen.back(), all);
  const auto stopped =
      measure_views(*field_, options, [](const Progress& progress) { return progress.done < 2; });
  ASSERT_FALSE(stopped);
  EXPECT_EQ(stopped.error().code, ErrorCode::cancelled);
}

TEST_F(Render, DistancesReachTheSurface) {
  const Camera camera = orbit_camera(field_->shape().sphere, 70, 10, 3, 96, 96);
  const Image image = draw(*field_, camera, {RenderMode::depth, 2, true});
  const Image truth = *trace_view(*scene_, field_->shape().sphere, camera);
  int close = 0, both = 0;
  for (std::size_t k = 0; k < image.pixels(); ++k) {
    if (!(truth.rgba[k].a > 0.99f && image.rgba[k].a > 0.99f)) continue;
    ++both;
    close += std::abs(image.depth[k] - truth.depth[k]) < 0.04f;
  }
  EXPECT_GT(both, 1000);
  EXPECT_GT(close, both * 9 / 10);
}

TEST_F(Render, BadRequestsAreUsageErrors) {
  const Sphere sphere = field_->shape().sphere;
  Renderer renderer(*field_);
  const auto code = [&](const Camera& camera, const ViewOptions& view) {
    const auto image = renderer.render(camera, view);
    EXPECT_FALSE(image);
    return image ? ErrorCode::failed : image.error().code;
  };
  const Camera good = orbit_camera(sphere, 0, 0, 3, 32, 32);
  EXPECT_EQ(code(good, {RenderMode::bitri, 3, false}), ErrorCode::usage);
  Camera camera = good;
  camera.eye = camera.look_at;
  EXPECT_EQ(code(camera, {}), ErrorCode::usage);
  camera = good;
  camera.eye.x = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(code(camera, {}), ErrorCode::usage);
  camera = good;
  camera.width = 0;
  EXPECT_EQ(code(camera, {}), ErrorCode::usage);
  camera = good;
  camera.width = camera.height = 1000000;
  EXPECT_EQ(code(camera, {}), ErrorCode::usage);
  camera = good;
  camera.fov = 180;
  EXPECT_EQ(code(camera, {}), ErrorCode::usage);
  camera = good;
  camera.up = camera.look_at - camera.eye;
  EXPECT_EQ(code(camera, {}), ErrorCode::usage);
  EXPECT_FALSE(parse_render_mode("sharp"));
}

TEST_F(Render, EyesInsideTheSphereAndFarAwayDraw) {
  for (const double distance : {0.7, 1.0, 1.01, 50.0, 1e6}) {
    const Camera camera = orbit_camera(field_->shape().sphere, 15, 40, distance, 48, 48);
    for (const RenderMode mode : kModes)
      for (const glm::vec4& pixel : draw(*field_, camera, {mode, 2, false}).rgba)
        ASSERT_TRUE(pixel.a >= 0 && pixel.a <= 1.0001f) << distance << " " << name(mode);
  }
}

TEST(RenderDistances, AreThoseOfTheVertexThatIsSeen) {
  // Every ray shows its entry vertex: its place is the colour.
  const FunctionScene scene([](const glm::dvec3& from, const glm::dvec3&) {
    return RaySample{glm::vec4((glm::vec3(from) + 1.f) / 2.f, 1), 0};
  });
  const TemporaryFolder folder;
  BuildOptions options = lossless_options(4, 8, 0);
  options.half = true;
  const auto field = build_and_open(scene, folder / "a.slf", options);
  ASSERT_TRUE(field);
  const Camera camera = orbit_camera(field->shape().sphere, 70, 10, 3, 48, 48);
  const auto rays = *RayGenerator::make(camera);
  for (const RenderMode mode : {RenderMode::nearest, RenderMode::st}) {
    const Image image = draw(*field, camera, {mode, 0, true});
    std::size_t seen = 0;
    for (std::uint32_t y = 0; y < camera.height; ++y)
      for (std::uint32_t x = 0; x < camera.width; ++x) {
        const std::size_t k = y * camera.width + x;
        if (image.rgba[k].a == 0) continue;
        ++seen;
        const PixelRay ray = rays.ray(x, y);
        const Chord chord = intersect(field->shape().sphere, ray.origin, ray.direction);
        const glm::dvec3 enter = ray.origin + chord.enter * ray.direction;
        const glm::dvec3 along = (chord.leave - chord.enter) * ray.direction;
        const glm::dvec3 vertex = 2.0 * glm::dvec3(image.rgba[k]) - 1.0;
        const double t =
            std::clamp(glm::dot(vertex - enter, along) / glm::dot(along, along), 0.0, 1.0);
        EXPECT_NEAR(image.depth[k], glm::distance(camera.eye, enter + t * along), 5e-3)
            << name(mode) << " " << x << "," << y;
      }
    EXPECT_GT(seen, 1000u);
  }
}

TEST(RenderConstant, AConstantFieldIsConstantInEveryModeAndAtEveryLevel) {
  TemporaryFolder folder;
  const FunctionScene scene([](const glm::dvec3&, const glm::dvec3&) {
    return RaySample{{0.2f, 0.4f, 0.6f, 0.8f}, 0.4f};
  });
  const auto field = build_and_open(scene, folder / "a.slf", lossless_options(2, 3, 2));
  ASSERT_TRUE(field);
  for (unsigned level = 0; level <= 2; ++level)
    for (const RenderMode mode : kModes) {
      ViewStatistics statistics;
      const Image image = draw(*field, orbit_camera(field->shape().sphere, 33, 44, 2, 64, 64),
                               {mode, level, false}, {}, &statistics);
      std::uint64_t seen = 0;
      for (const glm::vec4& pixel : image.rgba) {
        if (pixel.a == 0) continue;
        ++seen;
        EXPECT_NEAR(pixel.r, 51 / 255.f, 1e-5);
        EXPECT_NEAR(pixel.a, 204 / 255.f, 1e-5);
      }
      EXPECT_EQ(seen, statistics.pixels_hit);
      EXPECT_GT(seen, 2000u);
    }
}

TEST(RenderGeometry, ViewsCrossThePublishedShareOfPairs) {
  // Share of all (entry section, exit section) pairs that a view's rays pass through: 512², eye at
  // 3R, mean of random views.
  const double expected[] = {0.27, 0.078, 0.019, 0.0046};
  FieldShape shape;
  shape.sphere.radius = 1;
  const auto cameras = random_cameras(shape.sphere, 3, 12, 1, 512, 512);
  for (unsigned level = 0; level <= 3; ++level) {
    double share = 0;
    for (const Camera& camera : cameras)
      share += static_cast<double>(crossed_pairs(shape, camera, level)->size()) /
               static_cast<double>(tile_count(level, 0)) / static_cast<double>(cameras.size());
    EXPECT_NEAR(share, expected[level], 0.1 * expected[level]) << "level " << level;
  }
}

/// What a forked process makes of this: 0 the same picture, 1 another one, 2 an error that tells
/// of the fork.
int drawn_after_fork(Renderer& renderer, const Camera& camera, const Image& expected) {
  const auto image = renderer.render(camera, {});
  if (image) return image->rgba == expected.rgba ? 0 : 1;
  return image.error().message.find("was forked while") != std::string::npos ? 2 : 1;
}

// A fork waits for the views that other threads draw. Where that takes too long, the child knows.
TEST_F(Render, AForkedProcessDrawsOrSaysThatItCannot) {
#ifdef __SANITIZE_THREAD__
  GTEST_SKIP() << "the thread sanitizer ends forked processes that start threads";
#endif
  const Camera camera = orbit_camera(field_->shape().sphere, 30, 20, 3, 96, 96);
  const TileReader tiles(*field_, {.memory = 1 << 20});
  Renderer renderer(tiles, 2);
  const Image expected = *renderer.render(camera, {});
  for (const bool endless : {false, true}) {
    std::atomic<bool> stop{false}, begun{false};
    std::vector<std::jthread> others;
    for (int k = 0; k < 3; ++k)
      others.emplace_back([&] {
        Renderer own(tiles, 2);
        while (!stop)
          EXPECT_TRUE(own.render(camera, {}, nullptr, [&](const Progress&) {
            begun = true;
            while (endless && !stop) std::this_thread::yield();
            return true;
          }));
      });
    while (!begun) std::this_thread::yield();
    for (int round = 0; round < (endless ? 1 : testing::repetitions(40)); ++round) {
      const pid_t child = fork();
      if (child == 0) {
        alarm(60);
        int drawn = drawn_after_fork(renderer, camera, expected);
        {  // what was made before can be destroyed, and the field is as good as new
          const Renderer ended = std::move(renderer);
          Renderer another(*field_, {.memory = 1 << 20, .threads = 2});
          if (drawn_after_fork(another, camera, expected) != 0) drawn = 1;
        }
        _exit(drawn);
      }
      int status = 0;
      waitpid(child, &status, 0);
      ASSERT_TRUE(WIFEXITED(status)) << "hangs";
      EXPECT_EQ(WEXITSTATUS(status), endless ? 2 : 0);
    }
    stop = true;
  }
  EXPECT_EQ(drawn_after_fork(renderer, camera, expected), 0);
}

}  // namespace
}  // namespace slf
