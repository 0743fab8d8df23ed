#include "convert.h"

#include <cmath>

#include "base/join.h"
#include "calls.h"
#include "source/recipe/options.h"

namespace slf::python {

Camera camera_of(const Sphere& sphere, const CameraTuple& camera, const SizeTuple& size) {
  if (!(size[0] >= 1 && size[1] >= 1 && size[0] * size[1] <= 1 << 28))
    throw Failure(
        {ErrorCode::usage, concat("size (", std::llround(size[0]), ", ", std::llround(size[1]),
                                  "): expected (width, height), at least 1 and at most "
                                  "2^28 pixels")},
        "");
  const auto width = static_cast<std::uint32_t>(size[0]);
  const auto height = static_cast<std::uint32_t>(size[1]);
  if (const auto* orbit = std::get_if<Triple>(&camera))
    return orbit_camera(sphere, (*orbit)[0], (*orbit)[1], (*orbit)[2], width, height);
  const auto& [eye, look_at, up, fov] = std::get<0>(camera);
  return {vector_of(eye), vector_of(look_at), vector_of(up), fov, width, height};
}

std::vector<Camera> cameras_of(const Sphere& sphere, const CameraTuples& cameras,
                               const SizeTuple& size, double distance) {
  if (const auto* count = std::get_if<std::uint32_t>(&cameras)) {
    const Camera like = camera_of(sphere, Triple{0, 0, distance}, size);
    return random_cameras(sphere, distance, *count, 1, like.width, like.height);
  }
  std::vector<Camera> made;
  for (const CameraTuple& camera : std::get<1>(cameras))
    made.push_back(camera_of(sphere, camera, size));
  return made;
}

py::object tuple_of(const Sphere& sphere) {
  return tuple_named("Sphere", python_of(sphere.center), sphere.radius);
}

py::object tuple_of(const FieldShape& shape) {
  return tuple_named("Shape", tuple_of(shape.sphere), shape.entry_side, shape.exit_side,
                     shape.finest_level, shape.entry_extra_levels,
                     py::tuple(py::cast(shape.subfields)));
}

ToneMapping tone_of(const ToneTuple& tuple) {
  Recipe recipe;
  value_of(recipe::set(recipe, "exposure", std::get<0>(tuple)));
  value_of(recipe::set(recipe, "tonemap", std::get<1>(tuple)));
  return recipe.raycast.lighting.tone;
}

}  // namespace slf::python
