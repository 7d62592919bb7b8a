/// A one-way link in virtual time: delays and loses samples by a seed, as netem's relay does to frames.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <deque>
#include <optional>
#include <random>
#include <utility>

#include "netem/profile.hpp"

namespace tactus::bench {

template <class Sample>
class VirtualLink {
 public:
  VirtualLink(const netem::LinkProfile& profile, std::uint64_t seed) : profile_{profile}, random_{seed} {}

  /// One send in each millisecond: the memory of the smooth jitter counts sends.
  void send(std::int64_t now_ns, const Sample& sample) {
    const double memory = std::exp(-1 / netem::kJitterMemoryMs);
    wander_ = memory * wander_ + std::sqrt(1 - memory * memory) * normal_(random_);
    const double own = profile_.reorder ? normal_(random_) : wander_;
    burst_ = chance(burst_ ? 1 - profile_.burst_end : profile_.burst_start);
    if (burst_ || chance(profile_.loss)) return;
    const double delay_ms = std::max(0.0, profile_.delay_ms + profile_.jitter_ms * own);
    std::int64_t at = now_ns + std::llround(delay_ms * 1e6);
    if (!profile_.reorder && !under_way_.empty()) at = std::max(at, under_way_.back().first);
    const auto place = std::upper_bound(under_way_.begin(), under_way_.end(), at,
                                        [](std::int64_t t, const auto& packet) { return t < packet.first; });
    under_way_.insert(place, {at, sample});
  }

  /// The next sample that has arrived.
  std::optional<Sample> take(std::int64_t now_ns) {
    if (under_way_.empty() || under_way_.front().first > now_ns) return std::nullopt;
    Sample sample = std::move(under_way_.front().second);
    under_way_.pop_front();
    return sample;
  }

 private:
  bool chance(double p) { return p > 0 && std::uniform_real_distribution<double>{0, 1}(random_) < p; }

  netem::LinkProfile profile_;
  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
  std::deque<std::pair<std::int64_t, Sample>> under_way_;
  double wander_ = 0;
  bool burst_ = false;
};

}  // namespace tactus::bench
