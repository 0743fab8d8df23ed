#include "source/mesh/builder.h"
#include <algorithm>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <limits>

#include "base/ascii.h"
#include "base/file.h"
#include "base/half.h"
#include "base/try.h"
#include "image/formats.h"
#include "slf/tone.h"
#include "source/mesh/surface.h"

namespace slf {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kMaxFileBytes = std::uint64_t{8} << 30;
constexpr std::uint64_t kMaxTriangles = std::uint64_t{1} << 28;
/// What a mesh may take, whatever its files hold, and for each byte of its files. No format needs
/// more for what it holds; instances of glTF and accessors without data do.
constexpr std::uint64_t kAllowed = std::uint64_t{256} << 20, kPerByte = 64;
constexpr std::uint64_t kVertexBytes = 48, kTriangleBytes = 16;
/// All textures of a mesh together: 1 GiB.
constexpr std::size_t kMaxTexels = std::size_t{1} << 28;
/// Corners of a polygon, and comparisons for all, up to which ears are looked for.
constexpr std::size_t kMaxClipped = 1000;
constexpr std::uint64_t kMaxEarChecks = std::uint64_t{1} << 32;
/// Coordinates that are so many times larger than the mesh lose what shows if they become float.
constexpr double kFar = 64;

bool is_allowed(const fs::path& path) {
  int up = 0;
  for (const fs::path& part : path) {
    if (part == "..")
      ++up;
    else if (part.native().starts_with('.'))
      return false;
  }
  return !path.is_absolute() && up <= 1;
}

/// Whether this is a picture of a kind that is not read.
bool is_other_picture(const std::string& name, ByteSpan bytes) {
  const std::string_view start = chars_of(bytes);
  for (const std::string_view magic : {"BM", "GIF8", "RIFF", "DDS ", "\xABKTX", "8BPS", "sB"})
    if (start.starts_with(magic)) return true;
  const std::string extension = lower_case(fs::path(name).extension().string());
  for (const char* own : {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".exr", ".hdr", ""})
    if (extension == own) return false;
  return true;
}

double cross(const glm::dvec2& a, const glm::dvec2& b) { return a.x * b.y - a.y * b.x; }

}  // namespace

MeshBuilder::MeshBuilder(const std::string& path, bool y_up)
    : y_up_(y_up), finder_(fs::path(path).parent_path(), {}, is_allowed), allowed_(kAllowed) {
  mesh_.source = path;
}

Result<Bytes> MeshBuilder::read(const std::string& file) {
  Bytes bytes = SLF_TRY(read_file(file, kMaxFileBytes));
  allowed_ += kPerByte * bytes.size();
  add_file(file);
  return bytes;
}

void MeshBuilder::add_file(const std::string& file) {
  if (std::ranges::find(mesh_.files, file) == mesh_.files.end()) mesh_.files.push_back(file);
}

std::optional<std::string> MeshBuilder::find_file(const std::string& reference,
                                                  const std::string& folder) {
  for (const std::string& from : {folder, std::string()})
    for (const std::string& name : {reference, decode_percent(reference)})
      if (auto found = finder_.find(name, from)) return found;
  return {};
}

Result<Bytes> MeshBuilder::read(const std::string& what, const std::string& reference) {
  if (const auto found = find_file(reference)) return read(*found);
  return missing(what, reference);
}

tl::unexpected<Error> MeshBuilder::missing(const std::string& what,
                                           const std::string& reference) const {
  const std::string own = fs::path(path()).parent_path();
  return error(ErrorCode::io, "its ", what, " '", reference, "' is missing; put it into ",
               own.empty() ? "the mesh's folder" : own);
}

Result<std::size_t> MeshBuilder::texture(const std::string& reference, const std::string& folder) {
  const auto found = find_file(reference, folder);
  if (!found) return missing("texture", reference);
  const std::string& file = *found;
  if (const auto known = textures_.find(file); known != textures_.end()) return known->second;
  const std::uint64_t allowed = allowed_;
  const auto bytes = read(file);
  allowed_ = allowed;  // pictures have a limit of their own
  if (!bytes) return fail_in(bytes.error(), path(), ": ", part_);
  const std::size_t index = SLF_TRY(texture(file, ByteSpan(*bytes)));
  mesh_.textures[index].name = reference;
  return index;
}

Result<std::size_t> MeshBuilder::texture(const std::string& name, ByteSpan bytes) {
  if (const auto known = textures_.find(name); known != textures_.end()) return known->second;
  const bool png = chars_of(bytes).starts_with("\x89PNG");
  const auto image =
      png ? image_formats::decode_straight_png(name, bytes) : image_formats::decode(name, bytes);
  if (!image && is_other_picture(name, bytes))
    return error(ErrorCode::unsupported, "its texture ", name,
                 " is of a kind that is not read; convert it to PNG or JPEG");
  if (!image) return fail_in(image.error(), path(), ": ", part_);
  texels_ += image->pixels();
  if (texels_ > kMaxTexels)
    return error(ErrorCode::unsupported, "its textures have more than ", kMaxTexels,
                 " pixels; shrink them");
  MeshTexture made{name, image->width, image->height, {}};
  made.texels.reserve(image->pixels());
  for (glm::vec4 c : image->rgba) {
    if (!png && c.a > 0) c = {glm::vec3(c) / c.a, c.a};
    made.texels.push_back(color_bytes(c, false));
  }
  mesh_.textures.push_back(std::move(made));
  return textures_[name] = mesh_.textures.size() - 1;
}

std::uint32_t MeshBuilder::add(const MeshVertex& vertex) {
  const std::size_t index = positions_.size();
  use(kVertexBytes);
  if (index >= 3 * kMaxTriangles) use(kMost);
  if (full()) return 0;
  // What other parts lack: uvs as if there was no texture, white, normals made here.
  const auto put = [&](auto& list, const auto& value, auto nothing) {
    if (!value && list.empty()) return;
    list.resize(index, nothing);
    list.push_back(value ? *value : nothing);
  };
  const auto in_world = [&](const auto& v) {
    return y_up_ ? decltype(v + v)(v.x, 0 - v.z, v.y) : v;
  };
  positions_.push_back(in_world(vertex.position));
  put(mesh_.normals, vertex.normal ? std::optional(in_world(*vertex.normal)) : std::nullopt,
      glm::vec3(0));
  auto uv = vertex.uv;
  if (uv && !(std::isfinite(uv->x) && std::isfinite(uv->y))) uv = glm::vec2(0);
  put(mesh_.uvs, uv, glm::vec2(0));
  put(mesh_.colors, vertex.color, glm::u8vec4(255));
  return static_cast<std::uint32_t>(index);
}

void MeshBuilder::add(const glm::uvec3& triangle, std::uint32_t material) {
  if (full()) return;
  use(mesh_.triangles.size() >= kMaxTriangles ? kMost : kTriangleBytes);
  mesh_.triangles.push_back(triangle);
  mesh_.material_of.push_back(material);
}

void MeshBuilder::add(std::span<const std::uint32_t> polygon, std::uint32_t material) {
  if (polygon.size() < 3) return leave_out();
  ring_.assign(polygon.begin(), polygon.end());
  const bool clip = ring_.size() <= kMaxClipped && compared_ < kMaxEarChecks;
  if (!clip) note("polygons with many corners are shown as if they were convex");
  if (clip && ring_.size() > 3 && !full()) {
    // Seen along the axis of the plane that is longest, so that the corners run anticlockwise.
    glm::dvec3 normal(0);
    for (std::size_t k = 0; k < ring_.size(); ++k)
      normal += glm::cross(positions_[ring_[k]] - positions_[ring_[0]],
                           positions_[ring_[(k + 1) % ring_.size()]] - positions_[ring_[0]]);
    const glm::dvec3 size = glm::abs(normal);
    const int z = size.x > size.y && size.x > size.z ? 0 : size.y > size.z ? 1 : 2;
    const int x = (z + (normal[z] < 0 ? 2 : 1)) % 3, y = 3 - x - z;
    flat_.clear();
    for (const std::uint32_t k : ring_) {
      const glm::dvec3 p = positions_[k] - positions_[ring_[0]];
      flat_.emplace_back(p[x], p[y]);
    }
    const auto is_ear = [&](std::size_t k) {
      const std::size_t n = flat_.size(), before = k - 1, after = (k + 1) % n;
      const glm::dvec2 a = flat_[before], b = flat_[k], c = flat_[after];
      if (!(cross(b - a, c - a) > 0)) return false;
      compared_ += n;
      for (std::size_t j = 0; j < n; ++j) {
        const glm::dvec2 p = flat_[j];
        if (j == before || j == k || j == after || p == a || p == b || p == c) continue;
        if (cross(b - a, p - a) >= 0 && cross(c - b, p - b) >= 0 && cross(a - c, p - c) >= 0)
          return false;
      }
      return true;
    };
    // From the second corner on, so that convex polygons become fans around the first.
    while (ring_.size() > 3) {
      std::size_t ear = 1;
      while (ear < ring_.size() && !is_ear(ear)) ++ear;
      if (ear == ring_.size()) ear = 1;  // degenerate, or it crosses itself
      add({ring_[ear - 1], ring_[ear], ring_[(ear + 1) % ring_.size()]}, material);
      ring_.erase(ring_.begin() + static_cast<std::ptrdiff_t>(ear));
      flat_.erase(flat_.begin() + static_cast<std::ptrdiff_t>(ear));
    }
  }
  for (std::size_t k = 2; k < ring_.size() && !full(); ++k)
    add({ring_[0], ring_[k - 1], ring_[k]}, material);
}

void MeshBuilder::note(const std::string& text) {
  std::vector<std::string>& notes = mesh_.notes;
  if (notes.size() < 20 && std::ranges::find(notes, text) == notes.end()) notes.push_back(text);
}

void MeshBuilder::note_emission(bool shown) {
  note(shown ? "materials that only glow are shown in that colour, and lit like others"
             : "the emission of materials that also have another colour is left out");
}

Result<Mesh> MeshBuilder::finish() {
  if (full())
    return error(ErrorCode::unsupported, "has more than ", kMaxTriangles,
                 " triangles, or much more than its files hold, with all instances; simplify it");
  if (mesh_.triangles.empty())
    return error(ErrorCode::bad_file, "has no triangles", left_out_ ? ", only points or lines" : "",
                 "; export faces");
  glm::dvec3 low(std::numeric_limits<double>::infinity()), high = -low;
  for (std::size_t k = 0; k < positions_.size(); ++k) {
    const glm::dvec3& p = positions_[k];
    if (!std::isfinite(p.x + p.y + p.z))
      return wrong("vertex ", k, " is not finite; repair the mesh, or export it again");
    low = glm::min(low, p), high = glm::max(high, p);
  }
  const glm::dvec3 middle = (low + high) / 2.0;
  const double extent = glm::length(high - low);
  if (glm::length(middle) > kFar * extent && std::isfinite(extent)) mesh_.origin = middle;
  mesh_.positions.reserve(positions_.size());
  for (const glm::dvec3& p : positions_) {
    mesh_.positions.emplace_back(p - mesh_.origin);
    const glm::vec3& q = mesh_.positions.back();
    if (!std::isfinite(q.x + q.y + q.z))
      return error(ErrorCode::unsupported, "coordinates are too large; use larger units");
  }
  if (mesh_.uvs.empty() && !mesh_.textures.empty())
    note("its textures are not used: it has no texture coordinates");
  if (left_out_) note("points and lines were left out");
  return std::move(mesh_);
}

glm::u8vec4 color_bytes(glm::vec4 color, bool linear) {
  color = glm::clamp(glm::mix(glm::vec4(0), color, glm::equal(color, color)), 0.f, 1.f);
  for (int c = 0; c < 3 && linear; ++c) color[c] = srgb_from_linear(color[c]);
  return {byte_from_float(color.r), byte_from_float(color.g), byte_from_float(color.b),
          byte_from_float(color.a)};
}

std::string decode_percent(std::string_view text) {
  std::string out;
  for (std::size_t k = 0; k < text.size(); ++k) {
    unsigned byte = 0;
    const char* const digits = text.data() + k + 1;
    if (text[k] == '%' && k + 2 < text.size() &&
        std::from_chars(digits, digits + 2, byte, 16).ptr == digits + 2) {
      out += static_cast<char>(byte);
      k += 2;
    } else {
      out += text[k];
    }
  }
  return out;
}

}  // namespace slf
