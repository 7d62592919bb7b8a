// Late joiners and healed partitions: how soon a newcomer receives, how soon all agree again.
#include <signal.h>

#include <CLI/CLI.hpp>
#include <atomic>
#include <cstdio>
#include <set>
#include <string_view>
#include <thread>

#include "bench/figures.hpp"
#include "bench/latency_bench.hpp"
#include "bench/live_session.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::bench {
namespace {

using namespace std::chrono_literals;
using netem::Side;

struct Settings {
  int joins = 100;
  int rounds = 5;
};

constexpr auto kAgree = 10s;  // then it is given up

std::string hold_of(const std::string& user, const std::string& hrtc) {
  return "name: hold\nduration: 3600\nusers:\n  - name: " + user + "\n    hrtc: " + hrtc +
         "\n    repeat: true\n    script:\n      - approach: {object: organ, direction: [0, 0, 1], speed: 0.15, "
         "until_force: 0.5}\n      - hold: {seconds: 3000, force: 1}\n";
}

/// Prints the milliseconds from nothing to its participants, and to the first probe state.
int join(const std::string& session) {
  wire::SessionAddress address;
  address.session = session;
  address.participant = "joiner." + std::to_string(getpid());
  std::atomic<std::int64_t> received_ns{0};
  const std::int64_t began_ns = wire::monotonic_ns();
  {
    wire::Participants links{address};
    const std::int64_t made_ns = wire::monotonic_ns();
    const wire::Reader<session::ProbeState> states{links, wire::topics::kProbeState, [&](session::ProbeState&&) {
                                                     std::int64_t none = 0;
                                                     received_ns.compare_exchange_strong(none, wire::monotonic_ns());
                                                   }};
    // The time is the callback's; this only ends the program soon after.
    while (received_ns == 0 && wire::monotonic_ns() - began_ns < 10'000'000'000) std::this_thread::sleep_for(500us);
    std::printf("made %.3f received %.3f\n", static_cast<double>(made_ns - began_ns) * 1e-6,
                received_ns == 0 ? kUnfinished : static_cast<double>(received_ns - began_ns) * 1e-6);
    std::fflush(stdout);
  }
  return 0;
}

class Rejoin {
 public:
  Rejoin() {
    const std::string mesh = path("organ.ply");
    run("mesh", {"generate", "organ", mesh, "--faces", "50000", "--seed", "7"});
    run("mesh", {"build", mesh, path("organ.spm")});
    test_support::write_bytes(path("ann.yaml"), hold_of("ann", "left"));
    test_support::write_bytes(path("bob.yaml"), hold_of("bob", "right"));
    museum_ = session_.start(Side::kA, "host", {"--name", "museum", "--cache", path("cache"), path("organ.spm")});
    left_ = session_.start(Side::kA, "hrtc", {"--name", "left", "--priority", "0"});
    ann_ = session_.start(Side::kA, "sim", {"--name", "ann's", "--scenario", path("ann.yaml")});
    start_right();
    session_.until(
        "two touches and one scene", [](const SeenSession& seen) { return agree(seen, 0, 0); }, 60s);
  }

  /// ms from nothing; kUnfinished when nothing was received.
  struct Join {
    double made = kUnfinished, received = kUnfinished;
  };
  Join join_once() {
    e2e::Process joiner{{"/usr/bin/nsenter", "--net=/run/netns/" + session_.pair().name(Side::kA),
                         program_path("bench-rejoin"), "--join", session_.address("joiner").session}};
    if (!joiner.wait(20s)) return {};
    const std::string output = joiner.output();
    Join join;
    return std::sscanf(output.c_str(), "made %lf received %lf", &join.made, &join.received) == 2 ? join : Join{};
  }

  enum class Cut { kBoth, kForth, kBack };
  /// ms from the mend until all agree. `meanwhile` runs in the partition.
  template <class Meanwhile>
  double partition(Cut cut, std::chrono::milliseconds lasting, const Meanwhile& meanwhile) {
    if (cut != Cut::kBack) deafen(Side::kB);
    if (cut != Cut::kForth) deafen(Side::kA);
    meanwhile();
    pause(lasting);
    observe(Side::kA);
    observe(Side::kB);
    const std::int64_t mended_ns = wire::monotonic_ns();
    const std::uint64_t right = right_since_;
    try {
      session_.until(
          "agreement", [&](const SeenSession& seen) { return agree(seen, mended_ns, right); }, kAgree);
    } catch (const std::runtime_error&) {
      if (wire::stop_signal()) throw;
      return kUnfinished;
    }
    const double ms = static_cast<double>(wire::monotonic_ns() - mended_ns) * 1e-6;
    pause(2s);
    return ms;
  }
  double partition(Cut cut, std::chrono::milliseconds lasting) {
    return partition(cut, lasting, [] {});
  }
  /// The HRTC beyond the partition dies and starts again in it.
  double partition_with_restart() {
    return partition(Cut::kBoth, 2s, [this] {
      right_since_ = session_.seen().roster.at(session::id_of("right")).origin.incarnation;
      right_->signal(SIGKILL);
      (void)right_->wait(5s);
      bob_->signal(SIGKILL);
      (void)bob_->wait(5s);
      start_right();
    });
  }

 private:
  /// By metrics that were made after `since_ns`; an incarnation of the right one after `right_since`.
  static bool agree(const SeenSession& seen, std::int64_t since_ns, std::uint64_t right_since) {
    std::set<std::uint64_t> scenes, meshes;
    for (const char* name : {"museum", "left", "right"}) {
      const auto at = seen.metrics.find(session::id_of(name));
      if (at == seen.metrics.end() || at->second.origin.time_ns <= since_ns) return false;
      scenes.insert(at->second.scene);
      for (const session::MeshHash& mesh : at->second.meshes) meshes.insert(mesh.hash);
      if (std::string{name} != "museum" && at->second.meshes.empty()) return false;
    }
    return scenes.size() == 1 && meshes.size() == 1 && *meshes.begin() != 0 &&
           seen.metrics.at(session::id_of("right")).origin.incarnation > right_since;
  }
  void start_right() {
    right_ = session_.start(Side::kB, "hrtc", {"--name", "right", "--priority", "0"});
    bob_ = session_.start(Side::kB, "sim", {"--name", "bob's", "--scenario", path("bob.yaml")});
  }
  /// Nothing from the other side reaches this one: at ingress, before datagrams are put together.
  void deafen(Side side) {
    nft(side, {"add", "table", "netdev", "cut"});
    nft(side, {"add", "chain", "netdev", "cut", "in", "{ type filter hook ingress device link0 priority 0 ; }"});
    nft(side, {"add", "rule", "netdev", "cut", "in", "drop"});
  }
  void observe(Side side) {
    e2e::Process gone{{"/usr/bin/nsenter", "--net=/run/netns/" + session_.pair().name(side), "/usr/sbin/nft", "delete",
                       "table", "netdev", "cut"}};
    (void)gone.wait(5s);  // fails where nothing was cut
  }
  void nft(Side side, std::vector<std::string> arguments) {
    std::vector<std::string> command{"/usr/bin/nsenter", "--net=/run/netns/" + session_.pair().name(side),
                                     "/usr/sbin/nft"};
    command.insert(command.end(), arguments.begin(), arguments.end());
    e2e::Process process{command};
    if (process.wait(5s) != 0) throw std::runtime_error{"nft: " + process.output()};
  }
  static void run(const std::string& name, std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), program_path(name));
    e2e::Process program{arguments};
    if (program.wait(120s) != 0) throw std::runtime_error{"tactus-" + name + " failed: " + program.output()};
  }
  [[nodiscard]] std::string path(const std::string& name) const { return folder_.path() / name; }

  test_support::TemporaryFolder folder_;
  LiveSession session_{"veth"};
  std::unique_ptr<e2e::Process> museum_, left_, ann_, right_, bob_;
  std::uint64_t right_since_ = 0;
};

Report run(const Settings& settings) {
  char text[120];
  std::snprintf(text, sizeof text, "%d joins, %d rounds of each partition; veth", settings.joins, settings.rounds);
  Report report{{"a host, two HRTCs whose users hold one place, 50,000 faces", 0, 0, text}};
  const auto measure = [&] {
    Rejoin rejoin;
    Samples made, received, after;
    int within = 0;
    for (int i = 0; i < settings.joins; ++i) {
      std::fprintf(stderr, "\rjoin %d of %d ", i + 1, settings.joins);
      const Rejoin::Join join = rejoin.join_once();
      made.add(join.made);
      received.add(join.received);
      after.add(std::isinf(join.received) ? kUnfinished : join.received - join.made);
    }
    for (double percent = 1; percent <= 100; ++percent) within += received.percentile(percent / 100) <= 50 ? 1 : 0;
    report.row("its participants made", "late joiners", "ms", made);
    report.row("first sample after that", "late joiners", "ms", after);
    report.row("first sample received", "late joiners", "ms", received);
    report.at_least("received within 50 ms", {"late joiners", received.size()}, "%", within, 95);
    report.at_most("received at the latest", {"late joiners", received.size()}, "ms", received.max(), 400);
    using Cut = Rejoin::Cut;
    const auto rounds = [&](const char* name, const auto& once) {
      Samples agreed;
      for (int i = 0; i < settings.rounds; ++i) {
        std::fprintf(stderr, "\r%s, %d of %d   ", name, i + 1, settings.rounds);
        agreed.add(once());
      }
      report.row(name, "from the mend to agreement", "ms", agreed);
      report.at_most(std::string{name} + ", all agree", {"from the mend, at most", agreed.size()}, "ms", agreed.max(),
                     2000);
    };
    rounds("partition of 1 s", [&] { return rejoin.partition(Cut::kBoth, 1s); });
    rounds("partition of 5 s", [&] { return rejoin.partition(Cut::kBoth, 5s); });
    rounds("host deaf for 3 s", [&] { return rejoin.partition(Cut::kBack, 3s); });
    rounds("host silent for 3 s", [&] { return rejoin.partition(Cut::kForth, 3s); });
    rounds("new incarnation", [&] { return rejoin.partition_with_restart(); });
    std::fprintf(stderr, "\n");
  };
  in_own_thread(measure);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  // The benchmark starts itself as a late joiner of a session.
  if (argc == 3 && std::string_view{argv[1]} == "--join") return tactus::bench::join(argv[2]);
  tactus::bench::Settings settings;
  tactus::bench::App app{"rejoin", "Late joiners, partitions and new incarnations; needs root",
                         "20 joins, 1 round, for CI"};
  app.add_option("--joins", settings.joins, "late joiners")->check(CLI::Range(1, 10000));
  app.add_option("--rounds", settings.rounds, "of each kind of partition")->check(CLI::Range(1, 1000));
  return tactus::bench::latency_main(app, argc, argv, [&] {
    if (app.quick) settings.joins = 20, settings.rounds = 1;
    return tactus::bench::run(settings);
  });
}
