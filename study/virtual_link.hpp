/// One direction of an emulated link in virtual time, with the samples in transit.
///
/// netem::Link decides delay and loss of each sample, as it does for each frame in `tactus link`. The same seed and the
/// same calls give the same run. One thread.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <utility>

#include "netem/link.hpp"

namespace tactus::study {

template <class Sample>
class VirtualLink {
 public:
  VirtualLink(const netem::LinkProfile& profile, std::uint64_t seed) : link_{profile, seed} {}

  /// Replaces the profile for samples that are sent from now on.
  void set_profile(const netem::LinkProfile& profile) { link_.set_profile(profile); }
  /// `bytes` is the size of the whole frame. Times must not decrease.
  void send(std::int64_t now_ns, Sample sample, std::size_t bytes) {
    if (const auto at_ns = link_.departure(now_ns, bytes)) in_transit_.emplace(*at_ns, std::move(sample));
  }
  /// Removes and returns the next sample that has arrived, if any.
  [[nodiscard]] std::optional<Sample> take(std::int64_t now_ns) {
    if (in_transit_.empty() || in_transit_.begin()->first > now_ns) return std::nullopt;
    std::optional<Sample> sample{std::move(in_transit_.begin()->second)};
    in_transit_.erase(in_transit_.begin());
    return sample;
  }

 private:
  netem::Link link_;
  std::multimap<std::int64_t, Sample> in_transit_;  // by time of departure; with equal times, in the order of sending
};

}  // namespace tactus::study
