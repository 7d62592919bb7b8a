/// A mutex for data that threads under SCHED_FIFO share with ordinary ones.
#pragma once

#include <pthread.h>

namespace tactus::realtime {

/// A mutex with priority inheritance. While a thread under SCHED_FIFO waits for it, the thread that holds it has the
/// priority of the waiting one, so that ordinary threads do not prolong the wait. Use it with std::lock_guard. Threads:
/// any. Cost without contention: an atomic operation each for `lock` and `unlock`.
class InheritingMutex {
 public:
  InheritingMutex() noexcept {
    pthread_mutexattr_t attributes;
    pthread_mutexattr_init(&attributes);
    pthread_mutexattr_setprotocol(&attributes, PTHREAD_PRIO_INHERIT);
    pthread_mutex_init(&mutex_, &attributes);
    pthread_mutexattr_destroy(&attributes);
  }
  ~InheritingMutex() { pthread_mutex_destroy(&mutex_); }
  InheritingMutex(const InheritingMutex&) = delete;
  InheritingMutex& operator=(const InheritingMutex&) = delete;
  void lock() noexcept { pthread_mutex_lock(&mutex_); }
  void unlock() noexcept { pthread_mutex_unlock(&mutex_); }

 private:
  pthread_mutex_t mutex_ = PTHREAD_MUTEX_INITIALIZER;
};

}  // namespace tactus::realtime
