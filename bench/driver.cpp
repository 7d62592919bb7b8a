// Measures what the process of a driver adds to the loop from a pose to a force, beside the same driver in the haptic
// thread.
#include <sys/resource.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <map>

#include "bench/bench_main.hpp"
#include "bench/figures.hpp"
#include "bench/priority.hpp"
#include "haptics/plugin_device.hpp"
#include "hrtc_service/device/driver_process.hpp"
#include "realtime/process.hpp"
#include "realtime/realtime.hpp"

namespace tactus::bench {
namespace {

constexpr std::int64_t kPeriodNs = 1'000'000;

struct Settings {
  double seconds = 60;
  int silences = 100;
};

struct Figures {
  Samples pose_age_us;        // at the start of a cycle
  Samples force_late_us;      // from the write in the haptic thread to that of the driver
  Samples round_trip_us;      // the sum of both, of the same cycle
  Samples call_us;            // of the write in the haptic thread
  std::uint64_t unknown = 0;  // forces that the driver got after the one of the next cycle, or never
};

/// A force that the driver has not shown yet.
struct Command {
  std::int64_t written_ns;  // in the haptic thread
  double pose_age_us;       // of the pose in the same cycle
};

/// Returns the number of the cycle, or -1 if the driver's process has reduced the force, as after a timeout.
std::int64_t number_of(double force) { return force == std::floor(force) ? static_cast<std::int64_t>(force) : -1; }

/// Runs cycles at 1 kHz. The force along y is the number of the cycle, so that a pose shows the command that it follows.
Figures run_cycles(haptics::Device& device, double seconds) {
  Figures figures;
  std::map<std::int64_t, Command> commands;  // by cycle
  constexpr std::int64_t kFirst = 200;       // before it, the forces grow from zero
  const std::int64_t begin_ns = realtime::monotonic_ns() + kPeriodNs;
  const auto cycles = static_cast<std::int64_t>(seconds * 1000);
  for (std::int64_t cycle = 1; cycle < kFirst + cycles; ++cycle) {
    realtime::sleep_until(begin_ns + cycle * kPeriodNs);
    const std::int64_t now_ns = realtime::monotonic_ns();
    const haptics::DeviceState state = device.read(now_ns);
    if (cycle < kFirst) {
      device.write({0, 1, 0});
      continue;
    }
    const double age_us = static_cast<double>(now_ns - state.time_ns) * 1e-3;
    figures.pose_age_us.add(age_us);
    if (const auto command = commands.find(number_of(state.position.y())); command != commands.end()) {
      const double late_us = state.position.x() * 1e6 - static_cast<double>(command->second.written_ns) * 1e-3;
      figures.force_late_us.add(late_us);
      figures.round_trip_us.add(command->second.pose_age_us + late_us);
      commands.erase(command);
    }
    const std::int64_t write_ns = realtime::monotonic_ns();
    device.write({0, static_cast<double>(cycle), 0});
    figures.call_us.add(static_cast<double>(realtime::monotonic_ns() - write_ns) * 1e-3);
    commands[cycle] = {write_ns, age_us};
  }
  figures.unknown = commands.size();
  return figures;
}

/// Commands a force, and then nothing for 50 ms. Returns the time from that write to zero force, ms.
double silence_ms(haptics::Device& device) {
  for (int i = 0; i < 20; ++i) {
    realtime::sleep_until(realtime::monotonic_ns() + kPeriodNs);
    (void)device.read(realtime::monotonic_ns());
    device.write({0, 1, 0});
  }
  const std::int64_t last_ns = realtime::monotonic_ns();
  realtime::sleep_until(last_ns + 50 * kPeriodNs);
  const double zero_ms = device.read(realtime::monotonic_ns()).position.z() * 1e3 - static_cast<double>(last_ns) * 1e-6;
  return zero_ms > 0 ? zero_ms : kUnfinished;
}

/// Returns the processor time of ended child processes, s.
double children_seconds() {
  rusage used{};
  getrusage(RUSAGE_CHILDREN, &used);
  const auto seconds = [](const timeval& time) {
    return static_cast<double>(time.tv_sec) + static_cast<double>(time.tv_usec) * 1e-6;
  };
  return seconds(used.ru_utime) + seconds(used.ru_stime);
}

Report run(const Settings& settings) {
  const Priority priority;
  char text[120];
  std::snprintf(text, sizeof text, "%g s at 1 kHz, %d silences; %s", settings.seconds, settings.silences,
                priority.text());
  Report report{{"a driver without a device", 0, 0, text}};
  const auto add = [&](const std::string& where, const Figures& figures,
                       std::initializer_list<PercentileBound> bounds) {
    report.add_percentiles("age of a pose, " + where, "cycles", "us", figures.pose_age_us);
    report.add_percentiles("delay of a force, " + where, "forces", "us", figures.force_late_us);
    report.add_percentiles("round trip, " + where, "forces", "us", figures.round_trip_us, bounds);
    report.add_percentiles("time of a write, " + where, "cycles", "us", figures.call_us);
  };
  {
    haptics::PluginDevice device{TACTUS_TIMED_DRIVER, ""};
    add("haptic thread", run_cycles(device, settings.seconds), {});
  }
  Samples silences;
  const double before = children_seconds();
  Figures apart;
  {
    hrtc_service::DriverSettings driver;
    driver.library = TACTUS_TIMED_DRIVER;
    driver.period_ns = kPeriodNs;
    hrtc_service::DriverProcess device{driver,
                                       [](const std::string& end) { std::fprintf(stderr, "%s\n", end.c_str()); }};
    apart = run_cycles(device, settings.seconds);
    for (int i = 0; i < settings.silences; ++i) silences.add(silence_ms(device));
  }
  const double used = children_seconds() - before;
  // The stiffness is lowered for this round trip.
  add("own process", apart, {{0.5, 1e-3 * (hrtc_service::kReadAheadNs + hrtc_service::kPollNs)}});
  report.add_value("forces without a pose that follows them", {"cycles", apart.pose_age_us.size()}, "forces",
                   static_cast<double>(apart.unknown));
  report.add_value("processor time of the process", {"cycles", apart.pose_age_us.size()}, "us per cycle",
                   used / settings.seconds * 1e3);
  report.add_percentiles("time from the last command to zero force", "silences", "ms", silences, {{1, 11}});
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{"driver", "Measures the delays that the process of a driver adds",
                         "5 s and 20 silences, for CI"};
  app.add_option("--seconds", settings.seconds, "time of the cycles")->check(tactus::wire::finite_range(0.1, 3600.0));
  return tactus::bench::bench_main(app, argc, argv, [&] {
    if (app.quick) settings.seconds = 5, settings.silences = 20;
    return tactus::bench::run(settings);
  });
}
