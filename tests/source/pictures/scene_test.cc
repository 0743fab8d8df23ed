// The scene that pictures make.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <png.h>
#include <tiffio.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>

#include "base/file.h"
#include "slf/build.h"
#include "slf/measure.h"
#include "slf/pictures.h"
#include "tests/source/pictures/samples.h"

namespace slf {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

TEST_F(PictureScenes, ShowTheObjectFromOtherDirections) {
  PictureSceneOptions options{.voxels = 96};
  const auto by_depth = make_picture_scene(draw(60, ".exr"), options);
  ASSERT_TRUE(by_depth) << by_depth.error().message;
  EXPECT_EQ(Json::parse((*by_depth)->provenance())["depth"], "ray");
  EXPECT_GT(quality(**by_depth), 25);
  // The box around the balls has this centre; the last one reaches furthest from it.
  const Sphere sphere = (*by_depth)->bounds();
  EXPECT_LT(glm::distance(sphere.center, {0.01, -0.125, -0.015}), 0.03);
  EXPECT_NEAR(sphere.radius, 1.025, 0.06);

  options.depth = DepthKind::none;
  const auto by_hull = make_picture_scene(draw(60, ".png"), options);
  ASSERT_TRUE(by_hull) << by_hull.error().message;
  EXPECT_GT(quality(**by_hull), 22);

  options.depth = DepthKind::unknown;
  const auto estimated = make_picture_scene(draw(60, ".png"), options);
  ASSERT_TRUE(estimated) << estimated.error().message;
  EXPECT_EQ(Json::parse((*estimated)->provenance())["depth"], "estimated");
  EXPECT_GT(quality(**estimated), 22);
}

TEST_F(PictureScenes, EstimatedDepthsKeepTheSilhouettes) {
  // Pictures of fog match best at depths within it.
  balls_ = make_analytic_scene("fog").value();
  const auto scene = make_picture_scene(draw(60, ".png"), {.voxels = 96});
  ASSERT_TRUE(scene) << scene.error().message;
  std::size_t opaque = 0, missing = 0;
  for (const Picture& picture : spread_cameras(balls_->bounds(), 3.3, 7, 96, 96)) {
    const auto truth = view(picture), shown = view(**scene, picture);
    for (std::size_t k = 0; k < truth.rgba.size(); ++k)
      if (truth.rgba[k].a > 0.5f) ++opaque, missing += shown.rgba[k].a < 0.25f;
  }
  EXPECT_GT(opaque, 7000u);
  EXPECT_LT(static_cast<double>(missing), 0.01 * static_cast<double>(opaque));
}

TEST_F(PictureScenes, WhatOnlyTheHullHasAndNoPictureSeesIsEmpty) {
  // Cameras above leave a cone of the hull below each ball.
  PictureSet set = draw(80, ".png");
  std::erase_if(set.pictures, [&](const Picture& p) { return p.eye.z < 1.5; });
  const auto scene = make_picture_scene(set, {.sphere = balls_->bounds(), .voxels = 96});
  ASSERT_TRUE(scene) << scene.error().message;
  std::size_t object = 0, phantom = 0;
  for (const Picture& picture : spread_cameras(balls_->bounds(), 3.3, 30, 96, 96)) {
    if (std::abs(picture.eye.z) > 0.5) continue;
    const auto truth = view(picture), shown = view(**scene, picture);
    for (std::size_t k = 0; k < truth.rgba.size(); ++k)
      if (truth.rgba[k].a > 0.5f)
        ++object;
      else
        phantom += shown.rgba[k].a > 0.5f;
  }
  EXPECT_GT(object, 1000u);
  EXPECT_LT(static_cast<double>(phantom), 0.09 * static_cast<double>(object));
}

TEST_F(PictureScenes, DependNeitherOnMemoryNorOnThreads) {
  const PictureSet set = draw(20, ".png");
  PictureSceneOptions options{.voxels = 48, .threads = 1};
  const auto one = make_picture_scene(set, options);
  options.threads = 3;
  options.memory = 1;
  const auto other = make_picture_scene(set, options);
  ASSERT_TRUE(one && other);
  EXPECT_EQ((*one)->provenance(), (*other)->provenance());
  const auto camera = camera_of(set.pictures[3]);
  const auto a = trace_view(**one, (*one)->bounds(), *camera, 1),
             b = trace_view(**other, (*other)->bounds(), *camera, 3);
  EXPECT_EQ(a->rgba, b->rgba);
  EXPECT_EQ(a->depth, b->depth);
}

TEST_F(PictureScenes, KindOfDepthIsFoundAndChecked) {
  PictureSceneOptions options{.voxels = 48};
  const PictureSet set = draw(40, ".exr");
  options.depth_scale = 3;
  auto scene = make_picture_scene(set, options);
  ASSERT_FALSE(scene);
  EXPECT_EQ(scene.error().code, ErrorCode::usage);
  EXPECT_THAT(scene.error().message, AllOf(HasSubstr("disagree"), HasSubstr("along the ray")));
  options.depth_scale = 1;
  options.depth = DepthKind::inverse;
  scene = make_picture_scene(set, options);
  ASSERT_FALSE(scene);
  EXPECT_THAT(scene.error().message, HasSubstr("disagree"));
}

TEST_F(PictureScenes, DepthThatIsNotANumberIsNotKnown) {
  const PictureSet set = draw(40, ".exr");
  for (const Picture& picture : set.pictures) {
    Image image = read_image(picture.file).value();
    for (std::size_t p = 0; p < image.depth.size(); p += 7)
      image.depth[p] = std::numeric_limits<float>::quiet_NaN();
    ASSERT_TRUE(write_image(picture.file, image));
  }
  const auto scene = make_picture_scene(set, {.voxels = 96});
  ASSERT_TRUE(scene) << scene.error().message;
  EXPECT_GT(quality(**scene), 24);
}

TEST_F(PictureScenes, ImpossibleSetsAreNamed) {
  PictureSet set = draw(12, ".png");
  const auto message = [&](const PictureSet& from, PictureSceneOptions options = {.voxels = 32}) {
    const auto scene = make_picture_scene(from, options);
    return scene ? "no error" : scene.error().message;
  };
  EXPECT_EQ(message(set), "no error");
  PictureSet one = set;
  one.pictures.resize(1);
  EXPECT_THAT(message(one), HasSubstr("1 pictures; expected at least 2"));
  PictureSet parallel = set;
  for (Picture& picture : parallel.pictures) picture.axes = set.pictures[0].axes;
  EXPECT_THAT(message(parallel), HasSubstr("all look the same way"));
  PictureSet mixed = set;
  std::swap(mixed.pictures[0].eye, mixed.pictures[11].eye);
  for (std::size_t k = 0; k < 12; ++k) mixed.pictures[k].file = path("black.png");
  Image black{96, 96, std::vector(96 * 96, glm::vec4(0)), {}};
  ASSERT_TRUE(write_image(path("black.png"), black, {.transparent = true}));
  EXPECT_THAT(message(mixed), HasSubstr("nothing is inside the silhouettes"));
  for (const Picture& picture : set.pictures) write(picture.name + ".png", std::string("none"));
  EXPECT_THAT(message(set), HasSubstr("0000.png"));
}

TEST_F(PictureScenes, DamagedPicturesAreLeftOut) {
  PictureSet set = draw(12, ".png");
  write("0003.png", std::string("no picture"));
  std::vector<std::string> notes;
  const auto scene = make_picture_scene(
      set, {.voxels = 32, .on_note = [&](const std::string& note) { notes.push_back(note); }});
  ASSERT_TRUE(scene) << scene.error().message;
  EXPECT_EQ(Json::parse((*scene)->provenance())["pictures"], 11);
  EXPECT_THAT(notes, ::testing::Contains(
                         AllOf(HasSubstr("1 of 12 pictures are left out"), HasSubstr("0003.png"))));
}

// A mask is where it is not 0, whatever the number; of a palette, the index counts.
TEST_F(PictureScenes, MasksAreWhereTheyAreNotZero) {
  PictureSet set = draw(24, ".png");
  const auto palette_png = [](const Image& image) {  // index 0 is white, 1 black
    png_image png{};
    png.version = PNG_IMAGE_VERSION;
    png.width = image.width, png.height = image.height;
    png.format = PNG_FORMAT_RGB_COLORMAP;
    png.colormap_entries = 2;
    const std::array<std::uint8_t, 6> map{255, 255, 255, 0, 0, 0};
    std::vector<std::uint8_t> indices;
    for (const glm::vec4& p : image.rgba) indices.push_back(p.a > 0.5f);
    std::string bytes(1 << 16, '\0');
    png_alloc_size_t size = bytes.size();
    EXPECT_TRUE(
        png_image_write_to_memory(&png, bytes.data(), &size, 0, indices.data(), 0, map.data()));
    return bytes.substr(0, size);
  };
  const auto grey_png = [](const Image& image) {
    Image grey{image.width, image.height, {}, {}};
    for (const glm::vec4& p : image.rgba)
      grey.rgba.emplace_back(glm::vec3(p.a > 0.5f ? 1.0f / 255 : 0), 1);
    return grey;
  };
  for (const bool palette : {false, true}) {
    SCOPED_TRACE(palette);
    for (Picture& picture : set.pictures) {
      const Image image = view(picture);
      picture.mask = path("mask.png" + picture.name);
      if (palette)
        write("mask.png" + picture.name, palette_png(image));
      else {
        picture.mask = path("mask" + picture.name + ".png");
        ASSERT_TRUE(write_image(picture.mask, grey_png(image)));
      }
      Image opaque = image;
      for (glm::vec4& p : opaque.rgba) p = {glm::vec3(p) + (1 - p.a) * glm::vec3(0.2f), 1};
      ASSERT_TRUE(write_image(picture.file, opaque));
    }
    const auto scene = make_picture_scene(set, {.depth = DepthKind::none, .voxels = 96});
    ASSERT_TRUE(scene) << scene.error().message;
    EXPECT_GT(quality(**scene), 20);
  }
}

// Wide pictures see beside the object what no other picture sees: that is no object.
TEST_F(PictureScenes, TheSphereFitsWhatEnoughPicturesSee) {
  PictureSet set = draw(24, ".png");
  const double radius = balls_->bounds().radius;
  for (Picture& picture : set.pictures) {
    // From a ring of cameras, as most people take pictures, three times as wide as high.
    picture.eye.z = balls_->bounds().center.z + 0.3 * (picture.eye.z - balls_->bounds().center.z);
    const glm::dvec3 way = glm::normalize(balls_->bounds().center - picture.eye);
    const glm::dvec3 right = glm::normalize(glm::cross(way, {0, 0, 1}));
    picture.axes = glm::dmat3(right, glm::cross(way, right), way);
    picture.eye = balls_->bounds().center - 3 * radius * way;
    picture.lens.width *= 3;
    picture.lens.cx = picture.lens.width / 2.0;
    picture.lens.finish();
    ASSERT_TRUE(write_image(picture.file, view(picture), {.transparent = true}));
  }
  const auto scene = make_picture_scene(set, {.depth = DepthKind::none, .voxels = 64});
  ASSERT_TRUE(scene) << scene.error().message;
  EXPECT_LT((*scene)->bounds().radius, 1.25 * radius);
}

TEST_F(PictureScenes, EveryNthPictureIsHeldOut) {
  const auto scene = make_picture_scene(draw(20, ".png"), {.holdout = 4, .voxels = 32});
  ASSERT_TRUE(scene) << scene.error().message;
  const Json provenance = Json::parse((*scene)->provenance());
  EXPECT_EQ(provenance["pictures"], 15);
  EXPECT_EQ(provenance["holdout"], 4);
}

TEST_F(PictureScenes, PathsNeedNotBeUtf8) {
  PictureSet set = draw(12, ".png");
  set.source = path("no\xff.json");
  for (Picture& picture : set.pictures) {
    const std::string file = path("no\xff" + picture.name + ".png");
    std::filesystem::rename(picture.file, file);
    picture.file = file;
  }
  const auto scene = make_picture_scene(set, {.depth = DepthKind::none, .voxels = 32});
  ASSERT_TRUE(scene) << scene.error().message;
  EXPECT_THAT(std::string(Json::parse((*scene)->provenance())["source"]),
              HasSubstr("no\xef\xbf\xbd.json"));
  EXPECT_THAT(transforms_json(set.pictures, ""), HasSubstr("no\xef\xbf\xbd"));
}

// As Blender writes it: colours in 8 bits, and depth alone, in the colours of an OpenEXR beside it.
TEST_F(PictureScenes, DepthMayBeTheColourOfAnotherPicture) {
  PictureSet set = draw(40, ".exr");
  for (Picture& picture : set.pictures) {
    const Image image = read_image(picture.file).value();
    Image depth{image.width, image.height, {}, {}};
    for (const float z : image.depth)
      depth.rgba.emplace_back(glm::vec3(std::isfinite(z) ? z : 1e10f), 1);
    ASSERT_TRUE(write_image(picture.file, depth));
    picture.depth = picture.file;
    picture.file = path(picture.name + ".png");
    ASSERT_TRUE(write_image(picture.file, image, {.transparent = true}));
  }
  write("transforms.json", transforms_json(set.pictures, path("")));
  const auto read = read_pictures(path("."));
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->pictures[5].depth, set.pictures[5].depth);
  const auto scene = make_picture_scene(*read, {.voxels = 96});
  ASSERT_TRUE(scene) << scene.error().message;
  EXPECT_EQ(Json::parse((*scene)->provenance())["depth"], "ray");
  EXPECT_GT(quality(**scene), 24);
}

/// Writes a TIFF of one strip.
template <class T>
void write_tiff(const std::string& path, std::uint32_t width, std::uint32_t height, int samples,
                const std::vector<T>& values) {
  TIFF* tiff = TIFFOpen(path.c_str(), "w");
  TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, width);
  TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, height);
  TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, static_cast<int>(8 * sizeof(T)));
  TIFFSetField(tiff, TIFFTAG_SAMPLEFORMAT,
               std::is_floating_point_v<T> ? SAMPLEFORMAT_IEEEFP : SAMPLEFORMAT_UINT);
  TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, samples);
  TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, samples >= 3 ? PHOTOMETRIC_RGB : PHOTOMETRIC_MINISBLACK);
  TIFFSetField(tiff, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG);
  const std::uint16_t premultiplied = EXTRASAMPLE_ASSOCALPHA;
  if (samples == 4) TIFFSetField(tiff, TIFFTAG_EXTRASAMPLES, 1, &premultiplied);
  TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP, height);
  TIFFWriteEncodedStrip(tiff, 0, const_cast<T*>(values.data()),
                        static_cast<tmsize_t>(values.size() * sizeof(T)));
  TIFFClose(tiff);
}

TEST_F(PictureScenes, TiffHoldsColoursAndDepths) {
  for (const bool real : {false, true}) {
    PictureSet set = draw(40, ".exr");
    for (Picture& picture : set.pictures) {
      const Image image = read_image(picture.file).value();
      std::vector<std::uint16_t> colors, depths;
      std::vector<float> real_depths;
      for (std::size_t p = 0; p < image.pixels(); ++p) {
        for (int c = 0; c < 4; ++c)
          colors.push_back(static_cast<std::uint16_t>(std::lround(65535 * image.rgba[p][c])));
        const float depth = std::isfinite(image.depth[p]) ? image.depth[p] : 0;
        depths.push_back(static_cast<std::uint16_t>(std::lround(1000 * depth)));
        real_depths.push_back(1000 * depth);
      }
      std::filesystem::remove(picture.file);
      picture.file = path(picture.name + ".tif");
      picture.depth = path(picture.name + "_depth.tiff");
      write_tiff(picture.file, image.width, image.height, 4, colors);
      if (real)
        write_tiff(picture.depth, image.width, image.height, 1, real_depths);
      else
        write_tiff(picture.depth, image.width, image.height, 1, depths);
    }
    // Extensions may be left out.
    std::string json = transforms_json(set.pictures, path(""));
    for (std::size_t at; (at = json.find(".tif\"")) != std::string::npos;) json.erase(at, 4);
    write("transforms.json", json);
    const auto read = read_pictures(path("transforms.json"));
    ASSERT_TRUE(read) << read.error().message;
    EXPECT_EQ(read->pictures[3].file, set.pictures[3].file);
    const auto scene = make_picture_scene(*read, {.depth_scale = 0.001, .voxels = 96});
    ASSERT_TRUE(scene) << scene.error().message;
    EXPECT_EQ(Json::parse((*scene)->provenance())["depth"], "ray");
    EXPECT_GT(quality(**scene), 24);
  }
}

TEST_F(PictureScenes, MakeFieldsThatCanBeComparedWithPictures) {
  const PictureSet set = draw(40, ".exr");
  const auto scene = make_picture_scene(set, {.holdout = 8, .voxels = 64});
  ASSERT_TRUE(scene) << scene.error().message;
  BuildOptions options;
  options.shape.sphere = (*scene)->bounds();
  options.shape.entry_side = 4;
  options.shape.exit_side = 16;
  options.shape.finest_level = 1;
  ASSERT_TRUE(build_field(**scene, path("f.slf"), options));
  const auto field = Field::open(path("f.slf"));
  ASSERT_TRUE(field);
  const auto qualities =
      evaluate_pictures(*field, {set.pictures[0], set.pictures[8]}, {default_mode(*field)}, {});
  ASSERT_TRUE(qualities) << qualities.error().message;
  ASSERT_EQ(qualities->size(), 2u);
  EXPECT_GT((*qualities)[1].whole.psnr, 14);
  // Outside of the sphere, both are black.
  EXPECT_LE((*qualities)[1].inside.psnr, (*qualities)[1].whole.psnr + 1e-9);
  EXPECT_LE((*qualities)[1].inside.ssim, (*qualities)[1].whole.ssim + 1e-9);
}

}  // namespace
}  // namespace slf
