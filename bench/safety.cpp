// Checks that no force exceeds its limits, whatever the samples of a remote device contain and whenever they arrive.
#include <cstdio>
#include <numeric>

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
  report.set_virtual_time(true);
  const Population cycles{"cycles", result.cycles};
  const Population samples{"samples sent", result.sent};
  const Population arrived{"samples that arrived", result.arrived};
  const Population of_both{"cycles of sphere and tool", 2 * result.cycles};
  const auto count = [&](const std::string& name, const Population& of, auto value) {
    report.add_value(name, of, "", static_cast<double>(value));
  };
  count("corrupted samples", samples, result.corrupted);
  count("samples delayed by up to 0.5 s", samples, result.late);
  count("repeated samples", samples, result.repeated);
  count("lost samples", samples, result.lost);
  count("undecodable samples", arrived, result.undecodable);
  count("samples refused by the check", arrived, result.refused);
  count("refused samples that were handed on", arrived, result.unchecked);
  count("overtaken samples", arrived, result.overtaken);
  count("accepted samples", arrived, result.accepted);
  count("cycles", cycles, result.cycles);
  count("contact cycles", cycles, result.contact_cycles);
  count("cycles with a force", of_both, result.force_cycles);
  count("cycles with a torque", of_both, result.torque_cycles);
  const Population begun{"interventions begun",
                         std::accumulate(result.interventions.begin(), result.interventions.end(), std::uint64_t{0})};
  const Population latched{"latched faults",
                           std::accumulate(result.faults.begin(), result.faults.end(), std::uint64_t{0})};
  for (std::size_t bit = 0; bit < haptics::kForceBits; ++bit)
    count(session::figures::kInterventions[bit], begun, result.interventions[bit]);
  for (std::size_t fault = 1; fault < result.faults.size(); ++fault) {
    if (result.faults[fault] == 0) continue;
    const auto status = session::kFault | static_cast<std::uint32_t>(fault) << session::kFaultReasonShift;
    count(session::fault_reason(status), latched, result.faults[fault]);
  }

  report.add_at_least("samples that arrived", arrived, "", static_cast<double>(result.arrived),
                      static_cast<double>(settings.samples));
  report.add_at_least("cycles with a force divided by cycles, mean of sphere and tool", cycles, "%",
                      50 * static_cast<double>(result.force_cycles) / static_cast<double>(result.cycles), 5);
  report.add_at_most("max force", cycles, "N", result.max_force, settings.force.max_force * (1 + 1e-9));
  report.add_at_most("max change of the force in a cycle without a fault", cycles, "N", result.max_force_step,
                     settings.force.max_slew * 1e-3 * (1 + 1e-9));
  report.add_at_most("max torque", cycles, "N m", result.max_torque, settings.force.max_torque * (1 + 1e-9));
  report.add_at_most("max change of the torque in a cycle without a fault", cycles, "N m", result.max_torque_step,
                     settings.force.max_torque_slew * 1e-3 * (1 + 1e-9));
  report.add_at_most("max time without a sample at which a force acts", cycles, "ms", result.max_silence * 1e3,
                     settings.force.zero_force_age * 1e3);
  const auto add_none = [&](const char* violation, std::uint64_t value) {
    report.add_at_most(violation, cycles, "", static_cast<double>(value), 0);
  };
  add_none("forces and torques over their limit", result.over_limit);
  add_none("forces and torques over their slew limit", result.over_slew);
  add_none("forces and torques that are not finite", result.not_finite);
  add_none("forces and torques that act on a pose that is too old", result.too_old);
  add_none("forces and torques over the soft start", result.too_soon);
  add_none("forces and torques despite a fault", result.despite_fault);
  add_none("cycles with a fault without a reason", result.without_reason);
  add_none("faults that ended without a reset", result.ended_by_itself);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::SafetySettings settings;
  settings.samples = 100'000'000;
  tactus::bench::App app{"safety",
                         "Checks the forces for a remote device whose samples are lost, late, repeated or corrupted",
                         "uses 10^6 samples, for CI"};
  app.add_option("--samples", settings.samples, "number of samples that arrive")
      ->check(tactus::wire::finite_range(1000.0, 1e12));
  app.add_option("--seed", settings.seed, "seed of all random numbers");
  return tactus::bench::bench_main(app, argc, argv, [&] {
    if (app.quick) settings.samples = 1'000'000;
    return tactus::bench::run(settings);
  });
}
