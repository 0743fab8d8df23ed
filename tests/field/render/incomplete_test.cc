// Pictures of fields that lack tiles, or lose them while they are open.

#include <gtest/gtest.h>

#include <filesystem>
#include <limits>

#include "field/field_file.h"
#include "slf/render.h"
#include "slf/scene.h"
#include "storage/tile_writer.h"
#include "tests/field/field_testing.h"

namespace slf {
namespace {

using testing::build_and_open;
using testing::draw;
using testing::lossless_options;
using testing::TemporaryFolder;

TEST(RenderIncomplete, MissingTilesAreDrawnFromCoarserLevelsAndCounted) {
  TemporaryFolder folder;
  const auto scene = std::move(*make_analytic_scene("balls"));
  const auto options = lossless_options(4, 16, 2);
  std::uint64_t coarse = 0;
  ASSERT_FALSE(build_field(*scene, folder / "a.slf", options, [&](const Progress& p) {
    coarse = p.done;
    return p.done < p.total / 3;  // levels 0 and 1 and a part of level 2
  }));
  const auto field = Field::open(folder / "a.slf.unfinished");
  ASSERT_TRUE(field);
  const auto whole = build_and_open(*scene, folder / "b.slf", options);
  const Camera camera = orbit_camera(field->shape().sphere, 40, 25, 3, 128, 128);
  ViewStatistics statistics;
  const Image image = draw(*field, camera, {RenderMode::bitri, 2, false}, {}, &statistics);
  EXPECT_GT(statistics.fallback_pixels(), 0u);
  const Image fine = draw(*whole, camera, {RenderMode::bitri, 2, false});
  EXPECT_GT(compare(image, fine).psnr, 18);  // blurred in part, but the same picture
  const Image deep = draw(*field, camera, {RenderMode::depth, 2, true});
  EXPECT_GT(compare(deep, draw(*whole, camera, {RenderMode::depth, 2, false})).psnr, 18);
  EXPECT_EQ(draw(*field, camera, {RenderMode::depth, 2, true}, {1, 1}).rgba, deep.rgba);
  Image used{1, 1, std::vector<glm::vec4>(128 * 128, glm::vec4(7)), {}};
  ASSERT_TRUE(Renderer(*field, {}).render(camera, {RenderMode::depth, 2, false}, used));
  EXPECT_EQ(used.rgba, deep.rgba);
}

TEST(RenderIncomplete, PixelsThatCannotBeDrawnAreTransparent) {
  TemporaryFolder folder;
  const auto scene = std::move(*make_analytic_scene("balls"));
  auto options = lossless_options(4, 16, 1);
  const auto whole = build_and_open(*scene, folder / "whole.slf", options);
  options.shape.subfields = {7};  // enters where all coordinates are positive, leaves opposite
  const auto part = build_and_open(*scene, folder / "part.slf", options);
  ASSERT_TRUE(whole && part);
  const Camera camera = orbit_camera(part->shape().sphere, 135, 35, 3, 128, 128);
  for (const RenderMode mode : {RenderMode::bitri, RenderMode::depth}) {
    const ViewOptions view{mode, 1, true};
    const Image expected = draw(*whole, camera, view);
    Image image{1, 1, std::vector<glm::vec4>(128 * 128, glm::vec4(7)), {}};
    ASSERT_TRUE(Renderer(*part, {}).render(camera, view, image));
    std::size_t drawn = 0, left_out = 0;
    for (std::size_t k = 0; k < image.rgba.size(); ++k) {
      if (image.rgba[k] == expected.rgba[k]) {
        drawn += image.rgba[k].a > 0;
        continue;
      }
      ++left_out;
      EXPECT_EQ(image.rgba[k], glm::vec4(0)) << name(mode) << " pixel " << k;
      EXPECT_EQ(image.depth[k], std::numeric_limits<float>::infinity());
    }
    EXPECT_GT(drawn, 500u) << name(mode);
    EXPECT_GT(left_out, 500u) << name(mode);
  }
}

TEST(RenderBadFile, AFileThatShrinksIsAnErrorUnlessItsTilesAreLoaded) {
  TemporaryFolder folder;
  const auto scene = std::move(*make_analytic_scene("balls"));
  auto options = lossless_options(4, 16, 0);
  options.codec = "raw";
  const auto field = build_and_open(*scene, folder / "a.slf", options);
  ASSERT_TRUE(field);
  const Camera camera = orbit_camera(field->shape().sphere, 40, 25, 3, 64, 64);
  Renderer renderer(*field), other(*field);
  const auto before = renderer.render(camera, {RenderMode::depth, 0});
  ASSERT_TRUE(before);
  std::filesystem::resize_file(field->path(), 8192);
  const auto loaded = renderer.render(camera, {RenderMode::depth, 0});
  ASSERT_TRUE(loaded);
  EXPECT_EQ(loaded->rgba, before->rgba);
  const auto image = other.render(camera, {RenderMode::depth, 0});
  ASSERT_FALSE(image);
  EXPECT_EQ(image.error().code, ErrorCode::bad_file);
  EXPECT_NE(image.error().message.find("a.slf"), std::string::npos);
}

}  // namespace
}  // namespace slf
