// Each operation below is repeated until it succeeds: the first time its first allocation fails,
// then its second, and so on; and again so that all later ones fail, too. Each time it ends with an
// error or succeeds, and frees what it took.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <functional>

#include "base/guarded.h"
#include "base/try.h"
#include "field/field_file.h"
#include "field/tiles/tile_cache.h"
#include "slf/build.h"
#include "slf/player.h"
#include "slf/render.h"
#include "slf/repack.h"
#include "slf/scene.h"
#include "slf/verify.h"
#include "slf/volume.h"
#include "storage/range_source.h"
#include "tests/field/field_testing.h"
#include "tests/memory/allocations.h"

namespace slf {
namespace {

using testing::Later;
using testing::TemporaryFolder;

/// A file that is read in ranges, as a remote one is.
class LocalRanges final : public storage::RangeSource {
 public:
  explicit LocalRanges(const std::string& path) : name_(path), bytes_(testing::read_text(path)) {}
  [[nodiscard]] const std::string& name() const override { return name_; }
  [[nodiscard]] std::uint64_t size() const override { return bytes_.size(); }
  [[nodiscard]] Result<void> fetch(std::span<const storage::FileRange> ranges,
                                   const Sink& sink) override {
    for (const storage::FileRange& range : ranges) {
      const auto bytes = std::vector<char>(bytes_.begin() + std::ptrdiff_t(range.begin),
                                           bytes_.begin() + std::ptrdiff_t(range.end));
      SLF_TRY(sink(range.begin, std::as_bytes(std::span(bytes))));
    }
    return {};
  }

 private:
  std::string name_, bytes_;
};

std::size_t open_files() {
  return static_cast<std::size_t>(
      std::distance(std::filesystem::directory_iterator("/proc/self/fd"), {}));
}

std::size_t mapped_files(const std::string& folder) {
  std::ifstream maps("/proc/self/maps");
  std::size_t count = 0;
  for (std::string line; std::getline(maps, line);) count += line.find(folder) != std::string::npos;
  return count;
}

class FailingAllocations : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder;
    scene_ = std::move(*make_analytic_scene("balls")).release();
    field_ = new Field(*testing::build_and_open(*scene_, *folder_ / "balls.slf", options()));
  }
  static void TearDownTestSuite() {
    delete field_;
    delete scene_;
    delete folder_;
  }

  static BuildOptions options() {
    auto options = testing::lossless_options(2, 4, 1);
    options.codec = "predictive:80";
    options.threads = 1;
    return options;
  }
  static Camera camera(double azimuth = 30) {
    return orbit_camera(field_->shape().sphere, azimuth, 20, 3, 4, 4);
  }
  static ViewOptions view() { return {.mode = RenderMode::depth, .level = 1}; }

  struct Ways {
    /// The destructors of nlohmann::json take memory (base/owned_json.h). While an exception
    /// unwinds that makes a JSON value, nobody can empty it before.
    bool makes_json = false;
    /// What the operation leaves in a cache differs from time to time.
    bool keeps_tiles = false;
  };

  /// Runs `operation` as this file says. `clean` runs after each time, and may allocate.
  static void run(
      const Ways& ways, const std::function<Result<void>()>& operation,
      const std::function<void()>& clean = [] {}) {
    const auto attempt = [&](std::int64_t count, Later later) {
      testing::fail_allocation(count, later);
      const Result<void> ended = operation();
      const bool failed = testing::stop_failing();
      clean();
      if (failed && !ended) {
        EXPECT_EQ(ended.error().code, ErrorCode::out_of_memory) << ended.error().message;
      } else {
        EXPECT_TRUE(ended) << ended.error().message;
      }
      return failed;
    };
    constexpr std::int64_t kAll = std::int64_t{1} << 40;
    const auto warm_up = [&] {
      for (int k = 0; k < 2; ++k) EXPECT_FALSE(attempt(kAll, Later::succeed));
    };
    warm_up();
    const std::size_t files = open_files(), maps = mapped_files(folder_->path());
    const std::int64_t live = testing::live_allocations();
    std::int64_t attempts = 0;
    for (const Later later : {Later::succeed, Later::fail}) {
      if (ways.makes_json && later == Later::fail) break;
      bool failed = true;
      for (std::int64_t count = 0; failed; ++count, ++attempts) {
        SCOPED_TRACE("allocation " + std::to_string(count));
        // What stays the first time, and not the second, is kept on purpose.
        std::int64_t before = testing::live_allocations();
        failed = attempt(count, later);
        if (ways.keeps_tiles || testing::live_allocations() == before) continue;
        before = testing::live_allocations();
        (void)attempt(count, later);
        EXPECT_EQ(testing::live_allocations(), before) << "leaks";
        if (HasFailure()) return;
      }
    }
    warm_up();
    EXPECT_GT(attempts, 4);
    if (ways.keeps_tiles) {
      EXPECT_LT(testing::live_allocations(), live + attempts / 4);
    }
    EXPECT_EQ(open_files(), files);
    EXPECT_EQ(mapped_files(folder_->path()), maps);
  }

  static inline TemporaryFolder* folder_ = nullptr;
  static inline Scene* scene_ = nullptr;
  static inline Field* field_ = nullptr;
};

TEST_F(FailingAllocations, Open) {
  const std::string path = field_->path();
  run({.makes_json = true}, [&]() -> Result<void> {
    const auto field = SLF_TRY(Field::open(path));
    const auto content = SLF_TRY(field.content());
    return content.complete ? Result<void>() : fail(ErrorCode::failed, "is not complete");
  });
}

TEST_F(FailingAllocations, ReadOfATile) {
  TileKey key{1, 0};
  while (field_->file().store().find(key)->state != storage::TileState::stored) ++key.index;
  std::optional<TileReader> tiles;
  run(
      {},
      [&] {
        return guarded([&]() -> Result<void> {
          tiles.emplace(*field_, TileReaderOptions{.memory = 1 << 20});
          SLF_TRY(tiles->read(key));
          return {};
        });
      },
      [&] { tiles.reset(); });
}

TEST_F(FailingAllocations, ColdView) {
  const Image all = testing::draw(*field_, camera(), view());
  for (const unsigned threads : {1u, 2u}) {
    Image image;
    run({}, [&] {
      return guarded([&]() -> Result<void> {  // constructors may throw
        Renderer renderer(*field_, {.memory = 8 << 20, .threads = threads});
        SLF_TRY(renderer.render(camera(), view(), image));
        return {};
      });
    });
    EXPECT_EQ(image.rgba, all.rgba);
  }
}

TEST_F(FailingAllocations, WarmViewWithEviction) {
  const Image all = testing::draw(*field_, camera(), view());
  for (const unsigned threads : {1u, 2u}) {
    const TileReader tiles(*field_, {.memory = 24 << 10});
    Renderer renderer(tiles, threads);
    Image image;
    double azimuth = 0;
    ViewStatistics statistics;
    ASSERT_TRUE(renderer.render(camera(), view(), image, &statistics));
    ASSERT_TRUE(renderer.render(camera(), view(), image, &statistics));
    EXPECT_GT(statistics.decodes, 0u);  // tiles were evicted
    run(
        {.keeps_tiles = true},
        [&]() -> Result<void> { return renderer.render(camera(azimuth), view(), image); },
        [&] { azimuth = 70 - azimuth; });
    ASSERT_TRUE(renderer.render(camera(), view(), image));
    EXPECT_EQ(image.rgba, all.rgba);
  }
}

TEST_F(FailingAllocations, MovingCamera) {
  Image image;
  run({}, [&] {
    auto player = Player::make(
        *field_, {.renderer = {.memory = 1 << 20, .threads = 1}, .view = view(), .horizon = 2});
    for (int k = 0; player && k < 3; ++k) {
      if (auto drawn = player->draw(camera(10 * k), image); !drawn) return drawn;
      player->settle();
    }
    return player ? Result<void>() : tl::unexpected(player.error());
  });
}

TEST_F(FailingAllocations, BuildOfOneTile) {
  // A tile that is predicted from coarser ones.
  const std::string path = *folder_ / "tile.slf", coarser = *folder_ / "coarser.slf";
  BuildOptions options = FailingAllocations::options();
  options.shard.last_level = 0;
  ASSERT_TRUE(build_field(*scene_, coarser, options));
  options.shard.index = 500, options.shard.count = 1024;
  options.shard.last_level.reset();
  options.shard.first_level = 1;
  options.shard.coarser = coarser;
  std::uint64_t tiles = build_field(*scene_, path, options).value().tiles;
  const auto remove = [&] {
    for (const std::string& name : folder_->files())
      if (name.starts_with("tile.slf")) std::filesystem::remove(*folder_ / name);
  };
  for (remove(); tiles != 1; remove()) {
    ++options.shard.index;
    tiles = build_field(*scene_, path, options).value().tiles;
  }
  run(
      {.makes_json = true},
      [&]() -> Result<void> {
        SLF_TRY(build_field(*scene_, path, options));
        return {};
      },
      remove);
}

TEST_F(FailingAllocations, Repack) {
  const std::string path = *folder_ / "repacked.slf";
  const auto files = folder_->files();
  for (const char* codec : {"", "predictive:50", "zstd:1"}) {
    RepackOptions options;
    options.codec = codec, options.finest_level = 0, options.memory = 1 << 20, options.threads = 1;
    run(
        {.makes_json = true},
        [&]() -> Result<void> {
          SLF_TRY(repack_field(*field_, path, options));
          return {};
        },
        [&] {
          std::filesystem::remove(path);
          // LMDB's, which the next writer removes; to find out whether it is one takes memory.
          for (const std::string& name : folder_->files())
            if (name.ends_with("-lock")) std::filesystem::remove(*folder_ / name);
          EXPECT_EQ(folder_->files(), files);
        });
  }
}

// Only what the bytes prove is damage: a tile for which there was no memory is not dropped.
TEST_F(FailingAllocations, FixOfASoundField) {
  const std::string path = *folder_ / "sound.slf";
  for (const char* codec : {"predictive:80", "jpeg:80", "zstd:1"}) {
    auto options = FailingAllocations::options();
    options.shape.subfields = {28};
    options.codec = codec, options.replace = true;
    ASSERT_TRUE(build_field(*scene_, path, options));
    const std::string before = testing::read_text(path);
    for (const unsigned threads : {1u, 2u})
      run(
          {.makes_json = true, .keeps_tiles = threads > 1},
          [&]() -> Result<void> {
            const auto report = SLF_TRY(verify_field(path, {.fix = true, .threads = threads}));
            EXPECT_EQ(report.found, 0u) << report.findings.front().message;
            return {};
          },
          [&] { EXPECT_TRUE(testing::read_text(path) == before); });
  }
}

TEST_F(FailingAllocations, RemoteView) {
  const Image all = testing::draw(*field_, camera(), view());
  const auto source = std::make_shared<LocalRanges>(field_->path());
  Image image;
  run({.makes_json = true}, [&] {
    return guarded([&]() -> Result<void> {
      auto store = SLF_TRY(storage::TileStore::open(source));
      auto file = SLF_TRY(FieldFile::open(std::move(store)));
      Renderer renderer(Field::of(std::move(file)), {.memory = 8 << 20, .threads = 1});
      return renderer.render(camera(), view(), image);
    });
  });
  EXPECT_EQ(image.rgba, all.rgba);

  // A fetch that fails leaves the field as it was.
  auto store = storage::TileStore::open(source);
  ASSERT_TRUE(store);
  auto file = FieldFile::open(std::move(*store));
  ASSERT_TRUE(file);
  const Field field = Field::of(*file);
  run({}, [&] {
    return guarded([&]() -> Result<void> {
      Renderer renderer(field, {.memory = 8 << 20, .threads = 1});
      return renderer.render(camera(), view(), image);
    });
  });
  EXPECT_EQ(image.rgba, all.rgba);
}

// The libraries for these formats are C: no exception of a callback may pass through them.
TEST_F(FailingAllocations, DamagedPictures) {
  const std::string tiff = *folder_ / "damaged.tif", png = *folder_ / "damaged.png",
                    jpeg = *folder_ / "damaged.jpg";
  testing::write_text(tiff, std::string("II*\0\xff\xff\0\0", 8) + std::string(100, 'x'));
  testing::write_text(png, "\x89PNG\r\n\x1a\n" + std::string(100, 'x'));
  testing::write_text(jpeg, "\xff\xd8\xff" + std::string(100, 'x'));
  for (const std::string& path : {tiff, png, jpeg})
    for (const bool volume : {false, true})
      run({}, [&] {
        return guarded([&]() -> Result<void> {
          Error error{ErrorCode::failed, "was read"};
          if (volume) {
            if (auto read = read_volume(path, {}); !read) error = std::move(read.error());
          } else if (auto read = read_image(path); !read) {
            error = std::move(read.error());
          }
          const bool expected =
              error.code == ErrorCode::bad_file || error.code == ErrorCode::unsupported;
          return expected ? Result<void>() : tl::unexpected(std::move(error));
        });
      });
}

}  // namespace
}  // namespace slf
