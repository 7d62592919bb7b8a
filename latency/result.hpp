/// What the stamps of a cell come to.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "latency/measure.hpp"
#include "latency/statistics.hpp"

namespace tactus::latency {

/// A moment of the run, for plots: the echoes of the pings intended in it.
struct Moment {
  double at_s = 0;
  double median_us = 0, max_us = 0;  ///< half round trip; 0 without an echo
  std::uint32_t missing = 0;         ///< echoes
};

/// Times in microseconds. All populations leave out the first pings (warm_up). Lost pings have no time: they are
/// counted.
struct Result {
  Cell cell;
  Summary half_round_trip;       ///< from when a ping was intended, half of it; echoes of all readers
  Summary half_round_trip_sent;  ///< from when it was handed over: without the pinger's late wake-ups and hold-ups
  Summary age;                   ///< one way, from when it was intended; arrivals at all readers
  Summary known_age;  ///< of the newest state that a reader has, looked at every 97 us: grows where pings are lost
  double clock_bound_us = 0;                    ///< age is right to this; 0: both sides read one clock
  Summary timer;                                ///< how late the system woke the pinger
  double jitter_us = 0;                         ///< RFC 3550, worst reader
  std::uint64_t expected = 0;                   ///< pings x readers
  std::uint64_t lost = 0;                       ///< did not arrive
  std::uint64_t echoes_lost = 0;                ///< arrived, and their echo did not
  std::uint64_t reordered = 0, duplicates = 0;  ///< of arrivals
  std::uint64_t refused = 0;                    ///< not taken by the carrier, or held up beyond the end
  double load_mbyte_per_s = 0;                  ///< mesh records that arrived beside
  std::vector<double> curve;                    ///< half round trip at the shares of kCurveShares
  std::vector<Moment> moments;
  std::vector<std::string> notes;
};

/// Shares at which plots have the distribution: 0 to four nines, evenly in the logarithm of what is left.
[[nodiscard]] const std::vector<double>& curve_shares();

/// Pings at the start of a run that are sent but not judged: caches, discovery and queues settle.
[[nodiscard]] std::uint32_t warm_up(const Cell& cell) noexcept;

/// Pure function of the stamps. With two clocks their offset comes from the echoes of reader 0, through session/clock.
[[nodiscard]] Result evaluate(const Stamps& stamps);

}  // namespace tactus::latency
