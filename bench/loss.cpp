// Probe states and mesh records over a link that loses frames: how old is what a reader knows, how soon records are
// here.
#include <cstdio>

#include "bench/coded_rows.hpp"
#include "bench/figures.hpp"
#include "bench/latency_bench.hpp"
#include "bench/records_run.hpp"

namespace tactus::bench {
namespace {

struct Settings {
  double seconds = 20;
  std::uint64_t seed = 1;
};

struct Case {
  double loss_percent;
  double bound_ms;    ///< of the p99 of the age of what a reader knows
  double records_ms;  ///< in which 50 kB of records complete, p99
};
constexpr std::array kCases{Case{1, 1.5, 30}, Case{5, 2.5, 60}, Case{10, 3, 80}, Case{30, 5, 200}};

void add_records(Report& report, const Settings& settings, const std::atomic<bool>& stop) {
  for (const Case& c : kCases) {
    std::fprintf(stderr, "records, loss %g %%\n", c.loss_percent);
    const RecordsRun run =
        run_records("P0:loss=" + std::to_string(c.loss_percent), settings.seconds, 50'000, settings.seed, stop);
    char name[48];
    std::snprintf(name, sizeof name, "loss %g %%: ", c.loss_percent);
    report.row(std::string{name} + "records", "50 kB at once", "ms", run.burst_ms);
    report.figure(std::string{name} + "records at once", "mean", "kB", run.burst_kb);
    report.at_most(std::string{name} + "records, p99", {"50 kB at once", run.burst_ms.size()}, "ms",
                   run.burst_ms.percentile(0.99), c.records_ms);
    const std::string share = std::string{name} + "bytes sent for one that came";
    if (c.loss_percent <= 5)
      report.at_most(share, "records", "", run.sent_share, 1.3);
    else
      report.figure(share, "records", "", run.sent_share);
  }
  for (const char* loss : {"0", "1"}) {
    std::fprintf(stderr, "records, 10 ms, loss %s %%\n", loss);
    const RecordsRun run =
        run_records(std::string{"P0:delay=10:rate=100:loss="} + loss, settings.seconds, 0, settings.seed, stop);
    report.at_least(std::string{"10 ms one way, 100 Mbit/s, loss "} + loss + " %", "records", "MB/s", run.mbyte_per_s,
                    8);
  }
}

Report run(const Settings& settings) {
  const std::atomic<bool>& stop = wire::stop_signal();
  latency::RunSettings place = run_settings();
  place.link_seed = settings.seed;

  char text[128];
  std::snprintf(text, sizeof text, "link P0 with loss both ways, %g s each, seed %llu", settings.seconds,
                static_cast<unsigned long long>(settings.seed));
  Report report{{"probe states at 1 kHz, mesh records", 0, 0, text}};
  for (const Case& c : kCases) {
    std::fprintf(stderr, "loss %g %%\n", c.loss_percent);
    latency::Cell cell;
    cell.link = "P0:loss=" + std::to_string(c.loss_percent);
    cell.seconds = settings.seconds;
    const latency::Result result = latency::run_here(cell, place, stop);
    char name[48];
    std::snprintf(name, sizeof name, "loss %g %%: ", c.loss_percent);
    const double lost = 100 * static_cast<double>(result.lost) / static_cast<double>(result.expected);
    report.figure(std::string{name} + "lost", "probe states", "%", lost);
    report.figure(std::string{name} + "age at arrival p99", "probe states", "ms", result.age.p99 * 1e-3);
    report.figure(std::string{name} + "age known p50", "every 97 us", "ms", result.age_of_information.p50 * 1e-3);
    report.figure(std::string{name} + "age known p99.9", "every 97 us", "ms", result.age_of_information.p999 * 1e-3);
    report.figure(std::string{name} + "age known max", "every 97 us", "ms", result.age_of_information.max * 1e-3);
    report.at_most(std::string{name} + "age known p99", "every 97 us", "ms", result.age_of_information.p99 * 1e-3,
                   c.bound_ms);
    report.at_least(std::string{name} + "lost, or the link did not lose", "probe states", "%", lost,
                    0.7 * c.loss_percent);
  }
  for (const Case& c : kCases) add_coded_loss(report, c.loss_percent, settings.seconds, settings.seed);
  add_records(report, settings, stop);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{
      "loss", "Age of what a reader knows of a probe when the network loses 1 to 30 %; needs root for namespaces",
      "5 s each, for CI"};
  app.add_option("--seconds", settings.seconds, "of each run")->check(CLI::Range(5.0, 600.0));
  app.add_option("--seed", settings.seed, "of the losses");
  return tactus::bench::latency_main(app, argc, argv, [&] {
    if (app.quick) settings.seconds = 5;
    return tactus::bench::run(settings);
  });
}
