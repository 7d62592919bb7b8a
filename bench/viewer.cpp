// Measures what a viewer costs the HRTCs of a session: ages of probe states and computing times of cycles, without a
// viewer, again without one, and with one that has a page which reads and ten which do not.
#include <signal.h>

#include <CLI/CLI.hpp>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <memory>
#include <optional>
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

constexpr int kSilentPages = 10;  // they do not read
constexpr char kUsers[] = R"(name: watched
duration: 7200
users:
  - {name: ann, script: [{approach: {object: organ, direction: [0, 0, 1], speed: 0.15}}, {follow: {speed: 0.05, force: 1, seconds: 7000, pattern: around}}]}
  - {name: bob, script: [{approach: {object: organ, direction: [1, 0.3, 0], speed: 0.15}}, {follow: {speed: 0.1, force: 1.5, seconds: 7000, pattern: zigzag}}]}
)";

struct Settings {
  int triples = 10;
  int seconds = 20;
};

/// 99th percentiles in some windows, us.
struct Percentiles {
  Samples ages;   // of the probe states of each second
  Samples works;  // of the computing times of each half second, which an HRTC publishes
};

/// A page that reads.
class ReadingPage {
 public:
  explicit ReadingPage(std::uint16_t port)
      : page_{port}, thread_{[this] {
          while (!ended_) (void)page_.receive(100ms);
        }} {}
  ~ReadingPage() {
    ended_ = true;
    thread_.join();
  }
  ReadingPage(const ReadingPage&) = delete;
  ReadingPage& operator=(const ReadingPage&) = delete;

 private:
  test_support::PageClient page_;
  std::atomic<bool> ended_{false};
  std::thread thread_;
};

/// An HRTC with two users, in one session for all windows.
class WatchedSession {
 public:
  WatchedSession() {
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

  /// Measures a window of `seconds`. If `is_watched`, a viewer runs.
  void measure(int seconds, bool is_watched, Percentiles& into) {
    std::unique_ptr<e2e::Process> viewer;
    std::vector<std::unique_ptr<test_support::PageClient>> silent_pages;
    std::optional<ReadingPage> reading_page;
    if (is_watched) {
      viewer = session_.start(Side::kB, "view", {"--name", "view", "--port", "0", "--page", folder_.path().string()});
      const std::uint16_t port = port_of(*viewer);
      reading_page.emplace(port);
      for (int i = 0; i < kSilentPages; ++i) silent_pages.push_back(std::make_unique<test_support::PageClient>(port));
    }
    pause(3s);  // until the viewer has the meshes, or the viewer before has left
    observer_.add_values_of(session::figures::kRecentCycleP99, &into.works);
    for (int i = 0; i < seconds; ++i) {
      Samples ages;
      observer_.add_ages_of("ann", &ages);
      pause(1s);
      observer_.add_ages_of("ann", nullptr);
      if (ages.empty()) throw std::runtime_error("no probe state arrived within a second: " + desk_->output());
      into.ages.add(ages.percentile(0.99));
    }
    observer_.add_values_of("", nullptr);
    reading_page.reset();
    if (viewer) end_program(*viewer);
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

  test_support::TemporaryFolder folder_;
  LiveSession session_{"veth"};
  std::unique_ptr<e2e::Process> host_, desk_, users_;
  SessionObserver observer_{session_.address("ages")};
};

/// Adds the rows of one quantity. `none`, `again` and `watched`: its percentiles without a viewer, again without one,
/// and with one.
void add_rows(Report& report, const std::string& name, const Samples& none, const Samples& again,
              const Samples& watched) {
  Samples both = none;
  for (const double value : again.values()) both.add(value);
  const double same = again.percentile(0.5) / none.percentile(0.5),
               with_viewer = watched.percentile(0.5) / both.percentile(0.5);
  const Population without{"percentiles", both.size()}, with{"percentiles", watched.size()};
  report.add_value(name + ", no viewer, median", without, "us", both.percentile(0.5));
  report.add_value(name + ", no viewer again / no viewer", without, "times", same);
  report.add_value(name + ", viewer / no viewer", with, "times", with_viewer);
  // About half the difference of the two series without a viewer is noise in the median of both.
  report.add_at_most(name + ", viewer: increase, minus half the difference without a viewer", with, "%",
                     100 * (with_viewer - 1 - std::abs(same - 1) / 2), 5);
}

Report run(const Settings& settings) {
  char text[160];
  std::snprintf(
      text, sizeof text,
      "%d triples of windows of %d s of one session, 2 users of 1 HRTC; pages: one that reads, 10 that do not",
      settings.triples, settings.seconds);
  Report report{{"a generated organ of 200,000 faces", 0, 0, text}};
  Percentiles none, again, watched;
  in_own_thread([&] {
    WatchedSession session;
    for (int i = 0; i < settings.triples; ++i) {
      // The order rotates, so that a change of the machine's load affects all three alike.
      for (int k = 0; k < 3; ++k) {
        Percentiles* const all[] = {&none, &again, &watched};
        Percentiles& into = *all[(k + i) % 3];
        session.measure(settings.seconds, &into == &watched, into);
      }
      std::fprintf(stderr, "triple %d of %d\n", i + 1, settings.triples);
    }
  });
  add_rows(report, "p99 of a second's ages", none.ages, again.ages, watched.ages);
  add_rows(report, "p99 of half a second's cycle_us", none.works, again.works, watched.works);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{"viewer", "Measures what a viewer costs the HRTCs of a session; needs root",
                         "three triples of windows of 5 s, for CI"};
  app.add_option("--triples", settings.triples, "number of triples of windows")->check(CLI::Range(1, 100));
  app.add_option("--seconds", settings.seconds, "duration of each window, s")->check(CLI::Range(1, 60));
  return tactus::bench::latency_main(app, argc, argv, [&] {
    if (app.quick) {
      settings.triples = 3;
      settings.seconds = 5;
    }
    return tactus::bench::run(settings);
  });
}
