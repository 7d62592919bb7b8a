// Deadband coding of probe states: how many packets it saves and what of the force it costs, by size of the deadband
// and kind of movement; and the same over a link.
//
// Hands move over a model in virtual time, with tremor; the coder of session/ picks the states to send. The table sends
// them over a perfect line. The bounds are judged where real frames carried them, between two namespaces.
#include <cstdio>

#include "bench/coded_link.hpp"
#include "bench/coded_run.hpp"
#include "bench/figures.hpp"
#include "bench/latency_bench.hpp"
#include "bench/models.hpp"
#include "bench/movement.hpp"

namespace tactus::bench {
namespace {

constexpr double kShares[] = {0.02, 0.05, 0.1, 0.15, 0.2, 0.3};
constexpr double kForceJnd = 0.1;

struct Settings {
  std::string model, link = "P0";
  std::uint32_t faces = 200'000;
  double length = 0.2;  // m
  double seconds = 60, link_seconds = 20;
  std::uint32_t seed = 1;
};

session::CodingSettings coding(double share) {
  session::CodingSettings settings;
  settings.jnd.force_floor *= share / settings.jnd.force_share;
  settings.jnd.force_share = share;
  return settings;
}

double saved(const std::vector<std::uint32_t>& sent, const States& states) {
  return 100 - 100 * static_cast<double>(sent.size()) / static_cast<double>(states.size());
}

void add_table(Report& report, const Movement& movement, const States& states) {
  for (const double share : kShares) {
    const std::vector<std::uint32_t> sent = encode(states, coding(share));
    const Fidelity received = play(states, sent, on_time(states, sent), {});
    char name[64];
    std::snprintf(name, sizeof name, "%s, deadband %g %%: ", movement.name, 100 * share);
    const std::string at = name;
    report.figure(at + "packets", "table", "1/s",
                  1e3 * static_cast<double>(sent.size()) / static_cast<double>(states.size()));
    report.figure(at + "force error rms", "all ms", "N", received.rms_force);
    report.figure(at + "force error rms", "all ms", "JND", received.rms_jnd);
    report.figure(at + "force error p99", {"all ms", received.jnd.size()}, "JND", received.jnd.percentile(0.99));
    report.figure(at + "position error p99", {"all ms", received.position.size()}, "mm",
                  1e3 * received.position.percentile(0.99));
  }
}

Report run(const Settings& settings) {
  const LoadedModel subject = load_model(settings.model, settings.faces);
  const double scale = settings.length / (longest_side(subject.model.summary) / subject.model.summary.metres_per_unit);
  char text[160];
  std::snprintf(text, sizeof text, "%.2f m long, 3 mm tip, tremor 0.1 mm, %g s of each movement, seed %u; link %s",
                settings.length, settings.seconds, settings.seed, settings.link.c_str());
  Report report{{subject.name, subject.model.summary.digest, subject.model.summary.faces, text}};
  double saved_all = 0;
  struct Row {
    std::string name;
    double saved;
    Fidelity received;
  };
  std::vector<Row> rows;
  for (const Movement& movement : movements()) {
    std::fprintf(stderr, "%s\n", movement.name);
    const States states = record(subject.model, scale, movement, settings.seconds, settings.seed);
    add_table(report, movement, states);
    States part{states.begin(), states.begin() + static_cast<std::ptrdiff_t>(settings.link_seconds * 1e3)};
    const std::vector<std::uint32_t> sent = encode(part, coding(kForceJnd));
    const LinkRun link = send_deadband_coded(part, sent, settings.link, 0);
    rows.push_back({movement.name, saved(encode(states, coding(kForceJnd)), states),
                    play(part, sent, link.arrivals, session::PlayoutSettings{})});
    saved_all += rows.back().saved / static_cast<double>(movements().size());
  }
  for (const Row& row : rows) {
    report.figure(row.name + ": packets saved", "deadband 10 %", "%", row.saved);
    report.row(row.name + ": force error", "over the link, all ms", "JND", row.received.jnd);
    report.row(row.name + ": shown late by", "over the link, all ms", "ms", row.received.delay);
  }
  report.note(
      "JND: |force error| / max(10 % of the force, 0.05 N). Deadbands: that share of the force, half a newton of "
      "it at least.");
  report.at_least("packets saved", "mean of the movements", "%", saved_all, 90);
  for (const Row& row : rows) {
    report.at_most(row.name + ": force error rms", "over the link", "JND", row.received.rms_jnd, 1);
    report.at_most(row.name + ": force error p99", {"over the link", row.received.jnd.size()}, "JND",
                   row.received.jnd.percentile(0.99), 1);
  }
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{
      "bandwidth", "Packets and force error of coded probe states, by deadband and movement; needs root for namespaces",
      "10 s of each, 5 s of it over the link, for CI"};
  app.add_option("--model", settings.model, "model file of any kind, or .spm (default: a generated organ)")
      ->check(CLI::ExistingFile);
  app.add_option("--faces", settings.faces, "faces of the generated organ")->check(CLI::Range(1000u, 30000000u));
  app.add_option("--length", settings.length, "of the model's longest side, m")->check(CLI::Range(0.05, 2.0));
  app.add_option("--seconds", settings.seconds, "of each movement")->check(CLI::Range(5.0, 3600.0));
  app.add_option("--link", settings.link, "between the namespaces, as in `tactus-link list`");
  app.add_option("--seed", settings.seed, "of tremor and noise");
  return tactus::bench::latency_main(app, argc, argv, [&] {
    if (app.quick) settings.seconds = 10, settings.link_seconds = 5;
    settings.link_seconds = std::min(settings.link_seconds, settings.seconds);
    return tactus::bench::run(settings);
  });
}
