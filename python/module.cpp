// The extension module tactus._tactus. python/tactus/__init__.py is its public face.
#include "client_sim/scenario.hpp"
#include "netem/profile.hpp"
#include "python/bindings.hpp"
#include "spm/offline/triangle_mesh.hpp"
#include "trace/idl_schema.hpp"
#include "trace/mcap.hpp"
#include "wire/error.hpp"
#include "yaml/reader.hpp"

namespace {

namespace py = pybind11;

/// Adds an exception class with a docstring, as which C++ exceptions of type `Error` arrive in Python. Their texts are
/// those of C++.
template <class Error>
void add_error(py::module_& module, const char* name, const char* doc) {
  py::register_exception<Error>(module, name, PyExc_RuntimeError).attr("__doc__") = doc;
}

}  // namespace

PYBIND11_MODULE(_tactus, module) {
  module.doc() = "The compiled part of the package tactus.";
  add_error<tactus::spm::offline::ModelError>(module, "ModelError",
                                              "An unusable mesh, model file or option of a build.");
  add_error<tactus::netem::LinkError>(module, "LinkError", "An unknown link, or a setting of a link out of range.");
  add_error<tactus::wire::WireError>(module, "WireError", "A session that cannot be joined.");
  add_error<tactus::client_sim::ScenarioError>(module, "ScenarioError",
                                               "A scenario that is missing, or that a study cannot run.");
  add_error<tactus::yaml::YamlError>(module, "YamlError", "A YAML file with a wrong key or value.");
  add_error<tactus::trace::McapError>(module, "McapError", "A recording that cannot be read or is damaged.");
  add_error<tactus::trace::SchemaError>(module, "SchemaError", "Types or samples of a recording that cannot be read.");
  tactus::python::add_models(module);
  tactus::python::add_refinement(module);
  tactus::python::add_probe(module);
  tactus::python::add_recording(module);
  tactus::python::add_study(module);
  tactus::python::add_session(module);
}
