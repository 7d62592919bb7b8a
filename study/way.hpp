/// One direction of an emulated link in virtual time, and what is under way on it.
///
/// netem's Link decides, as it does for the relay's frames. Same seed and arrivals, same run. One thread.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <utility>

#include "netem/link.hpp"

namespace tactus::study {

template <class Sample>
class Way {
 public:
  Way(const netem::LinkProfile& profile, std::uint64_t seed) : link_{profile, seed} {}

  /// `bytes`: of the whole frame. Times must not step back.
  void send(std::int64_t now_ns, Sample sample, std::size_t bytes) {
    if (const auto at_ns = link_.departure(now_ns, bytes)) under_way_.emplace(*at_ns, std::move(sample));
  }
  /// The next sample that has arrived.
  [[nodiscard]] std::optional<Sample> take(std::int64_t now_ns) {
    if (under_way_.empty() || under_way_.begin()->first > now_ns) return std::nullopt;
    std::optional<Sample> sample{std::move(under_way_.begin()->second)};
    under_way_.erase(under_way_.begin());
    return sample;
  }

 private:
  netem::Link link_;
  std::multimap<std::int64_t, Sample> under_way_;  // by departure; of equal ones the first sent comes first
};

}  // namespace tactus::study
