// What tests of fields share: temporary folders, small fields, scenes with known answers.
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <functional>
#include <map>
#include <string>

#include "field/field_file.h"
#include "slf/build.h"
#include "slf/field.h"
#include "slf/render.h"
#include "slf/scene.h"

namespace slf::testing {

/// A folder of one test, in memory where there is /dev/shm; removed with it.
class TemporaryFolder {
 public:
  TemporaryFolder() {
    const std::filesystem::path memory = "/dev/shm";
    std::string name =
        (access(memory.c_str(), W_OK) == 0 ? memory : std::filesystem::temp_directory_path()) /
        "slf-test-XXXXXX";
    path_ = mkdtemp(name.data());
  }
  ~TemporaryFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  [[nodiscard]] std::string operator/(const std::string& name) const { return path_ + "/" + name; }
  /// The names of what is in it, sorted.
  [[nodiscard]] std::vector<std::string> files() const {
    std::vector<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(path_))
      names.push_back(entry.path().filename());
    std::sort(names.begin(), names.end());
    return names;
  }

 private:
  std::string path_;
};

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
  options.shape.levels = levels;
  options.color_codec = "zstd:1";
  options.depth_codec = "zstd:1";
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

/// Every tile's payload, by layer and key: what two equal fields share byte for byte.
inline std::map<std::pair<storage::LayerId, TileKey>, std::string> all_tiles(const Field& field) {
  std::map<std::pair<storage::LayerId, TileKey>, std::string> tiles;
  for (storage::LayerId layer = 0; layer < field.file().manifest().layers.size(); ++layer) {
    const auto ok = field.file().store().visit(
        layer, {0, 0}, {255, 0}, [&](const storage::TileRef& tile) -> Result<void> {
          if (tile.state == storage::TileState::stored) {
            if (auto checked = field.file().store().check(tile); !checked) return checked;
          }
          tiles[{layer, tile.key}] = {reinterpret_cast<const char*>(tile.payload.data()),
                                      tile.payload.size()};
          return {};
        });
    EXPECT_TRUE(ok) << (ok ? "" : ok.error().message);
  }
  return tiles;
}

inline Image draw(const Field& field, const Camera& camera, const ViewOptions& view,
                  const RendererOptions& options = {}, ViewStatistics* statistics = nullptr) {
  Renderer renderer(field, options);
  auto image = renderer.render(camera, view, statistics);
  EXPECT_TRUE(image) << (image ? "" : image.error().message);
  return image ? std::move(*image) : Image{};
}

}  // namespace slf::testing
