#include "session/full_rate_check.hpp"

#include <algorithm>

namespace tactus::session {

void FullRateCheck::restart(std::uint32_t number, std::int64_t now_ns) noexcept {
  *this = {};
  begin_ns_ = now_ns;
  begin_number_ = number;
}

void FullRateCheck::on_state(std::uint32_t number, std::int64_t transit_ns, std::int64_t now_ns) noexcept {
  constexpr std::int64_t kIntervalNs = 300'000'000, kMaxDelayNs = 200'000'000;
  constexpr double kMaxMissed = 0.4;
  constexpr std::uint32_t kOvertaken = 1000;  // a number further behind is of another sender
  const auto ahead = static_cast<std::int32_t>(number - begin_number_);
  if (!is_active(now_ns) || ahead < -static_cast<std::int32_t>(kOvertaken)) restart(number, now_ns);
  last_ns_ = now_ns;
  fastest_ns_ = std::min(fastest_ns_, transit_ns);
  if (now_ns - begin_ns_ >= kIntervalNs && ahead > 0) {
    missed_share_ = 1 - std::min(1.0, static_cast<double>(on_time_) / static_cast<double>(ahead));
    bad_intervals_ = missed_share_ > kMaxMissed ? bad_intervals_ + 1 : 0;
    begin_ns_ = now_ns;
    begin_number_ = number;
    on_time_ = 0;
  }
  if (transit_ns - fastest_ns_ <= kMaxDelayNs) ++on_time_;
}

}  // namespace tactus::session
