// Reveals of volumes, and views of fields through planes.
#include "slf/cut.h"

#include <gtest/gtest.h>

#include <functional>

#include "slf/build.h"
#include "slf/field.h"
#include "slf/raycaster.h"
#include "slf/render.h"
#include "tests/temporary_folder.h"

namespace slf {
namespace {

using Value = std::function<int(const glm::ivec3&)>;
constexpr int kSide = 32;

/// Voxels around (100, 0, 0), two to a world unit along x.
Volume volume_with(const Value& value, bool labels = false) {
  Volume volume;
  volume.dims = {kSide, kSide, kSide};
  volume.type = ScalarType::u16;
  volume.labels = labels;
  volume.source = "test";
  volume.origin = {100 - kSide / 4.0, -kSide / 2.0, -kSide / 2.0};
  volume.axes = {{0.5, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  for (int z = 0; z < kSide; ++z)
    for (int y = 0; y < kSide; ++y)
      for (int x = 0; x < kSide; ++x) {
        const int v = value({x, y, z});
        volume.voxels.push_back(static_cast<std::byte>(v & 255));
        volume.voxels.push_back(static_cast<std::byte>(v >> 8));
      }
  return volume;
}

double distance(const glm::ivec3& at) {
  return glm::length(glm::dvec3(at) - glm::dvec3(kSide / 2)) / (kSide / 2);
}
/// A ball with a core, a shell of air in it, and noise outside.
int ball(const glm::ivec3& at) {
  const double r = distance(at);
  return r < 0.4 ? 200 : r < 0.55 ? 20 : r < 0.8 ? 150 : (at.x * 7 + at.y * 3 + at.z) % 30;
}

TransferFunction transfer_above(double low, double opacity = 1) {
  TransferFunction t;
  t.colors = {{0, {0.2, 0.4, 1.0}}, {255, {1.0, 0.6, 0.2}}};
  t.opacities = {{low, 0, 0.5, 0}, {low + 20, opacity, 0.5, 0}};
  t.unit_distance = 0.5;
  return t;
}

int labels(const glm::ivec3& at) {
  return distance(at) > 0.8 ? 0 : at.x < 12 ? 7 : at.x < 20 ? 300 : 65000;
}
TransferFunction label_colors() {
  TransferFunction t;
  t.space = TransferFunction::Space::step;
  t.colors = {{0, {0, 0, 0}}, {7, {1, 0, 0}}, {300, {0, 1, 0}}, {65000, {0, 0, 1}}};
  t.opacities = {{0, 0, 0.5, 1}, {1, 1, 0.5, 1}};
  t.unit_distance = 0.5;
  return t;
}

std::unique_ptr<Raycaster> caster(Volume volume, const TransferFunction& transfer,
                                  const RaycastOptions& options = {}) {
  auto made = Raycaster::make(std::move(volume), transfer, options, {.deferred = true});
  EXPECT_TRUE(made) << (made ? "" : made.error().message);
  return made ? std::move(*made) : nullptr;
}

Reveal reveal_of(std::initializer_list<const Scene*> scenes, const RevealOptions& options = {}) {
  const auto reveal = make_reveal(std::vector<const Scene*>(scenes), options);
  EXPECT_TRUE(reveal) << (reveal ? "" : reveal.error().message);
  return reveal.value_or(Reveal());
}

/// The value of the reveal's voxel that lies where the volume's does; none: it lies outside.
std::optional<double> value_at(const Reveal& reveal, const Volume& volume, const glm::ivec3& at) {
  const glm::dvec3 world = volume.origin + volume.axes * glm::dvec3(at);
  const glm::dvec3 place = glm::inverse(reveal.axes) * (world - reveal.origin);
  std::size_t number = 0;
  for (int axis = 2; axis >= 0; --axis) {
    const double nearest = std::round(place[axis]);
    EXPECT_NEAR(place[axis], nearest, 1e-9);
    const auto side = reveal.dims[static_cast<std::size_t>(axis)];
    if (nearest < 0 || nearest >= side) return std::nullopt;
    number = number * side + static_cast<std::size_t>(nearest);
  }
  const auto byte = std::to_integer<std::size_t>(reveal.voxels[number]);
  if (!reveal.ids.empty()) return reveal.ids[byte];
  return reveal.low + (reveal.high - reveal.low) * static_cast<double>(byte) / 255;
}

TEST(Reveal, HasTheVolumesVoxelsAndNothingHidden) {
  const Volume volume = volume_with(ball);
  const auto scene = caster(volume, transfer_above(100));
  const Reveal reveal = reveal_of({scene.get()});
  EXPECT_EQ(reveal.content, content_of(scene->provenance()));
  EXPECT_EQ(reveal.unit, 0.5);
  int hidden = 0;
  for (int z = 0; z < kSide; ++z)
    for (int y = 0; y < kSide; ++y)
      for (int x = 0; x < kSide; ++x) {
        const auto value = value_at(reveal, volume, {x, y, z});
        if (const int own = ball({x, y, z}); own > 100) {
          ASSERT_TRUE(value);
          EXPECT_NEAR(*value, own, 0.51 * (reveal.high - reveal.low) / 255);
        } else if (value && distance({x, y, z}) > 0.95) {
          EXPECT_EQ(*value, reveal.low);  // it touches nothing visible
          ++hidden;
        }
      }
  EXPECT_GT(hidden, 100);
}

TEST(Reveal, AWindowKeepsAllOfIt) {
  const Volume volume = volume_with(ball);
  const auto scene = caster(volume, transfer_above(100));
  const Reveal reveal = reveal_of({scene.get()}, {.window = {{0, 100}}});
  EXPECT_NEAR(*value_at(reveal, volume, {16, 16, 24}), 20, 0.2);  // air inside
  EXPECT_EQ(*value_at(reveal, volume, {16, 16, 16}), 100);
  EXPECT_EQ(*value_at(reveal, volume, {4, 5, 5}), std::round(ball({4, 5, 5}) * 2.55) / 2.55);
}

TEST(Reveal, CoversWhatAnyStateShows) {
  const Volume volume = volume_with(ball);
  const auto half = caster(volume, transfer_above(100), {.clip = {{{100, 0, 0}, {1, 0, 0}}}});
  const auto core = caster(volume, transfer_above(170));
  const auto whole = caster(volume, transfer_above(100));
  const auto other =
      caster(volume_with([](const auto& at) { return ball(at) + 1; }), transfer_above(0));
  EXPECT_LT(reveal_of({half.get()}).dims[0], reveal_of({whole.get()}).dims[0]);
  const Reveal both = reveal_of({half.get(), whole.get(), other.get()});
  EXPECT_EQ(both.voxels, reveal_of({whole.get()}).voxels);
  EXPECT_LT(reveal_of({core.get()}).voxels.size(), both.voxels.size());
}

TEST(Reveal, HasNothingBeyondThePlanesOfTheField) {
  const Volume volume = volume_with(ball);
  const RaycastOptions cut{.clip = {{{100, 0, 0}, {1, 1, 1}}}};
  const auto scene = caster(volume, transfer_above(100), cut);
  for (const auto& window : {std::optional<std::array<double, 2>>(), {{10, 255}}}) {
    const Reveal reveal = reveal_of({scene.get()}, {.window = window});
    EXPECT_GT(*value_at(reveal, volume, {14, 14, 14}), 190);
    EXPECT_EQ(value_at(reveal, volume, {20, 20, 20}).value_or(reveal.low), reveal.low);
  }
  const auto colored = caster(volume_with(labels, true), label_colors(), cut);
  const Reveal ids = reveal_of({colored.get()});
  EXPECT_EQ(value_at(ids, volume, {20, 20, 20}).value_or(0), 0);
  EXPECT_EQ(value_at(ids, volume, {14, 14, 14}), 300);
}

TEST(Reveal, IsNoLargerThanAskedFor) {
  const auto scene = caster(volume_with(ball), transfer_above(100));
  for (const std::uint32_t side : {16u, 20u, 24u, 512u}) {
    const Reveal reveal = reveal_of({scene.get()}, {.side = side});
    EXPECT_LE(*std::ranges::max_element(reveal.dims), std::min<std::uint32_t>(side, kSide));
  }
  EXPECT_FALSE(make_reveal(std::vector<const Scene*>{scene.get()}, {.side = 15}));
  const auto analytic = *make_analytic_scene("balls");
  const auto refused = make_reveal(std::vector<const Scene*>{analytic.get()});
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::usage);
}

TEST(Reveal, LabelsStayIds) {
  const Volume volume = volume_with(labels, true);
  const auto scene = caster(volume, label_colors());
  const Reveal reveal = reveal_of({scene.get()});
  EXPECT_EQ(std::set<double>(reveal.ids.begin(), reveal.ids.end()),
            (std::set<double>{0, 7, 300, 65000}));
  for (int x = 0; x < kSide; ++x)
    if (const auto id = value_at(reveal, volume, {x, 16, 16})) {
      EXPECT_EQ(*id, labels({x, 16, 16}));
    }
  RaycastOptions only;
  only.parts.only = {7, 300};
  const auto some = caster(volume, label_colors(), only);
  const Reveal fewer = reveal_of({some.get()});
  EXPECT_EQ(std::ranges::count(fewer.ids, 65000), 0);  // it is not published
  const auto many =
      caster(volume_with([](const auto& at) { return at.x + 32 * at.y; }, true), label_colors());
  const auto refused = make_reveal(std::vector<const Scene*>{many.get()});
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::unsupported);
}

TEST(Reveal, KeepsStructuresAndLeavesOutWhatAMaskHides) {
  const Volume volume = volume_with(ball);
  RaycastOptions options;
  options.parts.labels = std::make_shared<Volume>(
      volume_with([](const auto& at) { return at.z < 10   ? 0
                                              : at.z < 16 ? 4
                                                          : 9; }, true));
  options.parts.mask =
      std::make_shared<Volume>(volume_with([](const auto& at) { return at.y < 20 ? 1 : 0; }, true));
  const auto scene = caster(volume, transfer_above(100), options);
  const Reveal reveal = reveal_of({scene.get()});
  EXPECT_EQ(reveal.part_ids.size(), 2u);
  EXPECT_TRUE(reveal.masked);
  ASSERT_EQ(reveal.parts.size(), reveal.voxels.size());
  EXPECT_EQ(value_at(reveal, volume, {16, 22, 16}).value_or(reveal.low), reveal.low);
  EXPECT_GT(*value_at(reveal, volume, {16, 16, 16}), 190);
  // Its scene has the same structures.
  const auto cap = make_cap(reveal, scene->provenance(), {});
  ASSERT_TRUE(cap) << cap.error().message;
  const Camera camera = orbit_camera(scene->bounds(), 70, 30, 3, 64, 64);
  EXPECT_GT(compare(*trace_view(*scene, scene->bounds(), camera),
                    *trace_view(**cap, scene->bounds(), camera))
                .psnr,
            35);
}

/// A small field of the ball, and its reveal.
class CutViews : public ::testing::Test {
 protected:
  void make(const TransferFunction& transfer, const RaycastOptions& options = {}) {
    scene_ = caster(volume_with(ball), transfer, options);
    BuildOptions build;
    build.shape.entry_side = 8, build.shape.exit_side = 16, build.shape.finest_level = 1;
    build.codec = "zstd:1";
    ASSERT_TRUE(build_field(*scene_, folder_ / "a.slf", build));
    field_.emplace(*Field::open(folder_ / "a.slf"));
    transfer_ = transfer, options_ = options;
    reveal_ = reveal_of({scene_.get()});
  }
  [[nodiscard]] Image drawn(const Camera& camera, const std::vector<ClipPlane>& clip,
                            bool capped = true, bool depth = false) const {
    ViewOptions view{RenderMode::depth, 1, depth};
    view.clip = clip;
    if (capped && !clip.empty()) {
      auto cap = make_cap(reveal_, field_->provenance(), clip);
      EXPECT_TRUE(cap) << (cap ? "" : cap.error().message);
      if (cap) view.cap = *cap;
    }
    Renderer renderer(*field_);
    ViewStatistics statistics;
    auto image = renderer.render(camera, view, &statistics);
    EXPECT_TRUE(image) << (image ? "" : image.error().message);
    EXPECT_EQ(statistics.fallback_pixels(), 0u);
    return std::move(*image);
  }
  [[nodiscard]] Image truth(const Camera& camera, const std::vector<ClipPlane>& clip) const {
    RaycastOptions options = options_;
    options.clip = clip;
    const auto cut = caster(volume_with(ball), transfer_, options);
    return *trace_view(*cut, field_->shape().sphere, camera);
  }
  /// How near the picture comes to the truth, in dB; and how near without planes. In the cut volume
  /// surfaces within a voxel of a plane have its normal, in the field they do not; and voxels are
  /// large here.
  void expect_near_truth(const Camera& camera, const std::vector<ClipPlane>& clip,
                         double worse = 4) const {
    const double whole = compare(truth(camera, {}), drawn(camera, {})).psnr;
    const double cut = compare(truth(camera, clip), drawn(camera, clip)).psnr;
    EXPECT_GT(cut, whole - worse) << whole;
  }
  [[nodiscard]] Camera camera(double azimuth, double elevation, double distance = 3) const {
    return orbit_camera(field_->shape().sphere, azimuth, elevation, distance, 96, 96);
  }

  testing::TemporaryFolder folder_;
  std::unique_ptr<Raycaster> scene_;
  std::optional<Field> field_;
  Reveal reveal_;
  TransferFunction transfer_;
  RaycastOptions options_;
};

const ClipPlane kMiddle{{100, 0, 0}, {1, 0, 0}}, kSlanted{{101, 1, 0}, {1, 2, -1}},
    kAbove{{100, 0, 3}, {0, 0, 5}};

RaycastOptions global() {
  RaycastOptions options;
  options.lighting.mode = Lighting::global;
  return options;
}

TEST_F(CutViews, LookLikeTheCutVolume) {
  make(transfer_above(100));
  for (const double azimuth : {0.0, 80.0, 150.0, 260.0}) {
    expect_near_truth(camera(azimuth, 20), {kMiddle});
    expect_near_truth(camera(azimuth, -30), {kSlanted});
    expect_near_truth(camera(azimuth, 20), {kMiddle, kAbove});
    expect_near_truth(camera(azimuth, 50), {kMiddle, kAbove, kSlanted});
  }
}

TEST_F(CutViews, AlsoOfTranslucentMatter) {
  make(transfer_above(100, 0.1));
  for (const double azimuth : {0.0, 80.0, 150.0, 260.0})
    expect_near_truth(camera(azimuth, 20), {kMiddle}, 5);
}

TEST_F(CutViews, TranslucentMatterHasTheLightThatAPlaneLetsIn) {
  make(transfer_above(100, 0.1), global());
  for (const double azimuth : {0.0, 80.0, 180.0})
    expect_near_truth(camera(azimuth, 20), {kMiddle}, 0);
}

TEST_F(CutViews, FacesHaveTheirOwnLight) {
  make(transfer_above(100), global());
  expect_near_truth(camera(80, 20), {kMiddle}, 1);
  expect_near_truth(camera(50, 60), {kAbove}, 1);
}

TEST_F(CutViews, PlanesThatMissChangeNothing) {
  make(transfer_above(100));
  const Camera from = camera(40, 20);
  const ClipPlane above{{100, 0, 60}, {0, 0, 1}};
  EXPECT_TRUE(drawn(from, {above}).rgba == drawn(from, {}).rgba);
  EXPECT_TRUE(drawn(from, {above}, false).rgba == drawn(from, {}).rgba);
}

TEST_F(CutViews, PlanesThatLeaveNothingShowNothing) {
  make(transfer_above(100));
  const std::vector<ClipPlane> all{{{100, 0, -60}, {0, 0, 1}}};
  const Image hollow = drawn(camera(40, 20), all, false);
  EXPECT_TRUE(std::ranges::all_of(hollow.rgba, [](const auto& p) { return p == glm::vec4(0); }));
  const auto cap = make_cap(reveal_, field_->provenance(), all);
  ASSERT_FALSE(cap);
  EXPECT_EQ(cap.error().code, ErrorCode::failed);
}

TEST_F(CutViews, AHollowCutIsOpen) {
  make(transfer_above(100));
  const Camera from = camera(90, 0);  // +x is removed
  const Image solid = drawn(from, {kMiddle}), hollow = drawn(from, {kMiddle}, false);
  const auto middle = std::size_t{96} * 48 + 48;
  EXPECT_GT(solid.rgba[middle].a, 0.9f);
  EXPECT_LT(hollow.rgba[middle].a, 0.1f);
  // From the other side the surface is the same, but for the rim.
  const Image back = drawn(camera(270, 0), {kMiddle}, false), whole = drawn(camera(270, 0), {});
  EXPECT_GT(compare(whole, back).psnr, 30);
}

TEST_F(CutViews, DepthsAreThoseOfTheFace) {
  make(transfer_above(100));
  const Camera from = camera(90, 0);
  const Image picture = drawn(from, {kMiddle}, true, true);
  const double to_plane = std::abs(from.eye.x - 100);
  EXPECT_NEAR(picture.depth[std::size_t{96} * 48 + 48], to_plane, 0.3);
  EXPECT_TRUE(std::isinf(picture.depth[0]));
  Renderer renderer(*field_);
  ViewOptions cut;
  cut.clip = {kMiddle};
  cut.cap = *make_cap(reveal_, field_->provenance(), cut.clip);
  const auto found = pick(renderer, from, 48, 48, cut);
  ASSERT_TRUE(found && *found);
  EXPECT_NEAR((*found)->point.x, 100, 0.3);
}

TEST_F(CutViews, ThroughTheEyeAndFromInside) {
  make(transfer_above(100));
  Camera from = camera(60, 25);
  expect_near_truth(from, {{from.eye, glm::cross(from.eye - glm::dvec3(100, 0, 0), {0, 0, 1})}},
                    13);
  const Sphere sphere = field_->shape().sphere;
  for (const double at : {0.9, 0.6}) {  // inside the sphere, in what is removed
    from.eye = sphere.center + glm::dvec3(at * sphere.radius, 0, 0);
    from.look_at = sphere.center;
    from.fov = 60;
    const auto expected = truth(from, {kMiddle});
    EXPECT_GT(compare(expected, drawn(from, {kMiddle})).psnr, 30) << at;
  }
}

TEST_F(CutViews, ASliceShowsValues) {
  make(transfer_above(100));
  const std::vector<ClipPlane> clip{kMiddle};
  const auto cap =
      make_cap(reveal_, field_->provenance(), clip, {.cap = Cap::slice, .window = {{100, 300}}});
  ASSERT_TRUE(cap) << cap.error().message;
  const auto at = [&](double y) { return (*cap)->trace({200, y, 0}, {0, y, 0}); };
  EXPECT_EQ(at(0).rgba.a, 1);
  EXPECT_NEAR(at(0).rgba.g, 0.5f, 0.01f);    // the core: 200
  EXPECT_NEAR(at(11).rgba.g, 0.25f, 0.01f);  // the ball: 150
  EXPECT_NEAR(at(11).depth, 0.5f, 1e-4f);
  EXPECT_EQ(at(11).rgba.r, at(11).rgba.b);
  EXPECT_GT(at(7.5).depth, 0.5f);  // air: what lies behind it
}

TEST_F(CutViews, ChecksItsInput) {
  make(transfer_above(100));
  ViewOptions view{RenderMode::depth, 1};
  view.clip.assign(7, kMiddle);
  EXPECT_FALSE(check_view(*field_, view));
  view.clip.resize(6);
  EXPECT_TRUE(check_view(*field_, view));
  view.mode = RenderMode::bitri;
  EXPECT_FALSE(check_view(*field_, view));
  view.mode = RenderMode::depth;
  view.clip[3].normal = {0, 0, 0};
  EXPECT_FALSE(check_view(*field_, view));
  view.clip[3].normal = {0, std::numeric_limits<double>::quiet_NaN(), 0};
  EXPECT_FALSE(check_view(*field_, view));
  for (const char* text : {"", "{}", "[]", R"({"transfer": 3})"})
    EXPECT_FALSE(make_cap(reveal_, text, {{kMiddle}})) << text;
  const auto little = make_cap(reveal_, field_->provenance(), {{kMiddle}}, {.memory = 1000});
  ASSERT_FALSE(little);
  EXPECT_EQ(little.error().code, ErrorCode::usage);
}

}  // namespace
}  // namespace slf
