/// Limits of what a program accepts from others in a second.
#pragma once

#include <algorithm>
#include <cstdint>
#include <map>

#include "wire/transport/rtps_message.hpp"

namespace tactus::wire {

/// A number that grows with time up to a maximum, and of which one may take (token bucket).
class Allowance {
 public:
  /// `rate`: growth in a second. `max`: at most this much, and at the begin.
  Allowance(double rate, double max, std::int64_t now_ns) : rate_{rate}, max_{max}, left_{max}, at_ns_{now_ns} {}

  /// Returns what is left. `now_ns`: monotonic clock, never decreases.
  [[nodiscard]] double left(std::int64_t now_ns) const {
    return std::min(max_, left_ + static_cast<double>(now_ns - at_ns_) * 1e-9 * rate_);
  }
  [[nodiscard]] bool is_full(std::int64_t now_ns) const { return left(now_ns) >= max_; }
  void take(double count, std::int64_t now_ns) {
    left_ = left(now_ns) - count;
    at_ns_ = now_ns;
  }
  void give_back(double count) { left_ = std::min(max_, left_ + count); }

 private:
  double rate_, max_, left_;
  std::int64_t at_ns_;
};

/// Limits the samples of one topic that a program accepts from each participant, so that one participant can hardly
/// fill the queue in which the samples of all wait.
class RateLimit {
 public:
  /// Max number of participants that are recorded at a time. One more removes all records.
  static constexpr std::size_t kMaxParticipants = 4096;

  /// Samples that a participant may send at once after a pause: those of an eighth of a second, but at least this many.
  static constexpr std::uint32_t kMinBurst = 64;

  /// `max_rate`: samples in a second.
  explicit RateLimit(std::uint32_t max_rate)
      : max_rate_{static_cast<double>(max_rate)}, burst_{static_cast<double>(std::max(max_rate / 8, kMinBurst))} {}

  /// Returns whether a sample that arrives now is within the limit. `now_ns`: monotonic clock, never decreases.
  [[nodiscard]] bool admits(const GuidPrefix& participant, std::int64_t now_ns) {
    if (senders_.size() == kMaxParticipants && senders_.count(participant) == 0) senders_.clear();
    Allowance& sender = senders_.try_emplace(participant, max_rate_, burst_, now_ns).first->second;
    if (sender.left(now_ns) < 1) return false;
    sender.take(1, now_ns);
    return true;
  }

 private:
  double max_rate_, burst_;
  std::map<GuidPrefix, Allowance> senders_;
};

}  // namespace tactus::wire
