/// What a thread with deadlines, or one that many wait for, asks of the system: a priority, locked memory, absolute
/// times to wake at.
#pragma once

#include <cstdint>
#include <string>

#include "wire/process.hpp"

namespace tactus::wire {

/// Tries SCHED_FIFO at `priority` for the calling thread and touches its stack. Says in one line, which begins with
/// `who`, what was had and, where something was refused, which right is missing.
[[nodiscard]] std::string enter_realtime(const std::string& who, int priority);

/// The calling thread, and those that it makes from now on, get nine times the time of an ordinary one (nice -10) where
/// more want to run than there are processors and the system allows it. One line as above.
[[nodiscard]] std::string go_before_others(const std::string& who);

/// Locks the memory of the process, present and to come, as it is first touched. One line as above.
[[nodiscard]] std::string lock_memory();

/// Sleeps until monotonic_ns() is `due_ns` or later. One system call.
void sleep_until(std::int64_t due_ns) noexcept;

}  // namespace tactus::wire
