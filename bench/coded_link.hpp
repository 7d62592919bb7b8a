/// Sends deadband-coded probe states over a link between two namespaces, as pings of tactus-latency.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "bench/coded_run.hpp"
#include "bench/figures.hpp"

namespace tactus::bench {

struct LinkRun {
  std::vector<CodedArrival> arrivals;
  Samples age;                  ///< ms, age of each arrived state at its arrival
  double lost_percent = 0;      ///< of the states sent
  double mesh_mbyte_per_s = 0;  ///< MB/s, mesh records that arrived in the same run
};

/// Sends the states with the indices `sent` over `link`, each at its session time, while mesh records load the link
/// with `load_mbit` (latency::TestCase). Takes as long as the movement. Throws as latency::measure_locally does.
[[nodiscard]] LinkRun send_deadband_coded(const States& states, const std::vector<std::uint32_t>& sent,
                                          const std::string& link, double load_mbit, std::uint64_t seed = 1);

}  // namespace tactus::bench
