// Kills and suspends the gateway of an HRTC, and measures the change of its users' forces, late cycles, and the time
// until the session receives the users' states again.
#include <signal.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <map>
#include <string>
#include <thread>
#include <vector>

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

/// Before each kill, nothing happens for this time. Then a process that has nothing to do with the session works for
/// this time.
constexpr auto kReference = 500ms;

/// Starts a process that works for `time`, takes as much memory as a gateway, and ends.
void run_other_process(std::chrono::nanoseconds time) {
  constexpr std::size_t kBytes = 50u << 20, kStep = 1u << 20;
  const std::int64_t begin_ns = realtime::monotonic_ns();
  const pid_t child = fork();
  if (child == 0) {  // allocates nothing by `new` after a fork
    for (std::size_t taken = 0; taken < kBytes; taken += kStep) {
      void* const memory = mmap(nullptr, kStep, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
      if (memory != MAP_FAILED) std::memset(memory, 1, kStep);
      const auto next_ns =
          begin_ns + time.count() * static_cast<std::int64_t>(taken) / static_cast<std::int64_t>(kBytes);
      while (realtime::monotonic_ns() < next_ns) {
      }
    }
    _exit(0);
  }
  int status = 0;
  while (child > 0 && waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
}

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
    pause(kReference);
    run_other_process(kReference);
  }

  /// When the newest gateway was found in the roster, monotonic ns.
  [[nodiscard]] std::int64_t joined_ns() const noexcept { return joined_ns_; }

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
    pause(kReference);
    run_other_process(kReference);
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
    joined_ns_ = realtime::monotonic_ns();
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
  std::int64_t joined_ns_ = 0;
};

Report run(const Settings& settings) {
  char text[120];
  std::snprintf(text, sizeof text, "%d kills of each kind; two replayed users at rest; veth", settings.kills);
  Report report{{"a host, and an HRTC with two users, 50,000 faces", 0, 0, text}};
  const auto measure = [&] {
    TwoUsers session;
    std::map<std::string, std::vector<Window>> without;  // by kind
    Samples joined_ms;                                   // of all kinds that end the gateway
    for (const Kind& kind : kKinds) {
      Samples back_ms;
      for (int i = 0; i < settings.kills; ++i) {
        std::fprintf(stderr, "\r%s %d of %d    ", kind.name, i + 1, settings.kills);
        const Window window = session.kill(kind.signal);
        without[kind.name].push_back(window);
        const double ms = static_cast<double>(window.end_ns - window.begin_ns) * 1e-6;
        back_ms.add(kind.signal == SIGSTOP ? ms - 2000 : ms);
        if (kind.signal != SIGSTOP) joined_ms.add(static_cast<double>(session.joined_ns() - window.begin_ns) * 1e-6);
        // The HRTC waits before it starts a gateway again whose predecessor was killed shortly before.
        if (joined_ms.size() == 1)
          report.add_at_most("first kill: time until the next gateway is in the session", {"kill", 1}, "ms",
                             joined_ms.max(), 1000);
      }
      const std::string figure = std::string{kind.name} + ": time until both users are back";
      report.add_percentiles(figure, "kills", "ms", back_ms);
      report.add_at_most(figure + ", p99", {"kills", back_ms.size()}, "ms", back_ms.percentile(0.99), 3000);
    }
    std::fprintf(stderr, "\n");
    report.add_percentiles("time until the next gateway is in the session", "kills", "ms", joined_ms);
    const Cycles cycles = read_cycles(session.recording());
    CycleFigures killed, idle, busy;
    for (const auto& [kind, windows] : without) {
      CycleFigures of_kind;
      for (const Window& window : windows) {
        of_kind.add(cycles, window);
        killed.add(cycles, window);
        constexpr std::int64_t kReferenceNs = std::chrono::nanoseconds{kReference}.count(), kEdgeNs = 50'000'000;
        busy.add(cycles, {window.begin_ns - kReferenceNs + kEdgeNs, window.begin_ns});
        idle.add(cycles, {window.begin_ns - 2 * kReferenceNs + kEdgeNs, window.begin_ns - kReferenceNs});
      }
      const Population of{"cycles", of_kind.intervals_ms.size()};
      report.add_value(kind + ": late cycles", of, "per million", of_kind.late_per_million());
      report.add_value(kind + ": time between two cycles, max", of, "ms", of_kind.intervals_ms.max());
    }
    report.add_at_most("largest change of a force, no gateway", {"cycles", killed.intervals_ms.size()}, "N",
                       killed.force_change, 0);
    report.add_at_least("smallest force, no gateway", {"cycles", killed.intervals_ms.size()}, "N", killed.min_force,
                        0.05);
    report.add_percentiles("time between two cycles, no gateway", "cycles", "ms", killed.intervals_ms);
    report.add_percentiles("time between two cycles, before", "cycles", "ms", idle.intervals_ms);
    report.add_percentiles("time between two cycles, before, with another process", "cycles", "ms", busy.intervals_ms);
    report.add_value("late cycles before", {"cycles", idle.intervals_ms.size()}, "per million",
                     idle.late_per_million());
    report.add_value("late cycles before, with another process", {"cycles", busy.intervals_ms.size()}, "per million",
                     busy.late_per_million());
    report.add_value("late cycles, no gateway", {"cycles", killed.intervals_ms.size()}, "per million",
                     killed.late_per_million());
    // On a machine with other load, cycles are late without a kill too. So each difference is compared with its chance.
    const auto add_difference = [&](const std::string& figure, const CycleFigures& reference) {
      const double error = std::hypot(killed.standard_error(), reference.standard_error());
      report.add_at_most(figure, {"cycles", killed.intervals_ms.size()}, "standard errors",
                         (killed.late_per_million() - reference.late_per_million()) / std::max(error, 1.0), 3);
    };
    add_difference("late cycles, difference of the two", idle);
    add_difference("late cycles, difference to those with another process", busy);
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
