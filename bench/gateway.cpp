// Kills and suspends the gateway of an HRTC, and measures the change of its users' forces, late cycles, and the time
// until the session receives the users' states again.
#include <signal.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <thread>

#include "bench/figures.hpp"
#include "bench/flight_cycles.hpp"
#include "bench/latency_bench.hpp"
#include "bench/live_session.hpp"
#include "bench/memory_group.hpp"
#include "bench/touched_session.hpp"

namespace tactus::bench {
namespace {

using namespace std::chrono_literals;
using netem::Side;

struct Settings {
  int kills = 100;  // of each kind
};

struct Kind {
  const char* name;
  int signal;
};
constexpr int kNoMemory = 0;
constexpr Kind kKinds[] = {{"SIGKILL", SIGKILL},
                           {"SIGSEGV", SIGSEGV},
                           {"SIGABRT", SIGABRT},
                           {"SIGSTOP for 2 s", SIGSTOP},
                           {"lack of memory", kNoMemory}};

/// A host, and an HRTC whose two users rest on one point.
class TwoUsers {
 public:
  TwoUsers() {
    touched_.start_host(Side::kA);
    hrtc_ = touched_.start_hrtc(
        Side::kB, "desk", {"ann", "bob"},
        {"--users", "2", "--no-coding", "--flight-recorder", "3600", "--flight-file", touched_.path("flight.mcap")});
    wait_for_touch(0);
    memory_.add(hrtc_->pid());
    memory_.add(gateway());
    pause(1s);
  }

  /// Ends or suspends the gateway. Returns the time without states of both users.
  Window kill(int signal) {
    const pid_t victim = gateway();
    const std::int64_t begin_ns = realtime::monotonic_ns();
    if (signal == kNoMemory)
      memory_.exhaust(victim);
    else
      ::kill(victim, signal);
    if (signal == SIGSTOP) {
      pause(2s);
      ::kill(victim, SIGCONT);
    }
    const std::int64_t end_ns = wait_for_touch(signal == SIGSTOP ? 0 : incarnation_);
    pause(500ms);
    return {begin_ns, end_ns};
  }

  /// Ends the HRTC, and returns its recording.
  std::string recording() {
    hrtc_->signal(SIGTERM);
    if (hrtc_->wait(60s) != 0) throw std::runtime_error{"the HRTC failed:\n" + hrtc_->output()};
    return touched_.path("flight.mcap");
  }

 private:
  [[nodiscard]] pid_t gateway() const {
    const pid_t gateway = hrtc_->child("tactus-gateway");
    if (gateway == 0) throw std::runtime_error{"no gateway runs:\n" + hrtc_->output()};
    return gateway;
  }
  /// Waits until both users touch exactly in states of a gateway that is not `former`. Returns the time of it.
  std::int64_t wait_for_touch(std::uint64_t former) {
    LiveSession& session = touched_.session();
    session.wait_until("the HRTC", [&](const ObservedSession& observed) {
      const auto desk = observed.roster.find(session::id_of("desk"));
      if (desk == observed.roster.end() || desk->second.origin.incarnation == former) return false;
      incarnation_ = desk->second.origin.incarnation;
      return true;
    });
    session.forget_states();  // those of the earlier gateway
    session.wait_until("exact contact of both users", [](const ObservedSession& observed) {
      return observed.touches_exactly("ann") && observed.touches_exactly("bob");
    });
    return realtime::monotonic_ns();
  }

  MemoryGroup memory_;
  TouchedSession touched_{50'000};
  std::unique_ptr<e2e::Process> hrtc_;
  std::uint64_t incarnation_ = 0;  // of the newest gateway
};

Report run(const Settings& settings) {
  char text[120];
  std::snprintf(text, sizeof text, "%d kills of each kind; two replayed users at rest; veth", settings.kills);
  Report report{{"a host, and an HRTC with two users, 50,000 faces", 0, 0, text}};
  const auto measure = [&] {
    TwoUsers session;
    std::vector<Window> without;
    for (const Kind& kind : kKinds) {
      Samples back_ms;
      for (int i = 0; i < settings.kills; ++i) {
        std::fprintf(stderr, "\r%s %d of %d    ", kind.name, i + 1, settings.kills);
        without.push_back(session.kill(kind.signal));
        const double ms = static_cast<double>(without.back().end_ns - without.back().begin_ns) * 1e-6;
        back_ms.add(kind.signal == SIGSTOP ? ms - 2000 : ms);
      }
      const std::string figure = std::string{kind.name} + ": time until both users are back";
      report.add_percentiles(figure, "kills", "ms", back_ms);
      report.add_at_most(figure + ", p99", {"kills", back_ms.size()}, "ms", back_ms.percentile(0.99), 3000);
    }
    std::fprintf(stderr, "\n");
    const Cycles cycles = read_cycles(session.recording());
    // The references lie just before the kills: half a second in which nothing happens.
    CycleFigures killed, reference;
    for (const Window& window : without) {
      killed.add(cycles, window);
      reference.add(cycles, {window.begin_ns - 450'000'000, window.begin_ns});
    }
    report.add_at_most("largest change of a force, no gateway", {"cycles", killed.intervals_ms.size()}, "N",
                       killed.force_change, 0);
    report.add_at_least("smallest force, no gateway", {"cycles", killed.intervals_ms.size()}, "N", killed.min_force,
                        0.05);
    report.add_percentiles("time between two cycles, no gateway", "cycles", "ms", killed.intervals_ms);
    report.add_percentiles("time between two cycles, before", "cycles", "ms", reference.intervals_ms);
    report.add_value("late cycles before", {"cycles", reference.intervals_ms.size()}, "per million",
                     reference.late_per_million());
    report.add_value("late cycles, no gateway", {"cycles", killed.intervals_ms.size()}, "per million",
                     killed.late_per_million());
    // On a machine with other load, cycles are late without a kill too. So the difference is compared with its chance.
    const double error = std::hypot(killed.standard_error(), reference.standard_error());
    report.add_at_most("late cycles, difference of the two", {"cycles", killed.intervals_ms.size()}, "standard errors",
                       (killed.late_per_million() - reference.late_per_million()) / std::max(error, 1.0), 3);
  };
  in_own_thread(measure);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{"gateway", "Measures the end of an HRTC's gateway; needs root",
                         "5 kills of each kind, for CI"};
  app.add_option("--kills", settings.kills, "number of kills of each kind")->check(CLI::Range(1, 10000));
  return tactus::bench::latency_main(app, argc, argv, [&] {
    if (app.quick) settings.kills = 5;
    return tactus::bench::run(settings);
  });
}
