// The parts of the extension module slf._slf. The package slf (python/slf) gives them their names,
// types and documentation; nothing else uses them.
#pragma once

#include <pybind11/pybind11.h>

namespace slf::python {

void bind_fields(pybind11::module_& module);
void bind_scenes(pybind11::module_& module);
void bind_writers(pybind11::module_& module);
void bind_views(pybind11::module_& module);

}  // namespace slf::python
