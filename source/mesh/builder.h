// What the readers of all mesh formats share: the files that a mesh names, its textures, and its
// vertices and triangles within limits. Private to source/mesh.
#pragma once

#include <cstdint>
#include <glm/glm.hpp>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/bytes.h"
#include "base/file_finder.h"
#include "slf/mesh.h"

namespace slf {

struct MeshVertex {
  glm::dvec3 position{0};
  std::optional<glm::vec3> normal{};
  std::optional<glm::vec2> uv{};
  std::optional<glm::u8vec4> color{};
};

class MeshBuilder {
 public:
  MeshBuilder(const std::string& path, bool y_up);

  [[nodiscard]] const std::string& path() const { return mesh_.source; }
  [[nodiscard]] Mesh& mesh() { return mesh_; }
  /// Errors name the file and the part of it that is being read.
  void at(std::string part) { part_ = std::move(part); }
  template <class... Parts>
  [[nodiscard]] tl::unexpected<Error> error(ErrorCode code, const Parts&... parts) const {
    return fail(code, path(), ": ", part_, parts...);
  }
  template <class... Parts>
  [[nodiscard]] tl::unexpected<Error> wrong(const Parts&... parts) const {
    return error(ErrorCode::bad_file, parts...);
  }

  /// All of a regular file, which becomes one of the mesh's files. It allows the mesh more memory.
  /// not_found, io, unsupported: more than 8 GiB.
  [[nodiscard]] Result<Bytes> read(const std::string& file);
  /// The same for a file that the mesh names, `what` is its role. io: it is missing.
  [[nodiscard]] Result<Bytes> read(const std::string& what, const std::string& reference);
  /// The path of a file that a mesh names; `folder`, relative to the mesh's own, is that of the
  /// file with the name. Only regular files in the mesh's folder, beside that folder, or below
  /// either; none that is hidden. As FileFinder finds them.
  [[nodiscard]] std::optional<std::string> find_file(const std::string& reference,
                                                     const std::string& folder = "");
  void add_file(const std::string& file);

  /// The index in Mesh::textures of a picture. Files are decoded once. io: it is missing.
  [[nodiscard]] Result<std::size_t> texture(const std::string& reference,
                                            const std::string& folder = "");
  [[nodiscard]] Result<std::size_t> texture(const std::string& name, ByteSpan bytes);

  /// Whether the mesh has all that it may have; finish() reports that. What is added then is
  /// ignored.
  [[nodiscard]] bool full() const { return used_ > allowed_; }
  /// Counts memory that a file asks for, beside vertices and triangles.
  void use(std::uint64_t bytes) { used_ += std::min(bytes, kMost); }
  std::uint32_t add(const MeshVertex& vertex);
  /// REQUIRES: corners are vertices.
  void add(const glm::uvec3& triangle, std::uint32_t material);
  /// Ears are clipped, so it may be concave. Less than three corners count as left out.
  void add(std::span<const std::uint32_t> polygon, std::uint32_t material);
  [[nodiscard]] std::size_t vertices() const { return positions_.size(); }
  void leave_out() { left_out_ = true; }
  void note(const std::string& text);
  /// Notes what becomes of emission: shown as the colour, of materials that have no other, or not.
  void note_emission(bool shown);

  /// unsupported: too large. bad_file: no triangles, or a vertex that is not finite.
  [[nodiscard]] Result<Mesh> finish();

 private:
  [[nodiscard]] tl::unexpected<Error> missing(const std::string& what,
                                              const std::string& reference) const;
  static constexpr std::uint64_t kMost = std::uint64_t{1} << 50;
  Mesh mesh_;
  const bool y_up_;
  FileFinder finder_;
  std::vector<glm::dvec3> positions_;
  std::map<std::string, std::size_t> textures_;  // by path or name
  std::uint64_t allowed_, used_ = 0;             // bytes
  std::size_t texels_ = 0;
  std::uint64_t compared_ = 0;  // corners with ears
  bool left_out_ = false;
  std::string part_;
  std::vector<glm::dvec2> flat_;     // a polygon in its plane,
  std::vector<std::uint32_t> ring_;  // and what is left of it
};

/// The linear colour of a mesh without any: a light grey, since white has no shades in strong
/// light.
inline constexpr float kPlainColor = 0.6f;

/// What the colours of a file run to, of which this is the largest number: 1, 255 or 65535. Colours
/// that were interpolated may be a little larger.
[[nodiscard]] constexpr double color_scale(double largest) {
  return largest > 256 ? 65535 : largest > 2 ? 255 : 1;
}

/// A colour as files write it, 0 to 1.
[[nodiscard]] glm::u8vec4 color_bytes(glm::vec4 color, bool linear);

/// Replaces %20 and the like.
[[nodiscard]] std::string decode_percent(std::string_view text);

// The readers. `bytes` are those of the file.
[[nodiscard]] Result<void> read_gltf(ByteSpan bytes, MeshBuilder& to);
[[nodiscard]] Result<void> read_obj(ByteSpan bytes, MeshBuilder& to);
[[nodiscard]] Result<void> read_ply(ByteSpan bytes, MeshBuilder& to);
[[nodiscard]] Result<void> read_stl(ByteSpan bytes, MeshBuilder& to);

}  // namespace slf
