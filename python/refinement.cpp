// Local refinement and queries of the refined mesh.
#include <pybind11/stl.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <memory>
#include <mutex>
#include <optional>
#include <utility>

#include "python/arrays.hpp"
#include "python/bindings.hpp"
#include "python/model.hpp"
#include "spm/codec/compressed_source.hpp"
#include "spm/local_refinement.hpp"

namespace tactus::python {
namespace {

using spm::Vec3d;

/// The rows of the structured arrays.
struct ContactRow {
  std::array<double, 3> point;
  std::uint32_t face;
  bool finest;
};
struct NearestRow {
  double distance = std::numeric_limits<double>::infinity();
  std::array<double, 3> point;
  std::uint32_t face = spm::kNone;
};
struct SweepRow {
  double share = std::numeric_limits<double>::infinity();
  std::array<double, 3> point, normal;
  std::uint32_t face = spm::kNone;
};
struct FrameRow {
  double depth;  // file units; 0 without contact
  std::array<double, 3> point;
  std::uint32_t face, contacts;
  bool exact, refined;
};

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
std::array<double, 3> plain(const Vec3d& v) { return {v.x(), v.y(), v.z()}; }

/// A LocalRefinement with the model that it needs. Its calls release the interpreter's lock and run one after another.
class ScriptRefinement {
 public:
  ScriptRefinement(std::shared_ptr<const SharedModel> model, double radius,
                   const spm::LocalRefinementSettings& settings)
      : model_{std::move(model)},
        source_{model_->compressed()},
        refinement_{source_, spm::ProbeShape{radius}, settings},
        radius_{radius} {}

  void approach(const Vec3d& position, double time, bool in_contact) {
    const Call call{*this};
    move(position, time, in_contact);
  }
  bool refine(std::uint32_t budget) {
    const Call call{*this};
    return refinement_.refine(spm::Budget{budget}) == spm::Advance::kDone;
  }

  /// Appends the contacts of each sphere to `rows`, and their end to `ends`.
  void find_contacts(std::span<const std::array<double, 3>> centres, double radius, std::vector<ContactRow>& rows,
                     std::vector<std::int64_t>& ends) {
    const Call call{*this};
    for (const std::array<double, 3>& centre : centres) {
      const std::uint32_t found = contacts_of(Vec3d{centre[0], centre[1], centre[2]}, radius);
      rows_.resize(std::max<std::size_t>(rows_.size(), found));
      for (std::uint32_t i = 0; i < found; ++i) {
        const spm::Contact& contact = contacts_[i];
        rows_[i] = {
            {contact.point.x(), contact.point.y(), contact.point.z()}, spm::index(contact.face), contact.is_finest()};
      }
      rows.insert(rows.end(), rows_.begin(), rows_.begin() + found);  // as one block of bytes
      ends.push_back(static_cast<std::int64_t>(rows.size()));
      // Estimates the number of all contacts from the first spheres, because growing copies the contacts.
      constexpr std::size_t kSample = 64;
      if (ends.size() == kSample + 1) rows.reserve(rows.size() * centres.size() / kSample);
    }
  }
  void nearest(std::span<const std::array<double, 3>> points, double max_distance, std::vector<NearestRow>& rows) {
    const Call call{*this};
    spm::NearestFace found;
    for (std::size_t i = 0; i < points.size(); ++i) {
      const Vec3d point{points[i][0], points[i][1], points[i][2]};
      rows[i].point = {kNan, kNan, kNan};
      if (refinement_.forest().tree().nearest(point, max_distance, found))
        rows[i] = {std::sqrt(found.squared_distance), plain(found.point), spm::index(found.face)};
    }
  }
  void sweep(std::span<const std::array<double, 3>> from, std::span<const std::array<double, 3>> to, double radius,
             std::vector<SweepRow>& rows) {
    const Call call{*this};
    spm::SweepContact found;
    for (std::size_t i = 0; i < from.size(); ++i) {
      rows[i].point = rows[i].normal = {kNan, kNan, kNan};
      if (refinement_.forest().tree().sweep({from[i][0], from[i][1], from[i][2]}, {to[i][0], to[i][1], to[i][2]},
                                            radius, found))
        rows[i] = {found.time, plain(found.point), plain(found.normal), spm::index(found.face)};
    }
  }
  /// Moves the sphere along a path and queries in each frame.
  void follow(std::span<const std::array<double, 3>> path, double interval, std::uint32_t budget,
              std::vector<FrameRow>& rows) {
    const Call call{*this};
    for (std::size_t i = 0; i < path.size(); ++i) {
      const Vec3d centre{path[i][0], path[i][1], path[i][2]};
      move(centre, time_ ? *time_ + interval : 0, touches_);
      FrameRow& row = rows[i];
      row.refined = refinement_.refine(spm::Budget{budget}) == spm::Advance::kDone;
      row.exact = refinement_.is_exact();
      row.contacts = contacts_of(centre, radius_);
      touches_ = row.contacts > 0;
      row.depth = 0;
      row.point = {kNan, kNan, kNan};
      row.face = spm::kNone;
      double nearest = std::numeric_limits<double>::infinity();
      for (std::uint32_t k = 0; k < row.contacts; ++k) {
        const double squared = (contacts_[k].point - centre).squaredNorm();
        if (squared >= nearest) continue;
        nearest = squared;
        row.depth = contacts_[k].depth(centre, radius_);
        row.point = plain(contacts_[k].point);
        row.face = spm::index(contacts_[k].face);
      }
    }
  }
  /// Returns the corners of the shown faces, and their numbers.
  std::pair<std::vector<std::array<float, 9>>, std::vector<std::uint32_t>> shown() {
    const Call call{*this};
    std::pair<std::vector<std::array<float, 9>>, std::vector<std::uint32_t>> result;
    const spm::AbTree& tree = refinement_.forest().tree();
    for (const spm::LeafLane at : tree.shown()) {
      result.first.push_back(tree.corners(at));
      result.second.push_back(spm::index(tree.face(at)));
    }
    return result;
  }
  [[nodiscard]] bool exact() {
    const Call call{*this};
    return refinement_.is_exact();
  }
  [[nodiscard]] std::uint64_t evictions() {
    const Call call{*this};
    return refinement_.evictions();
  }
  [[nodiscard]] double radius() const noexcept { return radius_; }

 private:
  /// Releases the interpreter's lock and waits for the end of another thread's call.
  struct Call {
    explicit Call(ScriptRefinement& refinement) : lock{refinement.mutex_} {}
    py::gil_scoped_release no_gil;
    std::lock_guard<std::mutex> lock;
  };

  void move(const Vec3d& position, double time, bool in_contact) {
    constexpr double kMaxTime = 1e9;  // s; the prediction needs times that are exact to a microsecond
    require(std::abs(time) <= kMaxTime, "time: found " + std::to_string(time) + " s, expected -1e9 to 1e9 s");
    require(!time_ || time > *time_, "time: found " + std::to_string(time) + " s, expected above " +
                                         std::to_string(time_.value_or(0)) + " s, the time of the previous pose");
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    pose.translation() = position;
    refinement_.approach(pose, time, in_contact);
    time_ = time;
  }
  /// Fills contacts_ with all contacts of a sphere and returns their number.
  std::uint32_t contacts_of(const Vec3d& centre, double radius) {
    for (;;) {
      const auto capacity = static_cast<std::uint32_t>(contacts_.size());
      const std::uint32_t found = refinement_.find_contacts(centre, radius, contacts_.data(), capacity);
      if (found <= capacity) return found;
      contacts_.resize(found);
    }
  }

  std::shared_ptr<const SharedModel> model_;
  spm::codec::CompressedSource source_;
  spm::LocalRefinement refinement_;
  double radius_;
  std::optional<double> time_;    // of the last pose, s
  bool touches_ = false;          // the last frame of `follow` had a contact
  std::vector<ContactRow> rows_;  // of one sphere
  std::vector<spm::Contact> contacts_ = std::vector<spm::Contact>(1024);
  std::mutex mutex_;
};

void require_not_negative(const char* name, double value) {
  require(value >= 0 && std::isfinite(value),
          std::string{name} + ": found " + std::to_string(value) + ", expected a finite number of at least 0");
}

std::unique_ptr<ScriptRefinement> make_refinement(std::shared_ptr<const SharedModel> model, double radius,
                                                  std::uint64_t memory, double refine_margin, double retain_margin,
                                                  double look_ahead, double load_ahead, double min_speed,
                                                  std::uint32_t targets) {
  require_not_negative("radius", radius);
  require_not_negative("refine_margin", refine_margin);
  require_not_negative("retain_margin", retain_margin);
  require_not_negative("look_ahead", look_ahead);
  require_not_negative("load_ahead", load_ahead);
  require_not_negative("min_speed", min_speed);
  spm::LocalRefinementSettings settings;
  settings.memory = memory;
  settings.margins = {refine_margin, retain_margin};
  settings.look_ahead = look_ahead;
  settings.load_ahead = load_ahead;
  settings.min_speed = min_speed;
  settings.targets = targets;
  const py::gil_scoped_release no_gil;
  return std::make_unique<ScriptRefinement>(std::move(model), radius, settings);
}

py::tuple find_contacts(ScriptRefinement& self, const Numbers& centres, std::optional<double> radius) {
  const auto points = points_in(centres, "centres");
  const double used = radius.value_or(self.radius());
  require_not_negative("radius", used);
  std::vector<ContactRow> rows;
  std::vector<std::int64_t> ends{0};
  ends.reserve(points.size() + 1);
  self.find_contacts(points, used, rows, ends);
  return py::make_tuple(array_of_records(std::move(rows)),
                        py::array_t<std::int64_t>{static_cast<py::ssize_t>(ends.size()), ends.data()});
}

py::array nearest(ScriptRefinement& self, const Numbers& points, double max_distance) {
  const auto centres = points_in(points, "points");
  require(max_distance >= 0, "max_distance: found " + std::to_string(max_distance) + ", expected at least 0");
  std::vector<NearestRow> rows(centres.size());
  self.nearest(centres, max_distance, rows);
  return array_of_records(std::move(rows));
}

py::array sweep(ScriptRefinement& self, const Numbers& starts, const Numbers& ends, std::optional<double> radius) {
  const auto from = points_in(starts, "starts"), to = points_in(ends, "ends");
  require(from.size() == to.size(), "ends: found " + std::to_string(to.size()) + " points, expected " +
                                        std::to_string(from.size()) + ", as in starts");
  const double used = radius.value_or(self.radius());
  require_not_negative("radius", used);
  std::vector<SweepRow> rows(from.size());
  self.sweep(from, to, used, rows);
  return array_of_records(std::move(rows));
}

py::array follow(ScriptRefinement& self, const Numbers& path, double interval, std::uint32_t budget) {
  const auto points = points_in(path, "path");
  require(interval > 0 && std::isfinite(interval),
          "interval: found " + std::to_string(interval) + " s, expected a finite time above 0");
  std::vector<FrameRow> rows(points.size());
  self.follow(points, interval, budget, rows);
  return array_of_records(std::move(rows));
}

py::tuple shown_triangles(ScriptRefinement& self) {
  auto [corners, faces] = self.shown();
  return py::make_tuple(array_of_rows(std::move(corners)).attr("reshape")(-1, 3, 3),
                        py::array_t<std::uint32_t>{static_cast<py::ssize_t>(faces.size()), faces.data()});
}

}  // namespace

void add_refinement(py::module_& module) {
  set_row_type<ContactRow>({{"point", "(3,)f8", offsetof(ContactRow, point)},
                            {"face", "u4", offsetof(ContactRow, face)},
                            {"finest", "?", offsetof(ContactRow, finest)}});
  set_row_type<NearestRow>({{"distance", "f8", offsetof(NearestRow, distance)},
                            {"point", "(3,)f8", offsetof(NearestRow, point)},
                            {"face", "u4", offsetof(NearestRow, face)}});
  set_row_type<SweepRow>({{"share", "f8", offsetof(SweepRow, share)},
                          {"point", "(3,)f8", offsetof(SweepRow, point)},
                          {"normal", "(3,)f8", offsetof(SweepRow, normal)},
                          {"face", "u4", offsetof(SweepRow, face)}});
  set_row_type<FrameRow>({{"depth", "f8", offsetof(FrameRow, depth)},
                          {"point", "(3,)f8", offsetof(FrameRow, point)},
                          {"face", "u4", offsetof(FrameRow, face)},
                          {"contacts", "u4", offsetof(FrameRow, contacts)},
                          {"exact", "?", offsetof(FrameRow, exact)},
                          {"refined", "?", offsetof(FrameRow, refined)}});
  py::class_<ScriptRefinement>(
      module, "LocalRefinement",
      "A mesh that is refined near one sphere, within fixed memory, and queries of this mesh.\n\n"
      "In each frame, call approach, then refine, then a query; or call follow for a whole path. Lengths and "
      "positions\n"
      "have the file units and the frame of the model.")
      .def(py::init(&make_refinement), py::arg("model"), py::arg("radius"), py::kw_only(),
           py::arg("memory") = std::uint64_t{64} << 20, py::arg("refine_margin") = 0.0, py::arg("retain_margin") = 0.0,
           py::arg("look_ahead") = 0.01, py::arg("load_ahead") = 0.2, py::arg("min_speed") = 0.0,
           py::arg("targets") = 1024,
           "Loads the base mesh. Raises RuntimeError if it does not fit into the memory.\n\n"
           "memory: bytes for mesh and directory. refine_margin: regions within this distance of the sphere are\n"
           "refined too. retain_margin: refined regions within this distance stay refined. look_ahead and load_ahead:\n"
           "s, refine and load the regions that the sphere will meet within this time. min_speed: speed that the\n"
           "prediction assumes for a slower sphere. targets: max number of regions to refine.")
      .def(
          "approach",
          [](ScriptRefinement& self, const Numbers& position, double time, bool in_contact) {
            self.approach(vector_in(position, "position"), time, in_contact);
          },
          py::arg("position"), py::arg("time"), py::arg("in_contact") = false,
          "Moves the sphere, and loads the regions that it will meet soon.\n\ntime: s, ascending, -1e9 to 1e9. "
          "in_contact: "
          "the\nprevious query found a contact.")
      .def("refine", &ScriptRefinement::refine, py::arg("budget") = 4000,
           "Refines near the sphere. Returns False if the budget, or the memory, did not suffice.\n\n"
           "budget: a change of the mesh costs 16, the visit of a record 1.")
      .def("find_contacts", &find_contacts, py::arg("centres"), py::arg("radius") = py::none(),
           "Finds the triangles that each of n spheres touches.\n\n"
           "Returns a structured array (point, face, finest) and the n + 1 indices at which the contacts of the\n"
           "spheres begin: those of sphere i are contacts[first[i]:first[i + 1]]. radius: default that of the probe.")
      .def("nearest", &nearest, py::arg("points"), py::arg("max_distance"),
           "Finds the nearest point of the mesh for each of n points: a structured array (distance, point, face).\n\n"
           "Without a triangle within max_distance, the distance is infinite and face is 2**32 - 1.")
      .def("sweep", &sweep, py::arg("starts"), py::arg("ends"), py::arg("radius") = py::none(),
           "Finds the first contact of each of n spheres that move on a straight line: a structured array (share, "
           "point,\nnormal, face).\n\nshare: of the motion before the contact, 0 to 1; infinite without a contact.")
      .def("follow", &follow, py::arg("path"), py::arg("interval") = 0.001, py::arg("budget") = 4000,
           "Moves the sphere along a path of n positions, one in each interval (s), and refines in each.\n\n"
           "Returns a structured array: depth of the deepest contact (0 without one), its point and face, number of\n"
           "contacts, exact, and refined (False: the budget did not suffice).")
      .def("shown_triangles", &shown_triangles,
           "The shown mesh: corners, float32 of shape (m, 3, 3), and numbers of the faces, uint32 of shape (m,).")
      .def_property_readonly("exact", &ScriptRefinement::exact,
                             "True if queries at the last position return the contacts of the finest mesh.")
      .def_property_readonly("evictions", &ScriptRefinement::evictions, "Number of regions that were evicted so far.")
      .def_property_readonly("radius", &ScriptRefinement::radius, "Radius of the sphere.");
}

}  // namespace tactus::python
