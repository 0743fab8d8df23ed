#include "source/pictures/depth_cache.h"

#include <xxhash.h>
#include <zstd.h>

#include <array>
#include <bit>

#include "base/content_hash.h"
#include "base/file.h"
#include "base/try.h"

namespace slf {
namespace {

constexpr std::uint64_t kMaxFileBytes = std::uint64_t{1} << 36;
/// Of estimate_depth(), which finds other depths, and of the file: another one has other keys.
constexpr std::uint64_t kVersion = 3;
constexpr std::size_t kPixelBytes = 5;  // a float, and a count
constexpr int kZstdLevel = 3;

std::size_t pixels_of(const std::vector<SmallView>& views) {
  std::size_t pixels = 0;
  for (const SmallView& view : views) pixels += view.rgba.size();
  return pixels;
}

/// The bytes of all floats sorted by significance, which packs better, then the counts.
Bytes planes_of(const std::vector<SmallView>& views) {
  const std::size_t pixels = pixels_of(views);
  Bytes planes(kPixelBytes * pixels);
  std::size_t at = 0;
  for (const SmallView& view : views)
    for (std::size_t p = 0; p < view.depth.size(); ++p, ++at) {
      const auto bytes = std::bit_cast<std::array<std::byte, 4>>(view.depth[p]);
      for (std::size_t b = 0; b < 4; ++b) planes[b * pixels + at] = bytes[b];
      planes[4 * pixels + at] = static_cast<std::byte>(view.confirmed[p]);
    }
  return planes;
}

void set_planes(const Bytes& planes, std::vector<SmallView>& views) {
  const std::size_t pixels = pixels_of(views);
  std::size_t at = 0;
  for (SmallView& view : views) {
    view.depth.resize(view.rgba.size());
    view.confirmed.resize(view.rgba.size());
    for (std::size_t p = 0; p < view.depth.size(); ++p, ++at) {
      std::array<std::byte, 4> bytes{};
      for (std::size_t b = 0; b < 4; ++b) bytes[b] = planes[b * pixels + at];
      view.depth[p] = std::bit_cast<float>(bytes);
      view.confirmed[p] = std::to_integer<std::uint8_t>(planes[4 * pixels + at]);
    }
  }
}

}  // namespace

std::string depth_key(const std::vector<SmallView>& views, const Sphere& sphere,
                      std::uint32_t hull_voxels) {
  ContentHash hash;
  const auto add = [&](const auto& values) { hash.add(std::as_bytes(std::span(values))); };
  add(std::array<std::uint64_t, 3>{kVersion, hull_voxels, views.size()});
  add(std::array{sphere.center.x, sphere.center.y, sphere.center.z, sphere.radius});
  for (const SmallView& view : views) {
    add(std::array{view.width, view.height});
    add(std::array{view.fx, view.fy, view.cx, view.cy});
    add(std::array{view.axes[0], view.axes[1], view.axes[2], view.eye});
    add(view.rgba);
  }
  return hash.text();
}

bool read_depth_cache(const std::string& path, const std::string& key,
                      std::vector<SmallView>& views) {
  const std::string head = kDepthCacheMagic + key;
  const auto is_ours = [&](ByteSpan start) -> Result<void> {
    if (chars_of(start).starts_with(head)) return {};
    return bad_file(path, "of other depths");
  };
  const auto file = read_file(path, kMaxFileBytes, is_ours);
  if (!file || file->size() < head.size() + 8) return false;
  const std::size_t end = file->size() - 8;
  if (XXH3_64bits(file->data(), end) != load_le<std::uint64_t>(&(*file)[end])) return false;
  // The size of the views, not what the frame claims.
  Bytes planes(kPixelBytes * pixels_of(views));
  const std::size_t got =
      ZSTD_decompress(planes.data(), planes.size(), file->data() + head.size(), end - head.size());
  if (got != planes.size()) return false;
  set_planes(planes, views);
  return true;
}

Result<void> write_depth_cache(const std::string& path, const std::string& key,
                               const std::vector<SmallView>& views) {
  SLF_TRY(check_own_file(path, kDepthCacheMagic, "a cache of depths"));
  const Bytes planes = planes_of(views);
  const std::string head = kDepthCacheMagic + key;
  Bytes file(head.size() + ZSTD_compressBound(planes.size()));
  std::ranges::copy(bytes_of(head), file.begin());
  file.resize(head.size() + ZSTD_compress(&file[head.size()], file.size() - head.size(),
                                          planes.data(), planes.size(), kZstdLevel));
  append_le<std::uint64_t>(file, XXH3_64bits(file.data(), file.size()));
  return write_file(path, file);
}

}  // namespace slf
