// Label tables, structures and masks.
#include "slf/volume_parts.h"

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

// FreeSurfer's columns are those of Slicer, but its last one is no opacity.
TEST(LabelTable, FreeSurfersLabelsAreVisible) {
  const std::string rows =
      "0   Unknown                 0   0   0   0\n"
      "1   Left-Cerebral-Exterior  70  130 180 0\n"
      "14  3rd-Ventricle           204 182 142 0   # a comment\n"
      "65535 x 10 20 30 0\n";
  const std::string header = "#$Id: FreeSurferColorLUT.txt,v 1.50 $\r\n\r\n";
  const std::string columns = "#No. Label Name:            R   G   B   A\n\n";
  for (const auto& comments :
       {header, columns, header + columns, std::string(), std::string("#\n")}) {
    SCOPED_TRACE(comments);
    const auto table = parse_label_table(comments + rows, "FreeSurferColorLUT.txt");
    ASSERT_TRUE(table) << table.error().message;
    ASSERT_EQ(table->size(), 4u);
    EXPECT_EQ(table->at(0).opacity, 0);
    EXPECT_EQ(table->at(14), (LabelStyle{"3rd-Ventricle", glm::dvec3(204, 182, 142) / 255.0, 1}));
    EXPECT_EQ(table->at(65535).opacity, 1);
  }
  // Some tools write 255, or a transparency, in the same column.
  const auto mixed = parse_label_table(columns + "1 a 1 2 3 255\n2 b 1 2 3 0\n", "a.txt");
  ASSERT_TRUE(mixed);
  EXPECT_EQ(mixed->at(1).opacity, 1);
  EXPECT_EQ(mixed->at(2).opacity, 1);
  // FreeSurfer takes the last of several lines with one id.
  const auto twice = parse_label_table(columns + "1 a 1 2 3 0\n1 b 1 2 3 0\n", "a.txt");
  ASSERT_TRUE(twice);
  EXPECT_EQ(twice->at(1).name, "b");
}

TEST(LabelTable, FurtherColumnsAreIgnored) {
  const auto table = parse_label_table(
      "#No. Label Name:  R   G   B   A\n0 Unknown 0 0 0 0\n17 Left-Hippocampus 220 216 20 0\n"
      "819 Left-HypoThal-noMB  0  80   0 0 2\n843 x 178 255 80 0 2 text 1 2 3\n",
      "a.txt");
  ASSERT_TRUE(table) << table.error().message;
  EXPECT_EQ(table->at(17), (LabelStyle{"Left-Hippocampus", glm::dvec3(220, 216, 20) / 255.0, 1}));
  EXPECT_EQ(table->at(819), (LabelStyle{"Left-HypoThal-noMB", glm::dvec3(0, 80, 0) / 255.0, 1}));
  EXPECT_EQ(table->at(843), (LabelStyle{"x", glm::dvec3(178, 255, 80) / 255.0, 1}));
  // Names may end with numbers.
  EXPECT_EQ(parse_label_table("7 Area 4 220 216 20 255\n", "a.txt")->at(7),
            (LabelStyle{"Area 4", glm::dvec3(220, 216, 20) / 255.0, 1}));
}

TEST(LabelTable, ColoursMayRunTo1) {
  for (const char* text : {"17 L 0.5 0.25 0 1.0\n819 Hypo 0 1 0 0.5\n",
                           "17 0.5 0.25 0 1 1 1 \"L\"\n819 0 1 0 0.5 1 1 \"Hypo\"\n",
                           "LabelValue,Name,Color_R,Color_G,Color_B,Color_A\n17,L,0.5,0.25,0,1\n"
                           "819,Hypo,0,1,0,0.5\n"}) {
    const auto table = parse_label_table(text, "a.txt");
    ASSERT_TRUE(table) << table.error().message;
    EXPECT_EQ(table->at(17), (LabelStyle{"L", glm::dvec3(0.5, 0.25, 0), 1}));
    EXPECT_EQ(table->at(819), (LabelStyle{"Hypo", glm::dvec3(0, 1, 0), 0.5}));
  }
}

TEST(LabelTable, ColoursMayBeALittleOver1) {
  const auto table = parse_label_table("17 L 1.02 0.25 0 1.0\n819 Hypo 0 1 0 0.5\n", "a.txt");
  ASSERT_TRUE(table) << table.error().message;
  EXPECT_EQ(table->at(17), (LabelStyle{"L", glm::dvec3(1, 0.25, 0), 1}));
}

TEST(LabelTable, LinesMayEndInAnyWay) {
  for (const std::string& text :
       {std::string(kSnap), std::string(kSlicer),
        std::string("LabelValue,Name,Color_R,Color_G,Color_B\n1,a,1,2,3\n2,b,4,5,6\n")})
    for (const char* end : {"\r", "\r\n"}) {
      std::string other;
      for (const char c : text) other += c == '\n' ? std::string(end) : std::string(1, c);
      const auto table = parse_label_table(other, "a.txt");
      ASSERT_TRUE(table) << table.error().message;
      EXPECT_EQ(*table, *parse_label_table(text, "a.txt"));
    }
}

TEST(LabelTable, TextMayBeUtf16OrLatin1) {
  const LabelTable expected{{7, {"Gro\xC3\x9Fhirn", glm::dvec3(1, 0, 0), 1}},
                            {4294967295, {"b", glm::dvec3(0, 0, 1), 1}}};
  const std::string latin = "7 Gro\xDFhirn 255 0 0 255\n4294967295 b 0 0 255 255\n";
  std::string little = "\xFF\xFE", big = "\xFE\xFF";
  for (const char c : latin) little += {c, '\0'}, big += {'\0', c};
  for (const auto& text : {latin, little, big})
    EXPECT_EQ(parse_label_table(text, "a.txt"), expected);
}

TEST(LabelTable, SlicersOpacityCountsWhereTheTableIsSlicers) {
  const std::string header = "# Color table file /home/FreeSurferColorLUT.ctbl\n# 3 values\n";
  const std::string rows = "0 (none) 0 0 0 0\n1 'left lung' 127.5 0 0 0\n2 2 0 255 0 51\n";
  const auto table = parse_label_table(header + rows, "a.ctbl");
  ASSERT_TRUE(table) << table.error().message;
  EXPECT_EQ(table->at(1), (LabelStyle{"left lung", glm::dvec3(0.5, 0, 0), 0}));
  EXPECT_EQ(table->at(2), (LabelStyle{"2", glm::dvec3(0, 1, 0), 0.2}));
  // A single hidden label is no reason to take the column for FreeSurfer's.
  EXPECT_EQ(parse_label_table(rows, "a.ctbl")->at(1).opacity, 0);
  const auto without =
      parse_label_table("0 background 0 0 0\n7 left lung 255 0 0\n8 lobe inf 9 9 9\n", "a.txt");
  ASSERT_TRUE(without) << without.error().message;
  EXPECT_EQ(without->at(0).opacity, 0);
  EXPECT_EQ(without->at(7), (LabelStyle{"left lung", glm::dvec3(1, 0, 0), 1}));
  EXPECT_EQ(without->at(8).name, "lobe inf");
}

TEST(LabelTable, ReadsSlicersCsv) {
  const auto table = parse_label_table(
      "\xef\xbb\xbfLabelValue,Name,Color_R,Color_G,Color_B,Color_A,Category_CodingScheme\r\n"
      "1,left_kidney,185,102,51,255,SCT\r\n"
      "5,\"mass, left \"\"upper\"\"\",0,0,0,51,SCT\r\n"
      "\r\n"
      "1000,,255,0,0,,\r\n",
      "a.csv");
  ASSERT_TRUE(table) << table.error().message;
  ASSERT_EQ(table->size(), 3u);
  EXPECT_EQ(table->at(1), (LabelStyle{"left_kidney", glm::dvec3(185, 102, 51) / 255.0, 1}));
  EXPECT_EQ(table->at(5), (LabelStyle{"mass, left \"upper\"", glm::dvec3(0, 0, 0), 0.2}));
  EXPECT_EQ(table->at(1000), (LabelStyle{"", glm::dvec3(1, 0, 0), 1}));
  const auto other =
      parse_label_table("\"LabelValue\";\"Color_B\";\"Color_G\";\"Color_R\"\n3;255;0;0\n", "a.csv");
  ASSERT_TRUE(other) << other.error().message;
  EXPECT_EQ(other->at(3), (LabelStyle{"", glm::dvec3(0, 0, 1), 1}));
}

TEST(LabelTable, MistakesAreNamed) {
  for (const auto& [text, place] : std::vector<std::pair<std::string, std::string>>{
           {"", "without labels"},
           {"1 liver 255 0\n", "line 1"},
           {"# x\n1 liver 256 0 0 255\n", "line 2"},
           {"1 liver 255 0 0 255\n1 spleen 0 0 0 255\n", "line 2: the id 1"},
           {"1 255 0 0 2 1 1 \"x\"\n", "line 1"},
           {"1.5 liver 255 0 0 255\n", "line 1"},
           // Tables without names, which could be taken for something else.
           {"1 255 0 0 255\n", "line 1"},
           {"1 255 0 0 1 1\n", "line 1"},
           {"1 255 0 0 1\n", "line 1"},
           {"1 liver 255 0 0 255\n2 255 0 0 1 1 1 \"x\"\n", "line 2: expected 3D Slicer's or"},
           {"1 255 0 0 1 1 1 \"x\"\n2 liver 255 0 0 255\n", "line 2: expected ITK-SNAP's"},
           {"# Color procedural file a.txt\n0 0 0 0\n63 0 0.5 0.5\n", "a continuous scale"},
           {"0 0 0 0\n63 0 0.5 0.5\n", "line 1: expected ITK-SNAP's"},
           {"LabelValue,Name,Color_R,Color_G\n", "line 1: the column Color_B is missing"},
           {"LabelValue,Color_R,Color_G,Color_B\nx,1,2,3\n", "line 2: LabelValue is 'x'"},
           {"LabelValue,Color_R,Color_G,Color_B\n1,1,2,300\n", "line 2: expected 0 to 255"},
           {"LabelValue,Color_R,Color_G,Color_B\n1,1,2,3\n\n1,1,2,3\n", "line 4: the id 1"},
           {"LabelValue,Color_R,Color_G,Color_B\n", "without labels"},
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

TEST(VolumeParts, StandInTheirOwnColours) {
  RaycastOptions options;
  options.shade = false;
  options.parts.labels = halves(20, 10);
  options.parts.styles = {{1, {"red", glm::dvec3(1, 0, 0), 1}},
                          {2, {"faint", glm::dvec3(0, 1, 0), 0.1}}};
  const RaySample red = along_z(options, 4), faint = along_z(options, 14);
  EXPECT_NEAR(red.rgba.r, 1, 0.01);
  EXPECT_EQ(red.rgba.g, 0);
  EXPECT_EQ(faint.rgba.r, 0);
  // 19 world units of opacity 0.05 each.
  EXPECT_NEAR(faint.rgba.a, 1 - std::pow(1 - 0.05, 19), 0.02);
  EXPECT_NEAR(faint.rgba.g, faint.rgba.a, 1e-4);
}

TEST(VolumeParts, HoldUnderAllLight) {
  RaycastOptions options;
  options.lighting.mode = Lighting::global;
  options.lighting.samples = 4;
  options.parts.labels = halves(20, 10);
  options.parts.styles = {{1, {"red", glm::dvec3(1, 0, 0), 1}},
                          {2, {"hidden", glm::dvec3(0, 1, 0), 0}}};
  EXPECT_GT(along_z(options, 4).rgba.r, 0.2);
  EXPECT_EQ(along_z(options, 14).rgba.a, 0);
}

TEST(VolumeParts, AMaskHidesWhatIsOutside) {
  RaycastOptions options;
  options.parts.mask = halves(20, 10);
  auto mask = std::make_shared<Volume>(*halves(20, 10));
  for (std::byte& voxel : mask->voxels) voxel = std::byte{voxel == std::byte{1}};
  options.parts.mask = mask;
  EXPECT_GT(along_z(options, 4).rgba.a, 0.9);
  EXPECT_EQ(along_z(options, 14).rgba.a, 0);
  const auto made = Raycaster::make(cube(20, 100), gray(), options);
  ASSERT_TRUE(made);
  EXPECT_LT((*made)->bounds().center.x, 7);  // and the bounds are those of what is left
}

TEST(VolumeParts, WithoutAnyStyleNothingChanges) {
  RaycastOptions plain, zero;
  zero.parts.labels = std::make_shared<Volume>(cube(20, 0));
  EXPECT_EQ(along_z(plain, 4).rgba, along_z(zero, 4).rgba);
}

// ---- other grids --------------------------------------------------------------------------------

/// A grey volume whose axes differ in length and spacing, away from the origin.
Volume grey() {
  Volume v;
  v.dims = {12, 8, 8};
  v.voxels.assign(768, std::byte{100});
  v.axes = glm::dmat3(1.5, 0, 0, 0, -2, 0, 0, 0, 3);
  v.origin = {-20, 30, -10};
  v.source = "grey";
  return v;
}

/// A label volume: at each voxel, what `at` gives for its world position.
template <class At>
std::shared_ptr<Volume> labels_by_position(std::array<std::uint32_t, 3> dims,
                                           const glm::dmat3& axes, const glm::dvec3& origin,
                                           const At& at) {
  auto v = std::make_shared<Volume>();
  v->dims = dims;
  v->axes = axes;
  v->origin = origin;
  v->labels = true;
  v->source = "labels";
  for (std::uint32_t z = 0; z < dims[2]; ++z)
    for (std::uint32_t y = 0; y < dims[1]; ++y)
      for (std::uint32_t x = 0; x < dims[0]; ++x)
        v->voxels.push_back(static_cast<std::byte>(at(origin + axes * glm::dvec3(x, y, z))));
  return v;
}

/// 1 to 8: the octant of the grey volume.
int octant(const glm::dvec3& at) {
  const Volume v = grey();
  const glm::dvec3 middle = v.origin + v.axes * glm::dvec3(5.5, 3.5, 3.5);
  return 1 + int(at.x > middle.x) + 2 * int(at.y > middle.y) + 4 * int(at.z > middle.z);
}

/// What short rays within the inner voxels of the grey volume see.
std::vector<glm::vec4> colors_of(const std::shared_ptr<Volume>& labels) {
  RaycastOptions options;
  options.shade = false;
  options.parts.labels = labels;
  for (int id = 1; id <= 8; ++id)
    options.parts.styles[id] = {"", glm::dvec3(id & 1, id >> 1 & 1, id >> 2 & 1), 1};
  const Volume v = grey();
  const auto made = Raycaster::make(grey(), gray(), options);
  EXPECT_TRUE(made) << (made ? "" : made.error().message);
  std::vector<glm::vec4> colors;
  for (int z = 1; made && z < 7; ++z)
    for (int y = 1; y < 7; ++y)
      for (int x = 1; x < 11; ++x) {
        const glm::dvec3 at = v.origin + v.axes * glm::dvec3(x, y, z);
        const glm::dvec3 reach(0.5, 0, 0);
        colors.push_back((*made)->trace(at - reach, at + reach).rgba);
      }
  return colors;
}

TEST(VolumeParts, LabelsOnAnotherGridAreResampledByPosition) {
  const Volume v = grey();
  const auto expected = colors_of(labels_by_position(v.dims, v.axes, v.origin, octant));
  ASSERT_EQ(expected.size(), 360u);
  EXPECT_NE(expected.front(), expected.back());
  const auto expect_same = [&](const char* what, std::array<std::uint32_t, 3> dims,
                               const glm::dmat3& axes, const glm::dvec3& origin) {
    SCOPED_TRACE(what);
    const auto labels = labels_by_position(dims, axes, origin, octant);
    EXPECT_FALSE(same_grid(*labels, v));
    EXPECT_EQ(colors_of(labels), expected);
  };
  const auto end = [&](int axis) {
    return double(v.dims[static_cast<std::size_t>(axis)] - 1) * v.axes[axis];
  };
  expect_same("flipped in x", v.dims, {-v.axes[0], v.axes[1], v.axes[2]}, v.origin + end(0));
  expect_same("flipped in all", v.dims, -1.0 * v.axes, v.origin + end(0) + end(1) + end(2));
  expect_same("x and y permuted", {8, 12, 8}, {v.axes[1], v.axes[0], v.axes[2]}, v.origin);
  expect_same("z first", {8, 12, 8}, {v.axes[2], v.axes[0], v.axes[1]}, v.origin);
  expect_same("cropped", {10, 6, 6}, v.axes, v.origin + v.axes * glm::dvec3(1));
  expect_same("larger", {16, 12, 12}, v.axes, v.origin - v.axes * glm::dvec3(2));
  expect_same("half as fine", {6, 4, 4}, 2.0 * v.axes, v.origin + v.axes * glm::dvec3(0.5));
  expect_same("three times as fine", {36, 24, 24}, v.axes / 3.0,
              v.origin - v.axes * glm::dvec3(1 / 3.0));
}

// Of a cube, the first and last voxels stay where they are when x and y are exchanged.
TEST(VolumeParts, EqualCornersAreNoEqualGrid) {
  const Volume v = cube(20, 100);
  auto labels = halves(20, 10);
  labels->axes = {v.axes[1], v.axes[0], v.axes[2]};
  EXPECT_FALSE(same_grid(*labels, v));
  RaycastOptions options;
  options.parts.labels = labels;
  options.parts.styles = {{1, {"", glm::dvec3(1, 0, 0), 1}}, {2, {"", {}, 0}}};
  const auto made = Raycaster::make(cube(20, 100), gray(), options);
  ASSERT_TRUE(made);
  EXPECT_GT((*made)->trace({14, 4, -20}, {14, 4, 40}).rgba.a, 0.9);
  EXPECT_EQ((*made)->trace({4, 14, -20}, {4, 14, 40}).rgba.a, 0);
}

TEST(VolumeParts, RotatedLabelsKeepTheirPlace) {
  const double c = std::cos(0.5), s = std::sin(0.5);
  const glm::dmat3 turned(c, s, 0, -s, c, 0, 0, 0, 1);
  const glm::dvec3 middle(9.5, 9.5, 9.5);
  RaycastOptions options;
  options.shade = false;
  options.parts.labels =
      labels_by_position({40, 40, 20}, turned, middle - turned * glm::dvec3(19.5, 19.5, 9.5),
                         [&](const glm::dvec3& at) { return at.x < 9.5 ? 1 : 2; });
  options.parts.styles = {{1, {"", glm::dvec3(1, 0, 0), 1}}, {2, {"", {}, 0}}};
  const auto made = Raycaster::make(cube(20, 100), gray(), options);
  ASSERT_TRUE(made);
  for (const double y : {1.0, 9.0, 18.0}) {
    EXPECT_NEAR((*made)->trace({7, y, -20}, {7, y, 40}).rgba.r, 1, 0.01) << y;
    EXPECT_EQ((*made)->trace({12, y, -20}, {12, y, 40}).rgba.a, 0) << y;
  }
}

TEST(VolumeParts, OutsideOfTheirGridLabelsAndMasksAre0) {
  RaycastOptions options;
  options.shade = false;
  const auto part = labels_by_position({5, 20, 20}, glm::dmat3(1.0), glm::dvec3(0.0),
                                       [](const glm::dvec3&) { return 1; });
  options.parts.labels = part;
  options.parts.styles = {{0, {"rest", glm::dvec3(0, 0, 1), 1}},
                          {1, {"part", glm::dvec3(1, 0, 0), 1}}};
  EXPECT_GT(along_z(options, 2).rgba.r, 0.9);
  EXPECT_GT(along_z(options, 14).rgba.b, 0.9);
  EXPECT_EQ(along_z(options, 14).rgba.r, 0);
  options.parts = {};
  options.parts.mask = part;
  EXPECT_GT(along_z(options, 2).rgba.a, 0.9);
  EXPECT_EQ(along_z(options, 14).rgba.a, 0);
}

TEST(VolumeParts, WhatLiesElsewhereIsRefused) {
  for (const bool as_mask : {false, true}) {
    RaycastOptions options;
    auto moved = std::make_shared<Volume>(*halves(20, 10));
    moved->origin.x = 30;
    moved->source = "moved";
    (as_mask ? options.parts.mask : options.parts.labels) = moved;
    const auto made = Raycaster::make(cube(20, 100), gray(), options);
    ASSERT_FALSE(made);
    EXPECT_EQ(made.error().code, ErrorCode::usage);
    EXPECT_NE(made.error().message.find("at 30,0,0 to 49,19,19, wholly outside of cube at 0,0,0"),
              std::string::npos)
        << made.error().message;
    EXPECT_EQ(made.error().message.find("moved: a "), 0u) << made.error().message;
  }
}

}  // namespace
}  // namespace slf
