/// Coded probe states over a real link: the frames that tactus-latency sends, at the times of a recorded movement.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "bench/coded_run.hpp"
#include "bench/figures.hpp"

namespace tactus::bench {

struct LinkRun {
  std::vector<CodedArrival> arrivals;
  Samples age;            ///< ms, of states when they arrive
  double lost = 0;        ///< % of those sent
  double mesh_mbyte = 0;  ///< MB/s of mesh records that arrived beside
};

/// The states of `sent` between two namespaces joined by `link`, beside `load_mbit` of mesh records (latency::Cell).
/// Takes as long as the movement. Throws as latency::run_here.
[[nodiscard]] LinkRun send_deadband_coded(const States& states, const std::vector<std::uint32_t>& sent,
                                          const std::string& link, double load_mbit, std::uint64_t seed = 1);

}  // namespace tactus::bench
