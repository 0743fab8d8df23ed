#include <algorithm>
#include <array>

#include "base/parallel.h"
#include "base/try.h"
#include "source/pictures/prepare.h"
#include "source/pictures/views.h"

namespace slf {
namespace {

constexpr std::uint32_t kCells = 4, kGap = 2;  // of a row; pixels around cells
constexpr int kManyConfirm = 6;                // of the 8 views that are compared

/// The colour at `place` of colours that are evenly spaced from 0 to 1.
template <std::size_t N>
glm::vec3 along(const std::array<glm::vec3, N>& colors, double place) {
  const double at = std::clamp(place, 0.0, 1.0) * (N - 1);
  const auto k = std::min(static_cast<std::size_t>(at), N - 2);
  return glm::mix(colors[k], colors[k + 1], static_cast<float>(at - static_cast<double>(k)));
}

glm::vec3 color_of_depth(double depth, double nearest, double farthest) {
  if (!(depth > 0)) return glm::vec3(0);
  constexpr std::array<glm::vec3, 5> kColors{glm::vec3(0.99f, 0.91f, 0.14f),
                                             {0.37f, 0.79f, 0.38f},
                                             {0.13f, 0.57f, 0.55f},
                                             {0.23f, 0.32f, 0.55f},
                                             {0.27f, 0.0f, 0.33f}};
  return along(kColors, (depth - nearest) / (farthest - nearest));
}

glm::vec3 color_of_confirmations(int count) {
  constexpr std::array<glm::vec3, 3> kColors{
      glm::vec3(0.8f, 0.1f, 0.1f), {0.9f, 0.8f, 0.1f}, {0.1f, 0.7f, 0.2f}};
  return along(kColors, count / double{kManyConfirm});
}

/// Draws the row of a view with its upper left corner at (left, top).
void draw(const Prepared& found, const SmallView& view, std::uint32_t cell, std::uint32_t left,
          std::uint32_t top, Image& image) {
  const double scale = std::max(view.width, view.height) / static_cast<double>(cell);
  const double to_center = glm::dot(found.sphere.center - view.eye, view.axes[2]);
  const double nearest = to_center - found.sphere.radius,
               farthest = to_center + found.sphere.radius;
  for (std::uint32_t y = 0; y < cell; ++y)
    for (std::uint32_t x = 0; x < cell; ++x) {
      const double px = (x + 0.5) * scale, py = (y + 0.5) * scale;
      if (!(px < view.width && py < view.height)) continue;
      const std::size_t p =
          static_cast<std::size_t>(py) * view.width + static_cast<std::size_t>(px);
      const double depth = view.depth.empty() ? 0 : view.depth[p];
      const bool shown = depth > 0 && view.rgba[p].a >= 128;
      const std::array<glm::vec3, kCells> colors{
          glm::vec3(view.rgba[p]) / 255.0f, color_of_depth(shown ? depth : 0, nearest, farthest),
          shown && !view.confirmed.empty() ? color_of_confirmations(view.confirmed[p])
                                           : glm::vec3(0),
          color_of_depth(
              found.surface.first_hit(found.sphere, view.eye, view.direction(px, py)).value_or(0),
              nearest, farthest)};
      for (std::uint32_t k = 0; k < kCells; ++k)
        image.rgba[std::size_t{top + y} * image.width + left + k * (cell + kGap) + x] =
            glm::vec4(colors[k], 1);
    }
}

}  // namespace

Result<DepthSheet> make_depth_sheet(PictureSet set, const PictureSceneOptions& options,
                                    std::uint32_t count, std::uint32_t cell) try {
  auto found = SLF_TRY(prepare_pictures(std::move(set), options));
  auto& views = found.loaded.views;
  const bool known = found.depth != "silhouettes";
  if (known) SLF_TRY(count_confirmations(found.sphere.center, options.threads, views));
  DepthSheet sheet;
  sheet.source = found.depth;
  double object = 0, with_depth = 0, confirmations = 0;
  for (const SmallView& view : views)
    for (std::size_t p = 0; p < view.rgba.size(); ++p) {
      const auto x = static_cast<double>(p % view.width);
      const auto y = static_cast<double>(std::size_t{p / view.width});
      const Chord chord = intersect(found.sphere, view.eye, view.direction(x + 0.5, y + 0.5));
      if (view.rgba[p].a < 128 || !chord.hit || chord.leave <= 0) continue;
      ++object;
      if (!known || !(view.depth[p] > 0)) continue;
      ++with_depth;
      confirmations += view.confirmed[p];
    }
  sheet.known = object > 0 ? with_depth / object : 0;
  sheet.confirmed_by = with_depth > 0 ? confirmations / with_depth : 0;

  const auto shown = static_cast<std::uint32_t>(std::min<std::size_t>(count, views.size()));
  const std::uint32_t columns = std::min(3u, shown), rows = (shown + columns - 1) / columns;
  const std::uint32_t width = kCells * (cell + kGap) + 3 * kGap, height = cell + kGap;
  Image& image = sheet.image;
  image.width = columns * width;
  image.height = rows * height;
  image.rgba.assign(std::size_t{image.width} * image.height, glm::vec4(0.25f, 0.25f, 0.25f, 1));
  SLF_TRY(parallel_for(shown, options.threads, [&](std::uint64_t k) {
    const auto number = static_cast<std::uint32_t>(k);
    draw(found, views[k * views.size() / shown], cell, number % columns * width,
         number / columns * height, image);
  }));
  return sheet;
} catch (...) {
  return tl::unexpected(error_of_exception());
}

}  // namespace slf
