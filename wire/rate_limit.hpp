/// Limits the samples of one topic that a program accepts from each participant, so that one participant cannot fill the
/// queue in which the samples of all wait.
#pragma once

#include <cstdint>
#include <map>

#include "wire/transport/rtps_message.hpp"

namespace tactus::wire {

class RateLimit {
 public:
  /// Max number of participants that are recorded at a time; more make it forget all.
  static constexpr std::size_t kMaxParticipants = 4096;

  /// `max_rate`: samples in a second. After a pause a participant may send as many at once.
  explicit RateLimit(std::uint32_t max_rate) : max_rate_{max_rate} {}

  /// Returns whether a sample that arrives now is within the limit. `now_ns`: monotonic clock, never decreases.
  [[nodiscard]] bool admits(const GuidPrefix& participant, std::int64_t now_ns) {
    if (senders_.size() == kMaxParticipants && senders_.count(participant) == 0) senders_.clear();
    const double full = max_rate_;
    Sender& sender = senders_.try_emplace(participant, Sender{full, now_ns}).first->second;
    sender.left += static_cast<double>(now_ns - sender.at_ns) * 1e-9 * full;
    if (sender.left > full) sender.left = full;
    sender.at_ns = now_ns;
    if (sender.left < 1) return false;
    sender.left -= 1;
    return true;
  }

 private:
  struct Sender {
    double left;  // samples that it may still send
    std::int64_t at_ns;
  };

  std::uint32_t max_rate_;
  std::map<GuidPrefix, Sender> senders_;
};

}  // namespace tactus::wire
