// What a remote device's samples may do to the force, whatever becomes of them on their way: nothing unsafe.
#include <cstdio>

#include "bench/bench_main.hpp"
#include "bench/figures.hpp"
#include "bench/safety_run.hpp"
#include "session/figures.hpp"
#include "session/messages.hpp"

namespace tactus::bench {
namespace {

Report run(const SafetySettings& settings) {
  const SafetyResult result = run_safety(settings);
  for (const std::string& problem : result.problems) std::fprintf(stderr, "%s\n", problem.c_str());

  char text[96];
  std::snprintf(text, sizeof text, "seed %llu, at most %g N, %g N/s, %g m/s",
                static_cast<unsigned long long>(settings.seed), settings.force.max_force, settings.force.max_slew,
                settings.force.max_speed);
  Report report{{"none: a box", 0, 0, text}};
  report.virtual_time(true);
  const Population cycles{"cycles", result.cycles};
  const auto count = [&](const std::string& name, const char* of, auto value) {
    report.figure(name, of, "", static_cast<double>(value));
  };
  count("spoilt on the way", "samples", result.corrupted);
  count("late by up to 0.5 s", "samples", result.late);
  count("doubled", "samples", result.doubled);
  count("lost", "samples", result.lost);
  count("not decodable", "samples that arrived", result.undecodable);
  count("refused by the check", "samples that arrived", result.refused);
  count("of these handed on all the same", "samples that arrived", result.unchecked);
  count("overtaken", "samples that arrived", result.overtaken);
  count("taken", "samples that arrived", result.taken);
  count("cycles", "all", result.cycles);
  count("in contact", "cycles", result.contact_cycles);
  count("with a force", "cycles of ball and tool", result.force_cycles);
  count("with a torque", "cycles", result.torque_cycles);
  for (std::size_t bit = 0; bit < haptics::kForceBits; ++bit)
    count(session::figures::kInterventions[bit], "times begun", result.interventions[bit]);
  for (std::size_t fault = 1; fault < result.faults.size(); ++fault) {
    if (result.faults[fault] == 0) continue;
    const auto status = session::kFault | static_cast<std::uint32_t>(fault) << session::kFaultReasonShift;
    count(session::fault_reason(status), "faults latched", result.faults[fault]);
  }

  report.at_least("arrived", {"samples", result.arrived}, "", static_cast<double>(result.arrived),
                  static_cast<double>(settings.samples));
  report.at_least("share with a force", cycles, "%",
                  50 * static_cast<double>(result.force_cycles) / static_cast<double>(result.cycles), 5);
  report.at_most("greatest force", cycles, "N", result.largest_force, settings.force.max_force * (1 + 1e-9));
  report.at_most("greatest step of the force", {"cycles without a fault", result.cycles}, "N", result.largest_step,
                 settings.force.max_slew * 1e-3 * (1 + 1e-9));
  report.at_most("greatest torque", cycles, "N m", result.largest_torque, settings.force.max_torque * (1 + 1e-9));
  report.at_most("greatest step of the torque", {"cycles without a fault", result.cycles}, "N m",
                 result.largest_torque_step, settings.force.max_torque_slew * 1e-3 * (1 + 1e-9));
  report.at_most("oldest pose with a force", cycles, "ms of silence", result.oldest_force * 1e3,
                 settings.force.zero_by * 1e3);
  const auto none = [&](const char* what, std::uint64_t value) {
    report.at_most(what, cycles, "", static_cast<double>(value), 0);
  };
  none("over the limit", result.over_limit);
  none("over the slew limit", result.over_slew);
  none("not a number", result.not_finite);
  none("of an old pose", result.too_old);
  none("stronger than the soft start", result.too_soon);
  none("a force despite a fault", result.despite_fault);
  none("a fault without its reason", result.without_reason);
  none("a fault that ended by itself", result.ended_by_itself);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::SafetySettings settings;
  settings.samples = 100'000'000;
  tactus::bench::App app{"safety",
                         "Fuzzed, reordered and corrupted samples of a remote device, from their bytes to the force",
                         "10^6 samples, for CI"};
  app.add_option("--samples", settings.samples, "that arrive")->check(CLI::Range(1000.0, 1e12));
  app.add_option("--seed", settings.seed, "of everything");
  return tactus::bench::bench_main(app, argc, argv, [&] {
    if (app.quick) settings.samples = 1'000'000;
    return tactus::bench::run(settings);
  });
}
