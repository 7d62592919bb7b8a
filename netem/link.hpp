/// Emulates one direction of a link: computes for each arriving Ethernet frame its departure time or its loss.
///
///     arrival --> queue (bytes, drop tail) --> transmitter (rate) --> losses --> delay, jitter --> departure
///
/// The result depends only on the profile, the seed and the arrivals; there is no clock, socket or thread. Losses do
/// not depend on times: runs with the same seed lose the same frames, except those that the queue has dropped.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <random>

#include "netem/profile.hpp"

namespace tactus::netem {

struct LinkCounts {
  std::uint64_t arrived = 0;
  std::uint64_t dropped = 0;   ///< frames that found the queue full
  std::uint64_t lost = 0;      ///< frames lost by chance or in a burst
  std::uint64_t repeated = 0;  ///< frames that arrive twice
  std::uint64_t bytes = 0;     ///< bytes of the frames that were neither dropped nor lost, each once
};

/// Times are in ns on any clock. One thread at a time. Does not allocate.
class Link {
 public:
  /// `profile` must pass `check`. Links with different seeds are independent.
  Link(const LinkProfile& profile, std::uint64_t seed);

  /// Returns the departure of a frame of `bytes`, or nothing if the frame is dropped or lost. Arrival times must not
  /// decrease. Departures have the order of arrivals unless the profile reorders. Takes about 0.1 us.
  [[nodiscard]] std::optional<std::int64_t> departure(std::int64_t arrival_ns, std::size_t bytes);

  /// Returns whether the frame of the last departure arrives twice, with the same departure.
  [[nodiscard]] bool is_repeated() const noexcept { return is_repeated_; }

  /// Replaces the profile, which must pass `check`, for later frames, and ends a burst of losses. Frames keep their
  /// order unless the new profile reorders. The bytes that wait when the next frame arrives stay in the queue, at the
  /// new rate; without a limit there is no queue.
  void set_profile(const LinkProfile& profile);

  [[nodiscard]] const LinkCounts& counts() const noexcept { return counts_; }

 private:
  /// Gives the bytes in the queue the time that they need at the rate of a new profile.
  void adapt_queue(std::int64_t now_ns);
  [[nodiscard]] bool is_lost();
  /// Returns the standard normal values that the jitter of one frame needs.
  [[nodiscard]] std::array<double, 2> jitter_noise();
  [[nodiscard]] double jitter(std::int64_t at_ns, const std::array<double, 2>& noise);

  LinkProfile profile_;
  double queue_rate_mbit_;  // rate with which free_ns_ is computed
  std::mt19937_64 loss_random_, jitter_random_, repeat_random_;
  std::uniform_real_distribution<double> uniform_{0, 1};
  std::normal_distribution<double> normal_;
  bool in_burst_ = false;
  bool is_repeated_ = false;
  bool has_smooth_jitter_ = false;
  double smooth_jitter_ = 0, smooth_jitter_rate_ = 0;  // in standard deviations, and per kJitterCorrelationMs
  std::int64_t smooth_jitter_ns_ = 0;                  // time of these values
  std::int64_t free_ns_ = 0;                           // time at which the transmitter has sent all accepted frames
  std::int64_t last_departure_ns_ = 0;
  LinkCounts counts_;
};

}  // namespace tactus::netem
