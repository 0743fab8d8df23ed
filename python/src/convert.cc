#include "convert.h"

#include <cmath>

#include "calls.h"

namespace slf::python {

std::vector<Camera> cameras_of(const std::vector<CameraTuple>& tuples) {
  std::vector<Camera> cameras;
  cameras.reserve(tuples.size());
  for (const CameraTuple& tuple : tuples) cameras.push_back(camera_of(tuple));
  return cameras;
}

py::object tuple_of(const Sphere& sphere) {
  return tuple_named("Sphere", py::cast(triple_of(sphere.center)).cast<py::tuple>(), sphere.radius);
}

py::object tuple_of(const FieldShape& shape) {
  return tuple_named("Shape", tuple_of(shape.sphere), shape.entry_side, shape.exit_side,
                     shape.levels, shape.entry_extra_levels, py::tuple(py::cast(shape.subfields)));
}

ToneMapping tone_of(const ToneTuple& tuple) {
  const auto& [exposure, curve] = tuple;
  if (!std::isfinite(exposure))
    throw Failure({ErrorCode::usage, "tone: expected a finite exposure"}, "");
  for (const auto& [name, value] : {std::pair{"neutral", ToneCurve::neutral},
                                    {"srgb", ToneCurve::srgb},
                                    {"none", ToneCurve::none}})
    if (curve == name) return {exposure, value};
  throw Failure({ErrorCode::usage, "tone curve '" + curve + "': expected neutral, srgb or none"},
                "");
}

}  // namespace slf::python
