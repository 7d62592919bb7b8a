// A probe of a simulated hand in a virtual session: host, link and HRTC in one process, without network and clock.
#include <pybind11/stl.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <memory>
#include <mutex>
#include <utility>

#include "netem/profile.hpp"
#include "python/arrays.hpp"
#include "python/bindings.hpp"
#include "python/model.hpp"
#include "study/constants.hpp"
#include "study/virtual_session.hpp"

namespace tactus::python {
namespace {

using Row3 = std::array<double, 3>;

/// One millisecond of a probe. World frame, SI.
struct ProbeRow {
  double time;
  Row3 target, position, velocity, force, proxy, normal;
  double stiffness, error_bound;
  std::uint32_t status;
  bool in_contact, exact;
};

Row3 row_of(const spm::Vec3d& v) { return {v.x(), v.y(), v.z()}; }

struct ProbeSettings {
  double radius;
  bool has_remote_device;
  study::SessionSettings session;
};

/// A virtual session with the model that it serves. Its calls release the interpreter's lock and run one after another.
class ScriptProbe {
 public:
  /// Runs the session until the HRTC has shown the base mesh for a second.
  ScriptProbe(std::shared_ptr<const SharedModel> model, const ProbeSettings& settings)
      : model_{std::move(model)},
        subject_{"object",
                 model_->provenance().source,
                 nullptr,
                 model_->arrays().model(),
                 std::make_unique<const spm::codec::EncodedModel>(model_->arrays().model()),
                 {}},
        session_{subject_, scenario_of(settings), settings.session},
        begin_ns_{session_.now_ns()} {
    session_.settle();
  }

  /// Moves the hand along `path`, one point in each interval, and returns a row for each millisecond.
  std::vector<ProbeRow> run(std::span<const Row3> path, std::int64_t interval_ns) {
    const py::gil_scoped_release no_gil;
    const std::lock_guard lock{mutex_};
    const auto points = static_cast<std::int64_t>(path.size());
    const std::int64_t steps = (points - 1) * interval_ns / study::kCycleNs + 1;
    const std::int64_t first_ns = session_.now_ns() + study::kCycleNs;
    std::vector<ProbeRow> rows;
    rows.reserve(static_cast<std::size_t>(steps));
    std::int64_t sent_from = -kWindow;  // index of the first waypoint of the last intent
    for (std::int64_t step = 0; step < steps; ++step) {
      const std::int64_t at = step * study::kCycleNs / interval_ns;  // the last waypoint at or before this step
      if (at >= sent_from + kWindow / 2) {
        sent_from = at;
        session_.move_hand(0, intent_of(path, at, first_ns, interval_ns));
      }
      session_.step();
      const double share =
          static_cast<double>(step * study::kCycleNs - at * interval_ns) / static_cast<double>(interval_ns);
      const Row3 &from = path[static_cast<std::size_t>(at)],
                 &to = path[static_cast<std::size_t>(std::min(at + 1, points - 1))];
      rows.push_back(last_row({from[0] + share * (to[0] - from[0]), from[1] + share * (to[1] - from[1]),
                               from[2] + share * (to[2] - from[2])}));
      if (step % 1000 == 999) check_signals();
    }
    return rows;
  }
  void set_link(const netem::LinkSettings& link) {
    const py::gil_scoped_release no_gil;
    const std::lock_guard lock{mutex_};
    session_.set_link(link);
  }
  [[nodiscard]] double now() const {
    const py::gil_scoped_release no_gil;
    const std::lock_guard lock{mutex_};
    return time();
  }
  [[nodiscard]] std::uint64_t records_received() const {
    const py::gil_scoped_release no_gil;
    const std::lock_guard lock{mutex_};
    return session_.records_received();
  }
  [[nodiscard]] std::uint64_t bytes_received() const {
    const py::gil_scoped_release no_gil;
    const std::lock_guard lock{mutex_};
    return session_.bytes_received();
  }

 private:
  static constexpr std::int64_t kWindow = session::kMaxWaypoints;

  /// Virtual time since the session began, s.
  [[nodiscard]] double time() const { return static_cast<double>(session_.now_ns() - begin_ns_) * 1e-9; }

  static client_sim::Scenario scenario_of(const ProbeSettings& settings) {
    client_sim::Scenario scenario;
    client_sim::User user;
    user.name = "script";
    user.radius = settings.radius;
    user.has_remote_device = settings.has_remote_device;
    scenario.users.push_back(std::move(user));
    return scenario;
  }
  static session::Intent intent_of(std::span<const Row3> path, std::int64_t from, std::int64_t first_ns,
                                   std::int64_t interval_ns) {
    session::Intent intent;
    const auto end = std::min(from + kWindow, static_cast<std::int64_t>(path.size()));
    for (std::int64_t i = from; i < end; ++i) {
      session::Waypoint waypoint;
      waypoint.session_time_ns = first_ns + i * interval_ns;
      waypoint.pose.position = path[static_cast<std::size_t>(i)];
      intent.path.push_back(waypoint);
    }
    return intent;
  }
  /// Raises KeyboardInterrupt.
  static void check_signals() {
    const py::gil_scoped_acquire gil;
    if (PyErr_CheckSignals() != 0) throw py::error_already_set();
  }
  [[nodiscard]] ProbeRow last_row(const Row3& target) const {
    const study::Felt& felt = session_.felt(0);
    const hrtc_service::ProbeOutput& output = session_.hrtc().servo().outputs()[0];
    return {time(),
            target,
            row_of(felt.device.position),
            row_of(felt.device.velocity),
            row_of(felt.wrench.force),
            output.proxy,
            output.normal,
            double{output.stiffness},
            double{output.error_bound},
            output.status,
            (output.status & session::kInContact) != 0,
            felt.exact};
  }

  std::shared_ptr<const SharedModel> model_;
  study::Subject subject_;
  study::VirtualSession session_;
  std::int64_t begin_ns_;
  mutable std::mutex mutex_;
};

std::unique_ptr<ScriptProbe> make_probe(std::shared_ptr<const SharedModel> model, double radius,
                                        const std::string& link, bool remote_device, double stiffness, double damping,
                                        double static_friction, double dynamic_friction, std::uint64_t seed,
                                        std::uint32_t slots, std::uint32_t budget) {
  const auto require_number = [](const char* name, double value, bool may_be_zero) {
    require(std::isfinite(value) && (value > 0 || (may_be_zero && value == 0)),
            std::string{name} + ": found " + std::to_string(value) + ", expected " +
                (may_be_zero ? "at least" : "above") + " 0");
  };
  require_number("radius", radius, false);
  require_number("stiffness", stiffness, false);
  require_number("damping", damping, true);
  require_number("static_friction", static_friction, true);
  require_number("dynamic_friction", dynamic_friction, true);
  require(dynamic_friction <= static_friction, "dynamic_friction: found " + std::to_string(dynamic_friction) +
                                                   ", expected at most the static friction " +
                                                   std::to_string(static_friction));
  ProbeSettings settings{radius, remote_device, {}};
  settings.session.link = netem::parse_link(link);
  settings.session.seed = seed;
  settings.session.slots = slots;
  settings.session.budget = budget;
  settings.session.material = {stiffness, damping, static_friction, dynamic_friction};
  const py::gil_scoped_release no_gil;
  return std::make_unique<ScriptProbe>(std::move(model), settings);
}

py::array run_probe(ScriptProbe& self, const Numbers& path, double interval) {
  const auto points = points_in(path, "path");
  require(!points.empty(), "path: found no point, expected at least one");
  require(interval >= 1e-6 && interval <= 1e3,
          "interval: found " + std::to_string(interval) + " s, expected 0.000001 to 1000");
  return array_of_records(self.run(points, static_cast<std::int64_t>(std::llround(interval * 1e9))));
}

}  // namespace

void add_probe(py::module_& module) {
  set_row_type<ProbeRow>({{"time", "f8", offsetof(ProbeRow, time)},
                          {"target", "(3,)f8", offsetof(ProbeRow, target)},
                          {"position", "(3,)f8", offsetof(ProbeRow, position)},
                          {"velocity", "(3,)f8", offsetof(ProbeRow, velocity)},
                          {"force", "(3,)f8", offsetof(ProbeRow, force)},
                          {"proxy", "(3,)f8", offsetof(ProbeRow, proxy)},
                          {"normal", "(3,)f8", offsetof(ProbeRow, normal)},
                          {"stiffness", "f8", offsetof(ProbeRow, stiffness)},
                          {"error_bound", "f8", offsetof(ProbeRow, error_bound)},
                          {"status", "u4", offsetof(ProbeRow, status)},
                          {"in_contact", "?", offsetof(ProbeRow, in_contact)},
                          {"exact", "?", offsetof(ProbeRow, exact)}});
  const study::SessionSettings defaults;
  py::class_<ScriptProbe>(
      module, "Probe",
      "A simulated hand that touches a model over an emulated link, in virtual time and without a network.\n\n"
      "A VE host serves the model, an HRTC loads it over the link and computes forces each millisecond. The object is\n"
      "at the origin, not rotated. World frame, SI units. Equal arguments give equal rows to the bit.")
      .def(
          py::init(&make_probe), py::arg("model"), py::arg("radius") = 0.003, py::arg("link") = "P0", py::kw_only(),
          py::arg("remote_device") = false, py::arg("stiffness") = defaults.material.stiffness,
          py::arg("damping") = defaults.material.damping, py::arg("static_friction") = 0.0,
          py::arg("dynamic_friction") = 0.0, py::arg("seed") = 1, py::arg("slots") = defaults.slots,
          py::arg("budget") = defaults.budget,
          "Runs the session until the base mesh is shown.\n\n"
          "radius: m. link: as in `tactus link list`, such as \"P4\" or \"P0:delay=10:loss=1\"; between host and HRTC. "
          "remote_device:\nthe hand's device is at the host's end of the link, so its force loop runs over the link. "
          "stiffness: N/m. damping:\nN s/m. seed: of losses, delays and the tremor of the hand. slots: of the pool. "
          "budget: refinement of a cycle.\nRaises LinkError for an unknown link.")
      .def("run", &run_probe, py::arg("path"), py::arg("interval") = 0.001,
           "Moves the hand along n positions, one in each interval (s). The first call places the hand at the first\n"
           "position; later calls continue from the pose of the hand.\n\n"
           "Returns a structured array with a row for each millisecond: time, target, position (of the device), "
           "velocity,\nforce (on the hand), proxy, normal, stiffness, error_bound, status, in_contact, exact.")
      .def(
          "set_link", [](ScriptProbe& self, const std::string& link) { self.set_link(netem::parse_link(link)); },
          py::arg("link"), "Replaces the link for samples that are sent from now on.")
      .def_property_readonly("now", &ScriptProbe::now, "Virtual time since the session began, s.")
      .def_property_readonly("records_received", &ScriptProbe::records_received,
                             "Number of vertex-split records that the HRTC has received.")
      .def_property_readonly("bytes_received", &ScriptProbe::bytes_received,
                             "Bytes of base mesh and regions that the HRTC has received.");
}

}  // namespace tactus::python
