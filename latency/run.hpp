/// A whole test on this machine: for each cell a link, an echoer in a process of its own, and the pinger here.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <string>

#include "latency/result.hpp"

namespace tactus::latency {

struct RunSettings {
  Place place;
  std::string echoer =
      "tactus-latency";  ///< the program to start as echoer; with a path, or beside the running program
  std::uint64_t link_seed = 1;
};

/// Self-contained: nothing but this machine. Cells with a link need root. Throws LatencyError, WireError and LinkError.
[[nodiscard]] Result run_here(const Cell& cell, const RunSettings& settings, const std::atomic<bool>& stop);

/// The same, and only what was stamped.
[[nodiscard]] Stamps stamp_here(const Cell& cell, const RunSettings& settings, const std::atomic<bool>& stop,
                                const Plan& plan);

/// With a `tactus-latency serve` that is connected to. Participants are then the network itself: the cell's is a name
/// for it.
[[nodiscard]] Result run_against(const Cell& cell, Channel& channel, const Place& place, const std::atomic<bool>& stop);

}  // namespace tactus::latency
