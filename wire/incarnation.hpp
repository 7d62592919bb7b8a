/// Numbers for the starts of programs: each is larger than all that this machine has given before.
///
/// They order the lives of one participant, so that a late sample of the life before is known as one; lives of
/// different participants are never compared. The system clock gives the number. A machine without a battery-backed
/// clock boots in 1970, and a clock may be set back, so the last number is kept in a file and the next one is larger
/// in any case. Where the file cannot be used (a read-only container), the clock alone decides; a restart under a
/// smaller number is then accepted once the life before has been silent for half a second (session/roster.hpp).
#pragma once

#include <cstdint>
#include <filesystem>

namespace tactus::wire {

/// `incarnation` in $XDG_STATE_HOME/tactus, else in ~/.local/state/tactus; empty when neither is known.
[[nodiscard]] std::filesystem::path incarnation_file();

/// The larger of `clock_ns`, nanoseconds of the system clock, and the file's last number plus one, which it replaces.
/// Safe between processes. Never throws for a file that cannot be used.
[[nodiscard]] std::uint64_t next_incarnation(const std::filesystem::path& file, std::uint64_t clock_ns) noexcept;

}  // namespace tactus::wire
