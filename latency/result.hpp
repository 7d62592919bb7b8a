/// Statistics of the timestamps of a cell.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "latency/measure.hpp"
#include "latency/statistics.hpp"

namespace tactus::latency {

/// An interval of the run, for plots: the echoes of the pings intended in it.
struct Moment {
  double at_s = 0;
  double median_us = 0, max_us = 0;  ///< half round trip; 0 without an echo
  std::uint32_t missing = 0;         ///< echoes
};

/// Times in microseconds. All populations exclude the first pings (warm_up). Lost pings have no time; they are counted.
struct Result {
  Cell cell;
  Summary half_round_trip;       ///< from the intended time of a ping, halved; echoes of all readers
  Summary half_round_trip_sent;  ///< from the send call: without late wake-ups and blocking of the pinger
  Summary age;                   ///< one way, from the intended time; arrivals at all readers
  Summary age_of_information;  ///< age of the newest state at a reader, sampled every 97 us (age of information); grows
                               ///< with losses
  double clock_bound_us = 0;   ///< error bound of age; 0: both sides read one clock
  Summary timer;               ///< lateness of the pinger's wake-ups
  double jitter_us = 0;        ///< RFC 3550, of the worst reader
  std::uint64_t expected = 0;  ///< pings x readers
  std::uint64_t lost = 0;      ///< did not arrive
  std::uint64_t echoes_lost = 0;                ///< pings that arrived without an echo
  std::uint64_t reordered = 0, duplicates = 0;  ///< of arrivals
  std::uint64_t refused = 0;                    ///< refused by the carrier, or blocked until the end
  double load_mbyte_per_s = 0;                  ///< mesh records that arrived
  std::vector<double> curve;                    ///< half round trip at the shares of curve_shares
  std::vector<Moment> moments;
  std::vector<std::string> notes;
};

/// Shares at which plots show the distribution: 0 to four nines, evenly in the logarithm of the remainder.
[[nodiscard]] const std::vector<double>& curve_shares();

/// Pings at the start of a run that are not evaluated, while caches, discovery and queues settle.
[[nodiscard]] std::uint32_t warm_up(const Cell& cell) noexcept;

/// Pure function of the timestamps. With two clocks the offset comes from the echoes of reader 0, through
/// session/clock.
[[nodiscard]] Result evaluate(const Stamps& stamps);

}  // namespace tactus::latency
