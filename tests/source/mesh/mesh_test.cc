// Meshes: their files, which the tests write themselves, and rays to them.
#include "slf/mesh.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>

#include "slf/image.h"
#include "tests/field/field_testing.h"

namespace slf {
namespace {

using ::testing::HasSubstr;
using testing::TemporaryFolder;

void write(const std::string& path, const std::string& text) {
  std::ofstream(path, std::ios::binary) << text;
}

template <class T>
void append(std::string& bytes, std::initializer_list<T> values) {
  for (const T& v : values) bytes.append(reinterpret_cast<const char*>(&v), sizeof v);
}

std::string word(std::uint32_t v) { return {reinterpret_cast<const char*>(&v), sizeof v}; }

std::string glb(nlohmann::json gltf, std::string data) {
  while (data.size() % 4) data += '\0';
  gltf["asset"] = {{"version", "2.0"}};
  gltf["buffers"] = {{{"byteLength", data.size()}}};
  std::string text = gltf.dump();
  while (text.size() % 4) text += ' ';
  return "glTF" + word(2) + word(static_cast<std::uint32_t>(28 + text.size() + data.size())) +
         word(static_cast<std::uint32_t>(text.size())) + "JSON" + text +
         word(static_cast<std::uint32_t>(data.size())) + std::string("BIN\0", 4) + data;
}

/// A square in x, y from 0 to 1 in the file, moved by a node; with a texture of 2x2 pixels.
std::string square_glb(const std::string& png, const nlohmann::json& material_members) {
  std::string data;
  append<float>(data, {0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0});  // positions
  append<float>(data, {0, 1, 1, 1, 1, 0, 0, 0});              // texture coordinates, v down
  append<std::uint16_t>(data, {0, 1, 2, 0, 2, 3});
  const std::size_t picture = data.size();
  data += png;
  nlohmann::json material{{"name", "paint"},
                          {"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}};
  material.update(material_members);
  return glb({{"scenes", {{{"nodes", {0}}}}},
              {"scene", 0},
              {"nodes", {{{"mesh", 0}, {"translation", {10, 0, 0}}}}},
              {"meshes",
               {{{"primitives",
                  {{{"attributes", {{"POSITION", 0}, {"TEXCOORD_0", 1}}},
                    {"indices", 2},
                    {"material", 0}}}}}}},
              {"materials", nlohmann::json::array({material})},
              {"textures", {{{"source", 0}, {"sampler", 0}}}},
              {"samplers", {{{"wrapS", 33071}, {"wrapT", 33071}}}},
              {"images", {{{"bufferView", 3}, {"mimeType", "image/png"}}}},
              {"accessors",
               {{{"bufferView", 0},
                 {"componentType", 5126},
                 {"count", 4},
                 {"type", "VEC3"},
                 {"min", {0, 0, 0}},
                 {"max", {1, 1, 0}}},
                {{"bufferView", 1}, {"componentType", 5126}, {"count", 4}, {"type", "VEC2"}},
                {{"bufferView", 2}, {"componentType", 5123}, {"count", 6}, {"type", "SCALAR"}}}},
              {"bufferViews",
               {{{"buffer", 0}, {"byteOffset", 0}, {"byteLength", 48}},
                {{"buffer", 0}, {"byteOffset", 48}, {"byteLength", 32}},
                {{"buffer", 0}, {"byteOffset", 80}, {"byteLength", 12}},
                {{"buffer", 0}, {"byteOffset", picture}, {"byteLength", png.size()}}}}},
             data);
}

std::string quarters_png(float alpha_of_last) {
  Image image;
  image.width = image.height = 2;
  image.rgba = {{1, 0, 0, 1}, {0, 1, 0, 1}, {0, 0, 1, 1}, glm::vec4(alpha_of_last)};
  const auto png = encode_image("quarters.png", image, {.transparent = true});
  return {reinterpret_cast<const char*>(png->data()), png->size()};
}

/// A sphere of radius 1 in rings, without normals.
Mesh ball_mesh(int rings, const glm::vec3& center = glm::vec3(0)) {
  Mesh mesh;
  mesh.source = "ball";
  const int around = 2 * rings;
  for (int i = 0; i <= rings; ++i)
    for (int j = 0; j < around; ++j) {
      const double polar = M_PI * i / rings, angle = 2 * M_PI * j / around;
      mesh.positions.push_back(center + glm::vec3(std::sin(polar) * std::cos(angle),
                                                  std::sin(polar) * std::sin(angle),
                                                  std::cos(polar)));
    }
  const auto at = [&](int i, int j) { return static_cast<unsigned>(i * around + j % around); };
  for (int i = 0; i < rings; ++i)
    for (int j = 0; j < around; ++j) {
      if (i > 0) mesh.triangles.push_back({at(i, j), at(i + 1, j), at(i, j + 1)});
      if (i < rings - 1) mesh.triangles.push_back({at(i, j + 1), at(i + 1, j), at(i + 1, j + 1)});
    }
  return mesh;
}

/// A square of side 2 `size` around (0, 0, z).
void add_floor(Mesh& mesh, float z, float size) {
  const auto first = static_cast<unsigned>(mesh.positions.size());
  for (const glm::vec2 p : {glm::vec2(-1, -1), {1, -1}, {1, 1}, {-1, 1}})
    mesh.positions.emplace_back(size * p, z);
  mesh.triangles.push_back({first, first + 1, first + 2});
  mesh.triangles.push_back({first, first + 2, first + 3});
}

std::unique_ptr<MeshScene> scene_of(Mesh mesh, const MeshOptions& options = {}) {
  auto scene = MeshScene::make(std::move(mesh), options);
  EXPECT_TRUE(scene) << scene.error().message;
  return scene ? std::move(*scene) : nullptr;
}

TEST(Mesh, DepthIsExactAtTheFirstHit) {
  Mesh mesh;
  add_floor(mesh, 0.25f, 1);
  add_floor(mesh, -0.5f, 1);
  const auto scene = scene_of(mesh);
  const RaySample down = scene->trace({0.1, 0.2, 1}, {0.1, 0.2, -1});
  EXPECT_EQ(down.rgba.a, 1);
  EXPECT_NEAR(down.depth, 0.375, 1e-7);
  const RaySample up = scene->trace({0.1, 0.2, -1}, {0.1, 0.2, 1});  // two-sided
  EXPECT_NEAR(up.depth, 0.25, 1e-7);
  EXPECT_EQ(scene->trace({3, 0, 1}, {3, 0, -1}).rgba.a, 0);
}

TEST(Mesh, NormalsAreSmoothOnCurvesAndSharpAtEdges) {
  // The light is along the normal at 45 degrees: if shading is smooth, there is no step between
  // the neighbouring triangles of a coarse ball.
  MeshOptions options;
  options.light = {1, 0, 1};
  options.ambient = 0;
  const auto scene = scene_of(ball_mesh(12), options);
  float last = -1, largest_step = 0;
  for (double polar = 0.5; polar < 2; polar += 0.002) {
    const glm::dvec3 out(std::sin(polar), 0.01, std::cos(polar));
    const float shown = scene->trace(2.0 * out, -2.0 * out).rgba.g;
    if (last >= 0) largest_step = std::max(largest_step, std::abs(shown - last));
    last = shown;
  }
  EXPECT_LT(largest_step, 0.01f);  // flat triangles: steps of up to 0.2

  Mesh edge;  // two squares that meet at a right angle
  edge.positions = {{0, -1, 0}, {0, 1, 0}, {1, 1, 0}, {1, -1, 0}, {0, 1, -1}, {0, -1, -1}};
  edge.triangles = {{0, 1, 2}, {0, 2, 3}, {0, 1, 4}, {0, 4, 5}};
  options.light = {0, 0, 1};
  const auto sharp = scene_of(edge, options);
  EXPECT_NEAR(sharp->trace({0.01, 0, 1}, {0.01, 0, -2}).rgba.g, 1, 0.01);
}

TEST(Mesh, ReadsGlbWithNodesAndEmbeddedTextures) {
  const TemporaryFolder folder;
  write(folder / "a.glb", square_glb(quarters_png(1), nlohmann::json::object()));
  auto mesh = read_mesh(folder / "a.glb");
  ASSERT_TRUE(mesh) << mesh.error().message;
  EXPECT_EQ(mesh->triangles.size(), 2u);
  ASSERT_EQ(mesh->textures.size(), 1u);
  MeshOptions unlit;
  unlit.shade = false;
  const auto scene = scene_of(std::move(*mesh), unlit);
  // glTF's y is up, and its front, +z, is -y.
  const auto color = [&](double x, double up) {
    const glm::vec4 c = scene->trace({10 + x, -1, up}, {10 + x, 1, up}).rgba;
    return glm::ivec3(glm::round(10.f * glm::vec3(c)));
  };
  EXPECT_EQ(color(0.1, 0.9), glm::ivec3(10, 0, 0));
  EXPECT_EQ(color(0.9, 0.9), glm::ivec3(0, 10, 0));
  EXPECT_EQ(color(0.1, 0.1), glm::ivec3(0, 0, 10));
  EXPECT_EQ(color(0.9, 0.1), glm::ivec3(10, 10, 10));
}

TEST(Mesh, CutsOutAndBlends) {
  const TemporaryFolder folder;
  const auto opacity_at_last_quarter = [&](const nlohmann::json& material) {
    write(folder / "a.glb", square_glb(quarters_png(0.4f), material));
    auto mesh = read_mesh(folder / "a.glb");
    EXPECT_TRUE(mesh) << mesh.error().message;
    return scene_of(std::move(*mesh))->trace({10.9, -1, 0.1}, {10.9, 1, 0.1}).rgba.a;
  };
  EXPECT_EQ(opacity_at_last_quarter({{"alphaMode", "OPAQUE"}}), 1);
  EXPECT_EQ(opacity_at_last_quarter({{"alphaMode", "MASK"}}), 0);
  EXPECT_EQ(opacity_at_last_quarter({{"alphaMode", "MASK"}, {"alphaCutoff", 0.3}}), 1);
  EXPECT_NEAR(opacity_at_last_quarter({{"alphaMode", "BLEND"}}), 0.4, 0.01);
}

TEST(Mesh, TextureCoordinatesThatAreNotFiniteAreZero) {
  const float kMost = std::numeric_limits<float>::max();
  const auto colors = [&](float u, MeshWrap wrap) {
    Mesh mesh;
    add_floor(mesh, 0, 1);
    mesh.uvs.assign(4, {u, u});
    mesh.textures.resize(1);
    mesh.textures[0].width = mesh.textures[0].height = 3;
    for (int k = 0; k < 9; ++k)
      mesh.textures[0].texels.emplace_back(std::uint8_t(20 * k), 0, 0, 255);
    mesh.materials.resize(1);
    mesh.materials[0].texture = 0;
    mesh.materials[0].wrap_u = mesh.materials[0].wrap_v = wrap;
    MeshOptions unlit;
    unlit.shade = false;
    const auto scene = scene_of(std::move(mesh), unlit);
    std::vector<float> red;
    for (double x = -0.9; x < 1; x += 0.01)
      red.push_back(scene->trace({x, 0.4, 1}, {x, 0.4, -1}).rgba.r);
    return red;
  };
  for (const MeshWrap wrap : {MeshWrap::clamp, MeshWrap::repeat, MeshWrap::mirror}) {
    const auto zero = colors(0, wrap);
    EXPECT_EQ(colors(std::numeric_limits<float>::quiet_NaN(), wrap), zero);
    EXPECT_EQ(colors(-std::numeric_limits<float>::infinity(), wrap), zero);
    if (wrap != MeshWrap::clamp) {
      EXPECT_EQ(colors(kMost, wrap), zero);
    }
  }
}

constexpr const char* kPly =
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    "property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
    "element face 1\nproperty list uchar int vertex_indices\nend_header\n";

TEST(Mesh, ReadsColoursOfPlyVertices) {
  const TemporaryFolder folder;
  write(folder / "a.ply",
        std::string(kPly) + "0 0 0 200 100 0\n1 0 0 200 100 0\n0 1 0 200 100 0\n3 0 1 2\n");
  auto mesh = read_mesh(folder / "a.ply");
  ASSERT_TRUE(mesh) << mesh.error().message;
  MeshOptions unlit;
  unlit.shade = false;
  const glm::vec4 color =
      scene_of(std::move(*mesh), unlit)->trace({0.2, 0.2, 1}, {0.2, 0.2, -1}).rgba;
  EXPECT_NEAR(color.r, 200 / 255.0, 0.003);
  EXPECT_NEAR(color.g, 100 / 255.0, 0.003);
  EXPECT_NEAR(color.b, 0, 0.003);
}

TEST(Mesh, NamesWhatIsWrongWithAFile) {
  const TemporaryFolder folder;
  const auto error = [&](const std::string& name, const std::string& bytes) {
    write(folder / name, bytes);
    const auto mesh = read_mesh(folder / name);
    if (mesh) return std::string("accepted");
    EXPECT_THAT(mesh.error().message, HasSubstr(name));
    return mesh.error().message;
  };
  EXPECT_THAT(read_mesh(folder / "none.obj").error().message, HasSubstr("no such file"));
  EXPECT_THAT(error("empty.obj", ""), HasSubstr("empty"));
  EXPECT_THAT(error("points.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n"), HasSubstr("3 points"));
  EXPECT_THAT(
      error("nan.ply", std::string(kPly) + "nan 0 0 1 1 1\n1 0 0 1 1 1\n0 1 0 1 1 1\n3 0 1 2\n"),
      HasSubstr("not finite"));
  EXPECT_THAT(error("short.ply", std::string(kPly) + "0 0 0"), HasSubstr("truncated"));
  EXPECT_THAT(error("many.ply", std::string(kPly).replace(36, 1, "4000000000")),
              HasSubstr("4000000000"));
  EXPECT_THAT(error("short.stl", std::string(80, ' ') + word(1000) + std::string(50, '\0')),
              HasSubstr("truncated"));
  EXPECT_THAT(error("solid.stl", "solid a\nfacet normal 0 0 1\nouter loop\n"),
              HasSubstr("truncated"));
  write(folder / "a.mtl", "newmtl wood\nmap_Kd oak.png\n");
  EXPECT_THAT(
      error("a.obj",
            "mtllib a.mtl\nusemtl wood\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n"),
      AllOf(HasSubstr("wood"), HasSubstr("oak.png"), HasSubstr("missing")));
  const std::string good = square_glb(quarters_png(1), nlohmann::json::object());
  for (std::size_t size : {std::size_t{3}, std::size_t{19}, good.size() / 2, good.size() - 1})
    EXPECT_NE(error("cut.glb", good.substr(0, size)), "accepted") << size;
  EXPECT_THAT(error("needs.glb", glb({{"extensionsRequired", {"KHR_texture_basisu"}}}, "")),
              HasSubstr("KHR_texture_basisu"));
  EXPECT_THAT(error("cycle.glb", glb({{"scenes", {{{"nodes", {0}}}}},
                                      {"nodes", {{{"children", {1}}}, {{"children", {0}}}}}},
                                     "")),
              HasSubstr("ancestor"));
}

TEST(Mesh, RefusesImpossibleMeshes) {
  const auto error = [](Mesh mesh) {
    const auto scene = MeshScene::make(std::move(mesh));
    return scene ? std::string("accepted") : scene.error().message;
  };
  Mesh flat;
  flat.positions = {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}};
  flat.triangles = {{0, 1, 2}};
  EXPECT_THAT(error(flat), HasSubstr("has an area"));
  Mesh far = flat;
  far.positions[2] = {1e30f, 1, 0};
  EXPECT_THAT(error(far), HasSubstr("larger units"));
  Mesh nan = flat;
  nan.positions[1].y = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THAT(error(nan), HasSubstr("vertex 1"));
  Mesh wrong = flat;
  wrong.triangles[0].z = 3;
  EXPECT_THAT(error(wrong), HasSubstr("vertex 3 of 3"));
}

TEST(Mesh, HashesAllThatShows) {
  const Mesh mesh = ball_mesh(4);
  Mesh colored = mesh;
  colored.colors.assign(mesh.positions.size(), glm::u8vec4(9));
  Mesh moved = mesh;
  moved.positions[3].x += 1e-3f;
  Mesh renamed = mesh;
  renamed.source = "other";
  EXPECT_NE(content_hash(mesh), content_hash(colored));
  EXPECT_NE(content_hash(mesh), content_hash(moved));
  EXPECT_EQ(content_hash(mesh), content_hash(renamed));
}

MeshOptions lit(Lighting mode, const std::string& rig) {
  MeshOptions options;
  options.lighting.mode = mode;
  options.lighting.rig = *read_rig(rig);
  options.lighting.tone.curve = ToneCurve::none;
  return options;
}

TEST(Mesh, CastsShadows) {
  Mesh mesh = ball_mesh(16, {0, 0, 1.2f});
  add_floor(mesh, 0, 3);
  MeshOptions options = lit(Lighting::shadowed, "sun");
  options.lighting.rig.sky = {};
  options.lighting.rig.lights = {{.direction = {0, 0, 1}, .color = glm::vec3(1)}};
  const auto scene = scene_of(mesh, options);
  const auto floor_at = [&](double x) {
    return scene->trace({x, 0.01, -1}, {x, 0.01, 0.1}).rgba;  // from below: the unlit side
  };
  EXPECT_EQ(floor_at(2).g, 0);
  const auto from_side = [&](double x) {
    return scene->trace({x, -1.5, 0.1}, {x, 0.01, -0.001}).rgba.g;
  };
  EXPECT_NEAR(from_side(2), 1, 0.01);  // a white surface that faces a light of intensity 1
  EXPECT_NEAR(from_side(0), 0, 0.01);
}

TEST(Mesh, ReflectsLightOfOtherSurfaces) {
  // Under an even sky, a ball on a floor is darkest below; light that both reflect brightens it,
  // but nothing exceeds the sky.
  Mesh mesh = ball_mesh(16, {0, 0, 1.05f});
  add_floor(mesh, 0, 3);
  const auto under = [&](Lighting mode) {
    MeshOptions options = lit(mode, "overcast");
    options.lighting.rig.sky = {glm::vec3(1), glm::vec3(1), glm::vec3(1)};
    return scene_of(mesh, options)->trace({0.9, -1.5, 0.1}, {0.9, 0, -0.001}).rgba.g;
  };
  const float shadowed = under(Lighting::shadowed), global = under(Lighting::global);
  EXPECT_GT(shadowed, 0.1f);
  EXPECT_LT(shadowed, 0.8f);
  EXPECT_GT(global, shadowed + 0.05f);
  EXPECT_LE(global, 1.01f);
}

TEST(Mesh, LightDoesNotDependOnTheSizeOfTriangles) {
  // One triangle stands for its small neighbours where reflected light is gathered.
  const auto under = [&](int rings) {
    Mesh mesh = ball_mesh(rings, {0, 0, 1.05f});
    add_floor(mesh, 0, 3);
    MeshOptions options = lit(Lighting::global, "overcast");
    options.lighting.rig.sky = {glm::vec3(1), glm::vec3(1), glm::vec3(1)};
    return scene_of(mesh, options)->trace({0.9, -1.5, 0.1}, {0.9, 0, -0.001}).rgba.g;
  };
  EXPECT_NEAR(under(64), under(600), 0.02);
}

TEST(Mesh, LightPassesThroughHolesAndNotThroughTheRest) {
  Mesh mesh;
  add_floor(mesh, 0, 3);
  add_floor(mesh, 1, 1);
  mesh.uvs.assign(mesh.positions.size(), glm::vec2(0));
  for (const glm::vec2 corner : {glm::vec2(0, 0), {1, 0}, {1, 1}, {0, 1}})
    mesh.uvs[4 + static_cast<std::size_t>(corner.y > 0 ? 3 - corner.x : corner.x)] = corner;
  mesh.textures = {{"half", 2, 1, {glm::u8vec4(0), glm::u8vec4(255)}}};
  mesh.materials.resize(2);
  mesh.materials[1].texture = 0;
  mesh.materials[1].opacity = MeshOpacity::cutout;
  mesh.material_of = {0, 0, 1, 1};
  MeshOptions options = lit(Lighting::shadowed, "sun");
  options.lighting.rig.sky = {};
  options.lighting.rig.lights = {{.direction = {0, 0, 1}, .color = glm::vec3(1)}};
  const auto scene = scene_of(mesh, options);
  const auto floor_at = [&](double x) {
    return scene->trace({x, 0.1, 0.5}, {x, 0.1, -0.1}).rgba.g;
  };
  EXPECT_NEAR(floor_at(-0.5), 1, 0.01);
  EXPECT_NEAR(floor_at(0.5), 0, 0.01);
}

TEST(Mesh, FilesWithoutColoursAreGrey) {
  const TemporaryFolder folder;
  write(folder / "a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
  const auto mesh = read_mesh(folder / "a.obj");
  ASSERT_TRUE(mesh) << mesh.error().message;
  ASSERT_EQ(mesh->materials.size(), 1u);
  EXPECT_FLOAT_EQ(mesh->materials[0].color.r, 0.6f);
}

TEST(Mesh, FieldIsTheSameForAnyNumberOfThreads) {
  const TemporaryFolder folder;
  Mesh mesh = ball_mesh(10, {0, 0, 1.2f});
  add_floor(mesh, 0, 2);
  for (const Lighting mode : {Lighting::direct, Lighting::global}) {
    MeshOptions options = lit(mode, "studio");
    options.lighting.samples = 8;
    options.lighting.spacing = 8;
    testing::Payloads tiles[2];
    for (const unsigned threads : {1u, 4u}) {
      BuildOptions build = testing::lossless_options(2, 8, 1);
      build.threads = threads;
      const std::string path = folder / ("t" + std::to_string(threads) + ".slf");
      std::filesystem::remove(path);
      const auto field = testing::build_and_open(*scene_of(mesh, options), path, build);
      ASSERT_TRUE(field);
      tiles[threads == 4] = testing::all_tiles(*field);
    }
    EXPECT_FALSE(tiles[0].empty());
    EXPECT_EQ(tiles[0], tiles[1]);
  }
}

}  // namespace
}  // namespace slf
