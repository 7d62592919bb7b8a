// Simulates one session for each seed, in virtual time. Checks the invariants of simulated_session.hpp while samples
// are lost or repeated, programs are killed and links are cut.
#include <CLI/CLI.hpp>
#include <array>
#include <atomic>
#include <cstdio>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

#include "bench/bench_main.hpp"
#include "bench/figures.hpp"
#include "bench/stopwatch.hpp"
#include "tests/session/simulated_session.hpp"

namespace tactus::bench {
namespace {

using namespace test_support;

struct Settings {
  std::uint64_t schedules = 100'000;
  std::uint64_t first = 1;  // seed
  std::uint64_t seed = 0;   // of the schedule to replay; 0: runs all
  unsigned threads = 0;     // 0: one for each processor
};

constexpr double kMaxSeconds = 300;
constexpr std::size_t kMaxReported = 10;

Report replay(std::uint64_t seed) {
  const Schedule schedule = random_schedule(seed);
  std::printf("seed %llu: %s\n\n", static_cast<unsigned long long>(seed), schedule.text().c_str());
  const SimulationResult result =
      simulate(seed, schedule, [](const std::string& line) { std::printf("%s\n", line.c_str()); });
  std::printf("\n%llu messages in %.0f ms, ", static_cast<unsigned long long>(result.samples_sent),
              static_cast<double>(result.virtual_ns) * 1e-6);
  if (result.recovery_ns)
    std::printf("recovered %.0f ms after the last fault\n", static_cast<double>(*result.recovery_ns) * 1e-6);
  else
    std::printf("did not recover\n");
  for (const std::string& condition : result.violations) std::printf("BROKEN %s\n", condition.c_str());
  std::printf("\n");
  Report report{{"2 hosts, 3 HRTCs, 2 clients", 0, 0, schedule.text()}};
  report.set_virtual_time(true);
  report.add_at_most("broken conditions", {"schedule", 1}, "", static_cast<double>(result.violations.size()), 0);
  return report;
}

/// Totals over all schedules.
struct Totals {
  std::vector<std::uint64_t> failed;  // seeds
  std::array<std::uint64_t, kFaultKinds> faults{};
  std::uint64_t min_messages = ~std::uint64_t{0}, messages = 0;
  std::size_t min_kinds = kFaultKinds;
  std::uint64_t held = 0, refused = 0, released = 0, pages_held = 0, pages_refused = 0, pages_forgotten = 0;
  std::uint64_t host_changes = 0, failures_detected = 0, false_suspicions = 0;
  double virtual_s = 0;
  Samples healed_ms;

  void add(std::uint64_t seed, const SimulationResult& result) {
    if (!result.violations.empty()) {
      failed.push_back(seed);
      if (failed.size() <= kMaxReported)
        std::printf("seed %llu: %s\n", static_cast<unsigned long long>(seed), result.violations.front().c_str());
    }
    for (std::size_t kind = 0; kind < kFaultKinds; ++kind) faults[kind] += result.fault_counts[kind];
    min_messages = std::min(min_messages, result.samples_sent);
    min_kinds = std::min(min_kinds, result.fault_kinds());
    messages += result.samples_sent;
    held += result.hrtcs.regions_held;
    refused += result.hrtcs.regions_refused;
    released += result.hrtcs.regions_released;
    pages_held += result.hrtcs.pages_held;
    pages_refused += result.hrtcs.pages_refused;
    pages_forgotten += result.hrtcs.pages_forgotten;
    host_changes += result.host_changes;
    failures_detected += result.hrtcs.failures_detected;
    false_suspicions += result.hrtcs.false_suspicions;
    virtual_s += static_cast<double>(result.virtual_ns) * 1e-9;
    healed_ms.add(result.recovery_ns ? static_cast<double>(*result.recovery_ns) * 1e-6 : kUnfinished);
  }
};

Report run(const Settings& settings) {
  const unsigned threads = settings.threads != 0 ? settings.threads : std::max(1u, std::thread::hardware_concurrency());
  Totals totals;
  totals.healed_ms.reserve(settings.schedules);
  std::mutex mutex;
  std::atomic<std::uint64_t> next{settings.first};
  const std::uint64_t end = settings.first + settings.schedules;
  (void)compressed_of(kFirstObject);  // builds the models once, before threads share it
  Stopwatch stopwatch;
  std::vector<std::thread> workers;
  for (unsigned i = 0; i < threads; ++i) {
    workers.emplace_back([&] {
      for (std::uint64_t seed; (seed = next++) < end;) {
        const SimulationResult result = simulate(seed, random_schedule(seed));
        const std::lock_guard lock{mutex};
        totals.add(seed, result);
      }
    });
  }
  for (std::thread& worker : workers) worker.join();
  const double seconds = stopwatch.lap() * 1e-6;

  char text[160];
  std::snprintf(text, sizeof text, "seeds %llu to %llu, %u threads; --seed N replays one",
                static_cast<unsigned long long>(settings.first), static_cast<unsigned long long>(end - 1), threads);
  Report report{{"2 hosts, 3 HRTCs, 2 clients in virtual time", 0, 0, text}};
  report.set_virtual_time(true);
  const auto count = [](auto value) { return static_cast<double>(value); };
  const Population schedules{"schedules", settings.schedules};
  report.add_percentiles("time from the last fault until the session has recovered", "schedules", "ms",
                         totals.healed_ms);
  report.add_value("schedules", schedules, "", count(settings.schedules));
  report.add_value("virtual time of all schedules", schedules, "s", totals.virtual_s);
  report.add_value("messages of all schedules", schedules, "", count(totals.messages));
  for (std::size_t kind = 0; kind < kFaultKinds; ++kind)
    report.add_value(std::string{"faults: "} + kFaultNames[kind], schedules, "", count(totals.faults[kind]));
  report.add_value("regions held", schedules, "", count(totals.held));
  report.add_value("regions released", schedules, "", count(totals.released));
  report.add_value("regions refused, which the host sends again", schedules, "", count(totals.refused));
  report.add_value("pages of directories held", schedules, "", count(totals.pages_held));
  report.add_value("pages of directories forgotten", schedules, "", count(totals.pages_forgotten));
  report.add_value("pages of directories refused, which the host sends again", schedules, "",
                   count(totals.pages_refused));
  report.add_value("changes of the host that serves an object to an HRTC", schedules, "", count(totals.host_changes));
  report.add_value("dead hosts suspected", schedules, "", count(totals.failures_detected));
  report.add_value("live hosts suspected", schedules, "", count(totals.false_suspicions));
  report.add_at_most("schedules with a broken condition", {"schedules", settings.schedules}, "",
                     count(totals.failed.size()), 0);
  report.add_at_least("min number of messages in a schedule", {"schedules", settings.schedules}, "",
                      count(totals.min_messages), 300);
  report.add_at_least("min number of kinds of fault in a schedule", {"schedules", settings.schedules}, "",
                      count(totals.min_kinds), 3);
  report.set_virtual_time(false);
  report.add_at_most("wall time for 10^5 schedules, extrapolated", {"schedules", settings.schedules}, "s",
                     seconds * 1e5 / count(settings.schedules), kMaxSeconds);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{
      "simulate", "Simulates a session of two hosts and three HRTCs with random faults, and checks it at each step",
      "2,000 schedules, for CI"};
  app.add_option("--schedules", settings.schedules, "number of schedules")->check(CLI::Range(1u, 100'000'000u));
  app.add_option("--first", settings.first, "seed of the first schedule")->check(CLI::PositiveNumber);
  app.add_option("--seed", settings.seed, "replays the schedule of this seed and prints a line for each message")
      ->check(CLI::PositiveNumber);
  app.add_option("--threads", settings.threads, "number of threads (default: one for each processor)")
      ->check(CLI::Range(1u, 256u));
  return tactus::bench::bench_main(app, argc, argv, [&] {
    if (app.quick) settings.schedules = 2000;
    return settings.seed != 0 ? tactus::bench::replay(settings.seed) : tactus::bench::run(settings);
  });
}
