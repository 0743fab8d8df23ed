#include "field/mesh/textures.h"

#include <algorithm>
#include <filesystem>
#include <string_view>
#include <vector>

#include "base/bytes.h"
#include "base/half.h"
#include "base/try.h"
#include "field/image/formats.h"
#include "slf/image.h"

namespace slf {
namespace {

namespace fs = std::filesystem;

/// All textures of a mesh together: 1 GiB.
constexpr std::size_t kMaxTexels = std::size_t{1} << 28;

/// Replaces %20 and the like.
std::string decode_percent(const std::string& text) {
  const auto digit = [&](std::size_t k) {
    const auto at = std::string_view("0123456789abcdef").find(static_cast<char>(text[k] | 0x20));
    return at == std::string_view::npos ? -1 : static_cast<int>(at);
  };
  std::string out;
  for (std::size_t k = 0; k < text.size(); ++k) {
    if (text[k] == '%' && k + 2 < text.size() && digit(k + 1) >= 0 && digit(k + 2) >= 0) {
      out += static_cast<char>(16 * digit(k + 1) + digit(k + 2));
      k += 2;
    } else {
      out += text[k];
    }
  }
  return out;
}

/// Where a file with this reference may be, best first. Programs on Windows write backslashes, and
/// some write the absolute path that the picture had on their machine.
std::vector<fs::path> places(const std::string& mesh, std::string reference) {
  std::replace(reference.begin(), reference.end(), '\\', '/');
  const fs::path folder = fs::path(mesh).parent_path();
  const std::string decoded = decode_percent(reference);
  return {folder / reference, folder / decoded, folder / fs::path(decoded).filename()};
}

MeshTexture pack(const Image& image, const std::string& name) {
  MeshTexture texture{name, image.width, image.height, {}};
  texture.texels.reserve(image.pixels());
  for (const glm::vec4& c : image.rgba)
    texture.texels.emplace_back(byte_from_float(c.r), byte_from_float(c.g), byte_from_float(c.b),
                                byte_from_float(c.a));
  return texture;
}

}  // namespace

Result<std::size_t> TextureReader::find(const std::string& reference, const std::string& material) {
  if (const auto known = found_.find(reference); known != found_.end()) return known->second;
  auto texture = decode(reference);
  if (!texture)
    return fail(texture.error().code, path_, ": material '", material,
                "': ", texture.error().message);
  texels_ += texture->texels.size();
  if (texels_ > kMaxTexels)
    return fail(ErrorCode::unsupported, path_, ": its textures have more than ", kMaxTexels,
                " pixels; shrink them");
  mesh_.textures.push_back(std::move(*texture));
  return found_[reference] = mesh_.textures.size() - 1;
}

Result<MeshTexture> TextureReader::decode(const std::string& reference) {
  if (const aiTexture* held = scene_.GetEmbeddedTexture(reference.c_str())) {
    const std::string name = "its texture " + reference;
    if (held->mHeight != 0)  // no format that is read here holds plain texels
      return fail(ErrorCode::unsupported, name, " is neither a PNG nor a JPEG");
    const auto image = SLF_TRY(image_formats::decode(
        name, {reinterpret_cast<const std::byte*>(held->pcData), held->mWidth}));
    return pack(image, reference);
  }
  for (const fs::path& place : places(path_, reference)) {
    std::error_code ignored;
    if (!fs::is_regular_file(place, ignored)) continue;
    const auto image = SLF_TRY(read_image(place));
    mesh_.files.push_back(place);
    return pack(image, reference);
  }
  const fs::path folder = fs::path(path_).parent_path();
  return fail(ErrorCode::io, "its texture '", reference, "' is missing; put it into ",
              folder.empty() ? "the mesh's folder" : folder.string());
}

}  // namespace slf
