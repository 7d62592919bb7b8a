/// Incarnation numbers of programs: each is larger than all that this machine has issued before.
///
/// They order the incarnations of one participant, so that late samples of an earlier one are detected. Incarnations of
/// different participants are never compared. The number is the time of the system clock. A machine without a
/// battery-backed clock boots in 1970, and a clock may be set back. So a file stores the last number, and the next one
/// is larger in any case. If the file cannot be used (a read-only container), the clock alone decides. A restart with a
/// smaller number is then accepted once the earlier incarnation has been silent for half a second
/// (session/roster.hpp).
#pragma once

#include <cstdint>
#include <filesystem>

namespace tactus::wire {

/// `$XDG_STATE_HOME/tactus/incarnation`, else `~/.local/state/tactus/incarnation`; empty when neither is set.
[[nodiscard]] std::filesystem::path incarnation_file();

/// The max of `clock_ns`, nanoseconds of the system clock, and the number in `file` plus one; replaces that number.
/// Safe between processes. Does not fail if the file cannot be used.
[[nodiscard]] std::uint64_t next_incarnation(const std::filesystem::path& file, std::uint64_t clock_ns) noexcept;

}  // namespace tactus::wire
