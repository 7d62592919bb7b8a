#include "python/model.hpp"

#include <pybind11/functional.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <utility>

#include "python/arrays.hpp"
#include "python/bindings.hpp"
#include "spm/offline/generate.hpp"
#include "spm/offline/import.hpp"
#include "spm/offline/verify.hpp"
#include "spm/offline/write_mesh.hpp"

namespace tactus::python {
namespace {

using spm::offline::LossPolicy;
using Faces = std::vector<std::array<std::uint32_t, 3>>;
using NoGil = py::call_guard<py::gil_scoped_release>;

/// Calls the progress function of a script, if there is one, in the thread that called the package. Also raises
/// KeyboardInterrupt, so that Ctrl-C ends a long call.
void report_progress(const py::object& progress, std::string_view stage, double done) {
  const py::gil_scoped_acquire gil;
  if (PyErr_CheckSignals() != 0) throw py::error_already_set();
  if (!progress.is_none()) progress(py::str(stage.data(), stage.size()), done);
}

LossPolicy loss_policy(bool allow_losses) { return allow_losses ? LossPolicy::kAllow : LossPolicy::kRefuse; }

SourcedMesh mesh_of(const py::array_t<float, py::array::c_style | py::array::forcecast>& vertices,
                    const py::object& face_rows) {
  const py::array faces{face_rows};
  require(vertices.ndim() == 2 && vertices.shape(1) == 3,
          "vertices: found shape " + shape_text(vertices) + ", expected (n, 3)");
  require(faces.ndim() == 2 && faces.shape(1) == 3, "faces: found shape " + shape_text(faces) + ", expected (n, 3)");
  require(faces.dtype().kind() == 'i' || faces.dtype().kind() == 'u',
          "faces: found numbers of type " + std::string{py::str(faces.dtype())} + ", expected integers");
  const py::array_t<std::int64_t, py::array::c_style | py::array::forcecast> corners{faces};
  SourcedMesh made{{}, "arrays"};
  const auto* const first = reinterpret_cast<const std::array<float, 3>*>(vertices.data());
  made.mesh.positions.assign(first, first + vertices.shape(0));
  made.mesh.faces.resize(static_cast<std::size_t>(corners.shape(0)));
  const auto count = static_cast<std::int64_t>(made.mesh.positions.size());
  for (std::size_t i = 0; i < made.mesh.faces.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      const std::int64_t corner = corners.data()[3 * i + k];
      require(corner >= 0 && corner < count, "face " + std::to_string(i) + ": found vertex " + std::to_string(corner) +
                                                 ", expected below " + std::to_string(count));
      made.mesh.faces[i][k] = static_cast<std::uint32_t>(corner);
    }
  }
  return made;
}

SourcedMesh load_mesh(const std::filesystem::path& path, bool allow_losses) {
  return {spm::offline::import_mesh(path, loss_policy(allow_losses)), path.filename().string()};
}

SourcedMesh generate_mesh(const std::string& shape, std::uint32_t faces, std::uint64_t seed) {
  return {spm::offline::generate(spm::offline::shape_from_name(shape), faces, seed), shape};
}

std::shared_ptr<SharedModel> build(const SourcedMesh& mesh, std::optional<double> size, double metres_per_unit,
                                   std::uint32_t base_faces, std::uint32_t cell_faces, unsigned grid_bits,
                                   double pair_distance, bool allow_losses, unsigned threads,
                                   const py::object& progress) {
  // The limits of `tactus mesh build`.
  require(!size || (*size > 0 && std::isfinite(*size)),
          "size: found " + std::to_string(size.value_or(0)) + ", expected a finite number above 0");
  require(metres_per_unit > 0 && std::isfinite(metres_per_unit),
          "metres_per_unit: found " + std::to_string(metres_per_unit) + ", expected a finite number above 0");
  require(base_faces >= 1 && base_faces < spm::offline::kMaxBuiltFaces,
          "base_faces: found " + std::to_string(base_faces) + ", expected 1 to " +
              std::to_string(spm::offline::kMaxBuiltFaces - 1));
  require(cell_faces >= 8 && cell_faces <= 1u << 20,
          "cell_faces: found " + std::to_string(cell_faces) + ", expected 8 to " + std::to_string(1u << 20));
  require(grid_bits == 0 || (grid_bits >= 4 && grid_bits <= 20),
          "grid_bits: found " + std::to_string(grid_bits) + ", expected 0 or 4 to 20");
  require(pair_distance >= 0 && std::isfinite(pair_distance),
          "pair_distance: found " + std::to_string(pair_distance) + ", expected a finite number of at least 0");
  spm::offline::BuildOptions options;
  options.size = size;
  options.metres_per_unit = metres_per_unit;
  options.simplify.base_faces = base_faces;
  options.partition.cell_faces = cell_faces;
  options.partition.max_cell_faces = cell_faces * 5 / 2;
  options.grid_bits = grid_bits;
  options.pair_distance = pair_distance;
  options.losses = loss_policy(allow_losses);
  options.threads = threads;
  const py::gil_scoped_release no_gil;
  return std::make_shared<SharedModel>(
      spm::offline::build_model(mesh.mesh, options,
                                [&](std::string_view stage, double done) { report_progress(progress, stage, done); }),
      mesh.source);
}

py::dict verify(const SharedModel& model, const SourcedMesh& original, const py::object& progress) {
  spm::offline::Verification result;
  {
    const py::gil_scoped_release no_gil;
    result = spm::offline::verify(model.arrays().model(), original.mesh,
                                  [&](double done) { report_progress(progress, "verify", done); });
  }
  // The keys of `tactus mesh verify --json`.
  py::dict report;
  report["exact"] = result.mismatches.empty();
  report["faces"] = result.faces;
  report["regions"] = result.regions;
  report["faces_in_regions"] = result.faces_in_regions;
  report["mismatches"] = result.mismatches;
  return report;
}

void save_model(const SharedModel& model, const std::filesystem::path& path) {
  spm::offline::write_model(path, model.arrays().model(), model.provenance());
}

py::array regions_of(const py::object& self) {
  return view_of_records(std::span<const spm::Region>{self.cast<const SharedModel&>().arrays().regions}, self);
}

py::array_t<std::uint32_t> regions_near(const SharedModel& model, const Numbers& centre, double radius) {
  const spm::Vec3d at = vector_in(centre, "centre");
  require(radius >= 0, "radius: found " + std::to_string(radius) + ", expected at least 0");
  std::vector<std::uint32_t> found;
  if (!model.grid().for_each_intersecting(at, radius,
                                          [&](spm::RegionId region, double) { found.push_back(spm::index(region)); })) {
    // The sphere contains so many cells that it is faster to test every region.
    found.clear();
    for (std::uint32_t i = 0; i < model.grid().size(); ++i)
      if (model.grid().squared_distance(spm::RegionId{i}, at) <= radius * radius) found.push_back(i);
  }
  std::sort(found.begin(), found.end());
  return py::array_t<std::uint32_t>{static_cast<py::ssize_t>(found.size()), found.data()};
}

py::array_t<std::uint32_t> refined_faces(
    const SharedModel& model, const py::array_t<std::int64_t, py::array::c_style | py::array::forcecast>& regions) {
  require(regions.ndim() == 1, "regions: found shape " + shape_text(regions) + ", expected (n,)");
  const std::span<const std::int64_t> ids{regions.data(), static_cast<std::size_t>(regions.size())};
  Faces faces;
  {
    const py::gil_scoped_release no_gil;
    faces = model.refined_faces(ids);
  }
  return array_of_rows(std::move(faces));
}

py::array_t<double> bounds_of(const spm::ModelSummary& summary) {
  py::array_t<double> bounds{{2, 3}};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    bounds.mutable_at(0, axis) = double{summary.bounds_min[axis]};
    bounds.mutable_at(1, axis) = double{summary.bounds_max[axis]};
  }
  return bounds;
}

void add_mesh(py::module_& module) {
  py::class_<SourcedMesh>(module, "Mesh", "Triangles of a file, of arrays or of a generator. Cannot be changed.")
      .def(py::init(&mesh_of), py::arg("vertices"), py::arg("faces"),
           "Copies a mesh.\n\nvertices: shape (n, 3), rounded to float32. faces: shape (m, 3), integers, the corners\n"
           "counter-clockwise seen from outside. Raises ValueError for a wrong shape or corner.")
      .def_static("load", &load_mesh, py::arg("path"), py::arg("allow_losses") = false, NoGil(),
                  "Reads an OBJ, PLY, STL, glTF, GLB or OFF file. Raises ModelError.\n\nallow_losses: accept a file of "
                  "which most vertices or faces cannot be used.")
      .def_static(
          "generate", &generate_mesh, py::arg("shape"), py::arg("faces") = 4096, py::arg("seed") = 1, NoGil(),
          "Generates a mesh of about 0.1 m: sphere, torus, organ, terrain, wall or box. The seed affects organ\n"
          "and terrain only. Raises ModelError for an unknown shape.")
      .def(
          "save",
          [](const SourcedMesh& self, const std::filesystem::path& path) { spm::offline::write_mesh(path, self.mesh); },
          py::arg("path"), NoGil(), "Writes a .ply, .stl or .obj file. Raises ModelError.")
      .def_property_readonly(
          "vertices",
          [](const py::object& self) {
            return view_of(std::span{self.cast<const SourcedMesh&>().mesh.positions}, self);
          },
          "The vertices: float32, shape (n, 3), read-only.")
      .def_property_readonly(
          "faces",
          [](const py::object& self) { return view_of(std::span{self.cast<const SourcedMesh&>().mesh.faces}, self); },
          "The corners of the faces as indices into `vertices`: uint32, shape (m, 3), read-only.")
      .def_property_readonly(
          "source", [](const SourcedMesh& self) { return self.source; },
          "Name of the file without folder, name of the generated shape, or \"arrays\".")
      .def("__repr__", [](const SourcedMesh& self) {
        return "<tactus.Mesh of " + self.source + ": " + std::to_string(self.mesh.positions.size()) + " vertices, " +
               std::to_string(self.mesh.faces.size()) + " faces>";
      });
}

void add_summary(py::module_& module) {
  using spm::ModelSummary;
  py::class_<ModelSummary>(module, "Summary", "Sizes and properties of a model, in its file units.")
      .def_readonly("digest", &ModelSummary::digest, "XXH3-64 of the model: equal for equal models.")
      .def_readonly("vertices", &ModelSummary::vertices, "Number of vertices of the finest mesh.")
      .def_readonly("faces", &ModelSummary::faces, "Number of faces of the finest mesh.")
      .def_readonly("base_vertices", &ModelSummary::base_vertices, "Number of vertices of the base mesh.")
      .def_readonly("base_faces", &ModelSummary::base_faces, "Number of faces of the base mesh.")
      .def_readonly("records", &ModelSummary::records, "Number of vertex-split records.")
      .def_readonly("parts", &ModelSummary::parts, "Number of record parts.")
      .def_readonly("regions", &ModelSummary::regions, "Number of regions.")
      .def_readonly("max_level", &ModelSummary::max_level, "Length of the longest chain of dependent records.")
      .def_property_readonly("bounds", &bounds_of, "Lowest and highest corner of the bounding box, shape (2, 3).")
      .def_property_readonly(
          "cell_size", [](const ModelSummary& self) { return self.grid.cell_size; }, "Edge of a cell of depth 0.")
      .def_readonly("metres_per_unit", &ModelSummary::metres_per_unit, "Metres per file unit.")
      .def_readonly("deviation", &ModelSummary::deviation,
                    "Upper bound of the distance between any version of the mesh and the finest one.")
      .def_readonly("position_step", &ModelSummary::position_step,
                    "Step of the grid of coordinates; 0 in the lossless profile.");
}

}  // namespace

std::string shape_text(const py::array& array) { return py::str(array.attr("shape")); }

std::span<const std::array<double, 3>> points_in(const Numbers& array, const char* name) {
  require(array.ndim() == 2 && array.shape(1) == 3,
          std::string{name} + ": found shape " + shape_text(array) + ", expected (n, 3)");
  require(std::all_of(array.data(), array.data() + array.size(), [](double x) { return std::isfinite(x); }),
          std::string{name} + ": found a number that is not finite");
  return {reinterpret_cast<const std::array<double, 3>*>(array.data()), static_cast<std::size_t>(array.shape(0))};
}

spm::Vec3d vector_in(const Numbers& array, const char* name) {
  require(array.ndim() == 1 && array.shape(0) == 3,
          std::string{name} + ": found shape " + shape_text(array) + ", expected (3,)");
  const spm::Vec3d vector{array.data()[0], array.data()[1], array.data()[2]};
  require(vector.allFinite(), std::string{name} + ": found a number that is not finite");
  return vector;
}

py::dtype record_type(std::initializer_list<Field> fields, std::size_t bytes) {
  py::list names, formats, offsets;
  for (const Field& field : fields) {
    names.append(field.name);
    formats.append(field.format);
    offsets.append(field.offset);
  }
  return {names, formats, offsets, static_cast<py::ssize_t>(bytes)};
}

SharedModel::SharedModel(const std::filesystem::path& path) : file_{std::in_place, path}, arrays_{file_->decode()} {
  provenance_ = file_->provenance();
}

SharedModel::SharedModel(spm::offline::BuiltModel built, std::string source)
    : arrays_{std::move(static_cast<spm::OwnedModel&>(built))}, provenance_{std::move(source), built.cleaned} {}

const Faces& SharedModel::base_faces() const {
  std::call_once(base_once_, [this] { base_ = spm::base_triangles(arrays_.model()); });
  return base_;
}

const Faces& SharedModel::finest_faces() const {
  std::call_once(finest_once_, [this] { finest_ = spm::finest_faces(arrays_.model()); });
  return finest_;
}

const spm::codec::CompressedModel& SharedModel::compressed() const {
  if (file_) return file_->compressed();
  std::call_once(encoded_once_, [this] { encoded_.emplace(arrays_.model()); });
  return encoded_->compressed();
}

const spm::RegionGrid& SharedModel::grid() const {
  std::call_once(grid_once_, [this] { grid_.emplace(summary().grid, arrays_.regions); });
  return *grid_;
}

Faces SharedModel::refined_faces(std::span<const std::int64_t> regions) const {
  const spm::Model model = arrays_.model();
  std::vector<bool> applied(model.summary.records, false);
  for (const std::int64_t region : regions) {
    require(region >= 0 && region < model.summary.regions,
            "found region " + std::to_string(region) + ", expected below " + std::to_string(model.summary.regions));
    for (const spm::Interval& interval : model.intervals_of(spm::RegionId{static_cast<std::uint32_t>(region)}))
      for (std::uint32_t r = interval.first; r < interval.first + interval.count; ++r) applied[r] = true;
  }
  // The corners of a face that is not shown are equal.
  spm::ModelCorners corners = spm::base_corners(model);
  for (std::uint32_t r = 0; r < model.summary.records; ++r)
    if (applied[r]) spm::apply_record(model, spm::RecordId{r}, corners, [](spm::VertexId) {});
  Faces faces;
  for (const std::array<spm::VertexId, 3>& face : corners.values())
    if (face[0] != face[1]) faces.push_back({spm::index(face[0]), spm::index(face[1]), spm::index(face[2])});
  return faces;
}

void add_models(py::module_& module) {
  using spm::Region;
  set_row_type<Region>({{"cell", "(3,)u2", offsetof(Region, cell)},
                        {"depth", "u2", offsetof(Region, depth)},
                        {"occupied", "(2,)u4", offsetof(Region, occupied)},
                        {"records", "u4", offsetof(Region, record_count)},
                        {"parts", "u4", offsetof(Region, part_count)},
                        {"faces", "u4", offsetof(Region, face_count)}});
  add_mesh(module);
  add_summary(module);
  py::class_<SharedModel, std::shared_ptr<SharedModel>>(
      module, "Model",
      "A space-partitioned multi-resolution model: base mesh, vertex-split records, regions.\n\n"
      "Every version of the mesh has the vertices of `vertices`; versions differ in their faces. Cannot be changed.")
      .def_static(
          "open", [](const std::filesystem::path& path) { return std::make_shared<SharedModel>(path); },
          py::arg("path"), NoGil(),
          "Opens an .spm file and checks all of it. Raises ModelError that names the file, the value found and the\n"
          "value expected.")
      .def("save", &save_model, py::arg("path"), NoGil(),
           "Writes an .spm file. Another program never sees an incomplete file. Raises ModelError.")
      .def("verify", &verify, py::arg("original"), py::arg("progress") = py::none(),
           "Compares the model with its original mesh to the bit: the finest mesh, and each region alone.\n\n"
           "Returns a dict with the keys of `tactus mesh verify --json`: exact, faces, regions, faces_in_regions,\n"
           "mismatches.")
      .def(
          "violations", [](const SharedModel& self) { return spm::violations(self.arrays().model()); }, NoGil(),
          "Descriptions of the defects of the model; empty if it has none.")
      .def_property_readonly(
          "summary", [](const SharedModel& self) -> const spm::ModelSummary& { return self.summary(); },
          "Sizes and properties of the model.")
      .def_property_readonly(
          "source", [](const SharedModel& self) { return self.provenance().source; },
          "Name of the source of the mesh, as Mesh.source.")
      .def_property_readonly(
          "vertices",
          [](const py::object& self) {
            return view_of(std::span{self.cast<const SharedModel&>().arrays().positions}, self);
          },
          "The vertices: float32, shape (n, 3), read-only. Those of the base mesh come first.")
      .def_property_readonly(
          "base_faces",
          [](const py::object& self) { return view_of(std::span{self.cast<const SharedModel&>().base_faces()}, self); },
          "The faces of the base mesh: uint32, shape (m, 3), read-only.")
      .def_property_readonly(
          "finest_faces",
          [](const py::object& self) {
            return view_of(std::span{self.cast<const SharedModel&>().finest_faces()}, self);
          },
          "The faces of the finest mesh by number: uint32, shape (m, 3), read-only.")
      .def("refined_faces", &refined_faces, py::arg("regions"),
           "The faces of the mesh that is refined in these regions and nowhere else: a new uint32 array of shape "
           "(m, 3).\nRaises ValueError for a region that does not exist.")
      .def_property_readonly(
          "regions", &regions_of,
          "The regions: a read-only structured array with the fields cell, depth, occupied, records, "
          "parts\nand faces.")
      .def("regions_near", &regions_near, py::arg("centre"), py::arg("radius"),
           "The regions that a sphere intersects, ascending: a new uint32 array.")
      .def("__repr__", [](const SharedModel& self) {
        return "<tactus.Model of " + self.provenance().source + ": " + std::to_string(self.summary().faces) +
               " faces, " + std::to_string(self.summary().base_faces) + " in the base mesh, " +
               std::to_string(self.summary().regions) + " regions>";
      });
  module.def(
      "build", &build, py::arg("mesh"), py::kw_only(), py::arg("size") = py::none(), py::arg("metres_per_unit") = 1.0,
      py::arg("base_faces") = spm::offline::SimplifyOptions{}.base_faces,
      py::arg("cell_faces") = spm::offline::PartitionOptions{}.cell_faces, py::arg("grid_bits") = 0,
      py::arg("pair_distance") = 0.0, py::arg("allow_losses") = false, py::arg("threads") = 0,
      py::arg("progress") = py::none(),
      "Builds a model with the options of `tactus mesh build`, and with the same bytes.\n\n"
      "size: longest side in m, instead of metres_per_unit. base_faces: faces of the base mesh. cell_faces: target\n"
      "number of faces of a region. grid_bits: 4 to 20 for the compact profile, 0 for the lossless one. "
      "pair_distance:\n"
      "m, see `tactus mesh build --pairs`. threads: 0 for one per processor. progress: called with the name of the\n"
      "stage and its finished share. Raises ModelError for an unusable mesh, and ValueError for an option out of "
      "range.");
}

}  // namespace tactus::python
