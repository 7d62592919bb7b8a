/// Limits the samples of one topic that a program accepts from each participant, so that one participant can hardly
/// fill the queue in which the samples of all wait.
#pragma once

#include <algorithm>
#include <cstdint>
#include <map>

#include "wire/transport/rtps_message.hpp"

namespace tactus::wire {

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
    Sender& sender = senders_.try_emplace(participant, Sender{burst_, now_ns}).first->second;
    sender.left = std::min(burst_, sender.left + static_cast<double>(now_ns - sender.at_ns) * 1e-9 * max_rate_);
    sender.at_ns = now_ns;
    if (sender.left < 1) return false;
    sender.left -= 1;
    return true;
  }

 private:
  struct Sender {
    double left;  // samples that it may send at once
    std::int64_t at_ns;
  };

  double max_rate_, burst_;
  std::map<GuidPrefix, Sender> senders_;
};

}  // namespace tactus::wire
