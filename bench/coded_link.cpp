#include "bench/coded_link.hpp"

#include <algorithm>

#include "bench/latency_bench.hpp"

namespace tactus::bench {

LinkRun send_deadband_coded(const States& states, const std::vector<std::uint32_t>& sent, const std::string& link,
                            double load_mbit, std::uint64_t seed) {
  latency::TestCase cell;
  cell.link = link;
  cell.load_mbit = load_mbit;
  cell.seconds = static_cast<double>(states.size()) * 1e-3;
  latency::RunSettings settings = run_settings();
  settings.link_seed = seed;
  const latency::Timestamps stamps = latency::measure_locally(cell, settings, realtime::stop_signal(), sent);
  LinkRun run;
  std::vector<bool> has_arrived(states.size(), false);
  for (const latency::Arrival& arrival : stamps.arrivals) {
    if (arrival.sequence >= states.size()) continue;
    has_arrived[arrival.sequence] = true;
    const std::int64_t age_ns = arrival.received_ns - stamps.pings[arrival.sequence].intended_ns;
    run.age.add(static_cast<double>(age_ns) * 1e-6);
    run.arrivals.push_back({states[arrival.sequence].session_time_ns + age_ns, arrival.sequence});
  }
  std::sort(run.arrivals.begin(), run.arrivals.end(),
            [](const CodedArrival& a, const CodedArrival& b) { return a.at_ns < b.at_ns; });
  const auto lost_count =
      std::count_if(sent.begin(), sent.end(), [&](std::uint32_t index) { return !has_arrived[index]; });
  run.lost_percent = 100 * static_cast<double>(lost_count) / static_cast<double>(sent.size());
  run.mesh_mbyte_per_s = stamps.load_bytes_per_s * 1e-6;
  return run;
}

}  // namespace tactus::bench
