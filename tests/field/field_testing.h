// What tests of fields share: temporary folders, small fields, scenes with known answers.
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <functional>
#include <map>
#include <string>

#include "field/tiles/tile_cache.h"
#include "slf/build.h"
#include "slf/field.h"
#include "slf/render.h"
#include "slf/scene.h"
#include "tests/temporary_folder.h"

namespace slf::testing {

/// The vertices of lattice(n).
inline std::vector<LatticeVertex> all_vertices(std::int32_t n) {
  std::vector<LatticeVertex> all;
  for (std::int32_t i = -n; i <= n; ++i)
    for (std::int32_t j = -(n - std::abs(i)); j <= n - std::abs(i); ++j) {
      const std::int32_t k = n - std::abs(i) - std::abs(j);
      all.push_back({i, j, k});
      if (k != 0) all.push_back({i, j, -k});
    }
  return all;
}

/// Reads a stored tile, by a cache of its own.
inline Result<void> read(const FieldFile& field, const storage::TileRef& tile, Bytes& samples) {
  return TileCache(field, 16 << 20).read(tile.key, samples);
}

/// A scene whose rays are a function of their two points on the unit sphere.
class FunctionScene final : public Scene {
 public:
  using Function = std::function<RaySample(const glm::dvec3&, const glm::dvec3&)>;
  explicit FunctionScene(Function f) : f_(std::move(f)) {}
  Sphere bounds() const override { return {glm::dvec3(0), 1}; }
  RaySample trace(const glm::dvec3& from, const glm::dvec3& to) const override {
    return f_(from, to);
  }
  std::string provenance() const override { return R"({"kind": "function"})"; }

 private:
  Function f_;
};

inline BuildOptions lossless_options(std::uint32_t entry, std::uint32_t exit, unsigned levels) {
  BuildOptions options;
  options.shape.sphere.radius = 0;
  options.shape.entry_side = entry;
  options.shape.exit_side = exit;
  options.shape.finest_level = levels;
  options.codec = "zstd:1";
  options.threads = 2;
  return options;
}

inline std::optional<Field> build_and_open(const Scene& scene, const std::string& path,
                                           const BuildOptions& options) {
  const auto report = build_field(scene, path, options);
  EXPECT_TRUE(report) << (report ? "" : report.error().message);
  auto field = Field::open(path);
  EXPECT_TRUE(field) << (field ? "" : field.error().message);
  if (!field) return {};
  return *field;
}

/// Payloads by key.
using Payloads = std::map<TileKey, std::string>;

/// Every tile's payload: what two equal fields share byte for byte.
inline Payloads all_tiles(const Field& field) {
  Payloads tiles;
  const auto ok = field.file().store().visit(
      {0, 0}, {255, 0}, [&](const storage::TileRef& tile) -> Result<void> {
        if (tile.state == storage::TileState::stored) {
          if (auto checked = field.file().store().check(tile); !checked) return checked;
        }
        tiles[tile.key] = {reinterpret_cast<const char*>(tile.payload.data()), tile.payload.size()};
        return {};
      });
  EXPECT_TRUE(ok) << (ok ? "" : ok.error().message);
  return tiles;
}

inline Image draw(const Field& field, const Camera& camera, const ViewOptions& view,
                  const RendererOptions& options = {}, ViewStatistics* statistics = nullptr) {
  Renderer renderer(field, options);
  auto image = renderer.render(camera, view, statistics);
  EXPECT_TRUE(image) << (image ? "" : image.error().message);
  return image ? std::move(*image) : Image{};
}

/// Tests of one field of the balls, built once for each suite.
class BallsTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder;
    scene_ = std::move(*make_analytic_scene("balls")).release();
    field_ =
        new Field(*build_and_open(*scene_, *folder_ / "balls.slf", lossless_options(4, 16, 2)));
  }
  static void TearDownTestSuite() {
    delete field_;
    delete scene_;
    delete folder_;
  }

  static inline TemporaryFolder* folder_ = nullptr;
  static inline Scene* scene_ = nullptr;
  static inline Field* field_ = nullptr;
};

}  // namespace slf::testing
