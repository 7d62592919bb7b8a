#include "tests/e2e/session_test.hpp"

#include <unistd.h>

#include <atomic>
#include <stdexcept>

namespace tactus::e2e {

bool Observer::Seen::is_here(const std::string& name) const {
  const auto at = roster.find(name);
  return at != roster.end() && !at->second.leaving;
}

bool Observer::Seen::has_left(const std::string& name) const {
  const auto at = roster.find(name);
  return at != roster.end() && at->second.leaving;
}

std::uint64_t Observer::Seen::metrics_of(const std::string& name) const {
  const auto at = metrics.find(name);
  return at == metrics.end() ? 0 : at->second;
}

double Observer::Seen::figure(const std::string& participant, const std::string& name) const {
  const auto of = figures.find(participant);
  if (of == figures.end()) return -1;
  const auto at = of->second.find(name);
  return at == of->second.end() ? -1 : at->second;
}

SeenStates Observer::Seen::user(const std::string& name) const {
  const auto at = states.find(session::id_of(name));
  return at == states.end() ? SeenStates{} : at->second;
}

Observer::Observer(const wire::SessionAddress& address)
    : participants_{address},
      roster_{participants_, wire::topics::kRoster, keep(&Observer::on_roster)},
      metrics_{participants_, wire::topics::kMetrics, keep(&Observer::on_metrics)},
      states_{participants_, wire::topics::kProbeState, keep(&Observer::on_state)} {}

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
  SeenStates& seen = seen_.states[state.user_id];
  ++seen.count;
  const bool contact = (state.status & session::kInContact) != 0;
  seen.in_contact += contact ? 1 : 0;
  seen.exact += contact && (state.status & session::kExact) != 0 ? 1 : 0;
  seen.faults += (state.status & session::kFault) != 0 ? 1 : 0;
  seen.last = state;
}

bool Observer::until(const std::function<bool(const Seen&)>& condition, std::chrono::milliseconds limit) {
  std::unique_lock lock{mutex_};
  return news_.wait_for(lock, limit, [&] { return condition(seen_); });
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

void make(const std::vector<std::string>& arguments) {
  std::vector<std::string> command{TACTUS_MESH};
  command.insert(command.end(), arguments.begin(), arguments.end());
  Process mesh{command};
  if (mesh.wait(60s) != 0) throw std::runtime_error{"tactus-mesh failed: " + mesh.output()};
}

}  // namespace

Models::Models() {
  for (const auto& [shape, model] : {std::pair{"organ", organ}, std::pair{"sphere", sphere}}) {
    const std::string mesh = model + ".ply";
    make({"generate", shape, mesh, "--faces", "20000", "--seed", "7"});
    make({"build", mesh, model, "--cell-faces", "100"});
  }
}

const Models& models() {
  static const Models kModels;
  return kModels;
}

SessionTest::SessionTest() {
  // Every third base domain from 1 to 94, so that neither two tests nor two test programs are likely to share one.
  static std::atomic<int> tests{0};
  const int test = ++tests;
  domain_ = 1 + 3 * ((getpid() + test) % 32);
  session_ = "e2e." + std::to_string(getpid()) + "." + std::to_string(test);
}

std::string SessionTest::write(const std::string& name, const std::string& text) const {
  test_support::write_bytes(path(name), text);
  return path(name);
}

std::vector<std::string> SessionTest::program(const std::string& name, std::vector<std::string> arguments) {
  static const std::map<std::string, std::string> kPrograms{
      {"host", TACTUS_HOST},       {"hrtc", TACTUS_HRTC},     {"sim", TACTUS_SIM},      {"mesh", TACTUS_MESH},
      {"control", TACTUS_CONTROL}, {"record", TACTUS_RECORD}, {"replay", TACTUS_REPLAY}};
  arguments.insert(arguments.begin(), kPrograms.at(name));
  return arguments;
}

std::vector<std::string> SessionTest::in_session(const std::string& name, std::vector<std::string> arguments) const {
  arguments.insert(arguments.end(), {"--session", session_, "--domain", std::to_string(domain_)});
  return program(name, std::move(arguments));
}

std::vector<std::string> SessionTest::host(const std::string& name, const std::string& model) const {
  return in_session("host", {"--name", name, "--cache", path("cache"), model});
}

std::vector<std::string> SessionTest::hrtc(const std::string& name, const std::vector<std::string>& further) const {
  std::vector<std::string> arguments{"--name", name, "--no-coding", "--flight-folder", path("flight")};
  arguments.insert(arguments.end(), further.begin(), further.end());
  return in_session("hrtc", std::move(arguments));
}

std::vector<std::string> SessionTest::sim(const std::string& text, const std::vector<std::string>& further) const {
  std::vector<std::string> arguments{"--scenario", write("scenario.yaml", text)};
  arguments.insert(arguments.end(), further.begin(), further.end());
  return in_session("sim", std::move(arguments));
}

wire::SessionAddress SessionTest::address(const std::string& participant) const {
  wire::SessionAddress address;
  address.session = session_;
  address.participant = participant;
  address.domain = domain_;
  return address;
}

testing::AssertionResult ends_with(int status, Process& process) {
  const std::optional<int> found = process.wait();
  if (!found) return testing::AssertionFailure() << "still runs, having said:\n" << process.output();
  if (*found != status)
    return testing::AssertionFailure() << "ended with " << *found << ", expected " << status << ", having said:\n"
                                       << process.output();
  if (!process.left_nothing_running()) return testing::AssertionFailure() << "left a process behind";
  return testing::AssertionSuccess();
}

}  // namespace tactus::e2e
