/// Passes the emergency stop from the callbacks of DDS to the haptic thread of an HRTC, without a queue.
///
///     callback of stop, reset, roster --> StopLatch --> ServoLink::set_stop --> zero force in the next cycle
///                                             |
///     roster entry of this HRTC  <------------+  after the haptic thread has obeyed
///
///     local stop by button or signal: zero force in the next cycle --> a stop of this HRTC, which a reset can name
#pragma once

#include <cstdint>
#include <vector>

#include "hrtc_service/servo/servo_link.hpp"
#include "realtime/inheriting_mutex.hpp"
#include "session/stop_latch.hpp"

namespace tactus::hrtc_service {

/// Holds the stops and resets that an HRTC received. At the start, a stop in the link becomes a stop of this HRTC,
/// because its name is lost. Threads: any except the haptic thread. The lock is held only for bounded work without
/// allocation.
class StopSwitch {
 public:
  /// `link` must outlive the switch, and no other object may set its stop.
  StopSwitch(const session::Origin& self, ServoLink& link);

  // These three pass stops and resets to the haptic thread, which obeys in its next cycle. They return true for a new
  // reset, and for a new stop that no reset has ended.
  bool on_stop(const session::StopName& stop);
  bool on_reset(const session::ForceReset& reset);
  bool on_roster(const session::RosterEntry& entry);

  /// Issues a stop of this HRTC if a local stop was requested, which the haptic thread has obeyed already. Returns whether
  /// it was requested.
  bool issue_local_stop();

  [[nodiscard]] bool stopped() const;
  /// Returns true if stops or resets came after the last call that returned true, and the haptic thread has obeyed all
  /// of them. Then sets `records` to the records of all stops and resets, for the roster entry.
  bool acknowledge(std::vector<session::StopRecord>& records);

 private:
  void post_to_haptic_thread() noexcept;

  ServoLink& link_;
  mutable realtime::InheritingMutex mutex_;  // guards the members below
  session::StopLatch latch_;
  std::uint32_t resets_before_;     // of earlier gateways
  std::uint64_t acknowledged_ = 0;  // StopLatch::changes at the last acknowledgement
};

}  // namespace tactus::hrtc_service
