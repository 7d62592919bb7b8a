/// Runs one latency test: on this machine, or with a server on another one.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <string>

#include "latency/result.hpp"

namespace tactus::latency {

struct RunSettings {
  SideSettings side;
  /// Program of the echoers. A name without a path is a file in the directory of the running program.
  std::string echoer = "tactus-latency";
  std::uint64_t link_seed = 1;
};

/// Runs the pinger in this process and the echoers in a process of their own. If the test names a link, emulates the
/// link between them, which needs root. Setting `cancelled` ends the test with LatencyError. Throws LatencyError,
/// WireError and LinkError.
[[nodiscard]] Result run_locally(const TestCase& test, const RunSettings& settings, const std::atomic<bool>& cancelled);

/// Runs the test as run_locally, but sends only the pings of `selection` and returns their timestamps.
[[nodiscard]] Timestamps measure_locally(const TestCase& test, const RunSettings& settings,
                                         const std::atomic<bool>& cancelled, const PingSelection& selection);

/// Runs the test with the process `tactus-latency serve` at the other end of `control`, over the real network between
/// the two machines. Emulates no link. Throws LatencyError and WireError.
[[nodiscard]] Result run_with_server(const TestCase& test, ControlConnection& control, const SideSettings& side,
                                     const std::atomic<bool>& cancelled);

}  // namespace tactus::latency
