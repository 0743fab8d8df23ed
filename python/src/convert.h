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
#include <variant>
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
/// slf._types.Camera: eye, look_at, up and fov; or Orbit: azimuth, elevation and distance.
using CameraTuple = std::variant<std::tuple<Triple, Triple, Triple, double>, Triple>;
/// A number of random ones, or a list.
using CameraTuples = std::variant<std::uint32_t, std::vector<CameraTuple>>;
/// Of a picture: width and height, rounded down.
using SizeTuple = std::array<double, 2>;
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

/// Throws if the size is none of a picture.
Camera camera_of(const Sphere& sphere, const CameraTuple& camera, const SizeTuple& size);
/// `distance`: of random ones, in radii.
std::vector<Camera> cameras_of(const Sphere& sphere, const CameraTuples& cameras,
                               const SizeTuple& size, double distance);

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

/// Sets members of options to the keyword arguments of these names:
/// read(given, "codec", options.codec, ...). Throws if one has another type, or another name.
inline void read(const py::kwargs& given) {
  for (const auto& [name, value] : given)
    throw py::type_error("unexpected argument " + name.cast<std::string>());
}
template <class T, class... Rest>
void read(const py::kwargs& given, const char* name, T& member, Rest&&... rest) {
  if (given.contains(name)) {
    const py::object value = given.attr("pop")(name);
    try {
      member = value.cast<T>();
    } catch (const py::cast_error&) {
      throw py::type_error(name + (": unexpected value " + py::repr(value).cast<std::string>()));
    }
  }
  read(given, std::forward<Rest>(rest)...);
}

}  // namespace slf::python
