/// Issues incarnation numbers of programs. Each number is larger than all numbers that this user's programs have got on
/// this machine before.
///
/// The numbers order the incarnations of one participant, so that receivers detect samples of an earlier incarnation.
/// Numbers of different participants are never compared. The number is the time of the system clock. But a machine
/// without a battery-backed clock boots in 1970, and a clock may be set back. So a file stores the last number, and the
/// next number is always larger than the stored one. If the file cannot be used, as in a read-only container, the
/// number is the time of the clock. Participants then accept a restart with a smaller number once the earlier
/// incarnation has been silent for half a second (session/roster.hpp).
#pragma once

#include <cstdint>
#include <filesystem>

namespace tactus::wire {

/// `$XDG_STATE_HOME/tactus`, else `~/.local/state/tactus`; empty when neither XDG_STATE_HOME nor HOME is an absolute
/// path.
[[nodiscard]] std::filesystem::path state_folder();
/// `incarnation` in the state folder; empty when there is none.
[[nodiscard]] std::filesystem::path incarnation_file();

/// Returns the larger of `clock_ns` (system clock) and the number in `file` plus one, and stores it in `file`. Safe for
/// several processes at once. If the file cannot be used, returns `clock_ns`.
[[nodiscard]] std::uint64_t next_incarnation(const std::filesystem::path& file, std::uint64_t clock_ns) noexcept;

}  // namespace tactus::wire
