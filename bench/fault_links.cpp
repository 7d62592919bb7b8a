#include "bench/coded_rows.hpp"
#include "bench/fault_runs.hpp"
#include "bench/records_run.hpp"
#include "realtime/process.hpp"

namespace tactus::bench {

void measure_narrow_link(const FaultSettings& settings, Report& report) {
  // At 1 kHz, states alone would fill this link, so HRTCs send them deadband-coded.
  add_coded_isolation(report, 2, settings.seconds / 3, 20);
}

void measure_loss_of_fragments(const FaultSettings& settings, Report& report) {
  for (const char* percent : {"5", "1"}) {
    const RecordsRun run = run_records(std::string{"P0:loss="} + percent, settings.seconds / 2, 50'000, settings.seed,
                                       realtime::stop_signal());
    // The measurement takes the whole time, without the warm-up before it.
    report.add_at_least(std::string{"bursts of 50 kB of records, loss "} + percent + " %", {"run", 1}, "1/s",
                        static_cast<double>(run.burst_ms.size()) / (settings.seconds / 2), 5);
    report.add_at_most(std::string{"longest time without a complete burst, loss "} + percent + " %", {"run", 1}, "ms",
                       run.longest_gap_ms, 500);
    // Without fragments, the kernel uses no memory to reassemble datagrams, so a loss cannot fill this memory.
    report.add_at_most(std::string{"IP fragments received, loss "} + percent + " %", {"run", 1}, "", run.fragments, 0);
  }
}

}  // namespace tactus::bench
