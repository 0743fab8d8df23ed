// Every file that a scene reads is in what its provenance says: a build resumes only from the same.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>

#include "slf/recipe.h"
#include "tests/source/pictures/samples.h"
#include "tests/source/volume/dicom_samples.h"
#include "tests/source/volume/samples.h"

namespace slf {
namespace {

/// A scene of several files, and one of them, which changes.
struct SceneOfFiles {
  std::string changes;
  std::map<std::string, std::string> files;
  Recipe description;  ///< of names in the folder
  /// The new content; else the last byte changes.
  std::string changed{};
};

std::string voxels(char value = 7) {
  std::string bytes(4 * 4 * 4, '\0');
  for (std::size_t k = 21; k < 43; ++k) bytes[k] = value;
  return bytes;
}

std::string nrrd_of(char value = 7) {
  return samples::nrrd("type: uint8\ndimension: 3\nsizes: 4 4 4\nencoding: raw\n", voxels(value));
}

Recipe of(std::string input) {
  Recipe d;
  d.input = std::move(input);
  return d;
}

Recipe with(const std::function<void(Recipe&)>& change) {
  Recipe d = of("v.nrrd");
  change(d);
  return d;
}

std::string picture(float gray) {
  const Image image{4, 4, std::vector(16, glm::vec4(gray, gray, gray, 1)), {}};
  const auto bytes = encode_image("a.png", image, {.transparent = true}).value();
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

std::vector<SceneOfFiles> volume_scenes() {
  const std::string detached =
      samples::nrrd("type: uint8\ndimension: 3\nsizes: 4 4 4\nencoding: raw\n", "");
  const std::string meta =
      "ObjectType = Image\nNDims = 3\nDimSize = 4 4 4\nElementType = MET_UCHAR\n";
  const auto header = [&](const std::string& more) {
    return detached.substr(0, detached.size() - 1) + more + "\n\n";
  };
  const std::string vti =
      "<VTKFile type=\"ImageData\" version=\"0.1\"><ImageData WholeExtent=\"0 1 0 1 0 1\">"
      "<Piece Extent=\"0 1 0 1 0 1\"><PointData Scalars=\"a\"><DataArray type=\"UInt8\" Name=\"a\" "
      "format=\"ascii\">0 1 2 3 4 5 6 9</DataArray></PointData></Piece></ImageData></VTKFile>";
  const std::string pvti =
      "<VTKFile type=\"PImageData\" version=\"0.1\"><PImageData WholeExtent=\"0 1 0 1 0 1\">"
      "<PPointData Scalars=\"a\"><PDataArray type=\"UInt8\" Name=\"a\"/></PPointData>"
      "<Piece Extent=\"0 1 0 1 0 1\" Source=\"p.vti\"/></PImageData></VTKFile>";
  std::string slices[4];
  for (int k = 0; k < 4; ++k) slices[k] = samples::write_dicom(samples::small_slice(k));
  std::string bright_vti = vti;
  bright_vti.replace(bright_vti.find(" 9<"), 3, " 8<");
  const std::string hdr = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n";
  const std::map<std::string, std::string> volume{{"v.nrrd", nrrd_of()}};
  const auto and_file = [&](const std::string& name, const std::string& content) {
    auto files = volume;
    files[name] = content;
    return files;
  };
  const std::string table = R"({"labels": [{"id": 1, "color": [1, 0, 0]}]})";
  const std::string preset =
      R"([{"ColorSpace": "RGB", "Name": "n", "RGBPoints": [0, 0, 0, 0, 9, 1, 1, 1],
           "Points": [0, 0, 0.5, 0, 9, 1, 0.5, 0]}])";
  std::string other_preset = preset;
  other_preset.replace(other_preset.find("9, 1, 1, 1"), 10, "9, 1, 1, 0");
  return {
      {"v.nrrd", volume, of("v.nrrd"), nrrd_of(8)},
      {"d.raw", {{"d.nhdr", header("data file: d.raw")}, {"d.raw", voxels()}}, of("d.nhdr")},
      {"d1.raw",
       {{"d.nhdr", header("data file: LIST\nd0.raw\nd1.raw\nd2.raw\nd3.raw")},
        {"d0.raw", voxels().substr(0, 16)},
        {"d1.raw", voxels().substr(16, 16)},
        {"d2.raw", voxels().substr(32, 16)},
        {"d3.raw", voxels().substr(48)}},
       of("d.nhdr")},
      {"m.raw", {{"m.mhd", meta + "ElementDataFile = m.raw\n"}, {"m.raw", voxels()}}, of("m.mhd")},
      {"p.vti", {{"v.pvti", pvti}, {"p.vti", vti}}, of("v.pvti"), bright_vti},
      {"s/2.png",
       {{"s/1.png", picture(0)}, {"s/2.png", picture(0.5f)}, {"s/3.png", picture(1)}},
       of("s"),
       picture(0.6f)},
      {"c/3.dcm",
       {{"c/0.dcm", slices[0]},
        {"c/1.dcm", slices[1]},
        {"c/2.dcm", slices[2]},
        {"c/3.dcm", slices[3]}},
       of("c/0.dcm")},
      {"mask.nrrd", and_file("mask.nrrd", nrrd_of(1)),
       with([](auto& d) { d.mask.path = "mask.nrrd"; }),
       samples::nrrd("type: uint8\ndimension: 3\nsizes: 4 4 4\nencoding: raw\n",
                     voxels(1).replace(30, 1, 1, '\0'))},
      {"l.nrrd", and_file("l.nrrd", nrrd_of(1)),
       with([](auto& d) { d.labels_volume.path = "l.nrrd"; }),
       samples::nrrd("type: uint8\ndimension: 3\nsizes: 4 4 4\nencoding: raw\n",
                     voxels(1).replace(30, 1, 1, '\2'))},
      {"t.json",
       {{"v.nrrd", nrrd_of(1)}, {"l.nrrd", nrrd_of(1)}, {"t.json", table}},
       with([](auto& d) { d.labels_volume.path = "l.nrrd", d.label_table = "t.json"; }),
       R"({"labels": [{"id": 1, "color": [1, 0.5, 0]}]})"},
      {"t.json",
       {{"v.nrrd", nrrd_of(1)}, {"t.json", table}},
       with([](auto& d) { d.reading.labels = true, d.label_table = "t.json"; }),
       R"({"labels": [{"id": 1, "color": [1, 0.5, 0]}]})"},
      {"t.json", and_file("t.json", preset), with([](auto& d) { d.transfer = "t.json"; }),
       other_preset},
      {"r.json", and_file("r.json", R"({"lights": [{"direction": [0, -1, 1]}]})"),
       with([](auto& d) { d.light_rig = "r.json"; }), R"({"lights": [{"direction": [0, -1, 2]}]})"},
      {"e.hdr", and_file("e.hdr", hdr + std::string(32, '\x70')),
       with([](auto& d) { d.environment = "e.hdr"; })},
  };
}

std::vector<SceneOfFiles> mesh_scenes() {
  const std::string obj =
      "mtllib m.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n"
      "f 1/1 2/2 3/3\n";
  const std::string mtl = "newmtl a\nKd 1 0 0\n", textured = mtl + "map_Kd t.png\n";
  const auto f = [](float value) {
    return std::string(reinterpret_cast<const char*>(&value), sizeof value);
  };
  std::string buffer;
  for (const float x : {0, 0, 0, 1, 0, 0, 0, 1, 0}) buffer += f(x);
  const std::string gltf = R"({"asset": {"version": "2.0"}, "scene": 0,
    "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
    "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
    "bufferViews": [{"buffer": 0, "byteLength": 36}],
    "buffers": [{"uri": "b.bin", "byteLength": 36}]})";
  std::string moved = obj;
  moved.replace(moved.find("v 1 0 0"), 7, "v 2 0 0");
  return {
      {"m.obj", {{"m.obj", obj}, {"m.mtl", mtl}}, of("m.obj"), moved},
      {"m.mtl", {{"m.obj", obj}, {"m.mtl", mtl}}, of("m.obj"), "newmtl a\nKd 1 0.5 0\n"},
      {"t.png",
       {{"m.obj", obj}, {"m.mtl", textured}, {"t.png", picture(0.3f)}},
       of("m.obj"),
       picture(0.4f)},
      {"b.bin", {{"m.gltf", gltf}, {"b.bin", buffer}}, of("m.gltf"), buffer.substr(0, 32) + f(2)},
  };
}

class ContentOfFiles : public PictureScenes {
 protected:
  void write_file_of(const std::string& name, const std::string& content) const {
    write(name, content);
  }
  /// What tells a scene from others, but for names.
  std::string told(Recipe d) const {
    for (std::string* name : {&d.input, &d.mask.path, &d.labels_volume.path, &d.label_table,
                              &d.transfer, &d.light_rig, &d.environment})
      if (!name->empty()) *name = path(*name);
    const auto scene = make_scene(d);
    EXPECT_TRUE(scene) << scene.error().message;
    return scene ? (*scene)->provenance() : "";
  }
};

TEST_F(ContentOfFiles, AllOfVolumesAndMeshesAreInTheirProvenance) {
  auto scenes = volume_scenes();
  for (SceneOfFiles& one : mesh_scenes()) scenes.push_back(std::move(one));
  for (const SceneOfFiles& one : scenes) {
    SCOPED_TRACE(one.description.input + " with " + one.changes);
    for (const auto& [name, content] : one.files) write_file_of(name, content);
    const std::string before = told(one.description);
    EXPECT_EQ(told(one.description), before);
    std::string content = one.changed;
    if (content.empty()) {
      content = one.files.at(one.changes);
      content.back() = static_cast<char>(content.back() ^ 1);
    }
    write_file_of(one.changes, content);
    EXPECT_NE(told(one.description), before);
    for (const auto& [name, _] : one.files) std::filesystem::remove(path(name));
  }
}

TEST_F(ContentOfFiles, ColoursMasksAndDepthsOfPicturesAreInTheirProvenance) {
  PictureSet set = draw(12, ".png");
  const auto told_of = [&] {
    const auto scene = make_picture_scene(set, {.depth = DepthKind::none, .voxels = 32});
    EXPECT_TRUE(scene) << scene.error().message;
    return scene ? Json::parse((*scene)->provenance())["content"] : Json();
  };
  const auto gray = [&](const std::string& name, float value) {
    const Image image{96, 96, std::vector(96 * 96, glm::vec4(value, value, value, 1)), {}};
    EXPECT_TRUE(write_image(path(name), image, {}));
    return path(name);
  };
  std::vector<Json> all{told_of()};
  const auto expect_another = [&](const std::string& what) {
    const Json now = told_of();
    EXPECT_THAT(all, ::testing::Not(::testing::Contains(now))) << what;
    all.push_back(now);
  };
  const std::string color = set.pictures[3].file;
  set.pictures[3].mask = gray("mask.png", 1);
  expect_another("a mask");
  gray("mask.png", 0.5f);
  expect_another("another mask");
  set.pictures[3].mask = "";
  set.pictures[3].depth = gray("mask.png", 0.5f);
  expect_another("the same as depths");
  gray("mask.png", 1);
  expect_another("other depths");
  set.pictures[3].depth = "";
  EXPECT_EQ(told_of(), all[0]);
  std::filesystem::copy_file(set.pictures[4].file, color,
                             std::filesystem::copy_options::overwrite_existing);
  expect_another("other colours");
}

}  // namespace
}  // namespace slf
