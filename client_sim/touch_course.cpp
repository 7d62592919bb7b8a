#include "client_sim/touch_course.hpp"

#include <algorithm>
#include <cmath>

namespace tactus::client_sim {
namespace {

void merge(TouchInterval& into, const TouchInterval& other) {
  into.states += other.states;
  into.force_max = std::max(into.force_max, other.force_max);
  into.age_max_us = std::max(into.age_max_us, other.age_max_us);
  into.coarse_contact = into.coarse_contact || other.coarse_contact;
  into.fault = into.fault || other.fault;
}

}  // namespace

void TouchCourse::add(double since_start, const session::ProbeState& state, double age_us) {
  constexpr double kMaxTime = 1e7;  // s; a later time is implausible
  if (!(since_start >= 0 && since_start < kMaxTime)) return;
  while (since_start >= length_ * kMaxIntervals) {
    for (std::size_t i = 1; i < intervals_.size(); i += 2) merge(intervals_[i - 1], intervals_[i]);
    for (std::size_t i = 2; i < intervals_.size(); i += 2) intervals_[i / 2] = intervals_[i];
    intervals_.resize((intervals_.size() + 1) / 2);
    length_ *= 2;
  }
  const auto index = std::min(static_cast<std::size_t>(since_start / length_), kMaxIntervals - 1);
  if (index >= intervals_.size()) intervals_.resize(index + 1);
  TouchInterval now;
  now.states = 1;
  now.force_max = static_cast<float>(std::hypot(state.force[0], state.force[1], state.force[2]));
  now.age_max_us = static_cast<float>(age_us);
  now.coarse_contact = (state.status & session::kInContact) != 0 && (state.status & session::kExact) == 0;
  now.fault = (state.status & session::kFault) != 0;
  merge(intervals_[index], now);
}

}  // namespace tactus::client_sim
