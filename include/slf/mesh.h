// Mesh: triangles with colours, textures and normals; reading them from files, and rays to them.
//
//   auto mesh = slf::read_mesh("model.glb");
//   auto scene = slf::MeshScene::make(std::move(*mesh), {});
//
// World coordinates are LPS as those of volumes: +z is up, and -y is the front.
#pragma once

#include <cstdint>
#include <glm/glm.hpp>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "slf/error.h"
#include "slf/light.h"
#include "slf/scene.h"

namespace slf {

/// 8 bits per channel, sRGB, and alpha, not premultiplied; rows from the top.
struct MeshTexture {
  std::string name;  ///< for messages
  std::uint32_t width = 0, height = 0;
  std::vector<glm::u8vec4> texels;

  void describe(auto& member) const {
    member("name", name, "");
    member("width_pixels", width, "");
    member("height_pixels", height, "");
  }
};

/// How a texture continues beyond its edges.
enum class MeshWrap : std::uint8_t { clamp, repeat, mirror };

enum class MeshOpacity : std::uint8_t {
  opaque,  ///< alpha is ignored
  cutout,  ///< alpha below MeshMaterial::cutoff is a hole, any other is opaque
  blend,   ///< translucent: what lies behind shows through
};

struct MeshMaterial {
  std::string name;
  glm::vec4 color{1};  ///< linear RGB and alpha, which multiply texture and vertex colour
  std::optional<std::size_t> texture;  ///< index into Mesh::textures
  MeshWrap wrap_u = MeshWrap::repeat, wrap_v = MeshWrap::repeat;
  MeshOpacity opacity = MeshOpacity::opaque;
  float cutoff = 0.5f;
};

/// Triangles with shared vertices. Attributes that a mesh does not have are empty; otherwise they
/// have an element for each position.
struct Mesh {
  std::string source;    ///< the path, for people
  glm::dvec3 origin{0};  ///< positions are relative to it, as coordinates of maps need it
  std::vector<glm::vec3> positions;
  /// Any length. A normal of 0 stands for none: then triangles that meet there at less than 60°
  /// look smooth.
  std::vector<glm::vec3> normals;
  std::vector<glm::vec2> uvs;       ///< (0, 0) is the top left corner of a texture
  std::vector<glm::u8vec4> colors;  ///< sRGB, and alpha, not premultiplied
  std::vector<glm::uvec3> triangles;
  std::vector<std::uint32_t> material_of;  ///< of each triangle; empty: all have material 0
  std::vector<MeshMaterial> materials;
  std::vector<MeshTexture> textures;
  std::vector<std::string> files;  ///< what it was read from
  std::vector<std::string> notes;  ///< what a person should know, as "12 points were left out"
};

/// The axis of a file that points up in the world. The other axes keep their handedness.
enum class UpAxis : std::uint8_t {
  by_format,  ///< y for glTF and OBJ, z for PLY and STL, as in Blender
  y,          ///< file (x, y, z) is world (x, -z, y)
  z,          ///< file coordinates are world coordinates
};

/// Whether the path ends in .glb, .gltf, .obj, .ply or .stl, in any case.
[[nodiscard]] bool is_mesh_name(std::string_view path);

/// Reads glTF 2 (.glb, .gltf), OBJ, PLY or STL, with node transforms, the pose of skins and of
/// morphs that the file gives, and with the textures that it holds or names. PLY, OBJ and STL files
/// without any colour become light grey. Polygons become triangles; points and lines are left out.
/// A mesh may name files in its own folder, beside that folder, and below either.
/// io: the mesh or one of its textures is missing, unreadable or no regular file. bad_file:
/// damaged, truncated, has no triangles or a vertex that is not finite. unsupported: only points or
/// Gaussian splats, an extension of glTF that it requires, a picture of another format, more than
/// 2^28 triangles, a file of more than 8 GiB, a mesh whose instances need much more memory than its
/// files have bytes.
[[nodiscard]] Result<Mesh> read_mesh(const std::string& path, UpAxis up = UpAxis::by_format);

/// "xxh3-128:" and 32 hexadecimal digits: a hash of everything that shows. Equal meshes have equal
/// hashes, whatever file they were read from.
[[nodiscard]] std::string content_hash(const Mesh& mesh);

/// How a mesh is lit. Surfaces are Lambertian and two-sided. RaycastOptions, which volumes have,
/// documents the members.
struct MeshOptions {
  bool shade = true;
  glm::dvec3 light{-0.45, -0.65, 0.6};
  float ambient = 0.3f;
  /// shadowed: lights and surroundings, with shadows. global: also light that surfaces reflect, up
  /// to three times (or `bounces`). Light is computed at nodes on the triangles, where a ray needs
  /// it first, and interpolated. `spacing` is that of the nodes, in 1/512 of the diameter of the
  /// bounds. Eight times `samples` directions around each node, the same for all, replace random
  /// ones: no noise, but shadows of the sky have steps. `memory` limits the nodes, but not below
  /// three for each triangle. `seed` has no effect.
  LightOptions lighting{};
};

/// Rays to the nearest triangles, by Embree. A ray's depth is exact at the first opaque surface;
/// translucent ones before it are composited, up to 32.
/// Thread-safety: any thread may trace. Results do not depend on the number of threads.
class MeshScene final : public Scene {
 public:
  /// usage: an index, an attribute's size or an option is out of range. bad_file: a vertex is not
  /// finite, or no triangle has an area. unsupported: coordinates beyond 10^12, or an extent below
  /// 10^-12. failed: Embree has not enough memory.
  [[nodiscard]] static Result<std::unique_ptr<MeshScene>> make(Mesh mesh,
                                                               const MeshOptions& options = {});
  ~MeshScene() override;

  [[nodiscard]] Sphere bounds() const override;
  [[nodiscard]] RaySample trace(const glm::dvec3& from, const glm::dvec3& to) const override;
  [[nodiscard]] std::string provenance() const override;
  [[nodiscard]] std::vector<std::string> files() const override;

 private:
  struct State;
  explicit MeshScene(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace slf
