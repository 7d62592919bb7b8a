// A participant of a session for scripts.
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <set>
#include <thread>
#include <utility>

#include "python/arrays.hpp"
#include "python/bindings.hpp"
#include "python/session_client.hpp"

namespace tactus::python {
namespace {

constexpr auto kPoll = std::chrono::milliseconds{5};
constexpr std::int64_t kLeadNs = 200'000'000;  // of a path, so that its first intents arrive before it begins
constexpr auto kTransit = std::chrono::milliseconds{300};  // after the end of a path, for the last states

std::string seconds_text(double seconds) {
  char text[32];
  std::snprintf(text, sizeof text, "%g s", seconds);
  return text;
}

[[noreturn]] void raise_timeout(const std::string& message) {
  PyErr_SetString(PyExc_TimeoutError, message.c_str());
  throw py::error_already_set();
}

/// Calls `condition` every few milliseconds, without the interpreter's lock in between. Returns false after `timeout`;
/// after the first call if this is NaN.
template <class Condition>
bool poll(double timeout, Condition condition) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>{timeout};
  while (!condition()) {
    if (!(std::chrono::steady_clock::now() <= end)) return false;
    if (PyErr_CheckSignals() != 0) throw py::error_already_set();
    const py::gil_scoped_release no_gil;
    std::this_thread::sleep_for(kPoll);
  }
  return true;
}

class ScriptSession {
 public:
  explicit ScriptSession(const wire::SessionAddress& address) {
    {
      const py::gil_scoped_release no_gil;
      client_ = std::make_shared<SessionClient>(address);
    }
    open_sessions().insert(this);
  }
  ~ScriptSession() { close(); }
  ScriptSession(const ScriptSession&) = delete;
  ScriptSession& operator=(const ScriptSession&) = delete;

  /// Leaves the session. Does nothing if it has been left.
  void close() {
    open_sessions().erase(this);
    std::shared_ptr<SessionClient> left = std::exchange(client_, nullptr);
    const py::gil_scoped_release no_gil;
    left.reset();
  }
  /// Leaves every session, at the end of the process: before the libraries of DDS end.
  static void close_all() {
    while (!open_sessions().empty()) (*open_sessions().begin())->close();
  }
  [[nodiscard]] std::shared_ptr<SessionClient> client() const {
    if (!client_) throw std::runtime_error("this session was closed");
    return client_;
  }
  /// Throws std::runtime_error if this participant cannot stay, or the session has ended.
  void require_session() const {
    if (const std::string reason = client()->end_reason(); !reason.empty()) throw std::runtime_error(reason);
  }

 private:
  static std::set<ScriptSession*>& open_sessions() {  // the interpreter's lock protects it
    static std::set<ScriptSession*> sessions;
    return sessions;
  }
  std::shared_ptr<SessionClient> client_;
};

/// The profiles for the place of this module: in the build tree those of the sources, else those of its prefix.
std::filesystem::path qos_directory() {
  const std::filesystem::path file = py::module_::import("tactus._tactus").attr("__file__").cast<std::string>();
  if (file.string().starts_with(TACTUS_BUILD_DIR "/")) return TACTUS_SOURCE_QOS_DIR;
  // PREFIX/lib/python3/dist-packages/tactus/_tactus.so
  std::filesystem::path prefix = file;
  for (int level = 0; level < 5; ++level) prefix = prefix.parent_path();
  const std::filesystem::path installed = prefix / "share/tactus/qos";
  return std::filesystem::exists(installed) ? installed : wire::default_qos_directory();
}

std::unique_ptr<ScriptSession> join_session(const std::string& session, const std::string& name, int domain,
                                            const std::vector<std::string>& peers,
                                            const std::vector<std::string>& servers,
                                            const std::optional<std::filesystem::path>& qos,
                                            const std::optional<std::filesystem::path>& keys, bool plain) {
  wire::SessionAddress address;
  address.session = session;
  address.participant = name.empty() ? "script-" + std::to_string(getpid()) : name;
  if (name.empty()) address.naming = wire::Naming::kInstance;
  address.domain = domain;
  address.discovery = {peers, servers};
  address.only_reads_bulk = true;
  address.qos = qos ? *qos : qos_directory();
  if (keys && keys->empty()) throw wire::WireError("keys: found no name, expected a folder of tactus keys");
  if (keys) address.keys = *keys;
  address.plain = plain;
  return std::make_unique<ScriptSession>(address);
}

py::dict participants_of(const ScriptSession& self) {
  py::dict participants;
  for (const auto& [name, member] : self.client()->members()) {
    py::dict one;
    one["role"] = session::role_name(member.entry.role);
    one["users"] = member.entry.users;
    py::list served;
    for (const session::UserProbe& probe : member.entry.served_users) served.append(probe.user);
    one["served_users"] = served;
    one["late"] = member.is_late;
    participants[py::str(name)] = one;
  }
  return participants;
}

py::dict figures_of(const ScriptSession& self) {
  py::dict figures;
  for (const auto& [name, member] : self.client()->members())
    if (!member.figures.empty()) figures[py::str(name)] = member.figures;
  return figures;
}

py::dict objects_of(const ScriptSession& self) {
  py::dict objects;
  for (const auto& [name, entry] : self.client()->objects()) {
    py::dict one;
    one["host"] = entry.host;
    one["position"] = py::array_t<double>(3, entry.pose.position.data());
    one["orientation"] = py::array_t<double>(4, entry.pose.orientation.data());
    one["scale"] = entry.scale;
    py::array_t<double> bounds{{2, 3}};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      bounds.mutable_at(0, axis) = double{entry.summary.bounds_min[axis]};
      bounds.mutable_at(1, axis) = double{entry.summary.bounds_max[axis]};
    }
    one["bounds"] = bounds;
    one["faces"] = entry.summary.faces;
    one["digest"] = entry.summary.digest;
    one["stiffness"] = entry.material.stiffness;
    one["damping"] = entry.material.damping;
    one["static_friction"] = entry.material.static_friction;
    one["dynamic_friction"] = entry.material.dynamic_friction;
    one["mass"] = entry.body.mass;
    objects[py::str(name)] = one;
  }
  return objects;
}

py::list users_of(const ScriptSession& self) {
  py::list users;
  for (const auto& [name, member] : self.client()->members())
    for (const session::UserProbe& probe : member.entry.served_users) users.append(probe.user);
  return users;
}

py::object state_of(const ScriptSession& self, const std::string& user) {
  const std::optional<StateRow> state = self.client()->newest_state(user);
  if (!state) return py::none();
  return py::object{array_of_records(std::vector<StateRow>{*state})[py::int_(0)]};
}

/// The participants and objects that this program has found, for messages.
std::string found_text(const SessionClient& client) {
  std::string text;
  const auto add = [&text](const std::string& what) { text += (text.empty() ? "" : ", ") + what; };
  for (const auto& [name, member] : client.members()) add(session::role_name(member.entry.role) + (" '" + name + "'"));
  for (const auto& [name, entry] : client.objects()) add("object '" + name + "'");
  return text.empty() ? "; found no other program: do all have the same session and domain?" : "; found " + text;
}

void wait(const ScriptSession& self, const py::function& condition, double timeout) {
  const auto holds = [&] {
    if (py::bool_(condition())) return true;
    self.require_session();
    return false;
  };
  if (!poll(timeout, holds))
    raise_timeout("the condition did not hold within " + seconds_text(timeout) + found_text(*self.client()));
}

void join_user(const ScriptSession& self, const std::string& user, const std::string& hrtc, double timeout) {
  const std::shared_ptr<SessionClient> client = self.client();
  client->add_user(user, hrtc);
  const auto is_ready = [&] {
    self.require_session();
    return client->is_served(user) && client->session_time().has_value();
  };
  if (!poll(timeout, is_ready))
    raise_timeout("not served: " + user + " by " + hrtc + ", waited " + seconds_text(timeout) + found_text(*client));
}

std::pair<std::int64_t, std::int64_t> move(const ScriptSession& self, const std::string& user, const Numbers& path,
                                           double interval) {
  const auto points = points_in(path, "path");
  require(!points.empty(), "path: found no point, expected at least one");
  require(interval >= 1e-6 && interval <= 1e3,
          "interval: found " + std::to_string(interval) + " s, expected 0.000001 to 1000");
  self.require_session();
  return self.client()->move(user, {points.begin(), points.end()},
                             static_cast<std::int64_t>(std::llround(interval * 1e9)), kLeadNs);
}

py::array drive(const ScriptSession& self, const std::string& user, const Numbers& path, double interval) {
  const std::shared_ptr<SessionClient> client = self.client();
  const auto [begin_ns, end_ns] = move(self, user, path, interval);
  (void)client->take_states(user);
  const std::int64_t first_ns = begin_ns, last_ns = end_ns;
  std::vector<StateRow> rows;
  const auto take = [&] {
    for (const StateRow& row : client->take_states(user))
      if (row.session_time_ns >= first_ns && row.session_time_ns <= last_ns) rows.push_back(row);
  };
  const auto is_over = [&] {
    self.require_session();
    take();  // during the motion, because a long one has more states than the client stores
    return client->session_time().value_or(0) > last_ns;
  };
  (void)poll(1e9, is_over);
  {
    const py::gil_scoped_release no_gil;
    std::this_thread::sleep_for(kTransit);
  }
  take();
  return array_of_records(std::move(rows));
}

std::string joined(const std::vector<std::string>& names) {
  std::string all;
  for (const std::string& name : names) all += (all.empty() ? "" : ", ") + name;
  return all.empty() ? "none" : all;
}

/// Repeats a stop or a reset until all hosts and HRTCs have acknowledged it, also those that fall silent meanwhile.
/// Returns their names.
template <class Sample>
std::vector<std::string> deliver(SessionClient& client, Sample sample, double timeout) {
  session::Recipients recipients;
  session::Acknowledgement answer;
  const auto is_done = [&] {
    client.publish(sample);
    client.update(recipients);
    answer = recipients.acknowledgement(sample);
    return answer.missing.empty() && !answer.hrtcs.empty() && client.has_discovered();
  };
  if (!poll(timeout, is_done))
    raise_timeout("waited " + std::to_string(timeout) + " s; acknowledged by HRTCs: " + joined(answer.hrtcs) +
                  "; by hosts: " + joined(answer.hosts) + "; not by: " + joined(answer.missing));
  answer.hrtcs.insert(answer.hrtcs.end(), answer.hosts.begin(), answer.hosts.end());
  return answer.hrtcs;
}

std::vector<std::string> stop_forces(const ScriptSession& self, const std::string& reason, double timeout) {
  const std::shared_ptr<SessionClient> client = self.client();
  return deliver(*client, session::EmergencyStop{{}, client->new_number(), reason}, timeout);
}

std::vector<std::string> reset_forces(const ScriptSession& self, const std::string& reason, double timeout) {
  const std::shared_ptr<SessionClient> client = self.client();
  const auto begin = std::chrono::steady_clock::now();
  const auto time_left = [&] {
    return std::max(0.0, timeout - std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count());
  };
  (void)poll(timeout, [&] { return client->has_discovered(); });
  std::vector<session::StopName> left = client->standing_stops();
  std::vector<std::string> names;
  do {
    session::ForceReset reset{{}, client->new_number(), {}, reason};
    while (!left.empty() && reset.stops.size() < session::kMaxStops) {
      reset.stops.push_back(left.back());
      left.pop_back();
    }
    names = deliver(*client, reset, time_left());
  } while (!left.empty());
  std::string still;  // issued after the stops were read
  for (const auto& [name, member] : client->members()) {
    if (!session::lists_stops(member.entry)) continue;
    if (const std::size_t count = session::standing_stops(member.entry.stops).size(); count > 0)
      still += (still.empty() ? "" : ", ") + name + ": " + std::to_string(count);
  }
  if (!still.empty())
    throw std::runtime_error("stops that this reset did not name are still in force; number of them at each program: " +
                             still);
  return names;
}

/// Publishes a sample that no roster entry acknowledges. Its writer stores it for programs that are discovered later.
/// Returns when all hosts and HRTCs are assumed discovered, at the latest after 10 s.
template <class Sample>
void announce(const ScriptSession& self, Sample sample) {
  const std::shared_ptr<SessionClient> client = self.client();
  client->publish(sample);
  (void)poll(10, [&] { return client->has_discovered(); });
}

}  // namespace

void add_session(py::module_& module) {
  set_row_type<StateRow>({{"session_time_ns", "i8", offsetof(StateRow, session_time_ns)},
                          {"position", "(3,)f8", offsetof(StateRow, position)},
                          {"orientation", "(4,)f8", offsetof(StateRow, orientation)},
                          {"velocity", "(3,)f8", offsetof(StateRow, velocity)},
                          {"force", "(3,)f8", offsetof(StateRow, force)},
                          {"proxy", "(3,)f8", offsetof(StateRow, proxy)},
                          {"radius", "f8", offsetof(StateRow, radius)},
                          {"stiffness", "f8", offsetof(StateRow, stiffness)},
                          {"error_bound", "f8", offsetof(StateRow, error_bound)},
                          {"data_age", "f8", offsetof(StateRow, data_age)},
                          {"object_id", "u8", offsetof(StateRow, object_id)},
                          {"status", "u4", offsetof(StateRow, status)},
                          {"in_contact", "?", offsetof(StateRow, in_contact)},
                          {"exact", "?", offsetof(StateRow, exact)}});
  py::class_<ScriptSession>(
      module, "Session",
      "A participant of a session: observes it, and moves the simulated hands of its own users.\n\n"
      "    with tactus.Session(\"lab\") as session: ...\n\n"
      "Samples arrive in threads of the package, which store them; every call returns what has\n"
      "arrived. World frame, SI units. After the session's end, calls that wait raise "
      "RuntimeError.")
      .def(py::init(&join_session), py::arg("session"), py::arg("name") = "", py::kw_only(),
           py::arg("domain") = wire::kDefaultDomain, py::arg("peers") = std::vector<std::string>{},
           py::arg("servers") = std::vector<std::string>{}, py::arg("qos") = py::none(), py::arg("keys") = py::none(),
           py::arg("plain") = false,
           "Joins a session. Raises WireError.\n\nname: of this participant; default script-PID. domain: base domain. "
           "peers: machines that multicast does not find.\nservers: discovery servers. qos: folder of the QoS "
           "profiles, default those of Tactus.\nkeys: folder of keys of tactus keys. plain: without keys, also take "
           "part with "
           "programs of other machines.")
      .def("close", &ScriptSession::close, "Leaves the session.")
      .def("__enter__", [](const py::object& self) { return self; })
      .def("__exit__", [](ScriptSession& self, const py::args&) { self.close(); })
      .def_property_readonly("participants", &participants_of,
                             "The other participants: a dict from names to dicts with role (host, hrtc, client or "
                             "viewer), users,\nserved_users and late.")
      .def_property_readonly("objects", &objects_of,
                             "The objects: a dict from names to dicts with host, position, orientation, scale, bounds "
                             "(file units), faces,\ndigest, stiffness, damping, static_friction, dynamic_friction and "
                             "mass.")
      .def_property_readonly("users", &users_of, "The names of all users whom an HRTC serves.")
      .def_property_readonly("figures", &figures_of,
                             "The newest figures of hosts and HRTCs (docs/reference/metrics.md): a dict from "
                             "participants to dicts.")
      .def_property_readonly(
          "time",
          [](const ScriptSession& self) -> std::optional<double> {
            const std::optional<std::int64_t> now = self.client()->session_time();
            if (!now) return std::nullopt;
            return 1e-9 * static_cast<double>(*now);
          },
          "Session time, s; None until the clock is synchronised.")
      .def_property_readonly(
          "end_reason", [](const ScriptSession& self) { return self.client()->end_reason(); },
          "The reason for which the session ended; empty while it continues.")
      .def("state", &state_of, py::arg("user"),
           "The newest state of a user's probe as a row, as states() has them; None before the first.")
      .def(
          "states",
          [](const ScriptSession& self, const std::string& user) {
            return array_of_records(self.client()->take_states(user));
          },
          py::arg("user"),
          "The states of a user's probe since the last call, at most 65,536: a structured array.\n\n"
          "Its fields are session_time_ns, position (of the device), orientation, velocity, force (on the hand), "
          "proxy, radius,\nstiffness, error_bound, data_age (s), object_id, status, in_contact, exact. The HRTC sends "
          "deadband-coded states,\n25 to 210 a second.")
      .def("wait", &wait, py::arg("condition"), py::arg("timeout") = 10.0,
           "Calls condition() every few milliseconds in this thread until it returns True. Raises TimeoutError.")
      .def("join", &join_user, py::arg("user"), py::arg("hrtc"), py::arg("timeout") = 10.0,
           "Brings a user: requests a probe from an HRTC, and waits until it serves the user. Raises TimeoutError.\n\n"
           "The HRTC simulates the user's hand. All users of a participant have the same HRTC.")
      .def(
          "move", &move, py::arg("user"), py::arg("path"), py::arg("interval") = 0.001,
          "Moves the hand of a user of this participant along n positions, one in each interval (s). Does not wait.\n\n"
          "The hand begins at the first position 0.2 s from now, and stays at the last. Between waypoints 10 ms apart\n"
          "it moves linearly. Returns begin and end of the motion, session time in ns.")
      .def("drive", &drive, py::arg("user"), py::arg("path"), py::arg("interval") = 0.001,
           "Like move, but waits for the end of the motion, and returns the states of the probe during the motion.")
      .def("stop_forces", &stop_forces, py::arg("reason") = "", py::arg("timeout") = 5.0,
           "Emergency stop: sets every force of the session to zero, until a reset.\n\nReturns the names of all HRTCs "
           "and hosts when they have acknowledged it, at least 1.5 s after the first\nof them was found, because "
           "discovery reports no end. Raises TimeoutError that names the others.")
      .def("reset_forces", &reset_forces, py::arg("reason") = "", py::arg("timeout") = 5.0,
           "Ends all stops that have no reset yet, and the faults of devices. Forces start softly.\n\nReturns and "
           "raises as stop_forces. Raises RuntimeError if later stops are still in force.")
      .def(
          "set_mode",
          [](const ScriptSession& self, const std::string& mode) {
            const std::shared_ptr<SessionClient> client = self.client();
            announce(self, session::Control{{}, client->new_number(), session::ControlKind::kMode, mode});
          },
          py::arg("mode"),
          "Sets the mode of all users or of some: auto, collaborate or large-scale; the last two may be followed by "
          "USER,USER...")
      .def(
          "end",
          [](const ScriptSession& self, const std::string& reason) {
            announce(self, session::SessionEnd{{}, reason});
          },
          py::arg("reason") = "", "Ends the session for all: its programs write their reports and leave.");
  py::module_::import("atexit").attr("register")(py::cpp_function(&ScriptSession::close_all));
}

}  // namespace tactus::python
