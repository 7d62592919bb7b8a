/// The emergency stop of an HRTC: from the callbacks of DDS to the haptic thread, past every queue.
///
///     callback of stop, reset, roster --> StopLatch --> ServoLink::set_stop --> zero force in the next cycle
///                                             |
///     roster entry of this HRTC  <------------+  once the haptic thread has obeyed
#pragma once

#include <pthread.h>

#include <cstdint>
#include <vector>

#include "hrtc_service/servo_link.hpp"
#include "session/stop_latch.hpp"

namespace tactus::hrtc_service {

/// A mutex whose holder gets the priority of whoever waits for it: an ordinary thread that was preempted while it held
/// the mutex cannot delay a callback that runs under SCHED_FIFO.
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

/// Any thread but the haptic thread. What is done under the lock is bounded and allocates nothing.
class StopSwitch {
 public:
  /// `link` outlives this, and nobody else sets its stop.
  StopSwitch(const session::Origin& self, ServoLink& link) : link_{link}, latch_{self} {}

  // When these return, the haptic thread's next cycle obeys. True when it was unknown, as StopLatch has it.
  bool on_stop(const session::StopName& stop);
  bool on_reset(const session::ForceReset& reset);
  bool on_roster(const session::RosterEntry& entry);

  [[nodiscard]] bool stopped() const;
  /// The stops and resets that the haptic thread has obeyed, for the roster entry. Those that came since wait for its
  /// next cycle. True when they are others than `records` had.
  bool acknowledge(std::vector<session::StopRecord>& records);

 private:
  void tell_haptic_thread() noexcept;

  ServoLink& link_;
  mutable InheritingMutex mutex_;  // for what follows
  session::StopLatch latch_;
  std::uint64_t acknowledged_ = 0;  // StopLatch::changes
};

}  // namespace tactus::hrtc_service
