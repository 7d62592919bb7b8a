#include <signal.h>

#include <array>
#include <cstdio>
#include <fstream>
#include <set>

#include "bench/fault_runs.hpp"
#include "bench/fetcher.hpp"
#include "bench/in_namespace.hpp"
#include "bench/live_session.hpp"
#include "bench/memory_group.hpp"
#include "bench/process_status.hpp"
#include "bench/session_observer.hpp"
#include "bench/surface_recording.hpp"

namespace tactus::bench {
namespace {

using namespace std::chrono_literals;
using netem::LinkProfile;
using netem::Side;
using Process = e2e::Process;

/// A session of real programs with two objects. Users follow the surface of one of them, which has 300,000 faces.
class MovingSession {
 public:
  explicit MovingSession(const std::string& link) : session_{link} {
    make_model("organ", "300000");
    make_model("box", "1200");
    std::ofstream config{path("host.yaml")};
    config << "objects:\n  - {name: organ, model: organ.spm}\n  - {name: box, model: box.spm, position: [0.5, 0, 0]}\n";
    if (!config.flush()) throw std::runtime_error("cannot write " + path("host.yaml"));
    const LoadedModel organ = load_model(path("organ.spm"), 0);
    write_recording(path("slow.csv"), follow_surface(organ, 0.05), kRecordingPeriod);
    write_recording(path("fast.csv"), follow_surface(organ, 0.3), kRecordingPeriod);
    host_ = session_.start(Side::kA, "host", {"--name", "museum", "--config", path("host.yaml")});
  }

  static constexpr std::size_t kObjects = 2;

  [[nodiscard]] LiveSession& session() noexcept { return session_; }
  [[nodiscard]] const Process& host() const noexcept { return *host_; }
  /// Starts an HRTC with a user who follows the surface of the organ as in a recording, "slow" or "fast".
  [[nodiscard]] std::unique_ptr<Process> start_hrtc(Side side, const std::string& name, const std::string& user,
                                                    const std::string& recording, std::vector<std::string> more = {},
                                                    const std::vector<std::string>& launcher = {}) {
    more.insert(more.end(), {"--name", name, "--replay", user + "=" + path(recording + ".csv")});
    return session_.start(side, "hrtc", std::move(more), launcher);
  }

 private:
  [[nodiscard]] std::string path(const std::string& name) const { return folder_.path() / name; }
  void make_model(const std::string& name, const std::string& faces) const {
    run_program("mesh", {"generate", name, path(name + ".ply"), "--faces", faces});
    run_program("mesh", {"build", path(name + ".ply"), path(name + ".spm"), "--size", "0.1"});
  }

  test_support::TemporaryFolder folder_;
  LiveSession session_;
  std::unique_ptr<Process> host_;
};

/// Counts of the states of a user.
struct StateCounts {
  std::size_t all = 0, in_contact = 0, exact = 0;

  /// Counts the states in `observed`.
  void add(const ObservedSession& observed, const std::string& user) {
    for (const ObservedSession::State& state : observed.states) {
      if (state.user != session::id_of(user)) continue;
      ++all;
      if ((state.status & session::kInContact) == 0) continue;
      ++in_contact;
      if ((state.status & session::kExact) != 0) ++exact;
    }
  }
  [[nodiscard]] double contact_percent() const { return percent(in_contact, all); }
  [[nodiscard]] double exact_percent() const { return percent(exact, in_contact); }

 private:
  [[nodiscard]] static double percent(std::size_t part, std::size_t whole) {
    return 100 * static_cast<double>(part) / static_cast<double>(whole);
  }
};

void wait_for_touch(LiveSession& session, const std::string& user) {
  session.wait_until(("exact contact of " + user).c_str(),
                     [&](const ObservedSession& observed) { return observed.touches_exactly(user); });
}

}  // namespace

void measure_repeated_frames(const FaultSettings& settings, Report& report) {
  constexpr auto kWindow = 4s;
  MovingSession moving{"P0"};
  LiveSession& session = moving.session();
  const auto near = moving.start_hrtc(Side::kA, "near", "ann", "slow", {"--no-coding"});
  const auto far = moving.start_hrtc(Side::kB, "far", "bob", "fast", {"--no-coding"});
  wait_for_touch(session, "ann");
  wait_for_touch(session, "bob");
  const auto cpu_of_all = [&] { return cpu_seconds(moving.host()) + cpu_seconds(*near) + cpu_seconds(*far); };
  const auto pids_of_all = [&] {
    std::set<pid_t> all;
    for (const Process* program : std::initializer_list<const Process*>{&moving.host(), near.get(), far.get()})
      for (const pid_t pid : program->pids()) all.insert(pid);
    return all;
  };
  const std::set<pid_t> pids_before = pids_of_all();
  LinkProfile repeating;
  repeating.repeat = 0.1;
  Samples once_percent, more_percent;  // of a core
  for (int i = 0; i < settings.rounds; ++i) {
    std::fprintf(stderr, "\rrepeated frames %d of %d ", i + 1, settings.rounds);
    std::array<double, 2> percent{};
    for (const bool repeats : {i % 2 == 0, i % 2 != 0}) {
      const LinkProfile profile = repeats ? repeating : LinkProfile{};
      session.pair().set_profiles(profile, profile);
      const double cpu_before = cpu_of_all();
      const std::int64_t begin_ns = realtime::monotonic_ns();
      pause(kWindow);
      const double seconds = static_cast<double>(realtime::monotonic_ns() - begin_ns) * 1e-9;
      percent[repeats ? 1 : 0] = 100 * (cpu_of_all() - cpu_before) / seconds;
      session.forget_states();
    }
    once_percent.add(percent[0]);
    more_percent.add(percent[1] - percent[0]);
  }
  // The time of a process that has ended is missing, so it would lower the difference.
  const bool all_run = moving.host().running() && near->running() && far->running();
  if (!all_run || pids_of_all() != pids_before)
    throw std::runtime_error("a program has ended:\n" + moving.host().output() + near->output() + far->output());
  session.forget_states();
  wait_for_touch(session, "ann");
  wait_for_touch(session, "bob");
  const netem::RelayFigures figures = session.pair().figures();
  const auto repeated = static_cast<double>(figures.a_to_b.repeated + figures.b_to_a.repeated);
  const Population windows{"pairs of windows of 4 s", once_percent.size()};
  report.add_at_least("frames that arrive twice", windows, "1/s", repeated / (4.0 * static_cast<double>(windows.n)),
                      100);
  report.add_value("processor time of a host and two HRTCs, each frame once", windows, "% of a core",
                   once_percent.mean());
  report.add_at_most("additional processor time, one of ten frames twice", windows, "% of a core", more_percent.mean(),
                     1);
}

void measure_slow_link(const FaultSettings& settings, Report& report) {
  constexpr double kWindow = 2;  // s
  LinkProfile slow;
  slow.rate_mbit = 1;
  slow.queue_bytes = 50'000;
  const auto name_of = [](bool is_slow) { return is_slow ? "link of 1 Mbit/s" : "unlimited link"; };
  MovingSession moving{"P0"};
  LiveSession& session = moving.session();
  const auto near = moving.start_hrtc(Side::kA, "near", "ann", "slow");
  auto far = moving.start_hrtc(Side::kB, "far", "bob", "fast");
  const auto observer = make_in_namespace<SessionObserver>(session.pair(), Side::kA, session.address("observer-near"));
  const auto fetcher = make_in_namespace<Fetcher>(session.pair(), Side::kA, session.address("fetcher"));
  const auto run_fetcher = [&](double seconds, Samples* times_ms) {
    fetcher->run(realtime::monotonic_ns() + static_cast<std::int64_t>(seconds * 1e9), times_ms);
    if (realtime::stop_signal()) throw std::runtime_error("interrupted");
  };
  for (int tries = 0; !fetcher->ready() || observer->exact_users() < 2; ++tries) {
    if (tries > 200) throw std::runtime_error("the HRTCs have no exact contact:\n" + near->output() + far->output());
    run_fetcher(0.1, nullptr);
  }
  // By whether the link is slow.
  std::array<Samples, 2> delivery_p99_ms, age_p99_us, silence_ms;  // a sample of each window
  std::array<StateCounts, 2> counts;
  for (int i = 0; i < settings.rounds; ++i) {
    std::fprintf(stderr, "\rslow link %d of %d ", i + 1, settings.rounds);
    for (const bool is_slow : {false, true}) {
      const LinkProfile profile = is_slow ? slow : LinkProfile{};
      session.pair().set_profiles(profile, profile);
      run_fetcher(1, nullptr);  // until the change has taken effect
      Samples times_ms, ages_us;
      observer->add_ages_of("ann", &ages_us);
      session.forget_states();
      run_fetcher(kWindow, &times_ms);
      silence_ms[is_slow].add(observer->longest_silence_ms());
      fetcher->add_unanswered(times_ms);
      observer->add_ages_of("ann", nullptr);
      counts[is_slow].add(session.observed(), "bob");
      delivery_p99_ms[is_slow].add(times_ms.percentile(0.99));
      age_p99_us[is_slow].add(ages_us.empty() ? kUnfinished : ages_us.percentile(0.99));
    }
  }
  for (const bool is_slow : {false, true}) {
    const std::string link = name_of(is_slow);
    const Population windows{"windows of 2 s", delivery_p99_ms[is_slow].size()};
    report.add_value("median p99 of the delivery time of a region for another HRTC, " + link, windows, "ms",
                     delivery_p99_ms[is_slow].percentile(0.5));
    report.add_value("median p99 of the age of probe states of another HRTC, " + link, windows, "us",
                     age_p99_us[is_slow].percentile(0.5));
    report.add_value("states in contact, " + link, {"probe states", counts[is_slow].all}, "%",
                     counts[is_slow].contact_percent());
    report.add_value("exact states, " + link, {"probe states in contact", counts[is_slow].in_contact}, "%",
                     counts[is_slow].exact_percent());
  }
  const Population windows{"windows of 2 s", delivery_p99_ms[1].size()};
  report.add_at_most(
      "median p99 of the delivery time of a region for another HRTC, divided by that with an unlimited "
      "link",
      windows, "times", ratio(delivery_p99_ms[1].percentile(0.5), delivery_p99_ms[0].percentile(0.5)), 1.1);
  report.add_at_most("median p99 of the age of probe states of another HRTC, divided by that with an unlimited link",
                     windows, "times", ratio(age_p99_us[1].percentile(0.5), age_p99_us[0].percentile(0.5)), 1.1);
  // A state that does not arrive has no age.
  report.add_at_most("longest time without a probe state of another HRTC in a window", windows, "ms",
                     silence_ms[1].max(), 500);
  report.add_at_least("states in contact, divided by those with an unlimited link", windows, "times",
                      counts[1].contact_percent() / counts[0].contact_percent(), 0.9);

  // The link is still slow.
  far->signal(SIGTERM);
  (void)far->wait();
  const std::uint64_t before = session.observed().roster.at(session::id_of("far")).origin.incarnation;
  const std::int64_t started_ns = realtime::monotonic_ns();
  far = moving.start_hrtc(Side::kB, "far", "bob", "fast");
  const auto has_all = [&](const ObservedSession& observed) {
    const auto metrics = observed.metrics.find(session::id_of("far"));
    return metrics != observed.metrics.end() && metrics->second.origin.incarnation > before &&
           metrics->second.meshes.size() == MovingSession::kObjects;
  };
  try {
    session.wait_until("all objects at the HRTC with a slow link", has_all);
  } catch (const std::runtime_error& error) {
    throw std::runtime_error(std::string{error.what()} + ":\n" + far->output());
  }
  report.add_at_most("time until an HRTC that starts has all objects, link of 1 Mbit/s", {"start", 1}, "s",
                     static_cast<double>(realtime::monotonic_ns() - started_ns) * 1e-9, 10);
}

void measure_small_memory(const FaultSettings& settings, Report& report) {
  const MemoryGroup group;
  group.limit(64'000'000);
  MovingSession moving{"veth"};
  LiveSession& session = moving.session();
  const auto desk = moving.start_hrtc(Side::kB, "desk", "ann", "fast", {"--memory", "16MiB"}, group.launcher());
  wait_for_touch(session, "ann");
  session.forget_states();
  pause(std::chrono::milliseconds{static_cast<long>(settings.seconds * 1e3 / 3)});
  StateCounts counts;
  counts.add(session.observed(), "ann");
  desk->signal(SIGTERM);
  const std::optional<int> status = desk->wait(60s);
  const Population run{"run", 1};
  report.add_at_most("processes that the system has ended, 64 MB", run, "",
                     static_cast<double>(group.ended_processes()), 0);
  report.add_at_most("exit status of the HRTC, 64 MB", run, "", status.value_or(127), 0);
  report.add_at_least("states in contact, 64 MB", {"probe states", counts.all}, "%", counts.contact_percent(), 50);
  report.add_value("exact states, 64 MB", {"probe states in contact", counts.in_contact}, "%", counts.exact_percent());
}

}  // namespace tactus::bench
