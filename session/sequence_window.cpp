#include "session/sequence_window.hpp"

#include <algorithm>

#include "session/units.hpp"

namespace tactus::session {
namespace {

constexpr std::int64_t kMaxDriftDivisor = 1000;  // two clocks drift by at most 1 / 1000
/// Times are clamped to this, 73 years, so that their differences do not overflow.
constexpr std::int64_t kMaxTimeNs = INT64_C(1) << 61;
constexpr std::int64_t kMaxPauseNs = 2'000'000'000;  // between consecutive samples outside the window

}  // namespace

bool SequenceWindow::is_successor(std::uint64_t number, std::uint64_t before, std::int64_t passed_ns) const noexcept {
  if (number <= before) return limits_.repeats && number == before;
  const double passed_s = static_cast<double>(std::max<std::int64_t>(passed_ns, 0)) / kNsPerS;
  return static_cast<double>(number - before) <= static_cast<double>(limits_.max_ahead) + limits_.rate * passed_s;
}

Admission SequenceWindow::start(std::uint64_t number, std::int64_t now_ns, bool confirmed) noexcept {
  newest_ = number;
  newest_ns_ = now_ns;
  started_ = true;
  confirmed_ = confirmed;
  return Admission::kNewStart;
}

Admission SequenceWindow::admit(std::uint64_t number, std::int64_t now_ns) noexcept {
  if (!started_) return start(number, now_ns, false);
  const bool next = is_successor(number, newest_, now_ns - newest_ns_);
  const bool never_decreases = confirmed_ && !limits_.falls && newest_ <= kMaxFollowedFencing;
  const bool overtaken = !next && number <= newest_ && (newest_ - number <= limits_.max_ahead || never_decreases);
  if ((next || overtaken) && limits_.falls) outside_count_ = 0;
  if (overtaken) return Admission::kOld;
  if (next) {
    (void)start(number, now_ns, true);
    return Admission::kAccepted;
  }
  if (!confirmed_) return start(number, now_ns, false);
  if (number > std::max(newest_, limits_.max_jump)) return Admission::kImplausible;
  const bool repeated = outside_count_ > 0 && number == outside_ && !limits_.repeats;
  if (repeated) return Admission::kImplausible;
  const std::int64_t passed_ns = now_ns - outside_ns_;
  const bool continues = outside_count_ > 0 && passed_ns <= kMaxPauseNs && is_successor(number, outside_, passed_ns);
  outside_count_ = continues ? outside_count_ + 1 : 1;
  outside_ = number;
  outside_ns_ = now_ns;
  if (outside_count_ < kAgreeing) return Admission::kImplausible;
  outside_count_ = 0;
  return start(number, now_ns, true);
}

Admission SourceWindow::admit(const Origin& origin) noexcept {
  const bool same = started_ && origin.participant == participant_ && origin.incarnation == incarnation_;
  if (same) {
    other_count_ = 0;
    return Admission::kAccepted;
  }
  const bool restarted = started_ && origin.participant == participant_ && origin.incarnation > incarnation_;
  if (started_ && !restarted) {
    const bool again = origin.participant == other_ && origin.incarnation == other_incarnation_;
    other_count_ = again ? other_count_ + 1 : 1;
    other_ = origin.participant;
    other_incarnation_ = origin.incarnation;
    if (other_count_ < kAgreeing) return Admission::kImplausible;
  }
  participant_ = origin.participant;
  incarnation_ = origin.incarnation;
  started_ = true;
  other_count_ = 0;
  return Admission::kNewStart;
}

Admission SenderWindow::admit(const Origin& origin, std::uint64_t number, std::int64_t now_ns) noexcept {
  const Admission source = source_.admit(origin);
  if (source == Admission::kImplausible) return source;
  if (source == Admission::kNewStart) numbers_ = SequenceWindow{limits_};
  return numbers_.admit(number, now_ns);
}

bool TimeWindow::is_plausible(std::int64_t offset_ns, std::int64_t expected_ns) const noexcept {
  return offset_ns - expected_ns <= limits_.max_ahead_ns && expected_ns - offset_ns <= limits_.max_behind_ns;
}

Admission TimeWindow::admit(std::int64_t time_ns, std::int64_t now_ns) noexcept {
  const std::int64_t offset_ns =
      std::clamp(std::clamp(time_ns, -kMaxTimeNs, kMaxTimeNs) - std::clamp(now_ns, -kMaxTimeNs, kMaxTimeNs),
                 -kMaxTimeNs, kMaxTimeNs);
  const std::int64_t drift_ns = std::max<std::int64_t>(now_ns - accepted_ns_, 0) / kMaxDriftDivisor;
  if (started_ && is_plausible(offset_ns, offset_ns_)) {
    offset_ns_ = std::max(offset_ns, offset_ns_ - drift_ns);
    accepted_ns_ = now_ns;
    confirmed_ = true;
    outside_count_ = 0;
    return Admission::kAccepted;
  }
  if (started_ && confirmed_) {
    outside_count_ = outside_count_ > 0 && is_plausible(offset_ns, outside_ns_) ? outside_count_ + 1 : 1;
    outside_ns_ = offset_ns;
    if (outside_count_ < kAgreeing) return Admission::kImplausible;
  }
  confirmed_ = started_ && confirmed_;
  started_ = true;
  offset_ns_ = offset_ns;
  accepted_ns_ = now_ns;
  outside_count_ = 0;
  return Admission::kNewStart;
}

Admission WrappedTimeWindow::admit(std::uint32_t transit_us, std::int64_t now_ns) noexcept {
  if (!started_) first_us_ = transit_us;
  started_ = true;
  const auto later_us = static_cast<std::int32_t>(transit_us - first_us_);
  return window_.admit(now_ns - std::int64_t{later_us} * 1000, now_ns);
}

}  // namespace tactus::session
