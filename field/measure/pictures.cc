#include <algorithm>
#include <cmath>
#include <iomanip>
#include <numbers>

#include "base/reporter.h"
#include "base/try.h"
#include "slf/measure.h"

namespace slf {
namespace {

/// Whether a Camera has exactly these pixels.
bool is_centered_pinhole(const Lens& lens) {
  return !lens.distorted() && std::abs(lens.fx - lens.fy) < 1e-6 * lens.fx &&
         std::abs(lens.cx - lens.width / 2.0) < 1e-3 &&
         std::abs(lens.cy - lens.height / 2.0) < 1e-3;
}

glm::vec4 bilinear(const Image& image, double x, double y) {
  const double px = std::clamp(x - 0.5, 0.0, image.width - 1.001),
               py = std::clamp(y - 0.5, 0.0, image.height - 1.001);
  const auto ix = static_cast<std::size_t>(px), iy = static_cast<std::size_t>(py);
  const auto fx = static_cast<float>(px - static_cast<double>(ix)),
             fy = static_cast<float>(py - static_cast<double>(iy));
  const glm::vec4* p = &image.rgba[iy * image.width + ix];
  return glm::mix(glm::mix(p[0], p[1], fx), glm::mix(p[image.width], p[image.width + 1], fx), fy);
}

/// Which pixels have rays that cross the sphere.
std::vector<bool> pixels_inside(const Sphere& sphere, const Picture& picture) {
  const Lens& lens = picture.lens;
  std::vector<bool> inside;
  inside.reserve(std::size_t{lens.width} * lens.height);
  for (std::uint32_t y = 0; y < lens.height; ++y)
    for (std::uint32_t x = 0; x < lens.width; ++x) {
      const Chord chord =
          intersect(sphere, picture.eye, picture.axes * lens.direction({x + 0.5, y + 0.5}));
      inside.push_back(chord.hit && chord.leave > 0);
    }
  return inside;
}

}  // namespace

Result<Camera> camera_of(const Picture& picture) try {
  const Lens& lens = picture.lens;
  Camera camera;
  camera.eye = picture.eye;
  camera.look_at = picture.eye + picture.axes[2];
  camera.up = -picture.axes[1];
  camera.width = lens.width;
  camera.height = lens.height;
  constexpr double kDegrees = 180 / std::numbers::pi;
  if (is_centered_pinhole(lens)) {
    camera.fov = 2 * std::atan(lens.height / 2.0 / lens.fy) * kDegrees;
    return camera;
  }
  constexpr int kSteps = 32;  // along each edge
  const double furthest = std::tan(80 / kDegrees);
  glm::dvec2 reach(0);
  for (int k = 0; k <= kSteps; ++k)
    for (const glm::dvec2 edge : {glm::dvec2(k, 0), {k, kSteps}, {0, k}, {kSteps, k}}) {
      const glm::dvec3 way =
          lens.direction(edge / double{kSteps} * glm::dvec2(lens.width, lens.height));
      if (!(way.z > 0 && std::hypot(way.x, way.y) < furthest * way.z))
        return unsupported(picture.name, "its lens sees further than 80 degrees from the axis");
      reach = glm::max(reach, glm::abs(glm::dvec2(way) / way.z));
    }
  // Finer than the picture, because it is resampled.
  const double focal = 2 * std::max(lens.fx, lens.fy);
  const glm::dvec2 size = glm::floor(2 * focal * reach + 4.0);
  constexpr double kMostPixels = 16384;  // along a side
  if (!(std::max(size.x, size.y) <= kMostPixels))
    return unsupported(picture.name, "without the distortion of its lens it has ",
                       concat(std::fixed, std::setprecision(0), size.x, "x", size.y),
                       " pixels, more than ", kMostPixels, " along a side; scale the picture, and ",
                       "the size, focal lengths and centre of its camera, down");
  camera.width = static_cast<std::uint32_t>(size.x);
  camera.height = static_cast<std::uint32_t>(size.y);
  camera.fov = 2 * std::atan(camera.height / 2.0 / focal) * kDegrees;
  return camera;
} catch (...) {
  return tl::unexpected(error_of_exception());
}

Image through_lens(const Picture& picture, const Camera& camera, Image view) {
  const Lens& lens = picture.lens;
  if (is_centered_pinhole(lens)) return view;
  const double focal = camera.height / 2.0 / std::tan(camera.fov * std::numbers::pi / 360);
  Image image{lens.width, lens.height, {}, {}};
  image.rgba.reserve(std::size_t{lens.width} * lens.height);
  for (std::uint32_t y = 0; y < lens.height; ++y)
    for (std::uint32_t x = 0; x < lens.width; ++x) {
      const glm::dvec3 way = lens.direction({x + 0.5, y + 0.5});
      image.rgba.push_back(bilinear(view, focal * way.x / way.z + camera.width / 2.0,
                                    focal * way.y / way.z + camera.height / 2.0));
    }
  return image;
}

Result<std::vector<PictureQuality>> evaluate_pictures(const Field& field,
                                                      const std::vector<Picture>& pictures,
                                                      const ViewOptions& view,
                                                      const RendererOptions& options,
                                                      const ProgressCallback& progress) try {
  if (pictures.empty()) return fail(ErrorCode::usage, "no pictures to compare with");
  Renderer renderer(field, options);
  std::vector<PictureQuality> qualities;
  Reporter reporter(progress, {0, pictures.size(), 0}, "stopped while pictures were compared");
  for (const Picture& picture : pictures) {
    const auto truth = SLF_TRY(load_picture(picture));
    const auto camera = SLF_TRY(camera_of(picture));
    auto drawn = SLF_TRY(renderer.render(camera, view));
    const Image image = through_lens(picture, camera, std::move(drawn));
    qualities.push_back({picture.name, compare(truth, image),
                         compare(truth, image, pixels_inside(field.shape().sphere, picture))});
    SLF_TRY(reporter.add(1));
  }
  return qualities;
} catch (...) {
  return tl::unexpected(error_of_exception());
}

}  // namespace slf
