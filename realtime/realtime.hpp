/// Sets thread priorities, locks memory, and sleeps until an absolute time.
#pragma once

#include <cstdint>
#include <string>

#include "realtime/process.hpp"

namespace tactus::realtime {

/// Requests SCHED_FIFO at `priority` for the calling thread. Makes the thread treat denormals as zero, and touches its
/// stack, so that page faults do not delay it later. Returns one line that begins with `who` and states the result; if
/// the system refused, also the right that is missing.
[[nodiscard]] std::string enter_realtime(const std::string& who, int priority);

/// Requests nice -10 for the calling thread and the threads that it creates later. On a busy machine they then get nine
/// times the processor time of an ordinary thread. Returns one line as enter_realtime does.
[[nodiscard]] std::string raise_priority(const std::string& who);

/// Locks the present and future memory of the process, each page at its first use. Returns one line as enter_realtime
/// does, without `who`.
[[nodiscard]] std::string lock_memory();

/// Sleeps until monotonic_ns() is `due_ns` or later. One system call.
void sleep_until(std::int64_t due_ns) noexcept;

}  // namespace tactus::realtime
