// Pictures for tests: files of one colour, and of scene:balls from all sides.
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "slf/measure.h"
#include "slf/pictures.h"
#include "slf/scene.h"
#include "tests/temporary_folder.h"

namespace slf {

using Json = nlohmann::json;

/// A folder with pictures and their transforms.json.
class Pictures : public ::testing::Test {
 protected:
  std::string path(const std::string& name) const { return folder_ / name; }

  void write(const std::string& name, const std::string& text) const {
    std::filesystem::create_directories(std::filesystem::path(path(name)).parent_path());
    std::ofstream(path(name), std::ios::binary) << text;
  }
  void write(const std::string& name, const Json& json) const { write(name, json.dump()); }

  /// A picture of some colour.
  void write_picture(const std::string& name, std::uint32_t width, std::uint32_t height) const {
    std::filesystem::create_directories(std::filesystem::path(path(name)).parent_path());
    Image image{width, height, std::vector(std::size_t{width} * height, glm::vec4(0.5f)), {}};
    ASSERT_TRUE(write_image(path(name), image, {.transparent = true}));
  }

  /// One frame that is valid, beside a picture of 40 x 30 pixels.
  Json transforms() const {
    write_picture("a.png", 40, 30);
    return {{"camera_angle_x", 0.8},
            {"frames",
             {{{"file_path", "a"},
               {"transform_matrix", {{1, 0, 0, 1}, {0, 1, 0, 2}, {0, 0, 1, 3}, {0, 0, 0, 1}}}}}}};
  }
  std::string message_of(const Json& json) const {
    write("transforms.json", json);
    const auto set = read_pictures(path("transforms.json"));
    return set ? "no error" : set.error().message;
  }

  testing::TemporaryFolder folder_;
};

/// Pictures of an analytic scene, as files.
class PictureScenes : public Pictures {
 protected:
  /// Writes `count` pictures of scene:balls; `extension` .exr has depth from the eye.
  PictureSet draw(std::uint32_t count, const std::string& extension) const {
    PictureSet set;
    set.source = path("transforms.json");
    set.pictures = spread_cameras(balls_->bounds(), 3, count, 96, 96);
    for (Picture& picture : set.pictures) {
      picture.file = path(picture.name + extension);
      const auto image = view(picture);
      EXPECT_TRUE(write_image(picture.file, image, {.transparent = true}));
    }
    return set;
  }
  Image view(const Picture& picture) const { return view(*balls_, picture); }
  static Image view(const Scene& scene, const Picture& picture) {
    const auto camera = camera_of(picture);
    return trace_view(scene, scene.bounds(), *camera).value();
  }
  /// Mean PSNR of views from other directions.
  double quality(const Scene& scene) const {
    double sum = 0;
    const auto cameras = spread_cameras(balls_->bounds(), 3.3, 7, 96, 96);
    for (const Picture& picture : cameras)
      sum += compare(view(picture), view(scene, picture)).psnr / 7;
    return sum;
  }

  std::unique_ptr<Scene> balls_ = make_analytic_scene("balls").value();
};

}  // namespace slf
