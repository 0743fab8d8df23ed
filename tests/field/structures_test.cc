// Label tables, structures and masks.
#include "slf/structures.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "slf/raycaster.h"

namespace slf {
namespace {

constexpr const char* kSnap = R"(# ITK-SnAP Label Description File
    0     0    0    0        0  0  0    "Clear Label"
    1   255    0    0        1  1  1    "Left lung"
    2     0  255    0      0.5  1  1    "Right lung"
    3     0    0  255        1  0  1    "Hidden"
)";
constexpr const char* kSlicer = R"(# Color table
0 background 0 0 0 0
1 liver 255 0 0 255
2 spleen 0 255 0 51
)";
constexpr const char* kJson =
    R"({"labels": [{"id": 1, "name": "a", "color": [1, 0, 0]}, {"id": 2, "opacity": 0.5}]})";

TEST(LabelTable, ReadsEveryFormat) {
  const auto snap = parse_label_table(kSnap, "a.label");
  ASSERT_TRUE(snap) << snap.error().message;
  EXPECT_EQ(snap->size(), 4u);
  EXPECT_EQ(snap->at(1), (LabelStyle{"Left lung", glm::dvec3(1, 0, 0), 1}));
  EXPECT_EQ(snap->at(2).opacity, 0.5);
  EXPECT_EQ(snap->at(3).opacity, 0);
  const auto slicer = parse_label_table(kSlicer, "a.ctbl");
  ASSERT_TRUE(slicer) << slicer.error().message;
  EXPECT_EQ(slicer->at(2), (LabelStyle{"spleen", glm::dvec3(0, 1, 0), 0.2}));
  const auto json = parse_label_table(kJson, "a.json");
  ASSERT_TRUE(json) << json.error().message;
  EXPECT_EQ(json->at(1).color, glm::dvec3(1, 0, 0));
  EXPECT_FALSE(json->at(2).color);
}

TEST(LabelTable, MistakesAreNamed) {
  for (const auto& [text, place] : std::vector<std::pair<std::string, std::string>>{
           {"", "without labels"},
           {"1 liver 255 0 0\n", "line 1"},
           {"# x\n1 liver 256 0 0 255\n", "line 2"},
           {"1 liver 255 0 0 255\n1 spleen 0 0 0 255\n", "line 2: the id 1"},
           {"1 255 0 0 2 1 1 \"x\"\n", "line 1"},
           {"1.5 liver 255 0 0 255\n", "line 1"},
           {"{", "labels"},
           {R"({"labels": [{"id": 1, "color": [2, 0, 0]}]})", "labels[0].color"},
           {R"({"labels": [{"id": "x"}]})", "labels[0].id"},
           {R"({"labels": [{"id": 1, "opacity": -1}]})", "labels[0].opacity"},
           {R"({"labels": [{"id": 1}, {"id": 1}]})", "labels[1].id"}}) {
    const auto table = parse_label_table(text, "a.label");
    ASSERT_FALSE(table) << text;
    EXPECT_EQ(table.error().code, ErrorCode::bad_file);
    EXPECT_NE(table.error().message.find(place), std::string::npos) << table.error().message;
  }
}

Volume cube(std::uint32_t side, int value) {
  Volume v;
  v.dims = {side, side, side};
  v.voxels.assign(std::size_t{side} * side * side, static_cast<std::byte>(value));
  v.source = "cube";
  return v;
}

/// The voxels with x below `middle` are 1, the others 2.
std::shared_ptr<Volume> halves(std::uint32_t side, std::uint32_t middle) {
  auto v = std::make_shared<Volume>(cube(side, 2));
  v->labels = true;
  for (std::size_t k = 0; k < v->voxels.size(); ++k)
    if (k % side < middle) v->voxels[k] = std::byte{1};
  return v;
}

TransferFunction gray() {
  TransferFunction t;
  t.colors = {{0, {0.5, 0.5, 0.5}}};
  t.opacities = {{0, 0.5, 0.5, 0}};
  return t;
}

RaySample along_z(const RaycastOptions& options, double x) {
  const auto made = Raycaster::make(cube(20, 100), gray(), options);
  EXPECT_TRUE(made) << (made ? "" : made.error().message);
  return (*made)->trace({x, 9, -20}, {x, 9, 40});
}

TEST(Structures, StandInTheirOwnColours) {
  RaycastOptions options;
  options.shade = false;
  options.structures.labels = halves(20, 10);
  options.structures.styles = {{1, {"red", glm::dvec3(1, 0, 0), 1}},
                               {2, {"faint", glm::dvec3(0, 1, 0), 0.1}}};
  const RaySample red = along_z(options, 4), faint = along_z(options, 14);
  EXPECT_NEAR(red.rgba.r, 1, 0.01);
  EXPECT_EQ(red.rgba.g, 0);
  EXPECT_EQ(faint.rgba.r, 0);
  // 19 world units of opacity 0.05 each.
  EXPECT_NEAR(faint.rgba.a, 1 - std::pow(1 - 0.05, 19), 0.02);
  EXPECT_NEAR(faint.rgba.g, faint.rgba.a, 1e-4);
}

TEST(Structures, HoldUnderAllLight) {
  RaycastOptions options;
  options.lighting.mode = Lighting::global;
  options.lighting.samples = 4;
  options.structures.labels = halves(20, 10);
  options.structures.styles = {{1, {"red", glm::dvec3(1, 0, 0), 1}},
                               {2, {"hidden", glm::dvec3(0, 1, 0), 0}}};
  EXPECT_GT(along_z(options, 4).rgba.r, 0.2);
  EXPECT_EQ(along_z(options, 14).rgba.a, 0);
}

TEST(Structures, AMaskHidesWhatIsOutside) {
  RaycastOptions options;
  options.structures.mask = halves(20, 10);
  auto mask = std::make_shared<Volume>(*halves(20, 10));
  for (std::byte& voxel : mask->voxels) voxel = std::byte{voxel == std::byte{1}};
  options.structures.mask = mask;
  EXPECT_GT(along_z(options, 4).rgba.a, 0.9);
  EXPECT_EQ(along_z(options, 14).rgba.a, 0);
  const auto made = Raycaster::make(cube(20, 100), gray(), options);
  ASSERT_TRUE(made);
  EXPECT_LT((*made)->bounds().center.x, 7);  // and the bounds are those of what is left
}

TEST(Structures, WithoutAnyStyleNothingChanges) {
  RaycastOptions plain, zero;
  zero.structures.labels = std::make_shared<Volume>(cube(20, 0));
  EXPECT_EQ(along_z(plain, 4).rgba, along_z(zero, 4).rgba);
}

TEST(Structures, AnotherGridIsRefused) {
  RaycastOptions options;
  options.structures.mask = halves(19, 9);
  const auto size = Raycaster::make(cube(20, 100), gray(), options);
  ASSERT_FALSE(size);
  EXPECT_EQ(size.error().code, ErrorCode::usage);
  EXPECT_NE(size.error().message.find("19x19x19"), std::string::npos) << size.error().message;
  auto moved = std::make_shared<Volume>(*halves(20, 10));
  moved->origin.x = 3;
  options.structures.mask = moved;
  const auto place = Raycaster::make(cube(20, 100), gray(), options);
  ASSERT_FALSE(place);
  EXPECT_NE(place.error().message.find("apart"), std::string::npos) << place.error().message;
}

}  // namespace
}  // namespace slf
