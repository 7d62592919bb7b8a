#include "tests/e2e/session_test.hpp"

#include <unistd.h>

#include <atomic>
#include <stdexcept>

namespace tactus::e2e {

bool Observer::Seen::is_present(const std::string& name) const {
  const auto entry = roster.find(name);
  return entry != roster.end() && !entry->second.leaving;
}

bool Observer::Seen::has_left(const std::string& name) const {
  const auto entry = roster.find(name);
  return entry != roster.end() && entry->second.leaving;
}

std::uint64_t Observer::Seen::metrics_count(const std::string& name) const {
  const auto count = metrics.find(name);
  return count == metrics.end() ? 0 : count->second;
}

double Observer::Seen::figure(const std::string& participant, const std::string& name) const {
  const auto published = figures.find(participant);
  if (published == figures.end()) return -1;
  const auto value = published->second.find(name);
  return value == published->second.end() ? -1 : value->second;
}

StateCounts Observer::Seen::user(const std::string& name) const {
  const auto counts = states.find(session::id_of(name));
  return counts == states.end() ? StateCounts{} : counts->second;
}

Observer::Observer(const wire::SessionAddress& address)
    : participants_{address},
      roster_{participants_, wire::topics::kRoster, callback(&Observer::on_roster)},
      metrics_{participants_, wire::topics::kMetrics, callback(&Observer::on_metrics)},
      states_{participants_, wire::topics::kProbeState, callback(&Observer::on_state)} {}

void Observer::on_roster(const session::RosterEntry& entry) {
  seen_.roster[entry.name] = entry;
  names_[entry.origin.participant] = entry.name;
}

void Observer::on_metrics(const session::Metrics& metrics) {
  const auto name = names_.find(metrics.origin.participant);
  if (name == names_.end()) return;
  ++seen_.metrics[name->second];
  std::vector<session::MeshHash>& meshes = seen_.meshes[name->second];
  meshes.insert(meshes.end(), metrics.meshes.begin(), metrics.meshes.end());
  for (const session::Figure& figure : metrics.figures) seen_.figures[name->second][figure.name] = figure.value;
}

void Observer::on_state(const session::ProbeState& state) {
  StateCounts& counts = seen_.states[state.user_id];
  ++counts.count;
  const bool contact = (state.status & session::kInContact) != 0;
  counts.in_contact += contact ? 1 : 0;
  counts.exact += contact && (state.status & session::kExact) != 0 ? 1 : 0;
  counts.faults += (state.status & session::kFault) != 0 ? 1 : 0;
  counts.last = state;
}

bool Observer::until(const std::function<bool(const Seen&)>& condition, std::chrono::milliseconds limit) {
  std::unique_lock lock{mutex_};
  return changed_.wait_for(lock, limit, [&] { return condition(seen_); });
}

Observer::Seen Observer::seen() const {
  const std::lock_guard lock{mutex_};
  return seen_;
}

void Observer::forget_states() {
  const std::lock_guard lock{mutex_};
  seen_.states.clear();
}

namespace {

void run_mesh_tool(const std::vector<std::string>& arguments) {
  std::vector<std::string> command{TACTUS_MESH};
  command.insert(command.end(), arguments.begin(), arguments.end());
  Process mesh{command};
  if (mesh.wait(60s) != 0) throw std::runtime_error{"tactus-mesh failed: " + mesh.output()};
}

}  // namespace

Models::Models() {
  for (const auto& [shape, model] : {std::pair{"organ", organ}, std::pair{"sphere", sphere}}) {
    const std::string mesh = model + ".ply";
    run_mesh_tool({"generate", shape, mesh, "--faces", "20000", "--seed", "7"});
    run_mesh_tool({"build", mesh, model, "--cell-faces", "100"});
  }
}

const Models& models() {
  static const Models kModels;
  return kModels;
}

SessionTest::SessionTest() {
  static std::atomic<int> test_count{0};
  session_ = "e2e." + std::to_string(getpid()) + "." + std::to_string(++test_count);
}

std::string SessionTest::write(const std::string& name, const std::string& text) const {
  test_support::write_bytes(path(name), text);
  return path(name);
}

std::vector<std::string> SessionTest::program(const std::string& name, std::vector<std::string> arguments) {
  static const std::map<std::string, std::string> kPrograms{
      {"host", TACTUS_HOST},       {"hrtc", TACTUS_HRTC},   {"sim", TACTUS_SIM},       {"mesh", TACTUS_MESH},
      {"control", TACTUS_CONTROL}, {"keys", TACTUS_KEYS},   {"record", TACTUS_RECORD}, {"replay", TACTUS_REPLAY},
      {"view", TACTUS_VIEW},       {"watch", TACTUS_WATCH}, {"top", TACTUS_TOP},       {"ros2", TACTUS_ROS2},
      {"gateway", TACTUS_GATEWAY}};
  arguments.insert(arguments.begin(), kPrograms.at(name));
  return arguments;
}

std::vector<std::string> SessionTest::in_session(const std::string& name, std::vector<std::string> arguments) const {
  arguments.insert(arguments.end(), {"--session", session_, "--domain", std::to_string(domain_.first())});
  return program(name, std::move(arguments));
}

std::vector<std::string> SessionTest::host(const std::string& name, const std::string& model) const {
  return in_session("host", {"--name", name, "--cache", path("cache"), model});
}

std::vector<std::string> SessionTest::hrtc(const std::string& name, const std::vector<std::string>& options) const {
  std::vector<std::string> arguments{"--name", name, "--no-coding", "--flight-folder", path("flight")};
  arguments.insert(arguments.end(), options.begin(), options.end());
  return in_session("hrtc", std::move(arguments));
}

std::vector<std::string> SessionTest::coding_hrtc(const std::string& name) const {
  return in_session("hrtc", {"--name", name});
}

std::vector<std::string> SessionTest::sim(const std::string& scenario, const std::vector<std::string>& options) const {
  std::vector<std::string> arguments{"--scenario", write("scenario.yaml", scenario)};
  arguments.insert(arguments.end(), options.begin(), options.end());
  return in_session("sim", std::move(arguments));
}

wire::SessionAddress SessionTest::address(const std::string& participant) const {
  wire::SessionAddress address;
  address.session = session_;
  address.participant = participant;
  address.domain = domain_.first();
  return address;
}

testing::AssertionResult exits_with(int status, Process& process) {
  const std::optional<int> exit_status = process.wait();
  if (!exit_status) return testing::AssertionFailure() << "still runs; its output:\n" << process.output();
  if (*exit_status != status)
    return testing::AssertionFailure() << "exit status " << *exit_status << ", expected " << status << "; its output:\n"
                                       << process.output();
  if (!process.left_nothing_running()) return testing::AssertionFailure() << "left a process of its own running";
  return testing::AssertionSuccess();
}

}  // namespace tactus::e2e
