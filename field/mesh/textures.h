// The textures of a mesh file: found, decoded, each once. Private to field/mesh.
#pragma once

#include <assimp/scene.h>

#include <cstddef>
#include <map>
#include <string>

#include "slf/mesh.h"

namespace slf {

class TextureReader {
 public:
  /// `path` is that of the mesh. All must outlive the reader.
  TextureReader(const std::string& path, const aiScene& scene, Mesh& mesh)
      : path_(path), scene_(scene), mesh_(mesh) {}

  /// The index in Mesh::textures of the picture that a material refers to: "*N", one in the file,
  /// or a path beside the mesh. Adds it, and its file, to the mesh.
  /// io: no such file. Other errors as read_image(). They name the material.
  [[nodiscard]] Result<std::size_t> find(const std::string& reference, const std::string& material);

 private:
  [[nodiscard]] Result<MeshTexture> decode(const std::string& reference);

  const std::string& path_;
  const aiScene& scene_;
  Mesh& mesh_;
  std::map<std::string, std::size_t> found_;
  std::size_t texels_ = 0;
};

}  // namespace slf
