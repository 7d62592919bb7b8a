/// A test on this machine: for each cell a link, an echoer in its own process, and the pinger here.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <string>

#include "latency/result.hpp"

namespace tactus::latency {

struct RunSettings {
  SideSettings side;
  std::string echoer =
      "tactus-latency";  ///< program of the echoer; with a path, or in the directory of the running program
  std::uint64_t link_seed = 1;
};

/// Needs no other machine. Cells with a link need root. Throws LatencyError, WireError and LinkError.
[[nodiscard]] Result run_here(const Cell& cell, const RunSettings& settings, const std::atomic<bool>& stop);

/// The same, but returns the timestamps only.
[[nodiscard]] Stamps stamp_here(const Cell& cell, const RunSettings& settings, const std::atomic<bool>& stop,
                                const Plan& plan);

/// Tests against a connected `tactus-latency serve`. The real network is then the link; the cell's link is only a
/// label.
[[nodiscard]] Result run_against(const Cell& cell, Channel& channel, const SideSettings& side,
                                 const std::atomic<bool>& stop);

}  // namespace tactus::latency
