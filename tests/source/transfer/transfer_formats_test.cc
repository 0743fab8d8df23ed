// Files and names of transfer functions.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/source/transfer/transfer_samples.h"
#include "tests/source/volume/samples.h"

namespace slf {
namespace {

using samples::Folder;
using samples::parse;
using samples::ramp_volume;
using samples::volume_of;
using ::testing::HasSubstr;
using Values = TransferPreset::Values;

TEST(TransferPreset, OneOfSeveralByName) {
  const Folder folder;
  const auto path =
      folder.write("maps #1.json", R"([{"Name": "First", "RGBPoints": [0, 1, 0, 0, 1, 1, 0, 0]},
                          {"Name": "Second #2", "RGBPoints": [0, 0, 1, 0, 1, 0, 1, 0]}])");
  const auto first = read_transfer(path);
  ASSERT_TRUE(first) << first.error().message;
  EXPECT_EQ(first->function.name, "First");
  for (const auto* name : {"#Second #2", "#second #2"}) {
    const auto second = read_transfer(path + name);
    ASSERT_TRUE(second) << second.error().message;
    EXPECT_EQ(second->function.name, "Second #2");
  }
  const auto none = read_transfer(path + "#third");
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().code, ErrorCode::usage);
  EXPECT_THAT(none.error().message, HasSubstr("no preset 'third'; there are First, Second #2"));
}

TEST(TransferPreset, BuiltInsByName) {
  for (const auto& preset : built_in_transfers()) {
    SCOPED_TRACE(preset.function.name);
    const auto found = read_transfer(preset.function.name);
    ASSERT_TRUE(found);
    EXPECT_FALSE(found->description.empty());
    for (const auto& points = found->function.opacities; const auto& point : points)
      EXPECT_LE(point.value, points.back().value);
    // Something of it is clear, and something well visible.
    double min = 1, max = 0;
    for (const auto& point : found->function.opacities) {
      min = std::min(min, point.opacity);
      max = std::max(max, point.opacity);
    }
    EXPECT_EQ(min, 0);
    EXPECT_GT(max, 0.1);
    EXPECT_TRUE(parse_transfer(to_json(found->fit(ramp_volume())), "again"));
    // 0 and 1 are the ends of the volume's range, wherever the function begins to show something.
    const auto ends = transfer_formats::extent(*found);
    const bool normal = (ends[0] == 0 || ends[0] == -1) && ends[1] == 1;
    EXPECT_EQ(normal, found->values == Values::relative) << ends[0] << " " << ends[1];
  }
  EXPECT_EQ(read_transfer("micro-ct")->fit(ramp_volume())(390).w, 0);
  EXPECT_GT(read_transfer("micro-ct")->fit(ramp_volume())(480).w, 0);
  EXPECT_TRUE(read_transfer("CT-Bone"));
  const auto none = read_transfer("ct-boone");
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().code, ErrorCode::usage);
  EXPECT_THAT(none.error().message, HasSubstr("no built-in transfer function; there are ct-bone"));
}

// The file has some of ParaView's own presets: of each colour space, kind of range and set of
// members that its 191 have.
TEST(TransferPreset, ParaViewsOwnShowAVolume) {
  const std::string path = std::string(SLF_TEST_DATA) + "/transfer/paraview.json";
  const auto presets = read_transfers(path);
  ASSERT_TRUE(presets) << presets.error().message;
  ASSERT_EQ(presets->size(), 26);
  auto labels = volume_of(ScalarType::u8, std::vector<std::uint8_t>{0, 1, 2, 3, 4, 5, 5, 0});
  labels.labels = true;
  for (const auto& preset : *presets) {
    SCOPED_TRACE(preset.function.name);
    EXPECT_TRUE(read_transfer(path + "#" + preset.function.name));
    const auto transfer = preset.fit(ramp_volume());
    EXPECT_EQ(transfer(0).w, 0);
    EXPECT_GT(transfer(1000).w, 0.9);
    EXPECT_GE(transfer.colors.front().value, 0);
    EXPECT_EQ(transfer.colors.back().value, 1000);
    EXPECT_EQ(preset.fit(labels)(3).w, 1);
  }
}

// As MRIcroGL writes them, and with the blanks that others leave.
TEST(TransferPreset, ReadsClut) {
  const std::string nodes =
      "[INT]\nnumnodes=3\n[BYT]\nnodeintensity0=0\nnodeintensity1 = 128\nnodeintensity2=255\n"
      "[RGBA255]\nnodergba0=0|0|0|0\nnodergba1=255|0|0|51\nnodergba2=255|255|0|255\n";
  const auto absolute = parse("[FLT]\r\nmin=100\r\nmax=610\r\n" + nodes, "hot.clut");
  EXPECT_EQ(absolute.function.name, "hot");
  EXPECT_EQ(absolute.values, Values::absolute);
  const auto fitted = absolute.fit(ramp_volume());
  EXPECT_EQ(fitted(100).w, 0);
  EXPECT_NEAR(fitted(356).w, 0.2, 1e-9);
  EXPECT_EQ(fitted(610), glm::dvec4(1, 1, 0, 1));
  const auto relative = parse("[FLT]\nmin=0\nmax=0\n" + nodes, "hot.clut");
  EXPECT_EQ(relative.values, Values::relative);
  EXPECT_EQ(relative.fit(ramp_volume())(1000), glm::dvec4(1, 1, 0, 1));
  EXPECT_EQ(parse(nodes, "hot.clut").values, Values::relative);
}

// The shapes of the tables that come with MRIcroGL.
TEST(TransferPreset, ReadsEveryShapeOfClut) {
  const std::string range = "[FLT]\nmin=0\nmax=0\n";
  const std::string nodes =
      "[INT]\nnumnodes=2\n[BYT]\nnodeintensity0=0\nnodeintensity1=255\n"
      "[RGBA255]\nnodergba0=0|0|0|0\nnodergba1=255|255|0|128\n";
  const auto plain = to_json(parse(range + nodes, "a.clut").function);
  // A comment first (cubehelix, linspecer), no range, its own range elsewhere, other sections,
  // text after the nodes (jet), blank lines, a byte order mark.
  for (const std::string& text :
       {"[STR]\ncomment=https://www.mrao.cam.ac.uk/~dag/CUBEHELIX/?min=4\n" + nodes, nodes,
        "\n\n; mine\n[STR]\r\n" + range + nodes, "[Other_1]\na=b\n" + nodes + range,
        range + nodes + "\n#00007F\", \"blue\",\n\"#007FFF\", \"cyan\"",
        "\xef\xbb\xbf" + range + nodes})
    EXPECT_EQ(to_json(parse(text, "a.clut").function), plain) << text;

  const auto with = [&](const std::string& change, const std::string& to) {
    std::string text = range + nodes;
    text.replace(text.find(change), change.size(), to);
    return parse(text, "a.clut").function;
  };
  // Three digits, and 256 for 255 (blue2red, blue_white_red); a bar at the end (random).
  EXPECT_EQ(with("255|255|0|128", "000|256|064|128")(1), glm::dvec4(0, 1, 64 / 255.0, 128 / 255.0));
  EXPECT_EQ(to_json(with("255|255|0|128", "255|255|0|128|")), plain);
  // MRIcroGL moves the last node to 255, and the first node holds below it (blue-lightblue).
  EXPECT_EQ(to_json(with("nodeintensity1=255", "nodeintensity1=240")), plain);
  const auto late = with("nodeintensity0=0", "nodeintensity0=51");
  EXPECT_EQ(late.colors.front().value, 0);
  EXPECT_EQ(late(0.2).w, 0);
  EXPECT_NEAR(late(0.6).x, 0.5, 1e-9);
  // A range with a decimal comma, as MRIcroGL writes it where the system has one.
  const auto comma = with("min=0\nmax=0", "min=-10,5\nmax=220,05");
  EXPECT_EQ(comma.colors.front().value, -10.5);
  EXPECT_EQ(comma.colors.back().value, 220.05);

  // All of 256 colours (random).
  std::string many = "[FLT]\nmin=0\nmax=255\n[INT]\nnumnodes=256\n[BYT]\n", colors = "[RGBA255]\n";
  for (int i = 0; i < 256; ++i) {
    const std::string k = std::to_string(i);
    many.append("nodeintensity").append(k).append("=").append(k).append("\n");
    colors.append("nodergba").append(k).append("=").append(k).append("|46|154|64|\n");
  }
  const auto table = parse(many + colors, "random.clut");
  EXPECT_EQ(table.values, Values::absolute);
  ASSERT_EQ(table.function.colors.size(), 256);
  for (const int id : {0, 1, 77, 255}) EXPECT_NEAR(table.function(id).x, id / 255.0, 1e-9);
}

TEST(TransferPreset, ReadsParaViewsXml) {
  const std::string two = R"(<?xml version="1.0"?>
<!-- from a colour loom -->
<ColorMaps>
  <ColorMap space="CIELAB" indexedLookup="false" group="Interlinked" name="Green/Brown">
    <Point x="1" o="1" r="1" g="0" b="0" cms="1" isMoving="true"/>
    <Point x="-1" o="0" r="0" g="0" b="1"/>
    <Section colorMapName="Green 1" startIndex="2" endIndex="3" startPos="0.6" endPos="0.7"/>
    <NaN r="0.25" g="0" b="0"/>
  </ColorMap>
  <ColorMap name="Three" indexedLookup="true" space="RGB">
    <Annotation v="2" t="two"/><Annotation v="5" t="five"/>
    <Point r="1" g="0" b="0" o="1"/>
    <Point r="0" g="1" b="0" o="1"/>
  </ColorMap>
</ColorMaps>)";
  const auto maps = parse_transfers(two, "maps.xml");
  ASSERT_TRUE(maps) << maps.error().message;
  ASSERT_EQ(maps->size(), 2u);
  const auto& lab = maps->front();
  EXPECT_EQ(lab.function.name, "Green/Brown");
  EXPECT_EQ(lab.function.space, TransferFunction::Space::lab);
  EXPECT_FALSE(lab.has_opacity);
  EXPECT_EQ(lab.function.colors.front().value, -1);
  EXPECT_NEAR(lab.fit(ramp_volume())(1000).x, 1, 0.01);
  EXPECT_EQ(lab.fit(ramp_volume())(0).w, 0);
  auto labels = volume_of(ScalarType::u8, std::vector<std::uint8_t>{0, 2, 2, 5, 5, 5, 5, 5});
  labels.labels = true;
  EXPECT_EQ(maps->back().values, Values::indexed);
  EXPECT_EQ(maps->back().fit(labels)(5), glm::dvec4(0, 1, 0, 1));

  // One alone, without a name or space; hues that wrap around.
  const auto one = parse(R"(<ColorMap><Point x="0" r="0" g="0" b="0"/>)"
                         R"(<Point x="255" r="1" g="1" b="1"/></ColorMap>)",
                         "gray.xml");
  EXPECT_EQ(one.function.name, "gray");
  EXPECT_EQ(one.function.space, TransferFunction::Space::rgb);
  EXPECT_EQ(parse(R"(<ColorMap space="Wrapped" indexedLookup="0"><Point x="0" r="0" g="0" b="0"/>)"
                  R"(</ColorMap>)")
                .function.space,
            TransferFunction::Space::hsv);
}

TEST(TransferPreset, ReadsSlicersPresets) {
  const Folder folder;
  const auto path = folder.write("presets.xml", R"(<?xml version="1.0" encoding="utf-8"?>
<MRML>
  <VolumeProperty selected="false" name="CT-AAA" gradientOpacity="4 0 1 255 1" userTags=""
    specularPower="10" scalarOpacity="6 -3024 0 100 0 400 0.8" id="vtkMRMLVolumePropertyNode1"
    colorTransfer="12 -3024 0 0 0 100 1 0 0 400 1 1 1" shade="1"/>
  <VolumeProperty name="MR-Default" scalarOpacity="4 0 0 1024 0.5"
    colorTransfer="8 0 0 0 0 1024 1 1 1"/>
</MRML>)");
  const auto all = read_transfers(path);
  ASSERT_TRUE(all) << all.error().message;
  ASSERT_EQ(all->size(), 2u);
  EXPECT_EQ(all->front().function.name, "CT-AAA");
  const auto transfer = all->front().fit(ramp_volume());
  EXPECT_DOUBLE_EQ(transfer(250).w, 0.4);
  EXPECT_EQ(transfer(250).y, 0.5);
  const auto second = read_transfer(path + "#mr-default");
  ASSERT_TRUE(second) << second.error().message;
  EXPECT_EQ(second->function(1024).w, 0.5);
}

constexpr const char* kVp =
    "1\n1\n0.9\n0.1\n0.2\n10\n6 -3024 0 100 0 400 0.8\n4 0 1 255 1\n"
    "12 -3024 0 0 0 100 1 0 0 400 1 1 1\n";

TEST(TransferPreset, ReadsSlicersVolumeProperty) {
  const auto preset = parse(kVp, "CT-Bones.vp");
  EXPECT_EQ(preset.function.name, "CT-Bones");
  const auto transfer = preset.fit(ramp_volume());
  EXPECT_EQ(transfer(100).w, 0);
  EXPECT_DOUBLE_EQ(transfer(250).w, 0.4);
  EXPECT_EQ(transfer(250).x, 1);
  EXPECT_EQ(transfer(250).y, 0.5);

  const auto json = parse(R"({"@schema": "volume-property-schema-v1.0.0.json#",
    "volumeProperties": [{"components": [{"scalarOpacityUnitDistance": 2,
      "rgbTransferFunction": {"points": [
        {"x": -3024, "color": [0, 0, 0], "midpoint": 0.5, "sharpness": 0},
        {"x": 400, "color": [1, 1, 1], "midpoint": 0.5, "sharpness": 0}]},
      "scalarOpacity": {"points": [
        {"x": 100, "y": 0, "midpoint": 0.5, "sharpness": 1},
        {"x": 400, "y": 0.8, "midpoint": 0.5, "sharpness": 0}]}}]}]})",
                          "a.vp.json");
  EXPECT_EQ(json.function.unit_distance, 2);
  EXPECT_EQ(json.function(249).w, 0);
  EXPECT_EQ(json.function(251).w, 0.8);
}

TEST(TransferPreset, TextMayBeUtf16OrLatin1) {
  const std::string map = R"(<?xml version="1.0" encoding="ISO-8859-1"?><ColorMap name="Gr)"
                          "\xFC"
                          R"(n"><Point x="0" )"
                          R"(r="0" g="0" b="0"/><Point x="1" r="1" g="1" b="1"/></ColorMap>)";
  EXPECT_EQ(parse_transfers(map, "a.xml")->front().function.name, "Gr\xC3\xBCn");
  std::string wide = "\xFF\xFE";
  for (const char c : std::string(R"({"Name": "x", "RGBPoints": [0, 0, 0, 0, 1, 1, 1, 1]})"))
    wide += {c, '\0'};
  EXPECT_EQ(parse_transfers(wide, "a.json")->front().function.name, "x");
}

TEST(TransferPreset, SaysWhatIsWrong) {
  const auto expect = [](std::string text, const std::string& change, const std::string& to,
                         const std::string& message) {
    if (!change.empty()) text.replace(text.find(change), change.size(), to);
    const auto presets = parse_transfers(text, "file");
    ASSERT_FALSE(presets) << text;
    EXPECT_EQ(presets.error().code, ErrorCode::bad_file);
    EXPECT_THAT(presets.error().message, HasSubstr("file: "));
    EXPECT_THAT(presets.error().message, HasSubstr(message));
  };
  expect("# Color table file\n0 a 0 0 0 0\n", "", "", "expected a transfer function of ParaView");
  expect(kVp, "6 -3024", "7 -3024", "line 7: begins with '7', expected a count");
  expect(kVp, "400 0.8", "400 1.8", "line 7: number 6 is 1.8, expected 0 to 1");
  expect(kVp, "100 0 400", "100 0 50", "line 7: number 5 is 50, below the point before it");
  expect(kVp, "12 -3024", "16 -3024", "line 9: has 12 numbers, expected 16");
  expect("1\n1\n0.9\n0.1\n0.2\n10\n6 -3024 0 100 0 400 0.8\n", "", "", "7 lines, expected the 9");
  const std::string clut =
      "[INT]\nnumnodes=1\n[BYT]\nnodeintensity0=0\n[RGBA255]\n"
      "nodergba0=1|2|3|4\n";
  expect(clut, "numnodes=1", "numnodes=2", "nodeintensity1 is missing");
  expect(clut, "numnodes=1", "numnodes=999", "numnodes is '999', expected a number from 1 to 256");
  expect(clut, "1|2|3|4", "1|2|3", "nodergba0 is '1|2|3', expected red|green|blue|alpha");
  expect(clut, "1|2|3|4", "1|2|x|4", "nodergba0 is '1|2|x|4'");
  expect(clut, "1|2|3|4", "1|2|-3|4", "nodergba0 is '1|2|-3|4'");
  expect(clut, "nodeintensity0=0", "nodeintensity0=300", "nodeintensity0 is '300', expected");
  expect("[abc]\n", "", "", "numnodes is missing");
  expect("<VTKFile/>", "", "", "XML of 'VTKFile', expected ParaView's ColorMap");
  expect("<ColorMap>", "", "", "line 1: Start-end tags mismatch");
  const std::string xml = R"(<ColorMap name="m"><Point x="0" r="0" g="0" b="0.5"/></ColorMap>)";
  expect(xml, "0.5", "1.5", "ColorMap 'm': Point 1: b is '1.5', expected 0 to 1");
  expect(xml, "x=\"0\"", "", "ColorMap 'm': Point 1: x is '', expected a number");
  expect(xml, "Point", "Pint", "ColorMap 'm': expected <Point");
  const std::string property = R"(<MRML><VolumeProperty name="p" scalarOpacity="4 0 0 9 1" )"
                               R"(colorTransfer="4 0 0 0 1"/></MRML>)";
  expect(property, "4 0 0 9 1", "5 0 0 9 1", "VolumeProperty 'p': scalarOpacity: begins with '5'");
  expect(property, "4 0 0 0 1", "4 0 0 0 2", "VolumeProperty 'p': colorTransfer: number 4 is 2");
  expect(property, "scalarOpacity", "opacity", "VolumeProperty 'p': scalarOpacity: is empty");
  expect(R"({"IndexedColors": [1, 0]})", "", "",
         "IndexedColors is an array of 2, expected 3 numbers a point");
  expect(R"({"IndexedColors": [1, 0, 7]})", "", "", "IndexedColors[2] is 7, expected 0 to 1");
  expect(R"({"volumeProperties": [{"components": []}]})", "", "", "[0].RGBPoints is missing");
}

// ---- default functions of volumes that the plain histogram misjudges ---------------------------

/// A signed map: exact 0 outside of a mask of a third, noise within, strong in places.

}  // namespace
}  // namespace slf
