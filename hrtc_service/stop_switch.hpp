/// Passes the emergency stop from the callbacks of DDS to the haptic thread of an HRTC, without a queue.
///
///     callback of stop, reset, roster --> StopLatch --> ServoLink::set_stop --> zero force in the next cycle
///                                             |
///     roster entry of this HRTC  <------------+  after the haptic thread has obeyed
#pragma once

#include <pthread.h>

#include <cstdint>
#include <vector>

#include "hrtc_service/servo_link.hpp"
#include "session/stop_latch.hpp"

namespace tactus::hrtc_service {

/// A mutex with priority inheritance: an ordinary thread that is preempted while it holds the mutex cannot delay a
/// callback that runs under SCHED_FIFO.
class InheritingMutex {
 public:
  InheritingMutex();
  ~InheritingMutex() { pthread_mutex_destroy(&mutex_); }
  InheritingMutex(const InheritingMutex&) = delete;
  InheritingMutex& operator=(const InheritingMutex&) = delete;
  void lock() noexcept { pthread_mutex_lock(&mutex_); }
  void unlock() noexcept { pthread_mutex_unlock(&mutex_); }

 private:
  pthread_mutex_t mutex_;
};

/// Any thread except the haptic thread. Its lock is held only for bounded work without allocation.
class StopSwitch {
 public:
  /// `link` must outlive the switch, and no other object may set its stop.
  StopSwitch(const session::Origin& self, ServoLink& link) : link_{link}, latch_{self} {}

  // These three pass a stop or reset to the haptic thread, which obeys in its next cycle. They return whether the stop
  // or reset is new.
  bool on_stop(const session::StopName& stop);
  bool on_reset(const session::ForceReset& reset);
  bool on_roster(const session::RosterEntry& entry);

  [[nodiscard]] bool stopped() const;
  /// If the haptic thread has obeyed the newest stop or reset since the last call, sets `records` to all stops and
  /// resets, for the roster entry, and returns true.
  bool acknowledge(std::vector<session::StopRecord>& records);

 private:
  void post_to_haptic_thread() noexcept;

  ServoLink& link_;
  mutable InheritingMutex mutex_;  // guards the members below
  session::StopLatch latch_;
  std::uint64_t acknowledged_ = 0;  // StopLatch::changes at the last acknowledgement
};

}  // namespace tactus::hrtc_service
