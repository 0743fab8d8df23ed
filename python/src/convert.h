// Values of slf as the named tuples of slf._types, and back.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <array>
#include <cstdint>
#include <glm/glm.hpp>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "base/report.h"
#include "calls.h"
#include "slf/camera.h"
#include "slf/inspect.h"
#include "slf/render.h"
#include "slf/shape.h"
#include "slf/tone.h"

namespace slf::python {

namespace py = pybind11;

using Triple = std::array<double, 3>;
/// slf._types.Camera with the picture's size: eye, look_at, up, fov, width, height.
using CameraTuple = std::tuple<Triple, Triple, Triple, double, std::uint32_t, std::uint32_t>;
/// slf._types.Sphere: centre and radius.
using SphereTuple = std::tuple<Triple, double>;
/// slf._types.Tone: exposure and curve.
using ToneTuple = std::tuple<float, std::string>;

/// slf._types.NAME(values...)
template <class... Values>
py::object tuple_named(const char* name, Values&&... values) {
  return py::module_::import("slf._types").attr(name)(std::forward<Values>(values)...);
}

/// A report (base/report.h), or a member of one, as Python has it: named tuples and tuples.
template <class T>
py::object python_of(const T& value) {
  if constexpr (report::Report<T>) {
    py::list members;
    const auto add = [&](const report::Name& name, const auto& member, const char*,
                         const char* = "") {
      if (name.python) members.append(python_of(member));
    };
    value.describe(add);
    return tuple_named(T::kPython, *members);
  } else if constexpr (report::Pointer<T> || report::Optional<T>) {
    return value ? python_of(*value) : py::none();
  } else if constexpr (report::Text<T>) {
    return py::cast(Text(value));
  } else if constexpr (report::Vector<T>) {
    return py::make_tuple(value.x, value.y, value.z);
  } else if constexpr (report::List<T>) {
    py::list list;
    for (const auto& one : value) list.append(python_of(one));
    return py::tuple(list);
  } else {
    return py::cast(value);
  }
}

inline glm::dvec3 vector_of(const Triple& v) { return {v[0], v[1], v[2]}; }
inline Triple triple_of(const glm::dvec3& v) { return {v.x, v.y, v.z}; }

inline Camera camera_of(const CameraTuple& tuple) {
  const auto& [eye, look_at, up, fov, width, height] = tuple;
  return {vector_of(eye), vector_of(look_at), vector_of(up), fov, width, height};
}
inline CameraTuple tuple_of(const Camera& c) {
  return {triple_of(c.eye), triple_of(c.look_at), triple_of(c.up), c.fov, c.width, c.height};
}
std::vector<Camera> cameras_of(const std::vector<CameraTuple>& tuples);

inline Sphere sphere_of(const SphereTuple& tuple) {
  return {vector_of(std::get<0>(tuple)), std::get<1>(tuple)};
}
py::object tuple_of(const Sphere& sphere);
py::object tuple_of(const FieldShape& shape);

/// Throws if the curve is unknown.
ToneMapping tone_of(const ToneTuple& tuple);
inline std::optional<ToneMapping> tone_of(const std::optional<ToneTuple>& tuple) {
  return tuple ? std::optional(tone_of(*tuple)) : std::nullopt;
}

}  // namespace slf::python
