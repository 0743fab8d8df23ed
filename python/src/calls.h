// Calls into slf from Python: errors as exceptions, and long work without the GIL.
#pragma once

#include <pybind11/pybind11.h>

#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "slf/error.h"
#include "slf/progress.h"

namespace slf::python {

namespace py = pybind11;

/// Text that need not be UTF-8: names of files, and what names them. Python has it as os.fsdecode()
/// makes it, and may pass what os.fsencode() takes.
struct Text : std::string {
  Text() = default;
  Text(std::string text) : std::string(std::move(text)) {}
};
using Texts = std::vector<Text>;

/// An Error on its way to Python, where it is raised as a class of slf._errors. `path` is the file
/// or address that the call was about, or empty.
struct Failure : std::runtime_error {
  Failure(Error error, std::string about)
      : std::runtime_error(error.message), code(error.code), path(std::move(about)) {}
  ErrorCode code;
  std::string path;
};

/// The value of a Result. Throws its error as Failure.
template <class T>
T value_of(Result<T>&& result, const std::string& path = {}) {
  if (!result) throw Failure(std::move(result.error()), path);
  if constexpr (!std::is_void_v<T>) return std::move(*result);
}

/// One long call, without the GIL. progress() gives slf a callback that calls Python's handlers of
/// signals about ten times a second, and `callback(done, total, skipped)`, if that is not None. It
/// stops the call if one of them raises or returns False, or if the interpreter is about to exit.
///
///   LongCall call(callback);
///   return call.value(path, [&] { return build_field(…, call.progress()); });
class LongCall {
 public:
  explicit LongCall(py::object callback = py::none()) : callback_(std::move(callback)) {}

  [[nodiscard]] ProgressCallback progress() {
    return [this](const Progress& progress) { return go_on(progress); };
  }

  /// Returns f(). Throws what Python code raised in a callback meanwhile.
  template <class F>
  auto without_gil(F&& f) {
    auto result = [&] {
      const py::gil_scoped_release release;
      const Running running;
      return std::forward<F>(f)();
    }();
    if (raised_) throw std::move(*raised_);
    return result;
  }
  /// The value of such a Result. Throws its error as Failure.
  template <class F>
  auto value(const std::string& path, F&& f) {
    return value_of(without_gil(std::forward<F>(f)), path);
  }

 private:
  /// Counts calls, so that the interpreter's exit can wait for them. Then the calls of daemon
  /// threads do not return, as these threads must not take the GIL again. Constructed and destroyed
  /// without the GIL.
  struct Running {
    Running();
    ~Running();
  };
  bool go_on(const Progress& progress);

  py::object callback_;
  double last_ = 0;  ///< seconds
  std::optional<py::error_already_set> raised_;
};

/// Adds a class's close(), and makes it a context manager.
template <class Class, class Close>
Class& bind_closing(Class&& type, Close close, const char* help) {
  return type.def("close", close, help)
      .def("__enter__", [](py::object self) { return self; })
      .def("__exit__", [](const py::object& self, const py::args&) { self.attr("close")(); });
}

/// Registers the translation of errors, and what happens at exit.
void bind_calls(py::module_& module);

}  // namespace slf::python

namespace pybind11::detail {

template <>
struct type_caster<slf::python::Text> {
  PYBIND11_TYPE_CASTER(slf::python::Text, const_name("str"));
  bool load(handle from, bool) {
    PyObject* bytes = nullptr;
    if (PyUnicode_FSConverter(from.ptr(), &bytes) == 0) {
      PyErr_Clear();
      return false;
    }
    value = std::string(reinterpret_steal<pybind11::bytes>(bytes));
    return true;
  }
  static handle cast(const slf::python::Text& text, return_value_policy, handle) {
    return PyUnicode_DecodeUTF8(text.data(), static_cast<ssize_t>(text.size()), "surrogateescape");
  }
};

}  // namespace pybind11::detail
