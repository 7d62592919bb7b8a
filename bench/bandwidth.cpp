// Measures how many packets deadband coding of probe states saves, and the force error that it causes, by deadband and
// movement.
//
// Simulated hands with tremor move over a model in virtual time. The table is computed without delay and loss. The
// bounds on the force error are for states that a link between two network namespaces carries.
#include <cstdio>

#include "bench/coded_link.hpp"
#include "bench/coded_run.hpp"
#include "bench/figures.hpp"
#include "bench/latency_bench.hpp"
#include "bench/models.hpp"
#include "bench/movement.hpp"

namespace tactus::bench {
namespace {

constexpr double kDeadbands[] = {0.02, 0.05, 0.1, 0.15, 0.2, 0.3};
constexpr double kForceJnd = 0.1;  // deadband of the bounds

struct Settings {
  std::string model, link = "P0";
  std::uint32_t faces = 200'000;
  double length = 0.2;  // m, longest side of the model
  double seconds = 60, link_seconds = 20;
  std::uint32_t seed = 1;
};

/// Settings for a deadband of `share` of the force.
session::CodingSettings coding(double share) {
  session::CodingSettings settings;
  settings.jnd.force_floor *= share / settings.jnd.force_share;
  settings.jnd.force_share = share;
  return settings;
}

double percent_saved(const std::vector<std::uint32_t>& sent, const States& states) {
  return 100 - 100 * static_cast<double>(sent.size()) / static_cast<double>(states.size());
}

void add_table(Report& report, const Movement& movement, const States& states) {
  for (const double share : kDeadbands) {
    const std::vector<std::uint32_t> sent = encode(states, coding(share));
    const Fidelity received = play(states, sent, arrivals_without_delay(states, sent), {});
    char name[64];
    std::snprintf(name, sizeof name, "%s, deadband %g %%: ", movement.name, 100 * share);
    const std::string prefix = name;
    report.add_value(prefix + "packets sent", {"states, one each ms", states.size()}, "1/s",
                     1e3 * static_cast<double>(sent.size()) / static_cast<double>(states.size()));
    report.add_value(prefix + "force error rms", {"views, one each ms", received.jnd.size()}, "N", received.rms_force);
    report.add_value(prefix + "force error rms", {"views, one each ms", received.jnd.size()}, "JND", received.rms_jnd);
    report.add_value(prefix + "force error p99", {"views, one each ms", received.jnd.size()}, "JND",
                     received.jnd.percentile(0.99));
    report.add_value(prefix + "position error p99", {"views, one each ms", received.position.size()}, "mm",
                     1e3 * received.position.percentile(0.99));
  }
}

Report run(const Settings& settings) {
  const LoadedModel subject = load_model(settings.model, settings.faces);
  const double scale = settings.length / (model_length(subject.model.summary) / subject.model.summary.metres_per_unit);
  char text[160];
  std::snprintf(text, sizeof text, "%.2f m long, 3 mm tip, tremor 0.1 mm, %g s of each movement, seed %u; link %s",
                settings.length, settings.seconds, settings.seed, settings.link.c_str());
  Report report{{subject.name, subject.model.summary.digest, subject.model.summary.faces, text}};
  report.set_virtual_time(true);  // of the rows without the link
  double mean_percent_saved = 0;
  struct MovementResult {
    std::string name;
    std::size_t states;
    double percent_saved;
    Fidelity received;
  };
  std::vector<MovementResult> rows;
  for (const Movement& movement : movements()) {
    std::fprintf(stderr, "%s\n", movement.name);
    const States states = simulate(subject.model, scale, movement, settings.seconds, settings.seed);
    add_table(report, movement, states);
    States link_states{states.begin(), states.begin() + static_cast<std::ptrdiff_t>(settings.link_seconds * 1e3)};
    const std::vector<std::uint32_t> sent = encode(link_states, coding(kForceJnd));
    const LinkRun link = send_deadband_coded(link_states, sent, settings.link, 0);
    rows.push_back({movement.name, states.size(), percent_saved(encode(states, coding(kForceJnd)), states),
                    play(link_states, sent, link.arrivals, session::PlayoutSettings{})});
    mean_percent_saved += rows.back().percent_saved / static_cast<double>(movements().size());
  }
  for (const MovementResult& row : rows)
    report.add_value(row.name + ": packets saved, deadband 10 %", {"states, one each ms", row.states}, "%",
                     row.percent_saved);
  report.add_at_least("packets saved, mean", {"movements", movements().size()}, "%", mean_percent_saved, 90);
  report.set_virtual_time(false);
  for (const MovementResult& row : rows) {
    report.add_percentiles(row.name + ": force error over the link", "views, one each ms", "JND", row.received.jnd);
    report.add_percentiles(row.name + ": playout delay over the link", "views, one each ms", "ms", row.received.delay);
  }
  report.add_note("JND: |force error| / max(10 % of the force, 0.05 N).");
  report.add_note("Deadband 20 %: max(20 % of the force, 0.1 N). Both limits of other deadbands are in proportion.");
  for (const MovementResult& row : rows) {
    report.add_at_most(row.name + ": force error rms, over the link", {"views, one each ms", row.received.jnd.size()},
                       "JND", row.received.rms_jnd, 1);
    report.add_at_most(row.name + ": force error p99, over the link", {"views, one each ms", row.received.jnd.size()},
                       "JND", row.received.jnd.percentile(0.99), 1);
  }
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{"bandwidth",
                         "Packets and force error of deadband-coded probe states, by deadband and movement; needs root",
                         "10 s of each movement, 5 s of that over the link, for CI"};
  app.add_option("--model", settings.model, "mesh file of any format, or .spm model (default: a generated organ)")
      ->check(CLI::ExistingFile);
  app.add_option("--faces", settings.faces, "faces of the generated organ")->check(CLI::Range(1000u, 30000000u));
  app.add_option("--length", settings.length, "length of the model's longest side, m")
      ->check(tactus::wire::finite_range(0.05, 2.0));
  app.add_option("--seconds", settings.seconds, "duration of each movement, s")
      ->check(tactus::wire::finite_range(5.0, 3600.0));
  app.add_option("--link", settings.link, "link between the namespaces, as in `tactus-link list`");
  app.add_option("--seed", settings.seed, "seed of the tremor");
  return tactus::bench::latency_main(app, argc, argv, [&] {
    if (app.quick) settings.seconds = 10, settings.link_seconds = 5;
    settings.link_seconds = std::min(settings.link_seconds, settings.seconds);
    return tactus::bench::run(settings);
  });
}
