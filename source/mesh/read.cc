// Reading meshes: the format of a file, and the parts that all readers share.
#include <algorithm>
#include <array>
#include <filesystem>

#include "base/ascii.h"
#include "base/try.h"
#include "slf/mesh.h"
#include "source/mesh/builder.h"
#include "source/volume/formats.h"

namespace slf {
namespace {

constexpr std::array<std::string_view, 5> kExtensions{"glb", "gltf", "obj", "ply", "stl"};

std::string extension_of(std::string_view path) {
  const std::string extension = lower_case(std::filesystem::path(path).extension().string());
  return extension.empty() ? extension : extension.substr(1);
}

}  // namespace

bool is_mesh_name(std::string_view path) {
  return std::ranges::find(kExtensions, extension_of(path)) != kExtensions.end();
}

Result<Mesh> read_mesh(const std::string& path, UpAxis up) try {
  const std::string extension = extension_of(path);
  const bool gltf = extension.starts_with("gl");
  const bool y_up = up == UpAxis::y || (up == UpAxis::by_format && (gltf || extension == "obj"));
  MeshBuilder builder(path, y_up);
  const Bytes bytes = SLF_TRY(builder.read(path));
  if (bytes.empty()) return builder.wrong("is empty (0 bytes)");
  const auto reader = gltf                 ? read_gltf
                      : extension == "obj" ? read_obj
                      : extension == "ply" ? read_ply
                                           : read_stl;
  const auto done = reader(bytes, builder);
  Result<Mesh> mesh = done ? builder.finish() : tl::unexpected(done.error());
  if (!mesh && mesh.error().code == ErrorCode::bad_file)
    SLF_TRY(volume_io::refuse_known(path, chars_of(bytes).substr(0, 4096)));
  return mesh;
} catch (...) {
  return tl::unexpected(error_of_exception(path));
}

}  // namespace slf
