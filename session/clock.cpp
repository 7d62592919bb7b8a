#include "session/clock.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace tactus::session {

std::int64_t ClockMap::session_time(std::int64_t at_local_ns) const noexcept {
  const std::int64_t slewed = std::min(at_local_ns, slew_until_ns) - local_ns;
  const auto gained = slewed > 0 ? std::llround(static_cast<double>(slewed) * slew) : 0;
  return session_ns + (at_local_ns - local_ns) + gained;
}

std::int64_t ClockMap::error_bound(std::int64_t at_local_ns) const noexcept {
  if (bound_ns >= kClockUnknown) return kClockUnknown;
  const auto residual =
      std::llround(static_cast<double>(std::max<std::int64_t>(0, slew_until_ns - at_local_ns)) * std::abs(slew));
  return bound_ns + residual + std::llround(static_cast<double>(at_local_ns - local_ns) * drift);
}

SessionClock::SessionClock(const Origin& self, const ClockSettings& settings, std::int64_t local_now_ns)
    : self_{self},
      settings_{settings},
      began_ns_{local_now_ns},
      map_{local_now_ns, 0, 0, local_now_ns, kClockUnknown} {}

void SessionClock::set_reference(std::uint64_t participant, std::uint64_t incarnation, std::int64_t local_now_ns) {
  if (participant == reference_ && incarnation == reference_incarnation_) return;
  // While this program was the reference, its error was 0 by definition. Its error relative to another reference is
  // unknown until that reference answers.
  if (reference_ == self_.participant && participant != 0) map_.bound_ns = kClockUnknown;
  reference_ = participant;
  reference_incarnation_ = incarnation;
  window_.clear();
  const std::int64_t widest_ns = settings_.step_ns + settings_.max_rtt_ns;
  times_ = TimeWindow{{widest_ns, widest_ns}};
  waits_for_force_off_ = false;
  if (participant != self_.participant) return;
  // Session time continues.
  map_ = {local_now_ns, map_.session_time(local_now_ns), 0, local_now_ns, 0, 0};
  if (!synchronised_) joined_ns_ = map_.session_ns;
  synchronised_ = true;
}

ClockSample SessionClock::request(std::int64_t local_now_ns) {
  ClockSample sample;
  sample.origin = self_;
  sample.origin.time_ns = local_now_ns;
  sample.peer = reference_;
  sample.sequence = ++sequence_;
  sample.t0_ns = requested_ns_[sequence_ % requested_ns_.size()] = local_now_ns;
  return sample;
}

ClockSample SessionClock::answer(const ClockSample& request, std::int64_t local_received_ns,
                                 std::int64_t local_now_ns) const {
  ClockSample sample = request;
  sample.origin = self_;
  sample.origin.time_ns = local_now_ns;
  sample.peer = request.origin.participant;
  sample.answer = true;
  sample.t1_ns = map_.session_time(local_received_ns);
  sample.t2_ns = map_.session_time(local_now_ns);
  return sample;
}

bool SessionClock::on_answer(const ClockSample& answer, std::int64_t local_now_ns) {
  for (const std::int64_t stamp : {answer.t0_ns, answer.t1_ns, answer.t2_ns}) {
    if (stamp <= -kClockUnknown || stamp >= kClockUnknown) return false;  // differences must not overflow
  }
  if (!may_follow(answer.t2_ns, local_now_ns)) return false;
  const std::int64_t turnaround = answer.t2_ns - answer.t1_ns;
  const std::int64_t rtt = local_now_ns - answer.t0_ns - turnaround;
  const bool is_answer_to_us = answer.answer && answer.origin.session == self_.session &&
                               answer.peer == self_.participant && answer.origin.participant == reference_ &&
                               answer.origin.incarnation == reference_incarnation_;
  if (!is_answer_to_us || answer.t0_ns != requested_ns_[answer.sequence % requested_ns_.size()] ||
      answer.sequence <= answered_ || answer.sequence > sequence_ || turnaround < 0 || rtt < 0 ||
      rtt > settings_.max_rtt_ns) {
    return false;
  }
  answered_ = answer.sequence;
  const std::int64_t offset = (answer.t1_ns - answer.t0_ns) / 2 + (answer.t2_ns - local_now_ns) / 2;
  const Admission time = times_.admit(local_now_ns + offset, local_now_ns);
  if (time == Admission::kImplausible) {
    ++implausible_;
    return false;
  }
  if (time == Admission::kNewStart) window_.clear();
  window_.push_back({local_now_ns, offset, rtt / 2 + 1});
  if (window_.size() > settings_.window) window_.pop_front();
  steer(local_now_ns);
  return true;
}

/// Steers the map towards the best measurement. Steps if the error is above `step_ns`, and at the first measurement,
/// unless a force is on. If a force is on and the error is above `max_slewed_ns`, session time continues without step
/// and slew, and only its error bound changes.
void SessionClock::steer(std::int64_t local_now_ns) {
  const auto bound_now = [&](const Measurement& m) {
    return m.bound_ns + std::llround(static_cast<double>(local_now_ns - m.local_ns) * settings_.drift);
  };
  const Measurement& best =
      *std::min_element(window_.begin(), window_.end(),
                        [&](const Measurement& a, const Measurement& b) { return bound_now(a) < bound_now(b); });
  const std::int64_t target = local_now_ns + best.offset_ns;
  const std::int64_t continued = map_.session_time(local_now_ns);
  const std::int64_t distance = std::abs(target - continued), bound = bound_now(best);
  const bool must_step = !force_on_ && (distance > settings_.step_ns + bound || !synchronised_);
  waits_for_force_off_ = force_on_ && distance > settings_.max_slewed_ns + bound;
  if (waits_for_force_off_) {
    const std::int64_t wrong_ns = synchronised_ ? distance + bound : kClockUnknown;
    map_ = {local_now_ns, continued, 0, local_now_ns, std::min(wrong_ns, kClockUnknown), settings_.drift};
    return;
  }
  const std::int64_t session = must_step ? target : continued;
  if (must_step || !synchronised_) joined_ns_ = session;
  const std::int64_t error = target - session;
  const double slew = error > 0 ? settings_.max_slew : error < 0 ? -settings_.max_slew : 0;
  const auto duration = std::llround(static_cast<double>(std::abs(error)) / settings_.max_slew);
  map_ = {local_now_ns, session, slew, local_now_ns + duration, bound, settings_.drift};
  synchronised_ = true;
}

}  // namespace tactus::session
