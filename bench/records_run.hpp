/// Mesh records between two namespaces: the delivery of the programs over a real link, without anything beside.
#pragma once

#include <atomic>
#include <cstdint>
#include <string>

#include "bench/figures.hpp"

namespace tactus::bench {

struct RecordsRun {
  Samples burst_ms;     ///< from wanting regions to holding the last of them
  double burst_kb = 0;  ///< mean size of these
  double mbyte_per_s = 0;
  double sent_share = 0;  ///< payload sent for each byte of messages that came whole
};

/// Regions of about `burst_bytes` together at a time, or with 0 as fast as they come, for `seconds` over `link`. The
/// pacer and what else learns have a fifth of that before. Throws LinkError and WireError; needs root.
[[nodiscard]] RecordsRun run_records(const std::string& link, double seconds, std::size_t burst_bytes,
                                     std::uint64_t seed, const std::atomic<bool>& stop);

}  // namespace tactus::bench
