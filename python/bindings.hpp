/// The parts of the extension module. Each function adds the classes of one source to the module.
#pragma once

#include <pybind11/pybind11.h>

namespace tactus::python {

void add_models(pybind11::module_& module);
void add_refinement(pybind11::module_& module);
void add_probe(pybind11::module_& module);
void add_recording(pybind11::module_& module);
void add_study(pybind11::module_& module);
void add_session(pybind11::module_& module);

}  // namespace tactus::python
