#include "field/pictures/depth_cache.h"

#include <xxhash.h>
#include <zstd.h>

#include <array>
#include <cstring>
#include <memory>
#include <string_view>

#include "base/file.h"
#include "base/parallel.h"
#include "base/try.h"

namespace slf {
namespace {

constexpr std::uint64_t kMaxFileBytes = std::uint64_t{1} << 36;
constexpr std::uint64_t kAlgorithm = 2;  // of estimate_depth(); another one finds other depths
constexpr std::size_t kPixelBytes = 5;   // a float, and a count

/// The bytes of floats sorted by significance, which packs better, then the counts.
Bytes planes_of(const SmallView& view) {
  const std::size_t pixels = view.depth.size();
  Bytes planes(kPixelBytes * pixels);
  for (std::size_t p = 0; p < pixels; ++p) {
    std::array<std::byte, 4> bytes{};
    std::memcpy(bytes.data(), &view.depth[p], 4);
    for (std::size_t b = 0; b < 4; ++b) planes[b * pixels + p] = bytes[b];
    planes[4 * pixels + p] = static_cast<std::byte>(view.confirmed[p]);
  }
  return planes;
}

void set_planes(const Bytes& planes, SmallView& view) {
  const std::size_t pixels = planes.size() / kPixelBytes;
  view.depth.resize(pixels);
  view.confirmed.resize(pixels);
  for (std::size_t p = 0; p < pixels; ++p) {
    std::array<std::byte, 4> bytes{};
    for (std::size_t b = 0; b < 4; ++b) bytes[b] = planes[b * pixels + p];
    std::memcpy(&view.depth[p], bytes.data(), 4);
    view.confirmed[p] = std::to_integer<std::uint8_t>(planes[4 * pixels + p]);
  }
}

}  // namespace

std::uint64_t depth_key(const std::vector<SmallView>& views, const Sphere& sphere,
                        std::uint32_t hull_voxels) {
  const std::unique_ptr<XXH3_state_t, XXH_errorcode (*)(XXH3_state_t*)> state(XXH3_createState(),
                                                                              XXH3_freeState);
  XXH3_64bits_reset(state.get());
  const auto add = [&](const void* from, std::size_t bytes) {
    XXH3_64bits_update(state.get(), from, bytes);
  };
  const std::array<std::uint64_t, 3> counts{kAlgorithm, hull_voxels, views.size()};
  add(counts.data(), sizeof counts);
  const std::array<double, 4> ball{sphere.center.x, sphere.center.y, sphere.center.z,
                                   sphere.radius};
  add(ball.data(), sizeof ball);
  for (const SmallView& view : views) {
    const std::array<std::uint32_t, 2> size{view.width, view.height};
    add(size.data(), sizeof size);
    const std::array<double, 4> lens{view.fx, view.fy, view.cx, view.cy};
    add(lens.data(), sizeof lens);
    add(&view.axes, sizeof view.axes);
    add(&view.eye, sizeof view.eye);
    add(view.rgba.data(), view.rgba.size() * sizeof view.rgba[0]);
  }
  return XXH3_64bits_digest(state.get());
}

bool read_depth_cache(const std::string& path, std::uint64_t key, unsigned threads,
                      std::vector<SmallView>& views) {
  const std::string_view magic = kDepthCacheMagic;
  const auto is_ours = [&](ByteSpan start) -> Result<void> {
    if (start.size() >= magic.size() + 16 &&
        std::memcmp(start.data(), magic.data(), magic.size()) == 0 &&
        load_le<std::uint64_t>(&start[magic.size()]) == key &&
        load_le<std::uint64_t>(&start[magic.size() + 8]) == views.size())
      return {};
    return bad_file(path, "of other depths");
  };
  const auto file = read_file(path, kMaxFileBytes, is_ours);
  if (!file || file->size() < magic.size() + 24) return false;
  const std::size_t end = file->size() - 8;
  if (XXH3_64bits(file->data(), end) != load_le<std::uint64_t>(&(*file)[end])) return false;

  std::vector<ByteSpan> frames;
  for (std::size_t at = magic.size() + 16; frames.size() < views.size();) {
    if (end - at < 8) return false;
    const auto length = load_le<std::uint64_t>(&(*file)[at]);
    if (length > end - at - 8) return false;
    frames.emplace_back(file->data() + at + 8, length);
    at += 8 + length;
  }
  std::vector<Bytes> planes(views.size());
  const auto done = parallel_for(views.size(), threads, [&](std::uint64_t k) {
    // The size of the view, not what the frame claims.
    Bytes plain(kPixelBytes * views[k].rgba.size());
    const std::size_t got =
        ZSTD_decompress(plain.data(), plain.size(), frames[k].data(), frames[k].size());
    if (got == plain.size()) planes[k] = std::move(plain);
  });
  if (!done) return false;
  for (std::size_t k = 0; k < views.size(); ++k)
    if (planes[k].size() != kPixelBytes * views[k].rgba.size()) return false;
  for (std::size_t k = 0; k < views.size(); ++k) set_planes(planes[k], views[k]);
  return true;
}

Result<void> write_depth_cache(const std::string& path, std::uint64_t key, unsigned threads,
                               const std::vector<SmallView>& views) {
  SLF_TRY(check_own_file(path, kDepthCacheMagic, "a cache of depths"));
  std::vector<Bytes> frames(views.size());
  SLF_TRY(parallel_for(views.size(), threads, [&](std::uint64_t k) {
    const Bytes planes = planes_of(views[k]);
    frames[k].resize(ZSTD_compressBound(planes.size()));
    frames[k].resize(ZSTD_compress(frames[k].data(), frames[k].size(), planes.data(), planes.size(),
                                   /*level=*/3));
  }));
  Bytes file;
  for (const char c : std::string_view(kDepthCacheMagic)) file.push_back(static_cast<std::byte>(c));
  append_le<std::uint64_t>(file, key);
  append_le<std::uint64_t>(file, views.size());
  for (const Bytes& frame : frames) {
    append_le<std::uint64_t>(file, frame.size());
    file.insert(file.end(), frame.begin(), frame.end());
  }
  append_le<std::uint64_t>(file, XXH3_64bits(file.data(), file.size()));
  return write_file(path, file);
}

}  // namespace slf
