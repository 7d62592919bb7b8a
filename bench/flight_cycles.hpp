/// The cycles of an HRTC with two users, from a flight recording, and figures of some of them.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <string>
#include <variant>
#include <vector>

#include "bench/figures.hpp"
#include "trace/flight_file.hpp"

namespace tactus::bench {

/// Some cycles of the recording: those that start in this time, monotonic ns. The interval before the first of them
/// belongs to the window too, because it contains the start of the window.
struct Window {
  std::int64_t begin_ns, end_ns;
};

struct Cycles {
  std::vector<std::int64_t> times_ns;
  std::vector<std::array<double, 2>> forces;  // N, of the two users
};
/// Throws trace::FlightError.
inline Cycles read_cycles(const std::string& file) {
  struct Cycle {
    std::int64_t time_ns = 0;
    std::array<double, 2> forces{};
  };
  std::map<std::uint64_t, Cycle> by_number;
  trace::FlightFileReader reader{file};
  for (trace::FlightMessage message; reader.next(message);) {
    if (const auto* touch = std::get_if<trace::FlightTouch>(&message)) by_number[touch->cycle].time_ns = touch->time_ns;
    const auto* probe = std::get_if<trace::FlightProbe>(&message);
    if (probe != nullptr && probe->probe < 2)
      by_number[probe->cycle].forces[probe->probe] = std::hypot(probe->force[0], probe->force[1], probe->force[2]);
  }
  Cycles cycles;
  for (const auto& [number, cycle] : by_number) {
    cycles.times_ns.push_back(cycle.time_ns);
    cycles.forces.push_back(cycle.forces);
  }
  return cycles;
}

/// Figures of all cycles of some windows.
struct CycleFigures {
  Samples intervals_ms;      // between two cycles
  std::uint64_t late = 0;    // intervals above 1.5 periods of 1 ms
  double force_change = 0;   // N, largest difference to the force in the last cycle before a window
  double min_force = 1e300;  // N

  void add(const Cycles& cycles, const Window& window) {
    const auto begin = std::lower_bound(cycles.times_ns.begin(), cycles.times_ns.end(), window.begin_ns);
    const auto first = static_cast<std::size_t>(begin - cycles.times_ns.begin());
    const std::size_t before = first > 0 ? first - 1 : first;
    for (std::size_t i = before + 1; i < cycles.times_ns.size() && cycles.times_ns[i] < window.end_ns; ++i) {
      const auto interval = static_cast<double>(cycles.times_ns[i] - cycles.times_ns[i - 1]);
      intervals_ms.add(interval * 1e-6);
      late += interval > 1.5 * 1e6 ? 1 : 0;
      for (int user = 0; user < 2; ++user) {
        force_change = std::max(force_change, std::abs(cycles.forces[i][user] - cycles.forces[before][user]));
        min_force = std::min(min_force, cycles.forces[i][user]);
      }
    }
  }
  [[nodiscard]] double late_per_million() const {
    return 1e6 * static_cast<double>(late) / static_cast<double>(intervals_ms.size());
  }
  /// Returns the standard error of `late_per_million`, assuming independent late cycles.
  [[nodiscard]] double standard_error() const {
    return 1e6 * std::sqrt(static_cast<double>(late)) / static_cast<double>(intervals_ms.size());
  }
};

}  // namespace tactus::bench
