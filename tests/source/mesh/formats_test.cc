// What the formats of meshes mean: each test compares a file with a plainer one that looks the
// same.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <algorithm>
#include <cctype>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>

#include "slf/image.h"
#include "slf/mesh.h"
#include "tests/temporary_folder.h"

namespace slf::mesh_formats {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;
using testing::TemporaryFolder;

void write(const std::string& path, const std::string& bytes) {
  std::filesystem::create_directories(std::filesystem::path(path).parent_path());
  std::ofstream(path, std::ios::binary) << bytes;
}

template <class T>
std::string bytes_of_all(const std::vector<T>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)};
}

/// 4x4 pixels, all different, and some transparent ones if `holes`.
std::string picture(bool holes = false) {
  Image image{4, 4, {}, {}};
  for (int k = 0; k < 16; ++k)
    image.rgba.emplace_back(0.1f + 0.05f * static_cast<float>(k), k % 4 * 0.3f, k % 3 * 0.4f, 1);
  for (int k = 0; holes && k < 16; k += 3) image.rgba[static_cast<std::size_t>(k)] *= 0.25f;
  const auto png = encode_image("t.png", image, {.transparent = true});
  return {reinterpret_cast<const char*>(png->data()), png->size()};
}

/// A glTF file that grows accessor by accessor: at first a square with a texture.
struct Gltf {
  json doc;
  std::string data;

  Gltf() {
    doc = {{"asset", {{"version", "2.0"}}},
           {"scene", 0},
           {"scenes", {{{"nodes", {0}}}}},
           {"nodes", {{{"mesh", 0}}}},
           {"meshes", {{{"primitives", {{{"material", 0}}}}}}},
           {"textures", {{{"source", 0}}}},
           {"images", {{{"bufferView", 0}, {"mimeType", "image/png"}}}}};
    doc["materials"] =
        json::array({{{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}}});
    view(picture());
    set("POSITION", floats("VEC3", {-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0}));
    set("TEXCOORD_0", floats("VEC2", {0, 1, 1, 1, 1, 0, 0, 0}));
    primitive()["indices"] = accessor<std::uint16_t>("SCALAR", 5123, {0, 1, 2, 0, 2, 3});
  }

  int view(const std::string& bytes) {
    while (data.size() % 4 != 0) data += '\0';
    doc["bufferViews"].push_back(
        {{"buffer", 0}, {"byteOffset", data.size()}, {"byteLength", bytes.size()}});
    data += bytes;
    return static_cast<int>(doc["bufferViews"].size()) - 1;
  }
  template <class T>
  int accessor(const std::string& type, int component, const std::vector<T>& values,
               bool normalized = false) {
    const std::size_t width = type == "SCALAR" ? 1 : type == "MAT4" ? 16 : type[3] - '0';
    doc["accessors"].push_back({{"bufferView", view(bytes_of_all(values))},
                                {"componentType", component},
                                {"count", values.size() / width},
                                {"normalized", normalized},
                                {"type", type}});
    return static_cast<int>(doc["accessors"].size()) - 1;
  }
  int floats(const std::string& type, const std::vector<float>& values) {
    return accessor(type, 5126, values);
  }
  json& primitive() { return doc["meshes"][0]["primitives"][0]; }
  json& material() { return doc["materials"][0]; }
  json& texture() { return material()["pbrMetallicRoughness"]["baseColorTexture"]; }
  void set(const std::string& attribute, int accessor) {
    primitive()["attributes"][attribute] = accessor;
  }
  [[nodiscard]] std::string glb() const {
    json whole = doc;
    if (!whole.contains("buffers")) whole["buffers"] = {{{"byteLength", data.size()}}};
    std::string text = whole.dump(), binary = data;
    while (text.size() % 4 != 0) text += ' ';
    while (binary.size() % 4 != 0) binary += '\0';
    const auto word = [](std::size_t v) {
      const auto small = static_cast<std::uint32_t>(v);
      return std::string(reinterpret_cast<const char*>(&small), 4);
    };
    return "glTF" + word(2) + word(28 + text.size() + binary.size()) + word(text.size()) + "JSON" +
           text + word(binary.size()) + std::string("BIN\0", 4) + binary;
  }
};

class MeshFormats : public ::testing::Test {
 protected:
  [[nodiscard]] Result<Mesh> read(const std::string& name, const std::string& bytes) const {
    write(folder_ / name, bytes);
    return read_mesh(folder_ / name);
  }
  [[nodiscard]] Error error(const std::string& name, const std::string& bytes) const {
    const auto mesh = read(name, bytes);
    return mesh ? Error{ErrorCode::failed, "accepted", {}} : mesh.error();
  }

  /// The unlit colours of a grid of rays through the box around both meshes.
  [[nodiscard]] static std::vector<glm::vec4> look(const Mesh& mesh) {
    const auto scene = MeshScene::make(mesh, {.shade = false});
    EXPECT_TRUE(scene) << scene.error().message;
    std::vector<glm::vec4> colors;
    if (!scene) return colors;
    const Sphere sphere = (*scene)->bounds();
    // Along y, where the square of a glTF or OBJ file is seen from its front, and askew.
    for (const glm::dvec3 along : {glm::dvec3(0, 1, 0), glm::dvec3(0.2, 0.5, -0.9)})
      for (int k = 0; k < 900; ++k) {
        const glm::dvec3 at(k % 30 / 15.0 - 0.97, 0.013, k / 30 / 15.0 - 0.97);
        const glm::dvec3 from = sphere.center + sphere.radius * (at - 2.0 * along);
        colors.push_back((*scene)->trace(from, from + 4 * sphere.radius * along).rgba);
      }
    return colors;
  }
  void expect_same(const std::string& name, const std::string& bytes, const std::string& plain_name,
                   const std::string& plain) const {
    const auto a = read(name, bytes), b = read(plain_name, plain);
    ASSERT_TRUE(a) << a.error().message;
    ASSERT_TRUE(b) << b.error().message;
    const auto seen = look(*a), expected = look(*b);
    ASSERT_EQ(seen.size(), expected.size());
    float largest = 0, any = 0;
    for (std::size_t k = 0; k < seen.size(); ++k) {
      const glm::vec4 d = glm::abs(seen[k] - expected[k]);
      largest = std::max({largest, d.r, d.g, d.b, d.a});
      any = std::max(any, expected[k].a);
    }
    EXPECT_LT(largest, 0.02f);
    EXPECT_EQ(any, 1);
  }
  void expect_same(const Gltf& a, const Gltf& b) const {
    expect_same("a.glb", a.glb(), "b.glb", b.glb());
  }
  void expect_other(const Gltf& a, const Gltf& b) const {
    const auto first = read("a.glb", a.glb()), second = read("b.glb", b.glb());
    ASSERT_TRUE(first && second);
    EXPECT_NE(look(*first), look(*second));
  }

  TemporaryFolder folder_;
};

TEST_F(MeshFormats, GltfTextureTransforms) {
  // The example of the extension's page: the lower left quadrant of the picture, turned clockwise.
  Gltf moved, plain;
  moved.texture()["extensions"]["KHR_texture_transform"] = {
      {"offset", {0, 1}}, {"rotation", M_PI / 2}, {"scale", {0.5, 0.5}}};
  plain.set("TEXCOORD_0", plain.floats("VEC2", {0.5, 1, 0.5, 0.5, 0, 0.5, 0, 1}));
  expect_same(moved, plain);

  // Scale comes before rotation. The set of coordinates is that of the extension.
  Gltf both, other;
  both.texture()["texCoord"] = 3;
  both.texture()["extensions"]["KHR_texture_transform"] = {
      {"offset", {0.3, 0.1}}, {"rotation", 0.5}, {"scale", {2, 0.5}}, {"texCoord", 0}};
  std::vector<float> uvs;
  const float c = std::cos(0.5f), s = std::sin(0.5f);
  for (const auto& [u, v] : {std::pair{0.f, 1.f}, {1.f, 1.f}, {1.f, 0.f}, {0.f, 0.f}}) {
    uvs.push_back(c * 2 * u + s * 0.5f * v + 0.3f);
    uvs.push_back(-s * 2 * u + c * 0.5f * v + 0.1f);
  }
  other.set("TEXCOORD_0", other.floats("VEC2", uvs));
  expect_same(both, other);
}

TEST_F(MeshFormats, GltfTextureCoordinates) {
  const std::vector<float> turned{1, 1, 1, 0, 0, 0, 0, 1};
  Gltf plain;
  plain.set("TEXCOORD_0", plain.floats("VEC2", turned));
  Gltf second;
  second.texture()["texCoord"] = 1;
  second.set("TEXCOORD_1", second.floats("VEC2", turned));
  expect_same(second, plain);
  expect_other(second, Gltf());
  Gltf bytes, shorts;
  bytes.set("TEXCOORD_0",
            bytes.accessor<std::uint8_t>("VEC2", 5121, {255, 255, 255, 0, 0, 0, 0, 255}, true));
  expect_same(bytes, plain);
  shorts.set("TEXCOORD_0", shorts.accessor<std::uint16_t>(
                               "VEC2", 5123, {65535, 65535, 65535, 0, 0, 0, 0, 65535}, true));
  expect_same(shorts, plain);
  for (const auto& [mode, from] : {std::pair{33648, 1.f}, {10497, 0.f}, {33071, 0.f}}) {
    // The square of the picture beside the first one.
    Gltf wrapped, held;
    wrapped.set("TEXCOORD_0", wrapped.floats("VEC2", {1.2f, 1, 1.8f, 1, 1.8f, 0, 1.2f, 0}));
    wrapped.doc["samplers"] = {{{"wrapS", mode}}};
    wrapped.doc["textures"][0]["sampler"] = 0;
    const float a = mode == 33071 ? 1 : std::abs(from - 0.2f),
                b = mode == 33071 ? 1 : std::abs(from - 0.8f);
    held.set("TEXCOORD_0", held.floats("VEC2", {a, 1, b, 1, b, 0, a, 0}));
    held.doc["samplers"] = {{{"wrapS", 33071}}};
    held.doc["textures"][0]["sampler"] = 0;
    expect_same(wrapped, held);
  }
}

TEST_F(MeshFormats, GltfQuantizedPositions) {
  Gltf small;
  small.doc["extensionsRequired"] = {"KHR_mesh_quantization"};
  small.set("POSITION",
            small.accessor<std::int8_t>(
                "VEC3", 5120, {-127, -127, 0, 127, -127, 0, 127, 127, 0, -127, 127, 0}, true));
  small.set("NORMAL", small.accessor<std::int8_t>(
                          "VEC3", 5120, {0, 0, 127, 0, 0, 127, 0, 0, 127, 0, 0, 127}, true));
  expect_same(small, Gltf());
  Gltf whole;
  whole.set("POSITION",
            whole.accessor<std::int16_t>("VEC3", 5122,
                                         {-200, -200, 0, 200, -200, 0, 200, 200, 0, -200, 200, 0}));
  whole.doc["nodes"][0]["scale"] = {0.005, 0.005, 0.005};
  expect_same(whole, Gltf());
}

TEST_F(MeshFormats, GltfSkinsFollowTheirJoints) {
  Gltf skinned, plain;
  skinned.set("JOINTS_0", skinned.accessor<std::uint8_t>(
                              "VEC4", 5121, {0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0}));
  skinned.set("WEIGHTS_0",
              skinned.accessor<std::uint8_t>(
                  "VEC4", 5121, {255, 0, 0, 0, 255, 0, 0, 0, 0, 255, 0, 0, 0, 255, 0, 0}, true));
  // The second joint is a child of the first; the inverse matrix takes its rest pose away.
  skinned.doc["nodes"] = {{{"mesh", 0}, {"skin", 0}, {"translation", {50, 0, 0}}},
                          {{"translation", {0.5, 0, 0}}, {"children", {2}}},
                          {{"translation", {0.25, 2, 0}}}};
  skinned.doc["scenes"][0]["nodes"] = {0, 1};
  const int matrices = skinned.floats("MAT4", {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0,  0, 1,  //
                                               1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, -1, 0, 1});
  skinned.doc["skins"] = {{{"joints", {1, 2}}, {"inverseBindMatrices", matrices}}};
  plain.set("POSITION", plain.floats("VEC3", {-0.5, -1, 0, 1.5, -1, 0, 1.75, 2, 0, -0.25, 2, 0}));
  expect_same(skinned, plain);
}

TEST_F(MeshFormats, GltfMorphsHaveTheirWeights) {
  Gltf morphed, plain;
  const int target = morphed.floats("VEC3", {0, 0, 0, 0, 0, 0, 2, 0, 0, 0, 0, 0});
  morphed.primitive()["targets"] = {{{"POSITION", target}}};
  morphed.doc["meshes"][0]["weights"] = {0.5};
  plain.set("POSITION", plain.floats("VEC3", {-1, -1, 0, 1, -1, 0, 2, 1, 0, -1, 1, 0}));
  expect_same(morphed, plain);
  morphed.doc["nodes"][0]["weights"] = {0.25};  // before those of the mesh
  plain.set("POSITION", plain.floats("VEC3", {-1, -1, 0, 1, -1, 0, 1.5, 1, 0, -1, 1, 0}));
  expect_same(morphed, plain);
  // Sparse targets are how exporters write them.
  morphed.doc["accessors"][target] = {
      {"componentType", 5126},
      {"count", 4},
      {"type", "VEC3"},
      {"sparse",
       {{"count", 1},
        {"indices",
         {{"bufferView", morphed.view(bytes_of_all<std::uint16_t>({2}))}, {"componentType", 5123}}},
        {"values", {{"bufferView", morphed.view(bytes_of_all<float>({2, 0, 0}))}}}}}};
  expect_same(morphed, plain);
}

TEST_F(MeshFormats, GltfMaterials) {
  Gltf plain, specular;
  plain.material()["pbrMetallicRoughness"]["baseColorFactor"] = {0.8, 0.1, 0.3, 1};
  specular.material() = {
      {"extensions",
       {{"KHR_materials_pbrSpecularGlossiness",
         {{"diffuseFactor", {0.8, 0.1, 0.3, 1}}, {"diffuseTexture", {{"index", 0}}}}}}}};
  expect_same(specular, plain);

  Gltf bytes, floats;
  bytes.set("COLOR_0", bytes.accessor<std::uint8_t>(
                           "VEC3", 5121, {255, 0, 0, 0, 255, 0, 0, 0, 255, 255, 255, 0}, true));
  floats.set("COLOR_0", floats.floats("VEC4", {1, 0, 0, 1, 0, 1, 0, 1, 0, 0, 1, 1, 1, 1, 0, 1}));
  expect_same(bytes, floats);
  expect_other(bytes, Gltf());

  Gltf bare;
  bare.primitive()["attributes"].erase("TEXCOORD_0");
  bare.doc["extensionsUsed"] = {"KHR_materials_transmission"};
  EXPECT_THAT(read("a.glb", bare.glb())->notes,
              ::testing::UnorderedElementsAre(HasSubstr("textures are not used"),
                                              HasSubstr("KHR_materials_transmission")));
}

TEST_F(MeshFormats, GltfThatOnlyGlowsIsShown) {
  const Gltf plain;
  Gltf glowing;
  glowing.material() = {{"pbrMetallicRoughness", {{"baseColorFactor", {0, 0, 0, 1}}}},
                        {"emissiveFactor", {1, 1, 1}},
                        {"emissiveTexture", {{"index", 0}}}};
  expect_same(glowing, plain);
  EXPECT_THAT(read("a.glb", glowing.glb())->notes, ::testing::Contains(HasSubstr("only glow")));
  Gltf both;
  both.material()["emissiveFactor"] = {1, 0, 0};
  expect_same(both, plain);
  EXPECT_THAT(read("a.glb", both.glb())->notes, ::testing::Contains(HasSubstr("left out")));
}

TEST_F(MeshFormats, AlphaOfOpaqueMaterialsIsIgnored) {
  Gltf holes;
  const std::string png = picture(true);
  holes.doc["bufferViews"][0] = {
      {"buffer", 0}, {"byteOffset", holes.data.size()}, {"byteLength", png.size()}};
  holes.data += png;
  expect_same(holes, Gltf());
  holes.material()["alphaMode"] = "BLEND";
  const auto blended = read("c.glb", holes.glb());
  ASSERT_TRUE(blended);
  const auto colors = look(*blended);
  EXPECT_TRUE(std::any_of(colors.begin(), colors.end(),
                          [](const glm::vec4& c) { return c.a > 0.2f && c.a < 0.3f; }));
  holes.material()["alphaMode"] = "MASK";
  EXPECT_NE(look(*read("c.glb", holes.glb())), colors);
  holes.material()["alphaCutoff"] = 0;  // all of it shows
  expect_same(holes, Gltf());
  // Nothing shows at all.
  holes.material()["alphaMode"] = "BLEND";
  holes.material()["pbrMetallicRoughness"]["baseColorFactor"] = {1, 1, 1, 0};
  const auto scene = MeshScene::make(*read("c.glb", holes.glb()));
  ASSERT_FALSE(scene);
  EXPECT_THAT(scene.error().message, HasSubstr("nothing can be seen"));
}

TEST_F(MeshFormats, GltfStripsAndFans) {
  for (const auto& [mode, order] : {std::pair{5, std::vector<std::uint8_t>{0, 1, 3, 2}},
                                    {6, std::vector<std::uint8_t>{0, 1, 2, 3}}}) {
    Gltf other;
    other.primitive()["mode"] = mode;
    other.primitive()["indices"] = other.accessor("SCALAR", 5121, order);
    expect_same(other, Gltf());
  }
  Gltf lines;
  lines.primitive()["mode"] = 1;
  EXPECT_THAT(error("lines.glb", lines.glb()).message, HasSubstr("only points or lines"));
}

TEST_F(MeshFormats, GltfNamesOfFiles) {
  const Gltf plain;
  Gltf named = plain;
  named.doc["buffers"] = {{{"byteLength", plain.data.size()}, {"uri", "b%20in%25.bin"}}};
  named.doc["images"] = {{{"uri", "my%20te%C3%BCx.png"}}};
  write(folder_ / "b in%.bin", plain.data);
  write(folder_ / "my te\xC3\xBCx.png", picture());
  expect_same("n.gltf", "\xEF\xBB\xBF" + named.doc.dump(), "b.glb", plain.glb());
  const auto named_mesh = read_mesh(folder_ / "n.gltf");
  ASSERT_TRUE(named_mesh) << named_mesh.error().message;
  EXPECT_THAT(named_mesh->files,
              ::testing::UnorderedElementsAre(folder_ / "n.gltf", folder_ / "b in%.bin",
                                              folder_ / "my te\xC3\xBCx.png"));

  std::string base64;
  for (std::size_t k = 0; k < plain.data.size(); k += 3) {
    std::uint32_t bits = 0;
    for (std::size_t i = 0; i < 3; ++i)
      bits = bits << 8 | (k + i < plain.data.size() ? std::uint8_t(plain.data[k + i]) : 0U);
    for (int shift = 18; shift >= 0; shift -= 6)
      base64 +=
          "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/"[bits >> shift & 63];
  }
  Gltf held = plain;
  held.doc["buffers"] = {{{"byteLength", plain.data.size()},
                          {"uri", "data:application/octet-stream;base64," + base64}}};
  expect_same("d.gltf", held.doc.dump(), "b.glb", plain.glb());
}

TEST_F(MeshFormats, MeshesNameOnlyRegularFilesAround) {
  Gltf named;
  const auto error_of = [&](const std::string& uri) {
    named.doc["buffers"] = {{{"byteLength", named.data.size()}, {"uri", uri}}};
    return error("in/side/n.gltf", named.doc.dump()).message;
  };
  write(folder_ / "in/beside/b.bin", named.data);
  EXPECT_EQ(error_of("../beside/b.bin"), "accepted");
  write(folder_ / "far.bin", named.data);
  EXPECT_THAT(error_of("../../far.bin"), HasSubstr("missing"));
  EXPECT_THAT(error_of(folder_ / "far.bin"), HasSubstr("missing"));
  write(folder_ / "in/.hidden/b.bin", named.data);
  EXPECT_THAT(error_of("../.hidden/b.bin"), HasSubstr("missing"));
  // Nothing waits for a pipe.
  const std::string pipe = folder_ / "in/side/pipe";
  ASSERT_EQ(::mkfifo(pipe.c_str(), 0600), 0);
  EXPECT_THAT(error_of("pipe"), HasSubstr("missing"));
  EXPECT_THAT(error("in/side/p.obj", "mtllib pipe\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").message,
              HasSubstr("accepted"));
  write(folder_ / "in/side/m.mtl", "newmtl m\nmap_Kd pipe\n");
  EXPECT_THAT(error("in/side/q.obj", "mtllib m.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
                  .message,
              HasSubstr("missing"));
}

TEST_F(MeshFormats, GltfThatIsNotReadIsNamed) {
  for (const char* name :
       {"KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_texture_basisu"}) {
    Gltf other;
    other.doc["extensionsRequired"] = {name};
    const Error why = error("a.glb", other.glb());
    EXPECT_EQ(why.code, ErrorCode::unsupported);
    EXPECT_THAT(why.message, HasSubstr(name));
  }
  Gltf draco;
  draco.doc["accessors"][0].erase("bufferView");
  draco.primitive()["extensions"]["KHR_draco_mesh_compression"] = json::object();
  EXPECT_EQ(error("a.glb", draco.glb()).code, ErrorCode::unsupported);
}

TEST_F(MeshFormats, GltfThatContradictsItselfIsRefused) {
  const auto message = [&](const std::function<void(Gltf&)>& change) {
    Gltf other;
    change(other);
    return error("a.glb", other.glb()).message;
  };
  EXPECT_EQ(message([](Gltf&) {}), "accepted");
  EXPECT_THAT(message([](Gltf& g) { g.doc["accessors"][0]["count"] = 5; }), HasSubstr("beyond"));
  EXPECT_THAT(message([](Gltf& g) { g.doc["accessors"][1]["count"] = 3; }),
              HasSubstr("4 vertices"));
  EXPECT_THAT(message([](Gltf& g) { g.doc["bufferViews"][1]["byteOffset"] = 1e9; }),
              HasSubstr("beyond its buffer"));
  EXPECT_THAT(message([](Gltf& g) { g.primitive()["material"] = 9; }),
              HasSubstr("no such material"));
  EXPECT_THAT(message([](Gltf& g) {
                g.primitive()["indices"] = g.accessor<std::uint8_t>("SCALAR", 5121, {0, 1, 4});
              }),
              HasSubstr("vertex 4 of 4"));
}

TEST_F(MeshFormats, MemoryIsInProportionToTheFile) {
  // A million instances, and zeros without any bytes behind them.
  Gltf many;
  many.doc["accessors"][0].erase("bufferView");
  many.doc["accessors"][0]["count"] = 4000000000U;
  EXPECT_EQ(error("a.glb", many.glb()).code, ErrorCode::unsupported);
  Gltf forest;
  std::vector<float> cloud(30000 * 3, 0.5f);
  forest.set("POSITION", forest.floats("VEC3", cloud));
  forest.primitive()["attributes"].erase("TEXCOORD_0");
  forest.doc["nodes"] = json::array();
  for (int k = 0; k < 1000; ++k) {
    forest.doc["nodes"].push_back({{"mesh", 0}});
    forest.doc["scenes"][0]["nodes"][static_cast<std::size_t>(k)] = k;
  }
  EXPECT_EQ(error("a.glb", forest.glb()).code, ErrorCode::unsupported);
}

// A square with a picture, in OBJ.
constexpr const char* kSquare =
    "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl m\n"
    "f 1/1 2/2 3/3 4/4\n";

TEST_F(MeshFormats, ObjNumbersLinesAndIndices) {
  const std::string plain = "v 0.5 0 0\nv 9 0 0\nv 9 9 0\nv -7 -7 0\nf 1 2 3\n";
  for (const char* other : {"v .5 0 0\nv 9 0 0\nv 9 9 0\nv -7 -7 0\nf 1 2 3\n",
                            "  v +5e-1 0 0\n\tv 9 0 0\n v 9. 9 0\n v -7 -7 0\n\t f 1 2 3\n",
                            "v .5 0 0\r\nv 9 0 0\r\nv 9 9 0\r\nv -7 -7 0\r\nf -4 -3 -2\r\n",
                            "v .5 0 0 # one\nv 9 0 0\nv 9 9 0\nf 1 2 3 # face\nv -7 -7 0\n",
                            "f 1// 2// 3//\nv .5 0 0\nv 9 \\\n0 0\nv 9 9 0\n",
                            "# C:\\\nv .5 0 0\nv 9 \\ \t\n0 0\nv 9 9 0\nf 1 2 3\n"})
    expect_same("a.obj", other, "b.obj", plain);
  EXPECT_THAT(error("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n").message,
              HasSubstr("line 4: a face has vertex '4' of 3"));
}

TEST_F(MeshFormats, ObjMaterials) {
  write(folder_ / "tex.png", picture());
  write(folder_ / "with blank.png", picture());
  write(folder_ / "sub/tex/t.png", picture());
  write(folder_ / "sub/m.mtl", "newmtl m\nmap_Kd tex\\t.png\n");
  const Gltf plain;
  const auto same = [&](const std::string& mtl, const Gltf& as) {
    SCOPED_TRACE(mtl);
    write(folder_ / "m.mtl", mtl);
    expect_same("a.obj", "mtllib m.mtl\n" + std::string(kSquare), "b.glb", as.glb());
  };
  same("newmtl m\nKd 1 1 1\nd 1\nmap_Kd tex.png\n", plain);
  same("newmtl m\nmap_Kd tex.png\n", plain);
  same("\xEF\xBB\xBFnewmtl m\r\n\tKd 1\r\n\tmap_Kd with blank.png \r\n", plain);
  same("newmtl m\nmap_Kd -blendu on -bm 1 -mm 0 1 -type cube C:\\work\\tex.png\n", plain);
  same("newmtl other\nmap_Kd none.png\nnewmtl m\nmap_Kd tex.png\n", plain);  // `other` is not used
  same("newmtl m\nTr 1\nmap_Kd tex.png\n", plain);                   // of old MeshLab: opaque
  same("newmtl m\nKd 0.00 0 0\nKa 0 0 0\nmap_Kd tex.png\n", plain);  // of Maya
  same("newmtl m\nmap_Ka tex.png\n", plain);
  same("newmtl m\nmap_Ka none.png\nmap_Kd tex.png\n", plain);
  same("newmtl m\nmap_Kd TEX.PNG\n", plain);
  same("newmtl m\nmap_Kd D:\\of\\others\\Sub\\tex\\T.png\n", plain);  // by its last folders
  same("newmtl m\nKd 0 0 0\nKe 1 1 1\nmap_Ke tex.png\n", plain);
  EXPECT_THAT(read_mesh(folder_ / "a.obj")->notes, ::testing::Contains(HasSubstr("only glow")));
  same("newmtl m\nKd 1 1 1\nmap_Kd tex.png\nKe 1 0 0\n", plain);
  EXPECT_THAT(read_mesh(folder_ / "a.obj")->notes, ::testing::Contains(HasSubstr("left out")));
  same("newmtl m\nKe 0 0 0\nmap_Kd tex.png\n", plain);
  EXPECT_THAT(read_mesh(folder_ / "a.obj")->notes, ::testing::IsEmpty());
  Gltf moved;
  // v' = 2 v + 0.5 upwards is 1 - v' downwards.
  moved.set("TEXCOORD_0",
            moved.floats("VEC2", {0.25f, 0.5f, 2.25f, 0.5f, 2.25f, -1.5f, 0.25f, -1.5f}));
  same("newmtl m\nmap_Kd -s 2 2 1 -o 0.25 0.5 tex.png\n", moved);
  expect_same("a.obj", "\xEF\xBB\xBFmtllib sub/m.mtl\n" + std::string(kSquare), "b.glb",
              plain.glb());
  EXPECT_THAT(read_mesh(folder_ / "a.obj")->files,
              ::testing::UnorderedElementsAre(folder_ / "a.obj", folder_ / "sub/m.mtl",
                                              folder_ / "sub/tex/t.png"));
  write(folder_ / "Gr\xC3\xBCn.png", picture());
  write(folder_ / "m.mtl", "newmtl m\nmap_Kd Gr\xFCn.png\n");  // Latin-1
  expect_same("a.obj", "mtllib \"m.mtl\"\n" + std::string(kSquare), "b.glb", plain.glb());
  write(folder_ / "m.mtl", "newmtl M\nKd 255 0 0\n");
  EXPECT_THAT(read("a.obj", "mtllib m.mtl\n" + std::string(kSquare))->notes,
              ::testing::UnorderedElementsAre(HasSubstr("above 1"), HasSubstr("material 'm'")));
  // Half of it shows, whatever the other half says.
  write(folder_ / "m.mtl", "newmtl m\nTr 0.75\nmap_Kd tex.png\n");
  const auto glass = read("a.obj", "mtllib m.mtl\n" + std::string(kSquare));
  EXPECT_FLOAT_EQ(glass->materials[0].color.a, 0.25f);
}

TEST_F(MeshFormats, PicturesThatAreNotReadAreUnsupported) {
  write(folder_ / "tex.bmp", "BM" + std::string(200, '\0'));
  write(folder_ / "m.mtl", "newmtl m\nmap_Kd tex.bmp\n");
  EXPECT_EQ(error("a.obj", "mtllib m.mtl\n" + std::string(kSquare)).code, ErrorCode::unsupported);
  write(folder_ / "tex.png", "\x89PNG damaged");
  write(folder_ / "m.mtl", "newmtl m\nmap_Kd tex.png\n");
  EXPECT_EQ(error("a.obj", "mtllib m.mtl\n" + std::string(kSquare)).code, ErrorCode::bad_file);
}

TEST_F(MeshFormats, ObjColours) {
  const std::string faces = "f 1 2 3 4\nf 5 6 7 8\n";
  const auto mesh = read("a.obj",
                         "o a\nv -1 -1 0\nv 0 -1 0\nv 0 1 0\nv -1 1 0\no b\nv 0 -1 0 1 0 0\n"
                         "v 1 -1 0 0 1 0\nv 1 1 0 0 0 1\nv 0 1 0 1 1 0\n" +
                             faces);
  ASSERT_TRUE(mesh) << mesh.error().message;
  EXPECT_EQ(mesh->colors.at(0), glm::u8vec4(255));
  EXPECT_EQ(mesh->colors.at(4), glm::u8vec4(255, 0, 0, 255));
  EXPECT_EQ(mesh->materials.at(0).color, glm::vec4(1));
  // With an alpha, with a weight, and as ZBrush paints.
  for (const char* text : {"v 0 0 0 1 0 0 1\nv 1 0 0 1 0 0 1\nv 0 1 0 1 0 0 1\nf 1 2 3\n",
                           "v 0 0 0 1 1 0 0\nv 1 0 0 1 1 0 0\nv 0 1 0 1 1 0 0\nf 1 2 3\n",
                           "v 0 0 0\nv 1 0 0\nv 0 1 0\n#MRGB ffff0000ffff0000ffff0000\nf 1 2 3\n"})
    EXPECT_EQ(read("a.obj", text)->colors.at(0), glm::u8vec4(255, 0, 0, 255)) << text;
}

TEST_F(MeshFormats, FacesThatTrHidesAreShown) {
  write(folder_ / "m.mtl", "newmtl m\nTr 1\nnewmtl n\nKd 1 0 0\n");
  const auto mesh = read("a.obj",
                         "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nusemtl m\nf 1 2 3\n"
                         "usemtl n\nf 1 2 4\n");
  ASSERT_TRUE(mesh) << mesh.error().message;
  EXPECT_EQ(mesh->materials.at(0).color.a, 1);
  EXPECT_THAT(mesh->notes, ::testing::ElementsAre(HasSubstr("'Tr 1' is taken for opaque")));
}

TEST_F(MeshFormats, ColoursMayRunTo255) {
  const std::string faces = "f 1 2 3\n";
  const auto whole = read("a.obj", "v 0 0 0 255 0 0\nv 1 0 0 0 51 0\nv 0 1 0 1 1 1\n" + faces);
  ASSERT_TRUE(whole) << whole.error().message;
  EXPECT_EQ(whole->colors.at(0), glm::u8vec4(255, 0, 0, 255));
  EXPECT_EQ(whole->colors.at(1), glm::u8vec4(0, 51, 0, 255));
  EXPECT_EQ(whole->colors.at(2), glm::u8vec4(1, 1, 1, 255));
  const auto ply_of = [&](const std::string& type, const std::string& alpha,
                          const std::string& numbers) {
    const auto mesh =
        read("a.ply",
             "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
             "property float z\nproperty " +
                 type + " red\nproperty " + type + " green\nproperty " + type + " blue\n" +
                 (alpha.empty() ? "" : "property " + alpha + " alpha\n") +
                 "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0 " +
                 numbers + "\n1 0 0 " + numbers + "\n0 1 0 " + numbers + "\n3 0 1 2\n");
    EXPECT_TRUE(mesh) << mesh.error().message;
    return mesh ? mesh->colors.at(0) : glm::u8vec4(0);
  };
  EXPECT_EQ(ply_of("float", "", "255 51 1"), glm::u8vec4(255, 51, 1, 255));
  EXPECT_EQ(ply_of("float", "", "1 0.2 0"), glm::u8vec4(255, 51, 0, 255));
  EXPECT_EQ(ply_of("double", "double", "255 51 1 102"), glm::u8vec4(255, 51, 1, 102));
  EXPECT_EQ(ply_of("float", "uchar", "1 0.2 0 102"), glm::u8vec4(255, 51, 0, 102));
  EXPECT_EQ(ply_of("uchar", "float", "255 51 1 0.4"), glm::u8vec4(255, 51, 1, 102));
  EXPECT_EQ(ply_of("ushort", "", "65535 13107 257"), glm::u8vec4(255, 51, 1, 255));
  EXPECT_EQ(ply_of("ushort", "", "255 51 1"), glm::u8vec4(255, 51, 1, 255));
  EXPECT_EQ(ply_of("float", "", "1.02 0.2 0"), glm::u8vec4(255, 51, 0, 255));  // interpolated
  EXPECT_EQ(ply_of("int", "", "255 51 1"), glm::u8vec4(255, 51, 1, 255));
  EXPECT_EQ(ply_of("uchar", "", "1 1 0"), glm::u8vec4(1, 1, 0, 255));
}

// Normals of all corners are made from all others at the same place.
TEST_F(MeshFormats, LargeFansTakeLinearTime) {
  constexpr int kTriangles = 150000;
  std::string text = "v 0 0 0\n";
  for (int k = 0; k < kTriangles; ++k) {
    const double angle = k * 2 * 3.14159265358979 / kTriangles;
    text +=
        "v " + std::to_string(std::cos(angle)) + ' ' + std::to_string(std::sin(angle)) + " 0.1\n";
  }
  for (int k = 0; k < kTriangles; ++k)
    text += "f 1 " + std::to_string(k + 2) + ' ' + std::to_string((k + 1) % kTriangles + 2) + '\n';
  const auto mesh = read("fan.obj", text);
  ASSERT_TRUE(mesh) << mesh.error().message;
  const auto begin = std::chrono::steady_clock::now();
  EXPECT_TRUE(MeshScene::make(*mesh));
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(60));
}

TEST_F(MeshFormats, FarCoordinatesKeepTheirDetail) {
  const auto strip = [](const glm::dvec3& at) {
    std::string text;
    char line[200];
    for (int k = 0; k < 41; ++k)
      for (const double y : {-1.0, 1.0}) {
        std::snprintf(line, sizeof line, "v %.3f %.3f %.3f\n", at.x + 0.05 * k - 1, at.y + y,
                      at.z + (k % 2) * 0.05);
        text += line;
      }
    for (int k = 0; k < 40; ++k)
      text += "f " + std::to_string(2 * k + 1) + ' ' + std::to_string(2 * k + 3) + ' ' +
              std::to_string(2 * k + 4) + ' ' + std::to_string(2 * k + 2) + '\n';
    return text;
  };
  const auto far = read("a.obj", strip({448262, 5411932, 55})),
             near = read("b.obj", strip({0, 0, 0}));
  ASSERT_TRUE(far && near);
  const auto a = MeshScene::make(*far), b = MeshScene::make(*near);
  ASSERT_TRUE(a && b);
  EXPECT_NEAR((*a)->bounds().center.z, 5411932, 1);
  for (int k = 0; k < 200; ++k) {
    const glm::dvec3 at(0.009 * k - 0.9, 0, 0.1), to = at + glm::dvec3(0.05, -1, 0.02);
    const glm::dvec3 shift = (*a)->bounds().center - (*b)->bounds().center;
    const RaySample x = (*a)->trace(shift + at + glm::dvec3(0, 1, 0), shift + to),
                    y = (*b)->trace(at + glm::dvec3(0, 1, 0), to);
    EXPECT_NEAR(x.depth, y.depth, 1e-5);
    EXPECT_NEAR(x.rgba.g, y.rgba.g, 1e-3);
  }
}

TEST_F(MeshFormats, ConcavePolygonsAreNotFilled) {
  // A U, which a fan around its first corner would fill.
  const auto mesh = read("a.obj",
                         "v 0 3 0\nv 0 0 0\nv 3 0 0\nv 3 3 0\nv 2 3 0\nv 2 1 0\nv 1 1 0\nv 1 3 0\n"
                         "f 1 2 3 4 5 6 7 8\n");
  ASSERT_TRUE(mesh) << mesh.error().message;
  EXPECT_EQ(mesh->triangles.size(), 6u);
  const auto scene = MeshScene::make(*mesh);
  const auto alpha = [&](double x, double y) {
    return (*scene)->trace({x, -1, y}, {x, 1, y}).rgba.a;
  };
  EXPECT_EQ(alpha(1.5, 2), 0);
  for (const glm::dvec2 p : {glm::dvec2(0.5, 2), {2.5, 2}, {1.5, 0.5}})
    EXPECT_EQ(alpha(p.x, p.y), 1);
}

std::string ply(const std::string& format, const std::string& rest) {
  return "ply\nformat " + format + " 1.0\n" + rest;
}

constexpr const char* kPlyVertices =
    "element vertex 4\nproperty float x\nproperty float y\nproperty float z\n";

TEST_F(MeshFormats, PlyFacesWithColoursAndCoordinates) {
  write(folder_ / "tex.png", picture());
  const std::string vertices = "-1 0 -1\n1 0 -1\n1 0 1\n-1 0 1\n";
  const auto colored = read(
      "a.ply", ply("ascii", std::string(kPlyVertices) +
                                "element face 2\nproperty list uchar int vertex_indices\n"
                                "property uchar red\nproperty uchar green\nproperty uchar blue\n"
                                "end_header\n" +
                                vertices + "3 0 1 2 255 0 0\n3 0 2 3 0 0 255\n"));
  ASSERT_TRUE(colored) << colored.error().message;
  EXPECT_EQ(colored->colors.at(colored->triangles[0].x), glm::u8vec4(255, 0, 0, 255));
  EXPECT_EQ(colored->colors.at(colored->triangles[1].x), glm::u8vec4(0, 0, 255, 255));
  // Each face has its part of the picture: the corners that they share have two coordinates.
  Gltf plain;
  plain.set("POSITION", plain.floats("VEC3", {-1, -1, 0, 1, -1, 0, 1, 1, 0,  //
                                              -1, -1, 0, 1, 1, 0, -1, 1, 0}));
  plain.set("TEXCOORD_0", plain.floats("VEC2", {0, 1, 1, 1, 1, 0, 0.5, 0.5, 1, 0.5, 1, 0}));
  plain.primitive().erase("indices");
  for (const char* comment :
       {"comment TextureFile tex.png\n", "comment TextureFile   tex.png  \r\n"})
    expect_same("a.ply",
                ply("ascii", comment + std::string(kPlyVertices) +
                                 "element face 2\nproperty list uchar int vertex_index\n"
                                 "property list uchar float texcoord\nend_header\n" +
                                 vertices + "3 0 1 2 6 0 0 1 0 1 1\n3 0 2 3 6 0.5 0.5 1 0.5 1 1\n"),
                "b.glb", plain.glb());
  EXPECT_THAT(read_mesh(folder_ / "a.ply")->files, ::testing::Contains(folder_ / "tex.png"));
  // The same in elements of their own, the second face first.
  const std::string elements = std::string(kPlyVertices) +
                               "element face 2\nproperty list uchar int vertex_indices\n"
                               "element multi_texture_vertex 5\nproperty uchar tx\n"
                               "property float u\nproperty float v\n"
                               "element multi_texture_face 2\nproperty uchar tx\n"
                               "property uint tn\n"
                               "property list uchar int texture_vertex_indices\nend_header\n" +
                               vertices + "3 0 1 2\n3 0 2 3\n" +
                               "0 0 0\n0 1 0\n0 1 1\n0 0.5 0.5\n0 1 0.5\n";
  expect_same(
      "a.ply",
      ply("ascii", "comment TextureFile tex.png\n" + elements + "0 1 3 3 4 2\n0 0 3 0 1 2\n"),
      "b.glb", plain.glb());
  // And before the faces.
  expect_same(
      "a.ply",
      ply("ascii", "comment TextureFile tex.png\n" + std::string(kPlyVertices) +
                       "element multi_texture_vertex 5\nproperty uchar tx\nproperty float u\n"
                       "property float v\nelement multi_texture_face 2\nproperty uchar tx\n"
                       "property uint tn\nproperty list uchar int texture_vertex_indices\n"
                       "element face 2\nproperty list uchar int vertex_indices\nend_header\n" +
                       vertices + "0 0 0\n0 1 0\n0 1 1\n0 0.5 0.5\n0 1 0.5\n" +
                       "0 1 3 3 4 2\n0 0 3 0 1 2\n3 0 1 2\n3 0 2 3\n"),
      "b.glb", plain.glb());
  for (const char* faces : {"0 2 3 0 1 2\n0 0 3 0 1 2\n", "0 0 3 0 1 5\n0 1 3 0 1 2\n"})
    EXPECT_EQ(error("a.ply", ply("ascii", elements + faces)).code, ErrorCode::bad_file);
  const auto unused =
      read("a.ply", ply("ascii", "comment TextureFile tex.png\n" + std::string(kPlyVertices) +
                                     "element face 1\nproperty list uchar int vertex_indices\n"
                                     "end_header\n" +
                                     vertices + "3 0 1 2\n"));
  ASSERT_TRUE(unused) << unused.error().message;
  EXPECT_THAT(unused->notes, ::testing::ElementsAre(HasSubstr("tex.png is not used")));
  // A face without a texture, and what else is no reason to be silent.
  const auto mixed = read(
      "a.ply", ply("ascii", "comment TextureFile tex.png\n" + std::string(kPlyVertices) +
                                "property uchar RED\nproperty uchar GREEN\n"
                                "property uchar BLUE\nelement material 1\nproperty int x\n"
                                "element face 2\nproperty list uchar int vertex_indices\n"
                                "property list uchar float texcoord\nproperty int texnumber\n"
                                "property uchar red\nproperty uchar green\n"
                                "property uchar blue\nend_header\n"
                                "-1 0 -1 9 9 9\n1 0 -1 9 9 9\n1 0 1 9 9 9\n-1 0 1 9 9 9\n5\n"
                                "3 0 1 2 6 0 0 1 0 1 1 0 1 2 3\n3 0 2 3 6 0 0 0 0 0 0 -1 1 2 3\n"));
  ASSERT_TRUE(mixed) << mixed.error().message;
  EXPECT_EQ(mixed->colors.at(0), glm::u8vec4(9, 9, 9, 255));
  EXPECT_TRUE(mixed->materials.at(mixed->material_of[0]).texture);
  EXPECT_FALSE(mixed->materials.at(mixed->material_of[1]).texture);
  EXPECT_THAT(mixed->notes, ::testing::UnorderedElementsAre(HasSubstr("'material' are not read"),
                                                            HasSubstr("colours of faces")));
}

template <class T>
std::string swapped(std::vector<T> values) {
  std::string bytes;
  for (const T& v : values) {
    std::string one(reinterpret_cast<const char*>(&v), sizeof v);
    std::reverse(one.begin(), one.end());
    bytes += one;
  }
  return bytes;
}

TEST_F(MeshFormats, PlyInAnyByteOrderWithStrips) {
  // The first byte of the data is a line feed.
  float first = 0;
  const std::uint32_t little = 0x3F00000A, big = 0x0A00003F;
  const std::vector<float> rest{0, -1, 1, 0, -1, -1, 0, 1, 1, 0, 1};
  std::memcpy(&first, &little, 4);
  const auto header = [](const std::string& faces) {
    return std::string(kPlyVertices) + faces + "end_header\n";
  };
  const std::string faces = "element face 1\nproperty list uchar int vertex_indices\n",
                    strips = "element tristrips 1\nproperty list int int vertex_indices\n";
  const auto from_little =
      read("a.ply", ply("binary_little_endian", header(faces) + bytes_of_all<float>({first}) +
                                                    bytes_of_all(rest) + std::string("\3", 1) +
                                                    bytes_of_all<std::int32_t>({0, 1, 2})));
  ASSERT_TRUE(from_little) << from_little.error().message;
  EXPECT_EQ(from_little->positions.at(0), glm::vec3(first, 0, -1));
  std::vector<float> all = rest;
  std::memcpy(&first, &big, 4);
  all.insert(all.begin(), first);
  const auto from_big =
      read("a.ply",
           ply("binary_big_endian", header(strips) + swapped(all) +
                                        swapped<std::int32_t>({9, 0, 1, 2, -1, 0, 1, 2, 3, 1})));
  ASSERT_TRUE(from_big) << from_big.error().message;
  EXPECT_EQ(from_big->positions.at(3), glm::vec3(1, 0, 1));
  ASSERT_EQ(from_big->triangles.size(), 4u);
  EXPECT_EQ(from_big->triangles[0], glm::uvec3(0, 1, 2));
  EXPECT_EQ(from_big->triangles[2], glm::uvec3(2, 1, 3));  // each second one is turned
  for (std::size_t cut = 1; cut < 30; ++cut) {
    std::ifstream file(folder_ / "a.ply", std::ios::binary);
    const std::string whole(std::istreambuf_iterator<char>(file), {});
    write(folder_ / "b.ply", whole.substr(0, whole.size() - cut));
    EXPECT_EQ(read_mesh(folder_ / "b.ply").error().code, ErrorCode::bad_file) << cut;
  }
}

TEST_F(MeshFormats, MisnamedFilesAreKnownByWhatTheyHold) {
  for (const char* name : {"a.ply", "a.obj", "a.stl", "a.glb", "a.gltf"})
    for (const auto& [begin, format] : {std::pair{"SIMPLE  =                    T", "FITS image"},
                                        {"GIF89a", "GIF picture"},
                                        {"Kaydara FBX Binary", "FBX scene"},
                                        {"<!DOCTYPE html><html>", "web page"},
                                        {"\x89HDF\r\n\x1a\n", "HDF5 file"},
                                        {"PK\3\4", "ZIP archive"}}) {
      const Error why = error(name, begin + std::string(400, ' '));
      EXPECT_EQ(why.code, ErrorCode::unsupported) << name << ": " << why.message;
      EXPECT_THAT(why.message, HasSubstr(format)) << name;
    }
}

TEST_F(MeshFormats, PointsAndSplatsAreNamed) {
  const std::string values = "0 0 0\n1 0 0\n0 1 0\n1 1 0\n";
  const Error points =
      error("a.ply", ply("ascii", std::string(kPlyVertices) + "end_header\n" + values));
  EXPECT_EQ(points.code, ErrorCode::unsupported);
  EXPECT_THAT(points.message, HasSubstr("4 points"));
  const Error splats =
      error("a.ply", ply("ascii",
                         "element vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
                         "property float f_dc_0\nproperty float scale_0\nend_header\n0 0 0 0 0\n"));
  EXPECT_EQ(splats.code, ErrorCode::unsupported);
  EXPECT_THAT(splats.message, HasSubstr("Gaussian splats"));
}

/// ASCII as UTF-16 with a mark, as PowerShell redirects text.
std::string as_utf16(const std::string& text) {
  std::string wide = "\xFF\xFE";
  for (const char c : text) wide += {c, '\0'};
  return wide;
}

TEST_F(MeshFormats, StlOfAnyProgram) {
  const std::string facet =
      "facet normal 0 0 1\n  outer loop\n   vertex 0 0 0\n vertex 1 0 0\nvertex 0 1 0\n endloop\n"
      "endfacet\n";
  std::string lower = facet;
  for (char& c : lower) c = static_cast<char>(std::toupper(c));
  for (const std::string& text :
       {"solid a\n" + facet + "endsolid a\n", "\n  solid part vertex\n" + facet + " endsolid\n",
        "solid a\n" + facet + "endsolid a\nsolid b\nendsolid b\n",
        "SOLID A\r\n" + lower + "ENDSOLID A\r\n", "solid a\n" + facet + "end solid a\n",
        "\xEF\xBB\xBFsolid a\n" + facet + "endsolid a\n",
        "# a comment\nsolid a\n" + facet + "endsolid a\n",
        "solid a\n" + facet + "endsolid a\n" + std::string(3, '\0'),
        as_utf16("solid a\n" + facet + "endsolid a\n")}) {
    const auto mesh = read("a.stl", text);
    ASSERT_TRUE(mesh) << text << mesh.error().message;
    EXPECT_EQ(mesh->triangles.size(), 1u);
    EXPECT_EQ(mesh->positions.at(2), glm::vec3(0, 1, 0));
  }
  const auto binary = [&](std::string header, std::uint16_t color, const std::string& more) {
    header.resize(80);
    const std::vector<float> numbers{0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0};
    return header + bytes_of_all<std::uint32_t>({1}) + bytes_of_all(numbers) +
           bytes_of_all<std::uint16_t>({color}) + more;
  };
  for (const char* header : {"solid exported by CAD", "anything"})
    for (const char* more : {"", "extra data"}) {
      const auto mesh = read("a.stl", binary(header, 0, more));
      ASSERT_TRUE(mesh) << mesh.error().message;
      EXPECT_EQ(mesh->positions.at(1), glm::vec3(1, 0, 0));
      EXPECT_TRUE(mesh->colors.empty());
    }
  for (const std::uint32_t count : {0u, ~0u, 1u}) {  // not known yet, or wrong
    auto text = binary("x", 0, binary("", 0, "").substr(84));
    std::memcpy(&text[80], &count, 4);
    const auto mesh = read("a.stl", text);
    ASSERT_TRUE(mesh) << mesh.error().message;
    EXPECT_EQ(mesh->triangles.size(), count == 1 ? 1u : 2u);
    EXPECT_EQ(mesh->notes.size(), count == 1 ? 1u : 0u);
  }
  EXPECT_EQ(read("a.stl", binary("x", 0xFC00, ""))->colors.at(0), glm::u8vec4(255, 0, 0, 255));
  // Of Magics, bit 15 means the colour of the whole.
  EXPECT_EQ(read("a.stl", binary("COLOR=\1\2\3\xFF", 0x001F, ""))->colors.at(0),
            glm::u8vec4(255, 0, 0, 255));
  EXPECT_EQ(read("a.stl", binary("COLOR=\1\2\3\xFF", 0x801F, ""))->colors.at(0),
            glm::u8vec4(1, 2, 3, 255));
  EXPECT_EQ(read("a.stl", binary("COLOR=\1\2\3\xFF", 0, ""))->colors.at(0),
            glm::u8vec4(1, 2, 3, 255));
}

}  // namespace
}  // namespace slf::mesh_formats
