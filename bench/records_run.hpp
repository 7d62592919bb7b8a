/// Delivers mesh records between two namespaces over an emulated link, with the delivery of the programs and no other
/// traffic.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>

#include "bench/figures.hpp"

namespace tactus::bench {

struct RecordsRun {
  Samples burst_ms;              ///< time from the request of a burst of regions to the arrival of the last of them
  double burst_kb = 0;           ///< mean size of a burst
  double mbyte_per_s = 0;        ///< payload of complete messages, MB/s
  double sent_per_received = 0;  ///< payload sent divided by payload of complete messages
};

/// Requests regions over `link` for `seconds`, in bursts of about `burst_bytes`; 0: without a pause. Before, runs for a
/// fifth of `seconds` without measuring, while the pacer adapts. Needs root. Throws LinkError and WireError.
[[nodiscard]] RecordsRun run_records(const std::string& link, double seconds, std::size_t burst_bytes,
                                     std::uint64_t seed, const std::atomic<bool>& stop);

}  // namespace tactus::bench
