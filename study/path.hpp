/// One direction of an emulated link in virtual time, with the samples in transit.
///
/// netem's Link decides, as for the relay's frames. The same seed and arrivals give the same run. One thread.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <utility>

#include "netem/link.hpp"

namespace tactus::study {

template <class Sample>
class Path {
 public:
  Path(const netem::LinkProfile& profile, std::uint64_t seed) : link_{profile, seed} {}

  /// `bytes`: of the whole frame. Times must not go back.
  void send(std::int64_t now_ns, Sample sample, std::size_t bytes) {
    if (const auto at_ns = link_.departure(now_ns, bytes)) under_way_.emplace(*at_ns, std::move(sample));
  }
  /// The next sample that has arrived, if any.
  [[nodiscard]] std::optional<Sample> take(std::int64_t now_ns) {
    if (under_way_.empty() || under_way_.begin()->first > now_ns) return std::nullopt;
    std::optional<Sample> sample{std::move(under_way_.begin()->second)};
    under_way_.erase(under_way_.begin());
    return sample;
  }

 private:
  netem::Link link_;
  std::multimap<std::int64_t, Sample> under_way_;  // by departure; equal ones in the order of sending
};

}  // namespace tactus::study
