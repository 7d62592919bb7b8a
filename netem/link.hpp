/// One direction of an emulated link: computes the departure time of an arriving Ethernet frame, or its loss.
///
///     arrival --> queue (bytes, drop tail) --> transmitter (rate) --> losses --> delay, jitter --> departure
///
/// The result depends only on the seed and the arrivals: there is no clock, socket or thread. The number of a frame
/// alone decides whether it is lost, so two runs with one seed lose the same frames at any timing.
#pragma once

#include <cstdint>
#include <optional>
#include <random>

#include "netem/profile.hpp"

namespace tactus::netem {

struct LinkCounts {
  std::uint64_t arrived = 0;
  std::uint64_t dropped = 0;  ///< the queue was full
  std::uint64_t lost = 0;     ///< by chance or in a burst
  std::uint64_t bytes = 0;    ///< of frames neither dropped nor lost
};

/// Times are nanoseconds of any clock. One thread at a time. Does not allocate.
class Link {
 public:
  /// `profile` must pass `check`. Links with different seeds are independent.
  Link(const LinkProfile& profile, std::uint64_t seed);

  /// Departure of a frame of `bytes`; empty when it is dropped or lost. Arrivals must not go back in time. Departures
  /// keep the order of arrivals unless the profile reorders. About 0.1 us.
  [[nodiscard]] std::optional<std::int64_t> departure(std::int64_t arrival_ns, std::size_t bytes);

  [[nodiscard]] const LinkCounts& counts() const noexcept { return counts_; }

 private:
  [[nodiscard]] bool loses();
  [[nodiscard]] double jitter(std::int64_t at_ns);

  LinkProfile profile_;
  std::mt19937_64 loss_random_, jitter_random_;
  std::uniform_real_distribution<double> share_{0, 1};
  std::normal_distribution<double> normal_;
  bool in_burst_ = false;
  bool started_ = false;
  double wander_ = 0, wander_speed_ = 0;  // state of smooth jitter, in standard deviations
  std::int64_t wander_ns_ = 0;            // time of that state
  std::int64_t free_ns_ = 0;              // when the transmitter has sent all accepted frames
  std::int64_t last_departure_ns_ = 0;
  LinkCounts counts_;
};

}  // namespace tactus::netem
