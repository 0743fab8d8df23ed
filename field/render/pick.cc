#include <cmath>
#include <numbers>

#include "base/try.h"
#include "slf/render.h"

namespace slf {

Result<std::optional<PickedPoint>> pick(Renderer& renderer, const Camera& camera, double x,
                                        double y, const ViewOptions& cut) try {
  const auto rays = SLF_TRY(RayGenerator::make(camera));
  if (!(x >= 0 && x < camera.width && y >= 0 && y < camera.height))
    return fail(ErrorCode::usage, "no pixel ", x, ",", y, " in a picture of ", camera.width, "x",
                camera.height);
  const FieldShape& shape = renderer.tiles().field().shape();
  const Sphere& sphere = shape.sphere;
  const glm::dvec3 ray = glm::normalize(rays.corner() + x * rays.across() + y * rays.down());
  // Nine rays, as far apart as the lines from one vertex to neighbouring exit vertices are on
  // average.
  const double distance = std::max(glm::distance(rays.eye(), sphere.center), sphere.radius);
  const double spacing =
      sphere.radius * std::numbers::pi / 4 / (std::uint64_t{shape.exit_side} << shape.finest_level);
  Camera around{rays.eye(), rays.eye() + ray, -rays.down()};
  around.width = around.height = 3;
  around.fov = 2 * glm::degrees(std::atan(1.5 * spacing / distance));
  ViewOptions view = cut;
  view.mode = RenderMode::depth, view.level = shape.finest_level, view.with_depth = true;
  const auto picture = SLF_TRY(renderer.render(around, view));
  constexpr std::size_t kMiddle = 4;
  if (picture.rgba[kMiddle].a < 0.5f) return std::nullopt;
  const double depth = picture.depth[kMiddle];
  double squares = 0, count = 0;
  for (std::size_t k = 0; k < picture.depth.size(); ++k) {
    if (picture.rgba[k].a < 0.5f) continue;
    squares += std::pow(picture.depth[k] - depth, 2);
    ++count;
  }
  const double step = 2 * sphere.radius / 255;  // of the longest chord
  return PickedPoint{rays.eye() + depth * ray, depth,
                     std::sqrt(step * step / 12 + squares / count)};
} catch (...) {
  return tl::unexpected(error_of_exception());
}

}  // namespace slf
