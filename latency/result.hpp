/// Computes the statistics of a test from its timestamps.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "latency/measure.hpp"
#include "latency/statistics.hpp"

namespace tactus::latency {

/// An interval of consecutive pings of a test, with their echoes. All intervals have about the same number of pings.
struct TimeBin {
  double median_us = 0, max_us = 0;  ///< half round trip; NaN without an echo
  std::uint32_t missing = 0;         ///< number of echoes that did not arrive
};

/// Times in microseconds. All populations exclude the pings of the warm-up. Lost pings are counted, but have no time.
struct Result {
  TestCase test;
  Summary half_round_trip;       ///< half of the time from a ping's intended time to its echo's arrival; all readers
  Summary half_round_trip_sent;  ///< half of the time from the send call: excludes late wake-ups and blocking
  Summary age;                   ///< time from a ping's intended time to its arrival; all readers
  /// Age of the newest ping at a reader, sampled every 97 us from the first arrival until the last ping is due. Losses
  /// increase it. Infinite at a reader without an arrival.
  Summary age_of_information;
  double clock_bound_us = 0;                    ///< error bound of `age`; 0: both sides read one clock
  Summary timer;                                ///< lateness of the pinger's wake-ups
  double jitter_us = 0;                         ///< maximum over the readers; RFC 3550
  std::uint64_t expected = 0;                   ///< pings x readers
  std::uint64_t lost = 0;                       ///< expected arrivals that are missing
  std::uint64_t echoes_lost = 0;                ///< arrivals whose echo is missing
  std::uint64_t reordered = 0, duplicates = 0;  ///< arrivals
  std::uint64_t refused = 0;                    ///< pings that the carrier refused or blocked until the end
  double evaluated_s = 0;       ///< duration after the warm-up; approximate with coding, where pings are uneven
  double load_mbyte_per_s = 0;  ///< payload of mesh records that arrived
  std::vector<double> curve;    ///< half round trips, one for each of quantile_shares
  std::vector<TimeBin> bins;
  std::vector<std::string> notes;
};

/// Returns the shares of echoes at which plots show the half round trip: from 0 to 99.99 %, evenly spaced in the
/// logarithm of the remaining share.
[[nodiscard]] const std::vector<double>& quantile_shares();

/// Returns the number of ticks at the start of a test whose pings are not evaluated, because caches, discovery and
/// queues settle at that time.
[[nodiscard]] std::uint32_t warm_up(const TestCase& test) noexcept;

/// Computes the statistics of a test. If the two sides read different clocks, estimates the offset of the clocks from
/// the echoes of reader 0 (session/clock.hpp). Pure.
[[nodiscard]] Result evaluate(const Timestamps& timestamps);

}  // namespace tactus::latency
