// Meshes of any bytes: an error that names the file, or a mesh that keeps its promises, and rays
// to it. The first byte chooses the format.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

#include "slf/image.h"
#include "slf/mesh.h"
#include "tests/temporary_folder.h"

namespace {

constexpr std::array<const char*, 5> kExtensions{"glb", "gltf", "obj", "ply", "stl"};

void require(bool condition) {
  if (!condition) std::abort();
}

// A folder of this process, with the files that meshes may name.
struct Scratch : slf::testing::TemporaryFolder {
  Scratch() {
    require(!path().empty());
    std::ofstream(path() + "/m.mtl") << "newmtl a\nKd 1 0 0\nmap_Kd t.png\nmap_d t.png\n"
                                     << "newmtl b\nd 0.5\n";
    std::ofstream(path() + "/b.bin", std::ios::binary) << std::string(256, '\x3f');
    const slf::Image picture{2, 2, std::vector<glm::vec4>(4, glm::vec4(0.5f)), {}};
    require(bool(slf::write_image(path() + "/t.png", picture, {.transparent = true})));
  }
};

void check(const slf::Mesh& mesh) {
  const std::size_t count = mesh.positions.size();
  require(!mesh.triangles.empty());
  require(mesh.normals.empty() || mesh.normals.size() == count);
  require(mesh.uvs.empty() || mesh.uvs.size() == count);
  require(mesh.colors.empty() || mesh.colors.size() == count);
  require(mesh.material_of.empty() || mesh.material_of.size() == mesh.triangles.size());
  for (const glm::vec3& p : mesh.positions)
    require(std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z));
  for (const glm::uvec3& t : mesh.triangles) require(t.x < count && t.y < count && t.z < count);
  for (const std::uint32_t m : mesh.material_of) require(m < mesh.materials.size());
  for (const slf::MeshMaterial& m : mesh.materials)
    require(!m.texture || *m.texture < mesh.textures.size());
  for (const slf::MeshTexture& t : mesh.textures)
    require(t.texels.size() == std::size_t{t.width} * t.height && !t.texels.empty());
}

void trace(slf::Mesh mesh) {
  slf::MeshOptions options;
  options.lighting.mode = slf::Lighting::direct;
  const auto scene = slf::MeshScene::make(std::move(mesh), options);
  if (!scene) {
    require(!scene.error().message.empty());
    return;
  }
  const slf::Sphere sphere = (*scene)->bounds();
  require(sphere.radius > 0 && std::isfinite(sphere.radius));
  for (int k = 0; k < 16; ++k) {
    const double a = 0.4 * k, z = 0.1 * (k - 8), r = std::sqrt(1 - z * z);
    const glm::dvec3 side = sphere.radius * glm::dvec3(r * std::cos(a), r * std::sin(a), z);
    const auto sample = (*scene)->trace(sphere.center + side, sphere.center - 0.9 * side);
    for (int c = 0; c < 4; ++c) require(std::isfinite(sample.rgba[c]) && sample.rgba[c] >= 0);
    require(sample.depth >= 0 && sample.depth <= 1);
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const Scratch scratch;
  if (size == 0) return 0;
  const std::string path = scratch.path() + "/input." + kExtensions[data[0] % kExtensions.size()];
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(data) + 1, static_cast<std::streamsize>(size - 1));
  auto mesh = slf::read_mesh(path);
  if (!mesh) {
    require(mesh.error().message.find("input.") != std::string::npos);
    return 0;
  }
  require(!mesh->files.empty() && mesh->files.front() == path);
  check(*mesh);
  if (mesh->triangles.size() < 10000) trace(std::move(*mesh));
  return 0;
}
