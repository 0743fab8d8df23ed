#include "module.h"

#include "calls.h"

PYBIND11_MODULE(_slf, module) {
  module.doc() = "The extension module of the package slf, which documents it.";
  module.attr("version") = SLF_VERSION;
  slf::python::bind_calls(module);
  slf::python::bind_fields(module);
  slf::python::bind_scenes(module);
  slf::python::bind_writers(module);
  slf::python::bind_views(module);
}
