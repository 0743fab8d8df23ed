// Depths of pictures: the cache, the contact sheet and the background.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "base/bytes.h"
#include "base/file.h"
#include "source/pictures/depth_cache.h"
#include "tests/source/pictures/samples.h"

namespace slf {
namespace {

using ::testing::HasSubstr;

class DepthCache : public PictureScenes {
 protected:
  static constexpr std::uint32_t kVoxels = 48;
  PictureSceneOptions options() const {
    return {.voxels = kVoxels, .depth_cache = path("depths"), .threads = 2};
  }
  /// A view of the scene, and how many pictures its progress counted.
  std::pair<Image, std::uint64_t> made(const PictureSet& set, PictureSceneOptions options) {
    std::uint64_t steps = 0;
    options.threads = 1;
    options.progress = [&](const Progress&) { return ++steps, true; };
    options.on_note = [&](const std::string& text) { notes_.push_back(text); };
    const auto scene = make_picture_scene(set, options);
    EXPECT_TRUE(scene) << scene.error().message;
    return {scene ? view(**scene, set.pictures[3]) : Image{}, steps};
  }
  Bytes cached() const { return read_file(path("depths"), 1 << 26).value(); }

  std::vector<std::string> notes_;
};

TEST_F(DepthCache, SparesTheSearchAndChangesNothing) {
  const PictureSet set = draw(20, ".png");
  const auto [plain, all] = made(set, {.voxels = kVoxels});
  EXPECT_EQ(all, 40u);  // read, and swept
  const auto [first, also_all] = made(set, options());
  EXPECT_EQ(also_all, 40u);
  const auto [second, fewer] = made(set, options());
  EXPECT_EQ(fewer, 20u);
  EXPECT_EQ(first.rgba, plain.rgba);
  EXPECT_EQ(second.rgba, plain.rgba);
  EXPECT_EQ(second.depth, plain.depth);
  EXPECT_TRUE(notes_.empty());
}

TEST_F(DepthCache, OfOtherPicturesOrOptionsIsReplaced) {
  PictureSet set = draw(20, ".png");
  (void)made(set, options());
  PictureSceneOptions other = options();
  other.holdout = 8;
  EXPECT_EQ(made(set, other).second, 2 * 17u);
  EXPECT_EQ(made(set, other).second, 17u);
  Image changed = read_image(set.pictures[5].file).value();
  for (glm::vec4& p : changed.rgba) p *= 0.9f;
  ASSERT_TRUE(write_image(set.pictures[5].file, changed, {.transparent = true}));
  EXPECT_EQ(made(set, other).second, 2 * 17u);
  set.pictures[5].eye.x += 0.01;
  EXPECT_EQ(made(set, other).second, 2 * 17u);
}

TEST_F(DepthCache, OfSomethingElseIsNeverReplaced) {
  const PictureSet set = draw(12, ".png");
  write("depths", std::string("a letter"));
  const auto scene = make_picture_scene(set, options());
  ASSERT_FALSE(scene);
  EXPECT_EQ(scene.error().code, ErrorCode::usage);
  EXPECT_THAT(scene.error().message, HasSubstr("is not a cache of depths"));
  EXPECT_EQ(cached().size(), 8u);
}

TEST_F(DepthCache, ThatCannotBeWrittenIsANote) {
  const PictureSet set = draw(12, ".png");
  PictureSceneOptions nowhere = options();
  nowhere.depth_cache = path("none/depths");
  EXPECT_GT(made(set, nowhere).first.pixels(), 0u);
  ASSERT_EQ(notes_.size(), 1u);
  EXPECT_THAT(notes_[0], HasSubstr("not kept"));
}

TEST_F(DepthCache, DamageIsNoticed) {
  const PictureSet set = draw(12, ".png");
  const auto [plain, steps] = made(set, options());
  const Bytes whole = cached();
  std::vector<SmallView> views;
  const auto read = [&](const Bytes& bytes) {
    EXPECT_TRUE(write_file(path("damaged"), bytes));
    views.resize(12);
    for (SmallView& view : views) view.rgba.resize(5);
    const std::string key(chars_of(whole).substr(std::strlen(kDepthCacheMagic), 41));
    return read_depth_cache(path("damaged"), key, views);
  };
  EXPECT_FALSE(read(whole));  // views of other sizes
  std::mt19937 random(5);
  for (std::size_t length = 0; length < whole.size(); length += 1 + random() % 97)
    EXPECT_FALSE(read(Bytes(whole.begin(), whole.begin() + std::ptrdiff_t(length)))) << length;
  for (int round = 0; round < 300; ++round) {
    Bytes damaged = whole;
    damaged[random() % damaged.size()] ^= std::byte(1 << random() % 8);
    EXPECT_FALSE(read(damaged));
  }
  EXPECT_TRUE(views[0].depth.empty());
  // A build finds the depths again.
  Bytes damaged = whole;
  damaged[damaged.size() / 2] ^= std::byte{4};
  ASSERT_TRUE(write_file(path("depths"), damaged));
  EXPECT_EQ(made(set, options()).first.rgba, plain.rgba);
  EXPECT_EQ(cached(), whole);
}

TEST_F(DepthCache, IsBesideTheCameras) {
  PictureSet set;
  set.source = "photos/sparse/0/";
  EXPECT_EQ(depth_cache_of(set), "photos/sparse/0.slf-depths");
  set.source = "chair/transforms.json";
  EXPECT_EQ(depth_cache_of(set), "chair/transforms.json.slf-depths");
}

TEST_F(PictureScenes, DepthSheetsShowWhatIsKnown) {
  const auto stated = make_depth_sheet(draw(40, ".exr"), {.voxels = 48}, 5, 64);
  ASSERT_TRUE(stated) << stated.error().message;
  EXPECT_EQ(stated->source, "ray");
  EXPECT_EQ(stated->image.width, 3u * (4 * 66 + 6));
  EXPECT_EQ(stated->image.height, 2u * 66);
  EXPECT_GT(stated->known, 0.95);
  EXPECT_GT(stated->confirmed_by, 3);
  // The balls are shown in the first cell, with depth and the surface beside them.
  const auto lit = [&](const Image& image, std::uint32_t cell) {
    int count = 0;
    for (std::uint32_t y = 0; y < 64; ++y)
      for (std::uint32_t x = 0; x < 64; ++x) {
        const glm::vec4 p = image.rgba[y * image.width + cell * 66 + x];
        count += p.r + p.g + p.b > 0.1f;
      }
    return count;
  };
  for (const std::uint32_t cell : {1u, 2u, 3u})
    EXPECT_NEAR(lit(stated->image, cell), lit(stated->image, 0), 0.25 * lit(stated->image, 0));

  const auto estimated = make_depth_sheet(draw(40, ".png"), {.voxels = 48}, 2, 32);
  ASSERT_TRUE(estimated) << estimated.error().message;
  EXPECT_EQ(estimated->source, "estimated");
  EXPECT_LT(estimated->known, stated->known);
  EXPECT_GE(estimated->confirmed_by, 2);

  const auto hull =
      make_depth_sheet(draw(40, ".png"), {.depth = DepthKind::none, .voxels = 48}, 1, 64);
  ASSERT_TRUE(hull) << hull.error().message;
  EXPECT_EQ(hull->source, "silhouettes");
  EXPECT_EQ(lit(hull->image, 1), 0);
  EXPECT_GT(lit(hull->image, 3), 0);
}

/// The balls in front of a wall of colours that is far away.
class Background : public PictureScenes {
 protected:
  static glm::vec4 wall(const glm::dvec3& way) {
    const glm::dvec3 d = glm::normalize(way);
    return {0.5 + 0.4 * d.x, 0.5 + 0.4 * d.y, 0.5 + 0.4 * d.z, 1};
  }
  static void add_wall(const Picture& picture, Image& image) {
    for (std::uint32_t y = 0; y < image.height; ++y)
      for (std::uint32_t x = 0; x < image.width; ++x) {
        glm::vec4& p = image.rgba[y * image.width + x];
        p += (1 - p.a) * wall(picture.axes * picture.lens.direction({x + 0.5, y + 0.5}));
      }
  }
};

TEST_F(Background, IsKeptWhereItIsAskedFor) {
  PictureSet set = draw(60, ".exr");
  for (const Picture& picture : set.pictures) {
    Image image = read_image(picture.file).value();
    add_wall(picture, image);
    ASSERT_TRUE(write_image(picture.file, image));
  }
  PictureSceneOptions options{.sphere = balls_->bounds(), .voxels = 96};
  const auto dropped = make_picture_scene(set, options);
  options.keep_background = true;
  const auto kept = make_picture_scene(set, options);
  ASSERT_TRUE(dropped && kept);
  EXPECT_EQ(Json::parse((*dropped)->provenance())["background"], "drop");
  EXPECT_EQ(Json::parse((*kept)->provenance())["background"], "keep");
  const auto picture = spread_cameras(balls_->bounds(), 3.3, 7, 96, 96)[2];
  Image truth = view(picture);
  std::vector<bool> inside;  // the sphere, but not the object
  for (std::uint32_t y = 0; y < 96; ++y)
    for (std::uint32_t x = 0; x < 96; ++x) {
      const auto way = picture.axes * picture.lens.direction({x + 0.5, y + 0.5});
      inside.push_back(truth.rgba[y * 96 + x].a == 0 &&
                       intersect(balls_->bounds(), picture.eye, way).hit);
    }
  add_wall(picture, truth);
  const Image with = view(**kept, picture), without = view(**dropped, picture);
  double difference = 0;
  int count = 0, painted = 0;
  for (std::size_t p = 0; p < inside.size(); ++p) {
    if (!inside[p]) continue;
    ++count;
    painted += with.rgba[p].a > 0.9f;
    difference += glm::distance(glm::vec3(with.rgba[p]), glm::vec3(truth.rgba[p]));
    EXPECT_LE(without.rgba[p].a, with.rgba[p].a + 1e-5f);
  }
  EXPECT_GT(count, 1000);
  EXPECT_GT(painted, 0.97 * count);
  // The wall is not on the sphere, so there is some parallax.
  EXPECT_LT(difference / count, 0.1);
}

TEST_F(Background, ThatMasksHideCannotBeKept) {
  const auto scene = make_picture_scene(draw(12, ".png"), {.keep_background = true, .voxels = 32});
  ASSERT_FALSE(scene);
  EXPECT_EQ(scene.error().code, ErrorCode::usage);
  EXPECT_THAT(scene.error().message, HasSubstr("background cannot be kept"));
}

}  // namespace
}  // namespace slf
