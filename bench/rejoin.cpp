// Measures the time until a late joiner receives its first sample, and the time from the end of a network partition
// until all participants agree.
#include <signal.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <cstdio>
#include <set>
#include <string_view>
#include <thread>

#include "bench/figures.hpp"
#include "bench/latency_bench.hpp"
#include "bench/live_session.hpp"
#include "bench/resting_touch.hpp"
#include "session/figures.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::bench {
namespace {

using namespace std::chrono_literals;
using netem::Side;

struct Settings {
  int joins = 100;
  int rounds = 5;
};

constexpr auto kMaxAgreementTime = 60s;
constexpr double kMaxAgreedMs = 2000, kMaxSecuredAgreedMs = 8000;

/// Joins a session once. Prints the time from the start until its DDS participants exist, and until the first probe
/// state arrives, ms.
int join(const std::string& session) {
  wire::SessionAddress address;
  address.session = session;
  address.is_test = true;
  address.participant = "joiner." + std::to_string(getpid());
  std::atomic<std::int64_t> received_ns{0};
  const std::int64_t start_ns = realtime::monotonic_ns();
  {
    wire::Participants participants{address};
    const std::int64_t created_ns = realtime::monotonic_ns();
    const wire::Reader<session::ProbeState> states{participants, wire::topics::kProbeState, [&](session::ProbeState&&) {
                                                     std::int64_t none = 0;
                                                     received_ns.compare_exchange_strong(none,
                                                                                         realtime::monotonic_ns());
                                                   }};
    // The callback takes the time; the precision of this wait does not matter.
    while (received_ns == 0 && realtime::monotonic_ns() - start_ns < 10'000'000'000) std::this_thread::sleep_for(500us);
    std::printf("created %.3f received %.3f\n", static_cast<double>(created_ns - start_ns) * 1e-6,
                received_ns == 0 ? kUnfinished : static_cast<double>(received_ns - start_ns) * 1e-6);
    std::fflush(stdout);
  }
  return 0;
}

/// A session of a host and two HRTCs with a user each, who rest on the same point. The network between the HRTC
/// "right" and the other programs can be cut.
class Rejoin {
 public:
  explicit Rejoin(Protection protection = Protection::kPlain) : session_{"veth", protection} {
    const std::string mesh = path("organ.ply");
    run_program("mesh", {"generate", "organ", mesh, "--faces", "50000", "--seed", "7"});
    run_program("mesh", {"build", mesh, path("organ.spm")});
    write_resting_touch(path("organ.spm"), path("touch.csv"));
    host_ = session_.start(Side::kA, "host", {"--name", "museum", "--cache", path("cache"), path("organ.spm")});
    left_ = start_hrtc(Side::kA, "left", "ann");
    right_ = start_hrtc(Side::kB, "right", "bob");
    session_.wait_until(
        "exact contact of both users and agreement of all participants",
        [](const ObservedSession& observed) {
          return observed.touches_exactly("ann") && observed.touches_exactly("bob") && all_agree(observed, 0, 0);
        },
        60s);
  }

  /// Times since the start of a late joiner, ms. kUnfinished if no sample arrived.
  struct JoinTimes {
    double created = kUnfinished, received = kUnfinished;
  };
  /// Starts a late joiner and waits for its end.
  JoinTimes join_once() {
    e2e::Process joiner{{"/usr/bin/nsenter", "--net=/run/netns/" + session_.pair().name(Side::kA),
                         program_path("bench-rejoin"), "--join", session_.address("joiner").session}};
    if (!joiner.wait(20s)) return {};
    const std::string output = joiner.output();
    JoinTimes times;
    return std::sscanf(output.c_str(), "created %lf received %lf", &times.created, &times.received) == 2 ? times
                                                                                                         : JoinTimes{};
  }

  /// Direction in which the partition drops datagrams. The host is at A, the right HRTC at B.
  enum class Cut { kBoth, kToB, kToA };
  struct Recovery {
    double agreed_ms = kUnfinished;      ///< from the end of the partition until all agree
    double fresh_ms = kUnfinished;       ///< until the first probe state of the left HRTC arrives at side B
    double records_again = kUnfinished;  ///< records that the right HRTC has received again, without its restart
  };
  /// Partitions the network, calls `meanwhile` and waits for `duration`.
  template <class Meanwhile>
  Recovery partition(Cut cut, std::chrono::milliseconds duration, const Meanwhile& meanwhile) {
    return interrupt(
        [&] {
          if (cut != Cut::kToA) block_ingress(Side::kB);
          if (cut != Cut::kToB) block_ingress(Side::kA);
          meanwhile();
        },
        duration,
        [&] {
          unblock_ingress(Side::kA);
          unblock_ingress(Side::kB);
        });
  }
  Recovery partition(Cut cut, std::chrono::milliseconds duration) {
    return partition(cut, duration, [] {});
  }
  /// Suspends the right HRTC.
  Recovery suspension(std::chrono::milliseconds duration) {
    return interrupt([this] { right_->signal_all(SIGSTOP); }, duration, [this] { right_->signal_all(SIGCONT); });
  }
  /// Kills the right HRTC during a partition and starts it again.
  Recovery partition_with_restart() {
    return partition(Cut::kBoth, 2s, [this] {
      right_incarnation_ = session_.observed().roster.at(session::id_of("right")).origin.incarnation;
      right_->signal_all(SIGKILL);
      (void)right_->wait(5s);
      right_ = start_hrtc(Side::kB, "right", "bob");
    });
  }

 private:
  /// Calls `begin`, waits for `duration`, and calls `end`. All results are kUnfinished if the agreement takes too long.
  template <class Begin, class End>
  Recovery interrupt(const Begin& begin, std::chrono::milliseconds duration, const End& end) {
    const auto records_again = [this] {
      return session_.observed().figure("right", session::figures::kRecordsReceivedAgain);
    };
    const double records_before = records_again();
    begin();
    pause(duration);
    session_.forget_states();
    end();
    const std::int64_t end_ns = realtime::monotonic_ns();
    const std::uint64_t right = right_incarnation_;
    try {
      session_.wait_until(
          "agreement", [&](const ObservedSession& observed) { return all_agree(observed, end_ns, right); },
          kMaxAgreementTime);
    } catch (const std::runtime_error&) {
      if (realtime::stop_signal()) throw;
      return {};
    }
    Recovery recovery;
    recovery.agreed_ms = static_cast<double>(realtime::monotonic_ns() - end_ns) * 1e-6;
    for (const ObservedSession::State& state : session_.observed().states)
      if (state.user == session::id_of("ann") && state.received_ns >= end_ns)
        recovery.fresh_ms = std::min(recovery.fresh_ms, static_cast<double>(state.received_ns - end_ns) * 1e-6);
    pause(2s);
    recovery.records_again = records_again() - records_before;
    return recovery;
  }
  /// Returns true if host and HRTCs have equal scenes and mesh hashes. Uses metrics after `since_ns` only. The right
  /// HRTC must have an incarnation after `right_since`.
  static bool all_agree(const ObservedSession& observed, std::int64_t since_ns, std::uint64_t right_since) {
    std::set<std::uint64_t> scenes, meshes;
    for (const char* name : {"museum", "left", "right"}) {
      const auto at = observed.metrics.find(session::id_of(name));
      if (at == observed.metrics.end() || at->second.origin.time_ns <= since_ns) return false;
      scenes.insert(at->second.scene);
      for (const session::MeshHash& mesh : at->second.meshes) meshes.insert(mesh.hash);
      if (std::string{name} != "museum" && at->second.meshes.empty()) return false;
    }
    return scenes.size() == 1 && meshes.size() == 1 && *meshes.begin() != 0 &&
           observed.metrics.at(session::id_of("right")).origin.incarnation > right_since;
  }
  [[nodiscard]] std::unique_ptr<e2e::Process> start_hrtc(Side side, const std::string& name, const std::string& user) {
    return session_.start(side, "hrtc",
                          {"--name", name, "--priority", "0", "--replay", user + "=" + path("touch.csv")});
  }
  /// Drops all datagrams from the other side at ingress, before they are reassembled.
  void block_ingress(Side side) {
    nft(side, {"add", "table", "netdev", "cut"});
    nft(side, {"add", "chain", "netdev", "cut", "in", "{ type filter hook ingress device link0 priority 0 ; }"});
    nft(side, {"add", "rule", "netdev", "cut", "in", "drop"});
  }
  void unblock_ingress(Side side) {
    e2e::Process nft_process{{"/usr/bin/nsenter", "--net=/run/netns/" + session_.pair().name(side), "/usr/sbin/nft",
                              "delete", "table", "netdev", "cut"}};
    (void)nft_process.wait(5s);  // fails if the side was not blocked
  }
  void nft(Side side, std::vector<std::string> arguments) {
    std::vector<std::string> command{"/usr/bin/nsenter", "--net=/run/netns/" + session_.pair().name(side),
                                     "/usr/sbin/nft"};
    command.insert(command.end(), arguments.begin(), arguments.end());
    e2e::Process process{command};
    if (process.wait(5s) != 0) throw std::runtime_error{"nft: " + process.output()};
  }
  [[nodiscard]] std::string path(const std::string& name) const { return folder_.path() / name; }

  test_support::TemporaryFolder folder_;
  LiveSession session_;
  std::unique_ptr<e2e::Process> host_, left_, right_;
  std::uint64_t right_incarnation_ = 0;
};

/// One sample a partition.
struct Recovered {
  Samples fresh_ms, records_again;
};

Report run(const Settings& settings) {
  char text[120];
  std::snprintf(text, sizeof text, "%d joins, %d rounds of each partition; veth", settings.joins, settings.rounds);
  Report report{{"a host, two HRTCs whose users touch one point, 50,000 faces", 0, 0, text}};
  using Cut = Rejoin::Cut;
  const auto measure_rounds = [&](const std::string& name, double max_agreed_ms, const auto& run_once) {
    Samples agreed_ms;
    Recovered recovered;
    for (int i = 0; i < settings.rounds; ++i) {
      std::fprintf(stderr, "\r%s, %d of %d   ", name.c_str(), i + 1, settings.rounds);
      const Rejoin::Recovery recovery = run_once();
      agreed_ms.add(recovery.agreed_ms);
      recovered.fresh_ms.add(recovery.fresh_ms);
      recovered.records_again.add(recovery.records_again);
    }
    report.add_percentiles(name + ": time from its end until all agree", "partitions", "ms", agreed_ms);
    report.add_at_most(name + ": max time from its end until all agree", {"partitions", agreed_ms.size()}, "ms",
                       agreed_ms.max(), max_agreed_ms);
    return recovered;
  };
  const auto measure = [&] {
    Rejoin rejoin;
    Samples created_ms, received_ms, difference_ms;
    int within_bound = 0;
    for (int i = 0; i < settings.joins; ++i) {
      std::fprintf(stderr, "\rjoin %d of %d ", i + 1, settings.joins);
      const Rejoin::JoinTimes times = rejoin.join_once();
      created_ms.add(times.created);
      received_ms.add(times.received);
      difference_ms.add(std::isinf(times.received) ? kUnfinished : times.received - times.created);
    }
    for (double percent = 1; percent <= 100; ++percent)
      within_bound += received_ms.percentile(percent / 100) <= 50 ? 1 : 0;
    report.add_percentiles("time from start until the DDS participants exist", "late joiners", "ms", created_ms);
    report.add_percentiles("time from the DDS participants to the first sample", "late joiners", "ms", difference_ms);
    report.add_percentiles("time from start to the first sample", "late joiners", "ms", received_ms);
    report.add_at_least("late joiners with the first sample within 50 ms", {"late joiners", received_ms.size()}, "%",
                        within_bound, 95);
    report.add_at_most("max time from start to the first sample", {"late joiners", received_ms.size()}, "ms",
                       received_ms.max(), 400);
    const auto measure_cut = [&](const char* name, std::chrono::milliseconds duration, double max_fresh_ms) {
      const Recovered recovered =
          measure_rounds(name, kMaxAgreedMs, [&] { return rejoin.partition(Cut::kBoth, duration); });
      const Population partitions{"partitions", recovered.fresh_ms.size()};
      report.add_at_most(std::string{name} + ": max time from its end until a probe state arrives", partitions, "ms",
                         recovered.fresh_ms.max(), max_fresh_ms);
      report.add_at_most(std::string{name} + ": max number of records received again", partitions, "",
                         recovered.records_again.max(), 0);
    };
    measure_cut("partition of 1 s", 1s, 100);
    measure_cut("partition of 5 s", 5s, 1000);
    measure_rounds("partition of 3 s towards the host", kMaxAgreedMs, [&] { return rejoin.partition(Cut::kToA, 3s); });
    measure_rounds("partition of 3 s from the host", kMaxAgreedMs, [&] { return rejoin.partition(Cut::kToB, 3s); });
    // Only one side receives nothing for longer than the lease of 4 s.
    measure_rounds("partition of 8 s towards the host", kMaxAgreedMs, [&] { return rejoin.partition(Cut::kToA, 8s); });
    measure_rounds("partition of 8 s from the host", kMaxAgreedMs, [&] { return rejoin.partition(Cut::kToB, 8s); });
    measure_rounds("HRTC suspended for 8 s", kMaxAgreedMs, [&] { return rejoin.suspension(8s); });
    measure_rounds("partition of 2 s with a restarted HRTC", kMaxAgreedMs,
                   [&] { return rejoin.partition_with_restart(); });
  };
  const auto measure_with_keys = [&] {
    Rejoin rejoin{Protection::kSecured};
    measure_rounds("with keys, partition of 20 s", kMaxSecuredAgreedMs,
                   [&] { return rejoin.partition(Cut::kBoth, 20s); });
    measure_rounds("with keys, partition of 8 s towards the host", kMaxSecuredAgreedMs,
                   [&] { return rejoin.partition(Cut::kToA, 8s); });
    measure_rounds("with keys, partition of 8 s from the host", kMaxSecuredAgreedMs,
                   [&] { return rejoin.partition(Cut::kToB, 8s); });
    measure_rounds("with keys, HRTC suspended for 8 s", kMaxSecuredAgreedMs, [&] { return rejoin.suspension(8s); });
    std::fprintf(stderr, "\n");
  };
  in_own_thread(measure);
  in_own_thread(measure_with_keys);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  // The benchmark starts itself as a late joiner of a session.
  if (argc == 3 && std::string_view{argv[1]} == "--join") return tactus::bench::join(argv[2]);
  tactus::bench::Settings settings;
  tactus::bench::App app{"rejoin", "Measures late joining, partitions and the restart of an HRTC; needs root",
                         "20 late joiners, 1 round, for CI"};
  app.add_option("--joins", settings.joins, "number of late joiners")->check(CLI::Range(1, 10000));
  app.add_option("--rounds", settings.rounds, "rounds of each kind of partition")->check(CLI::Range(1, 1000));
  return tactus::bench::latency_main(app, argc, argv, [&] {
    if (app.quick) settings.joins = 20, settings.rounds = 1;
    return tactus::bench::run(settings);
  });
}
