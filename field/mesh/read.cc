// Reading meshes by Assimp.
#include <assimp/DefaultIOSystem.h>
#include <assimp/GltfMaterial.h>
#include <assimp/config.h>
#include <assimp/importerdesc.h>
#include <assimp/postprocess.h>
#include <assimp/scene.h>

#include <algorithm>
#include <array>
#include <assimp/Importer.hpp>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <utility>

#include "base/guarded.h"
#include "base/half.h"
#include "base/lower_case.h"
#include "base/try.h"
#include "field/mesh/declared.h"
#include "field/mesh/isolated.h"
#include "field/mesh/textures.h"
#include "slf/mesh.h"
#include "slf/tone.h"

namespace slf {
namespace {

namespace fs = std::filesystem;

constexpr std::array<std::string_view, 5> kExtensions{"glb", "gltf", "obj", "ply", "stl"};
constexpr std::uint64_t kMaxFileBytes = std::uint64_t{8} << 30;
constexpr std::uint64_t kMaxTriangles = std::uint64_t{1} << 28;
constexpr std::uint64_t kMaxVertices = 3 * kMaxTriangles;
constexpr std::uint64_t kSeconds = 60;  // of reading, and one for each MiB

/// The colour of a mesh without any: a light grey, since white has no shades in strong light.
constexpr glm::vec4 kPlain{0.6f, 0.6f, 0.6f, 1};

std::string extension_of(std::string_view path) {
  const std::string extension = lower_case(fs::path(path).extension());
  return extension.empty() ? extension : extension.substr(1);
}

/// Opens regular files only, of a limited size, and remembers them.
class Files final : public Assimp::DefaultIOSystem {
 public:
  explicit Files(std::vector<std::string>& opened) : opened_(opened) {}
  Assimp::IOStream* Open(const char* file, const char* mode) override {
    std::error_code error;
    if (mode[0] != 'r' || !fs::is_regular_file(file, error)) return nullptr;
    if (const auto bytes = fs::file_size(file, error); error || bytes > kMaxFileBytes)
      return nullptr;
    Assimp::IOStream* stream = DefaultIOSystem::Open(file, mode);
    if (stream && std::find(opened_.begin(), opened_.end(), file) == opened_.end())
      opened_.emplace_back(file);
    return stream;
  }

 private:
  std::vector<std::string>& opened_;
};

/// Keeps the readers of the formats that are supported, and tested, here.
void keep_known_readers(Assimp::Importer& importer) {
  for (std::size_t k = importer.GetImporterCount(); k-- > 0;) {
    const aiImporterDesc* info = importer.GetImporterInfo(k);
    const std::string names = info ? ' ' + std::string(info->mFileExtensions) + ' ' : "";
    const bool known = std::any_of(kExtensions.begin(), kExtensions.end(), [&](auto extension) {
      return names.find(' ' + std::string(extension) + ' ') != std::string::npos;
    });
    // glTF 1 has the same extensions.
    const bool old = info && std::string(info->mName).find("glTF Importer") != std::string::npos;
    if (!known || old) importer.UnregisterLoader(importer.GetImporter(k));
  }
}

glm::u8vec4 to_bytes(const aiColor4D& c, bool linear) {
  const auto coded = [&](float v) {
    return byte_from_float(linear ? srgb_from_linear(std::clamp(v == v ? v : 0.f, 0.f, 1.f)) : v);
  };
  return {coded(c.r), coded(c.g), coded(c.b), byte_from_float(c.a)};
}

/// Makes a Mesh of what Assimp has read.
class Converter {
 public:
  Converter(const std::string& path, const aiScene& scene, UpAxis up, Mesh& mesh)
      : path_(path),
        scene_(scene),
        gltf_(extension_of(path).starts_with("gl")),
        y_up_(up == UpAxis::y ||
              (up == UpAxis::by_format && (gltf_ || extension_of(path) == "obj"))),
        faceted_(extension_of(path) == "stl"),
        mesh_(mesh),
        textures_(path, scene, mesh) {}

  Result<void> convert() {
    for (unsigned k = 0; k < scene_.mNumMaterials; ++k)
      SLF_TRY(add_material(*scene_.mMaterials[k]));
    // A stack, because files decide how deep nodes are.
    std::vector<std::pair<const aiNode*, aiMatrix4x4>> nodes{{scene_.mRootNode, aiMatrix4x4()}};
    while (!nodes.empty()) {
      const auto [node, parent] = nodes.back();
      nodes.pop_back();
      const aiMatrix4x4 to_world = parent * node->mTransformation;
      for (unsigned k = 0; k < node->mNumMeshes; ++k)
        SLF_TRY(add_mesh(*scene_.mMeshes[node->mMeshes[k]], to_world));
      for (unsigned k = node->mNumChildren; k-- > 0;)
        nodes.emplace_back(node->mChildren[k], to_world);
    }
    if (mesh_.triangles.empty())
      return fail(ErrorCode::bad_file, path_, ": has no triangles",
                  left_out_ ? ", only points or lines" : "", "; export faces");
    const bool plain = mesh_.textures.empty() && mesh_.colors.empty() && !gltf_ &&
                       std::all_of(mesh_.materials.begin(), mesh_.materials.end(),
                                   [](const MeshMaterial& m) { return m.color == glm::vec4(1); });
    if (plain)
      for (MeshMaterial& m : mesh_.materials) m.color = kPlain;
    if (left_out_ > 0) mesh_.notes.emplace_back("points and lines were left out");
    return {};
  }

 private:
  Result<void> add_material(const aiMaterial& from) {
    MeshMaterial to;
    aiString text;
    if (from.Get(AI_MATKEY_NAME, text) == aiReturn_SUCCESS) to.name = text.C_Str();
    aiColor4D color(1, 1, 1, 1);
    if (from.Get(AI_MATKEY_BASE_COLOR, color) != aiReturn_SUCCESS)
      from.Get(AI_MATKEY_COLOR_DIFFUSE, color);
    if (to.name == AI_DEFAULT_MATERIAL_NAME) color = {1, 1, 1, 1};  // Assimp's; the file has none
    for (int c = 0; c < 3; ++c) {
      const float v = std::clamp(color[static_cast<unsigned>(c)], 0.f, 1.f);
      to.color[c] = gltf_ ? v : linear_from_srgb(v);
    }
    to.color.a = std::clamp(color.a, 0.f, 1.f);
    if (float opacity = 1; !gltf_ && from.Get(AI_MATKEY_OPACITY, opacity) == aiReturn_SUCCESS)
      to.color.a = std::clamp(opacity, 0.f, 1.f);
    if (gltf_) {
      if (from.Get(AI_MATKEY_GLTF_ALPHAMODE, text) == aiReturn_SUCCESS)
        to.opacity = text == aiString("MASK")    ? MeshOpacity::cutout
                     : text == aiString("BLEND") ? MeshOpacity::blend
                                                 : MeshOpacity::opaque;
      from.Get(AI_MATKEY_GLTF_ALPHACUTOFF, to.cutoff);
    } else if (to.color.a < 1) {
      to.opacity = MeshOpacity::blend;
    }
    aiTextureType type = aiTextureType_BASE_COLOR;
    if (from.GetTextureCount(type) == 0) type = aiTextureType_DIFFUSE;
    Coordinates coordinates;
    if (from.GetTextureCount(type) > 0) {
      from.GetTexture(type, 0, &text);
      to.texture = SLF_TRY(textures_.find(text.C_Str(), to.name));
      from.Get(AI_MATKEY_UVWSRC(type, 0), coordinates.set);
      coordinates.moved =
          from.Get(AI_MATKEY_UVTRANSFORM(type, 0), coordinates.transform) == aiReturn_SUCCESS;
      int mode = aiTextureMapMode_Wrap;
      from.Get(AI_MATKEY_MAPPINGMODE_U(type, 0), mode);
      to.repeat_u = mode != aiTextureMapMode_Clamp;
      mode = aiTextureMapMode_Wrap;
      from.Get(AI_MATKEY_MAPPINGMODE_V(type, 0), mode);
      to.repeat_v = mode != aiTextureMapMode_Clamp;
      SLF_TRY(add_opacity_texture(from, to));
    }
    coordinates_.push_back(coordinates);
    mesh_.materials.push_back(std::move(to));
    return {};
  }

  /// OBJ: map_d names a picture whose alpha, or whose grey if it is opaque, cuts holes.
  Result<void> add_opacity_texture(const aiMaterial& from, MeshMaterial& to) {
    if (from.GetTextureCount(aiTextureType_OPACITY) == 0) return {};
    aiString text;
    from.GetTexture(aiTextureType_OPACITY, 0, &text);
    const std::size_t found = SLF_TRY(textures_.find(text.C_Str(), to.name));
    to.opacity = MeshOpacity::cutout;
    if (found == *to.texture) return {};
    const MeshTexture& mask = mesh_.textures[found];
    MeshTexture cut = mesh_.textures[*to.texture];
    if (mask.width != cut.width || mask.height != cut.height)
      return fail(ErrorCode::unsupported, path_, ": material '", to.name, "': its textures ",
                  cut.name, " and ", mask.name, " differ in size (", cut.width, "x", cut.height,
                  ", ", mask.width, "x", mask.height, "); scale one of them");
    const bool opaque = std::all_of(mask.texels.begin(), mask.texels.end(),
                                    [](const glm::u8vec4& t) { return t.a == 255; });
    for (std::size_t k = 0; k < cut.texels.size(); ++k) {
      const unsigned share = opaque ? mask.texels[k].g : mask.texels[k].a;
      cut.texels[k] = glm::u8vec4((glm::uvec4(cut.texels[k]) * share + 127u) / 255u);
    }
    mesh_.textures.push_back(std::move(cut));
    to.texture = mesh_.textures.size() - 1;
    return {};
  }

  Result<void> add_mesh(const aiMesh& from, const aiMatrix4x4& to_world) {
    const auto wrong = [&](const auto&... what) {
      const std::string name = from.mName.length > 0 ? from.mName.C_Str() : "unnamed";
      return fail(ErrorCode::bad_file, path_, ": mesh '", name, "': ", what...);
    };
    if (!(from.mPrimitiveTypes & aiPrimitiveType_TRIANGLE)) {
      left_out_ += from.mNumFaces + from.mNumVertices;
      return {};
    }
    if (from.mMaterialIndex >= mesh_.materials.size()) return wrong("its material is missing");
    const std::size_t first = mesh_.positions.size();
    if (first + from.mNumVertices > kMaxVertices ||
        mesh_.triangles.size() + from.mNumFaces > kMaxTriangles)
      return fail(ErrorCode::unsupported, path_, ": has more than ", kMaxTriangles,
                  " triangles with all instances of its meshes; simplify it");
    const aiMatrix3x3 linear(to_world);
    const aiMatrix3x3 to_normal = cofactors(linear);
    const std::size_t end = first + from.mNumVertices;
    const auto fill = [&](auto& attribute, bool present, auto nothing) {
      if (present || !attribute.empty()) attribute.resize(end, nothing);
    };
    if (from.mNumVertices > 0) {
      mesh_.positions.reserve(end);
      const Coordinates& wanted = coordinates_[from.mMaterialIndex];
      const unsigned set = wanted.set < AI_MAX_NUMBER_OF_TEXTURECOORDS ? wanted.set : 0;
      const aiVector3D* uvs = from.mTextureCoords[set];
      const bool normals = from.mNormals && !faceted_;
      // What other meshes lack: uvs as if there was no texture, white, normals made here.
      fill(mesh_.normals, normals, glm::vec3(0));
      fill(mesh_.uvs, uvs != nullptr, glm::vec2(0));
      fill(mesh_.colors, from.mColors[0] != nullptr, glm::u8vec4(255));
      for (unsigned k = 0; k < from.mNumVertices; ++k) {
        const glm::vec3 p = in_world(to_world * from.mVertices[k]);
        if (!(std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z)))
          return wrong("vertex ", k, " is not finite; repair the mesh, or export it again");
        mesh_.positions.push_back(p);
        if (normals) mesh_.normals[first + k] = in_world(to_normal * from.mNormals[k]);
        if (uvs) mesh_.uvs[first + k] = wanted.apply(uvs[k]);
        if (from.mColors[0]) mesh_.colors[first + k] = to_bytes(from.mColors[0][k], gltf_);
      }
    }
    mesh_.triangles.reserve(mesh_.triangles.size() + from.mNumFaces);
    for (unsigned k = 0; k < from.mNumFaces; ++k) {
      const aiFace& face = from.mFaces[k];
      if (face.mNumIndices != 3) continue;
      glm::uvec3 corners;
      for (unsigned c = 0; c < 3; ++c) {
        if (face.mIndices[c] >= from.mNumVertices)
          return wrong("triangle ", k, " has vertex ", face.mIndices[c], " of ", from.mNumVertices);
        corners[static_cast<int>(c)] = static_cast<unsigned>(first) + face.mIndices[c];
      }
      mesh_.triangles.push_back(corners);
    }
    mesh_.material_of.resize(mesh_.triangles.size(), from.mMaterialIndex);
    return {};
  }

  glm::vec3 in_world(const aiVector3D& v) const {
    return y_up_ ? glm::vec3(v.x, 0 - v.z, v.y) : glm::vec3(v.x, v.y, v.z);
  }

  /// The matrix of normals; unlike the inverse, it exists for singular matrices, too.
  static aiMatrix3x3 cofactors(const aiMatrix3x3& m) {
    return {m.b2 * m.c3 - m.b3 * m.c2, m.b3 * m.c1 - m.b1 * m.c3, m.b1 * m.c2 - m.b2 * m.c1,
            m.c2 * m.a3 - m.c3 * m.a2, m.c3 * m.a1 - m.c1 * m.a3, m.c1 * m.a2 - m.c2 * m.a1,
            m.a2 * m.b3 - m.a3 * m.b2, m.a3 * m.b1 - m.a1 * m.b3, m.a1 * m.b2 - m.a2 * m.b1};
  }

  /// The texture coordinates that a material wants.
  struct Coordinates {
    unsigned set = 0;
    bool moved = false;
    aiUVTransform transform;

    /// In Assimp, v points up, and a transform is about the middle of the texture.
    [[nodiscard]] glm::vec2 apply(const aiVector3D& uv) const {
      glm::vec2 at(uv.x, uv.y);
      if (moved) {
        const float c = std::cos(transform.mRotation), s = std::sin(transform.mRotation);
        at = glm::vec2(transform.mScaling.x, transform.mScaling.y) * (at - 0.5f);
        at = glm::vec2(c * at.x - s * at.y, s * at.x + c * at.y) + 0.5f +
             glm::vec2(transform.mTranslation.x, transform.mTranslation.y);
      }
      at.y = 1 - at.y;
      return std::isfinite(at.x) && std::isfinite(at.y) ? at : glm::vec2(0);
    }
  };

  const std::string& path_;
  const aiScene& scene_;
  const bool gltf_, y_up_;
  const bool faceted_;  // whether normals are those of triangles, which share no vertices
  Mesh& mesh_;
  TextureReader textures_;
  std::vector<Coordinates> coordinates_;  // of each material
  std::uint64_t left_out_ = 0;
};

/// By Assimp, in a child process.
Result<Mesh> read_by_assimp(const std::string& path, UpAxis up) {
  Mesh mesh;
  mesh.source = path;
  Assimp::Importer importer;
  keep_known_readers(importer);
  importer.SetIOHandler(new Files(mesh.files));  // the importer owns it
  const aiScene* scene = importer.ReadFile(
      path, aiProcess_Triangulate | aiProcess_SortByPType | aiProcess_ValidateDataStructure);
  if (!scene || !scene->mRootNode) {
    std::string why = importer.GetErrorString();
    if (why.empty()) why = "damaged";
    if (why == "std::bad_alloc") why = "its counts ask for more memory than there is";
    return fail(ErrorCode::bad_file, path, ": not a readable ", extension_of(path), " mesh: ", why);
  }
  SLF_TRY(Converter(path, *scene, up, mesh).convert());
  return mesh;
}

Result<Mesh> read(const std::string& path, UpAxis up, std::uint64_t seconds) {
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  if (!fs::exists(status)) return fail(ErrorCode::not_found, path, ": no such file");
  if (!fs::is_regular_file(status)) return fail(ErrorCode::io, path, ": not a regular file");
  const std::uint64_t bytes = fs::file_size(path, error);
  if (error) return fail(ErrorCode::io, path, ": ", error.message());
  if (bytes > kMaxFileBytes)
    return fail(ErrorCode::unsupported, path, ": has ", bytes, " bytes; meshes are read up to ",
                kMaxFileBytes);
  SLF_TRY(check_declared(path));
  // Text expands most, to some 50 times; a glTF file's buffers are elsewhere.
  const std::uint64_t memory = (std::uint64_t{16} << 30) + 64 * bytes;
  return read_isolated(path, memory, seconds + (bytes >> 20),
                       [&] { return read_by_assimp(path, up); });
}

}  // namespace

bool is_mesh_name(std::string_view path) {
  return std::find(kExtensions.begin(), kExtensions.end(), extension_of(path)) != kExtensions.end();
}

Result<std::vector<std::string>> mesh_files(const std::string& path) {
  const Mesh mesh = SLF_TRY(read_mesh(path));
  std::vector<std::string> files = mesh.files;
  if (std::find(files.begin(), files.end(), path) == files.end()) files.push_back(path);
  return files;
}

Result<Mesh> read_mesh(const std::string& path, UpAxis up) {
  return read_mesh_within(path, up, kSeconds);
}

Result<Mesh> read_mesh_within(const std::string& path, UpAxis up, std::uint64_t seconds) {
  auto mesh = guarded([&] { return read(path, up, seconds); });
  if (!mesh && mesh.error().message.find(path) == std::string::npos)
    return fail(mesh.error().code, path, ": ", mesh.error().message);
  return mesh;
}

}  // namespace slf
