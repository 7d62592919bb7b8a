/// The course of one user's forces over the time of a session, for plots.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "session/messages.hpp"

namespace tactus::client_sim {

/// What the probe states of one interval of time have in common.
struct TouchInterval {
  std::uint32_t states = 0;
  float force_max = 0;          ///< N
  float age_max_us = 0;         ///< of the probe states at their arrival
  bool coarse_contact = false;  ///< a contact was not exact
  bool fault = false;
};

/// Intervals of equal length from the start of the scenario. Their number is bounded: when there would be more than
/// kMaxIntervals, each two intervals become one.
class TouchCourse {
 public:
  static constexpr std::size_t kMaxIntervals = 800;

  /// `since_start`: s; states before the start are not added.
  void add(double since_start, const session::ProbeState& state, double age_us);

  [[nodiscard]] const std::vector<TouchInterval>& intervals() const noexcept { return intervals_; }
  [[nodiscard]] double interval_length() const noexcept { return length_; }  ///< s

 private:
  std::vector<TouchInterval> intervals_;
  double length_ = 0.05;
};

}  // namespace tactus::client_sim
