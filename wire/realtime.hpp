/// System settings for threads with deadlines, and for threads that many programs wait for: priority, locked memory,
/// sleep until an absolute time.
#pragma once

#include <cstdint>
#include <string>

#include "wire/process.hpp"

namespace tactus::wire {

/// Requests SCHED_FIFO at `priority` for the calling thread and touches its stack. Returns one line, which begins with
/// `who`: the result and, if it was refused, the missing right.
[[nodiscard]] std::string enter_realtime(const std::string& who, int priority);

/// Requests nice -10 for the calling thread and the threads that it creates later: nine times the share of an ordinary
/// thread on a busy machine. Returns one line as above.
[[nodiscard]] std::string raise_priority(const std::string& who);

/// Locks the present and future memory of the process, page by page on first use. Returns one line as above.
[[nodiscard]] std::string lock_memory();

/// Sleeps until monotonic_ns() is `due_ns` or later. One system call.
void sleep_until(std::int64_t due_ns) noexcept;

}  // namespace tactus::wire
