/// Delivers mesh records between two namespaces over an emulated link, by the protocol between host and HRTC. The link
/// carries no other traffic.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>

#include "bench/figures.hpp"

namespace tactus::bench {

struct RecordsRun {
  Samples burst_ms;              ///< time from the request of a burst of regions to the arrival of the last of them
  double longest_gap_ms = 0;     ///< longest time of the measurement in which no burst became complete
  double burst_kb = 0;           ///< mean size of a burst
  double mbyte_per_s = 0;        ///< payload of complete messages received per second, MB/s
  double sent_per_received = 0;  ///< payload sent divided by payload of complete messages received
  double fragments = 0;          ///< IP fragments that both sides have received; each waits in the kernel for others
};

/// Requests regions over `link` (netem::parse_link) for `seconds`. Requests them in bursts of about `burst_bytes`, or
/// continuously if `burst_bytes` is 0. A fifth of `seconds` after the first records precedes the measurement; in it the
/// pacer adapts to the link. `seed`: of the emulated link. Ends early if `stop` becomes true. Needs root. Throws
/// LinkError, also if no records arrive within 30 s, and WireError.
[[nodiscard]] RecordsRun run_records(const std::string& link, double seconds, std::size_t burst_bytes,
                                     std::uint64_t seed, const std::atomic<bool>& stop);

}  // namespace tactus::bench
