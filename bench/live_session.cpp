#include "bench/live_session.hpp"

#include <unistd.h>

#include <algorithm>
#include <exception>
#include <filesystem>
#include <stdexcept>
#include <thread>

namespace tactus::bench {
namespace {

using std::chrono::milliseconds;

void throw_if_stopped() {
  if (realtime::stop_signal()) throw std::runtime_error{"interrupted"};
}

}  // namespace

struct LiveSession::Impl {
  explicit Impl(const wire::SessionAddress& address)
      : participants{address},
        roster{participants, wire::topics::kRoster, storing_callback<session::RosterEntry>()},
        metrics{participants, wire::topics::kMetrics, storing_callback<session::Metrics>()},
        demands{participants, wire::topics::kDemand, storing_callback<session::Demand>()},
        states{participants, wire::topics::kProbeState, storing_callback<session::ProbeState>()} {}

  template <class Sample>
  std::function<void(Sample&&)> storing_callback() {
    return [this](Sample&& sample) {
      const std::lock_guard lock{mutex};
      store(sample);
      new_sample.notify_all();
    };
  }
  void store(const session::RosterEntry& entry) { observed.roster[entry.origin.participant] = entry; }
  void store(const session::Metrics& sample) { observed.metrics[sample.origin.participant] = sample; }
  void store(const session::Demand& demand) {
    ObservedSession::Stream& stream = observed.streams[demand.origin.participant];
    if (demand.newest > 0 && demand.stream != stream.id) stream = {demand.stream, realtime::monotonic_ns()};
    if (demand.serving_host == observed.serving_host) return;
    observed.serving_host = demand.serving_host;
    observed.serving_since_ns = realtime::monotonic_ns();
  }
  void store(const session::ProbeState& state) {
    observed.states.push_back({state.user_id, state.sequence, state.status, state.session_time_ns, state.force,
                               state.origin.incarnation, realtime::monotonic_ns()});
  }

  wire::Participants participants;
  std::mutex mutex;
  std::condition_variable new_sample;
  ObservedSession observed;
  // The readers are declared last, so that they are destroyed before the members that their callbacks use.
  wire::Reader<session::RosterEntry> roster;
  wire::Reader<session::Metrics> metrics;
  wire::Reader<session::Demand> demands;
  wire::Reader<session::ProbeState> states;
};

double ObservedSession::figure(const std::string& participant, const std::string& name) const {
  const auto entry = metrics.find(session::id_of(participant));
  if (entry == metrics.end()) return -1;
  for (const session::Figure& figure : entry->second.figures)
    if (figure.name == name) return figure.value;
  return -1;
}

bool ObservedSession::touches_exactly(const std::string& user, std::uint64_t since) const {
  constexpr std::uint32_t kBits = session::kInContact | session::kExact;
  return std::any_of(states.begin(), states.end(), [&](const State& state) {
    return state.user == session::id_of(user) && (state.status & kBits) == kBits && state.incarnation > since;
  });
}

LiveSession::LiveSession(const std::string& link, Protection protection)
    : pair_{netem::parse_link(link)}, session_{"bench." + std::to_string(getpid())} {
  if (protection == Protection::kSecured) keys_ = std::make_unique<SessionKeys>(folder_.path());
  pair_.enter_namespace(netem::Side::kB);
  impl_ = std::make_unique<Impl>(address("observer"));
}

LiveSession::~LiveSession() = default;

wire::SessionAddress LiveSession::address(const std::string& participant) const {
  wire::SessionAddress address;
  address.session = session_;
  address.participant = participant;
  address.is_test = true;
  if (keys_) keys_->secure(address);
  return address;
}

std::unique_ptr<LiveSession::Process> LiveSession::start(netem::Side side, const std::string& name,
                                                         std::vector<std::string> arguments,
                                                         const std::vector<std::string>& launcher) {
  std::vector<std::string> command{"/usr/bin/nsenter", "--net=/run/netns/" + pair_.name(side)};
  command.insert(command.end(), launcher.begin(), launcher.end());
  command.push_back(program_path(name));
  command.insert(command.end(), arguments.begin(), arguments.end());
  command.insert(command.end(), {"--session", session_});
  if (keys_) {
    const auto option = std::find(arguments.begin(), arguments.end(), "--name");
    const bool has_name = arguments.end() - option > 1;
    const std::vector<std::string> keys = keys_->arguments(name, has_name ? *(option + 1) : name);
    command.insert(command.end(), keys.begin(), keys.end());
  } else {
    command.push_back("--plain");
  }
  return std::make_unique<Process>(std::move(command));
}

ObservedSession LiveSession::observed() const {
  const std::lock_guard lock{impl_->mutex};
  return impl_->observed;
}

void LiveSession::forget_states() {
  const std::lock_guard lock{impl_->mutex};
  impl_->observed.states.clear();
}

void LiveSession::wait_until(const char* what, const std::function<bool(const ObservedSession&)>& condition,
                             milliseconds limit) {
  const auto end = std::chrono::steady_clock::now() + limit;
  std::unique_lock lock{impl_->mutex};
  while (!condition(impl_->observed)) {
    throw_if_stopped();
    if (std::chrono::steady_clock::now() >= end)
      throw std::runtime_error{std::string{"timed out while waiting for "} + what};
    impl_->new_sample.wait_for(lock, milliseconds{50});
  }
}

void in_own_thread(const std::function<void()>& work) {
  std::exception_ptr failure;
  std::thread{[&] {
    try {
      work();
    } catch (...) {
      failure = std::current_exception();
    }
  }}.join();
  if (failure) std::rethrow_exception(failure);
}

std::string program_path(const std::string& name) {
  const std::filesystem::path folder = std::filesystem::read_symlink("/proc/self/exe").parent_path();
  const std::filesystem::path here = folder / ("tactus-" + name);
  return std::filesystem::exists(here) ? here : folder.parent_path() / "bin" / here.filename();  // for a test
}

void run_program(const std::string& name, std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), program_path(name));
  e2e::Process program{arguments};
  if (program.wait(std::chrono::seconds{120}) != 0)
    throw std::runtime_error{"tactus-" + name + " failed: " + program.output()};
}

std::int64_t wait_for_text(const e2e::Process& process, std::size_t from, const std::string& text, milliseconds limit) {
  const std::int64_t end_ns = realtime::monotonic_ns() + std::chrono::nanoseconds{limit}.count();
  while (realtime::monotonic_ns() < end_ns) {
    throw_if_stopped();
    if (process.output().find(text, from) != std::string::npos) return realtime::monotonic_ns();
    std::this_thread::sleep_for(std::chrono::microseconds{300});  // resolution of the returned time
  }
  return 0;
}

void pause(milliseconds time) {
  for (; time.count() > 0; time -= milliseconds{50}) {
    throw_if_stopped();
    std::this_thread::sleep_for(std::min(time, milliseconds{50}));  // a signal ends the pause within this time
  }
}

}  // namespace tactus::bench
