// Measures what a viewer costs the HRTCs of a session: ages of probe states and computing times of cycles, without a
// viewer, again without one, and with one whose ten pages do not read.
#include <signal.h>

#include <CLI/CLI.hpp>
#include <array>
#include <cstdio>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "bench/figures.hpp"
#include "bench/latency_bench.hpp"
#include "bench/live_session.hpp"
#include "bench/models.hpp"
#include "bench/session_observer.hpp"
#include "session/figures.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tests/viewer/page_client.hpp"

namespace tactus::bench {
namespace {

using namespace std::chrono_literals;
using netem::Side;

constexpr int kPages = 10;
constexpr char kUsers[] = R"(name: watched
duration: 7200
users:
  - {name: ann, script: [{approach: {object: organ, direction: [0, 0, 1], speed: 0.15}}, {follow: {speed: 0.05, force: 1, seconds: 7000, pattern: around}}]}
  - {name: bob, script: [{approach: {object: organ, direction: [1, 0.3, 0], speed: 0.15}}, {follow: {speed: 0.1, force: 1.5, seconds: 7000, pattern: zigzag}}]}
)";

struct Settings {
  int pairs = 10;
  double seconds = 10;
};

/// Of one window, us. `work`: median of the 99th percentiles of each second.
struct WindowResult {
  double age, work;
};

/// An HRTC with two users, in one session for all windows.
class WatchedSession {
 public:
  explicit WatchedSession(double seconds) : seconds_{seconds} {
    run("mesh", {"generate", "organ", path("organ.ply"), "--faces", "200000", "--seed", "7"});
    run("mesh", {"build", path("organ.ply"), path("organ.spm"), "--size", "0.2"});
    test_support::write_bytes(path("users.yaml"), kUsers);
    test_support::write_bytes(path("index.html"), "<!doctype html>");
    host_ = session_.start(Side::kA, "host", {"--name", "museum", path("organ.spm")});
    desk_ = session_.start(Side::kB, "hrtc", {"--name", "desk"});
    users_ = session_.start(Side::kB, "sim", {"--scenario", path("users.yaml")});
    const auto end = std::chrono::steady_clock::now() + 60s;
    while (observer_.exact_users() < 2) {
      if (std::chrono::steady_clock::now() > end)
        throw std::runtime_error("no contact: " + host_->output() + desk_->output());
      pause(10ms);
    }
  }

  /// Measures for some seconds, with a viewer whose pages do not read if `is_watched`.
  WindowResult measure(bool is_watched) {
    std::unique_ptr<e2e::Process> viewer;
    std::vector<std::unique_ptr<test_support::PageClient>> pages;
    if (is_watched) {
      viewer = session_.start(Side::kB, "view", {"--name", "view", "--port", "0", "--page", folder_.path().string()});
      const std::uint16_t port = port_of(*viewer);
      for (int i = 0; i < kPages; ++i) pages.push_back(std::make_unique<test_support::PageClient>(port));
    }
    pause(3s);  // until the viewer has the meshes, or its end is over
    Samples ages, works;
    observer_.add_ages_of("ann", &ages);
    observer_.add_values_of(session::figures::kRecentCycleP99, &works);
    pause(std::chrono::milliseconds{static_cast<int>(1e3 * seconds_)});
    observer_.add_ages_of("ann", nullptr);
    observer_.add_values_of("", nullptr);
    if (viewer) end_program(*viewer);
    return {ages.percentile(0.99), works.percentile(0.5)};
  }

 private:
  [[nodiscard]] std::string path(const std::string& name) const { return folder_.path() / name; }
  static void run(const std::string& name, std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), program_path(name));
    e2e::Process program{arguments};
    if (program.wait(120s) != 0) throw std::runtime_error{"tactus-" + name + " failed: " + program.output()};
  }
  static void end_program(e2e::Process& program) {
    program.signal(SIGINT);
    if (!program.wait(20s)) throw std::runtime_error("a program did not end: " + program.output());
  }
  static std::uint16_t port_of(e2e::Process& viewer) {
    for (int i = 0; i < 1000; ++i, pause(10ms)) {
      const std::string output = viewer.output();
      const std::size_t at = output.find("http://localhost:");
      if (at != std::string::npos && output.find('/', at + 17) != std::string::npos)
        return static_cast<std::uint16_t>(std::stoul(output.substr(at + 17)));
    }
    throw std::runtime_error("the viewer did not start: " + viewer.output());
  }

  double seconds_;
  test_support::TemporaryFolder folder_;
  LiveSession session_{"veth"};
  std::unique_ptr<e2e::Process> host_, desk_, users_;
  SessionObserver observer_{session_.address("ages")};
};

/// Adds the rows of one quantity. Each triple has the values without a viewer, without one again, and with one.
void add_rows(Report& report, const std::string& name, const std::vector<std::array<double, 3>>& triples) {
  std::array<Samples, 3> values;
  Samples same, watched;
  for (const auto& triple : triples) {
    for (std::size_t i = 0; i < 3; ++i) values[i].add(triple[i]);
    same.add(triple[1] / triple[0]);
    watched.add(triple[2] / triple[0]);
  }
  const Population windows{"windows", triples.size()};
  report.add_value(name + ", no viewer, median", windows, "us", values[0].percentile(0.5));
  report.add_value(name + ", no viewer again, median", windows, "us", values[1].percentile(0.5));
  report.add_value(name + ", viewer, median", windows, "us", values[2].percentile(0.5));
  report.add_value(name + ", no viewer again / no viewer, median", windows, "times", same.percentile(0.5));
  report.add_value(name + ", viewer / no viewer, median", windows, "times", watched.percentile(0.5));
  report.add_at_most(name + ", viewer: increase beyond that of the second window without", windows, "%",
                     100 * (watched.percentile(0.5) - same.percentile(0.5)), 5);
}

Report run(const Settings& settings) {
  char text[160];
  std::snprintf(text, sizeof text,
                "%d triples of windows of %g s of one session, 2 users of 1 HRTC, 10 pages that do not read",
                settings.pairs, settings.seconds);
  Report report{{"a generated organ of 200,000 faces", 0, 0, text}};
  std::vector<std::array<double, 3>> ages, works;
  in_own_thread([&] {
    WatchedSession session{settings.seconds};
    for (int i = 0; i < settings.pairs; ++i) {
      std::array<WindowResult, 3> results{};
      // The order rotates, so that a change of the machine's load affects all three alike.
      for (std::size_t k = 0; k < 3; ++k) {
        const std::size_t which = (k + static_cast<std::size_t>(i)) % 3;
        results[which] = session.measure(which == 2);
      }
      ages.push_back({results[0].age, results[1].age, results[2].age});
      works.push_back({results[0].work, results[1].work, results[2].work});
      std::fprintf(stderr, "triple %d: p99 of age %.0f %.0f %.0f us, of computing time %.0f %.0f %.0f us\n", i + 1,
                   ages.back()[0], ages.back()[1], ages.back()[2], works.back()[0], works.back()[1], works.back()[2]);
    }
  });
  add_rows(report, "p99 age of probe states", ages);
  add_rows(report, "p99 of a second's cycle_us", works);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{"viewer", "Measures what a viewer costs the HRTCs of a session; needs root",
                         "three triples of windows of 5 s, for CI"};
  app.add_option("--pairs", settings.pairs, "number of triples of windows")->check(CLI::Range(1, 100));
  app.add_option("--seconds", settings.seconds, "duration of each window, s")->check(CLI::Range(1.0, 60.0));
  return tactus::bench::latency_main(app, argc, argv, [&] {
    if (app.quick) {
      settings.pairs = 3;
      settings.seconds = 5;
    }
    return tactus::bench::run(settings);
  });
}
