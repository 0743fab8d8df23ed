#include "source/pictures/views.h"

#include <algorithm>
#include <cmath>

#include "base/half.h"
#include "base/parallel.h"

namespace slf {
namespace {

/// Opacity below which a pixel shows the background.
constexpr double kSilhouette = 0.3;

}  // namespace

SmallView make_small_view(const Picture& picture, const Image& image, std::uint32_t factor) {
  const Lens& lens = picture.lens;
  SmallView view;
  view.width = std::max(1u, lens.width / factor);
  view.height = std::max(1u, lens.height / factor);
  view.fx = lens.fx / factor, view.fy = lens.fy / factor;
  view.cx = lens.cx / factor, view.cy = lens.cy / factor;
  view.axes = picture.axes;
  view.eye = picture.eye;
  view.rgba.resize(std::size_t{view.width} * view.height);
  if (!image.depth.empty()) view.depth.assign(view.rgba.size(), 0);
  for (std::uint32_t y = 0; y < view.height; ++y)
    for (std::uint32_t x = 0; x < view.width; ++x) {
      glm::vec4 sum(0);
      for (std::uint32_t b = 0; b < factor; ++b)
        for (std::uint32_t a = 0; a < factor; ++a) {
          glm::dvec2 place(x * factor + a + 0.5, y * factor + b + 0.5);
          if (lens.distorted()) {
            const auto at =
                lens.project({(place.x - lens.cx) / lens.fx, (place.y - lens.cy) / lens.fy, 1});
            if (!at) continue;
            place = *at;
          }
          const auto px = static_cast<std::int64_t>(std::floor(place.x)),
                     py = static_cast<std::int64_t>(std::floor(place.y));
          if (px < 0 || py < 0 || px >= image.width || py >= image.height) continue;
          const std::size_t pixel =
              static_cast<std::size_t>(py) * image.width + static_cast<std::size_t>(px);
          sum += image.rgba[pixel];
          if (a == factor / 2 && b == factor / 2 && !view.depth.empty())
            view.depth[std::size_t{y} * view.width + x] = image.depth[pixel];
        }
      sum /= static_cast<float>(factor * factor);
      view.rgba[std::size_t{y} * view.width + x] = {byte_from_float(sum.r), byte_from_float(sum.g),
                                                    byte_from_float(sum.b), byte_from_float(sum.a)};
    }
  const auto is_opaque = [](float alpha) { return alpha >= kSilhouette; };
  const auto rim = [&](std::size_t x, std::size_t y) {
    return is_opaque(image.rgba[y * image.width + x].a);
  };
  bool cut = false;
  for (std::size_t x = 0; x < image.width; ++x) cut |= rim(x, 0) || rim(x, image.height - 1);
  for (std::size_t y = 0; y < image.height; ++y) cut |= rim(0, y) || rim(image.width - 1, y);
  view.whole = !cut && std::ranges::any_of(view.rgba, [&](const glm::u8vec4& p) {
    return is_opaque(static_cast<float>(p.a) / 255);
  });
  return view;
}

Result<void> carve(const std::vector<SmallView>& views, unsigned threads, DistanceField& surface) {
  const std::uint32_t side = surface.side();
  const auto whole = std::ranges::count_if(views, &SmallView::whole);
  auto done = parallel_for(side, threads, [&](std::uint64_t z) {
    for (std::uint32_t y = 0; y < side; ++y)
      for (std::uint32_t x = 0; x < side; ++x) {
        const glm::dvec3 world = surface.center(x, y, static_cast<std::uint32_t>(z));
        double least = 1;
        std::size_t seen = 0;
        std::ptrdiff_t beside = 0;  // pictures of the whole object
        for (const SmallView& view : views) {
          const glm::dvec3 at = view.project(world);
          const double px = at.x - 0.5, py = at.y - 0.5;
          if (!(at.z > 0 && px >= 0 && py >= 0 && px < view.width - 1 && py < view.height - 1)) {
            beside += view.whole ? 1 : 0;
            continue;
          }
          const auto ix = static_cast<std::size_t>(px), iy = static_cast<std::size_t>(py);
          const double fx = px - static_cast<double>(ix), fy = py - static_cast<double>(iy);
          const glm::u8vec4* p = &view.rgba[iy * view.width + ix];
          const double top = p[0].a + fx * (p[1].a - p[0].a);
          const double bottom = p[view.width].a + fx * (p[view.width + 1].a - p[view.width].a);
          ++seen;
          least = std::min(least, (top + fy * (bottom - top)) / 255);
          if (least == 0) break;
        }
        // Where a voxel is outside already, not all views were asked.
        if (4 * seen < views.size() || (beside > 0 && 3 * beside >= whole)) least = 0;
        const double value = least < kSilhouette ? 1 - least / kSilhouette
                                                 : (kSilhouette - least) / (1 - kSilhouette);
        surface.set(surface.index(x, y, static_cast<std::uint32_t>(z)), value);
      }
  });
  surface.finish();
  return done;
}

Result<void> fuse(const std::vector<SmallView>& views, bool hull, double hull_weight,
                  unsigned threads, DistanceField& surface) {
  const std::uint32_t side = surface.side();
  const double reach = DistanceField::kTruncation * surface.voxel();
  auto done = parallel_for(side, threads, [&](std::uint64_t z) {
    for (std::uint32_t y = 0; y < side; ++y)
      for (std::uint32_t x = 0; x < side; ++x) {
        const std::size_t voxel = surface.index(x, y, static_cast<std::uint32_t>(z));
        const double outside = surface.get(voxel);
        if (outside >= 1) continue;
        const glm::dvec3 world = surface.center(x, y, static_cast<std::uint32_t>(z));
        double count = hull_weight, sum = outside * count;
        for (const SmallView& view : views) {
          const glm::dvec3 at = view.project(world);
          const auto pixel = view.pixel_at(at);
          if (!pixel || !(view.depth[*pixel] > 0)) continue;
          const float depth = view.depth[*pixel];
          const double distance = (depth - at.z) / reach;
          if (distance < -1) continue;
          sum += std::min(distance, 1.0);
          ++count;
        }
        if (count > 0)
          surface.set(voxel, std::max(outside, sum / count));
        else if (!hull)
          surface.set(voxel, 1);
      }
  });
  surface.finish();
  return done;
}

}  // namespace slf
