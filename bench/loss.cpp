// Measures the age of the newest probe state that a reader has, and the delivery time of mesh records, over a link that
// loses frames.
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

struct LossCase {
  double loss_percent;
  double bound_ms;          ///< of the p99 of the age of information
  double records_bound_ms;  ///< of the p99 of the delivery time of 50 kB of records
};
constexpr std::array kCases{LossCase{1, 1.5, 30}, LossCase{5, 2.5, 60}, LossCase{10, 3, 80}, LossCase{30, 5, 200}};

void add_records(Report& report, const Settings& settings, const std::atomic<bool>& stop) {
  for (const LossCase& loss : kCases) {
    std::fprintf(stderr, "records, loss %g %%\n", loss.loss_percent);
    const RecordsRun run =
        run_records("P0:loss=" + std::to_string(loss.loss_percent), settings.seconds, 50'000, settings.seed, stop);
    char name[48];
    std::snprintf(name, sizeof name, "loss %g %%: ", loss.loss_percent);
    report.add_percentiles(std::string{name} + "delivery of 50 kB of records", "bursts", "ms", run.burst_ms);
    report.add_value(std::string{name} + "records in a burst, mean", {"bursts", run.burst_ms.size()}, "kB",
                     run.burst_kb);
    report.add_at_most(std::string{name} + "delivery of 50 kB of records, p99", {"bursts", run.burst_ms.size()}, "ms",
                       run.burst_ms.percentile(0.99), loss.records_bound_ms);
    // A burst that does not arrive has no delivery time, and ends the sequence of bursts.
    report.add_at_most(std::string{name} + "longest time without a complete burst", {"run", 1}, "ms",
                       run.longest_gap_ms, 500);
    const std::string share = std::string{name} + "bytes sent for each byte delivered";
    if (loss.loss_percent <= 5)
      report.add_at_most(share, {"run", 1}, "", run.sent_per_received, 1.3);
    else
      report.add_value(share, {"run", 1}, "", run.sent_per_received);
  }
  for (const char* percent : {"0", "1"}) {
    std::fprintf(stderr, "records, 10 ms, loss %s %%\n", percent);
    const RecordsRun run =
        run_records(std::string{"P0:delay=10:rate=100:loss="} + percent, settings.seconds, 0, settings.seed, stop);
    report.add_at_least(std::string{"rate of records, 10 ms, 100 Mbit/s, loss "} + percent + " %", {"run", 1}, "MB/s",
                        run.mbyte_per_s, 8);
  }
}

Report run(const Settings& settings) {
  const std::atomic<bool>& stop = realtime::stop_signal();
  latency::RunSettings run_options = run_settings();
  run_options.link_seed = settings.seed;

  char text[128];
  std::snprintf(text, sizeof text, "link P0 with loss both ways, %g s for each run, seed %llu", settings.seconds,
                static_cast<unsigned long long>(settings.seed));
  Report report{{"probe states at 1 kHz, mesh records", 0, 0, text}};
  for (const LossCase& loss : kCases) {
    std::fprintf(stderr, "loss %g %%\n", loss.loss_percent);
    latency::TestCase cell;
    cell.link = "P0:loss=" + std::to_string(loss.loss_percent);
    cell.seconds = settings.seconds;
    const latency::Result result = latency::run_locally(cell, run_options, stop);
    char name[48];
    std::snprintf(name, sizeof name, "loss %g %%: ", loss.loss_percent);
    const double lost = 100 * static_cast<double>(result.lost) / static_cast<double>(result.expected);
    const Population sent{"probe states", result.expected};
    const Population instants{"instants, every 97 us", result.age_of_information.count};
    // In runs of 5 s, a correct link exceeds this by chance in less than one of 10^6 runs.
    report.add_at_most(std::string{name} + "lost", sent, "%", lost, 1.3 * loss.loss_percent + 0.5);
    report.add_value(std::string{name} + "age at arrival p99", {"probe states received", result.age.count}, "ms",
                     result.age.p99 * 1e-3);
    report.add_value(std::string{name} + "age of information p50", instants, "ms",
                     result.age_of_information.p50 * 1e-3);
    report.add_value(std::string{name} + "age of information p99.9", instants, "ms",
                     result.age_of_information.p999 * 1e-3);
    report.add_value(std::string{name} + "age of information max", instants, "ms",
                     result.age_of_information.max * 1e-3);
    report.add_at_most(std::string{name} + "age of information p99", instants, "ms",
                       result.age_of_information.p99 * 1e-3, loss.bound_ms);
    report.add_at_least(std::string{name} + "lost (check of the link)", sent, "%", lost, 0.7 * loss.loss_percent);
  }
  for (const LossCase& loss : kCases) add_coded_loss(report, loss.loss_percent, settings.seconds, settings.seed);
  add_records(report, settings, stop);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{
      "loss", "Age of the newest probe state of a reader when the network loses 1 to 30 % of the frames; needs root",
      "runs of 5 s, for CI"};
  app.add_option("--seconds", settings.seconds, "duration of each run, s")
      ->check(tactus::wire::finite_range(5.0, 600.0));
  app.add_option("--seed", settings.seed, "seed of the losses");
  return tactus::bench::latency_main(app, argc, argv, [&] {
    if (app.quick) settings.seconds = 5;
    return tactus::bench::run(settings);
  });
}
