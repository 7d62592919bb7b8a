/// Lets two programs of a secured session meet again after only one of them has removed the other.
///
/// While messages pass in one direction only, the program that receives nothing removes the other one when its lease
/// ends; the other one does not remove it. When they receive each other again, the library of the other one ignores its
/// handshake for ever. So an announcement names the participants that its sender has removed, and a program that finds
/// itself named drops all messages of the sender until its library has removed the sender too (wire/members.hpp). Then
/// both begin a new handshake.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "wire/transport/rtps_message.hpp"

namespace tactus::wire {

/// Max number of participants that an announcement names.
inline constexpr std::size_t kMaxNamedRemovals = 64;

/// Returns a message with a participant announcement, with the first participants of `removed` in a parameter that
/// other libraries skip (RTPS 2.2, 9.6.2.2.1). Returns an empty one if `message` has no announcement.
[[nodiscard]] std::vector<std::uint8_t> with_removals(const std::uint8_t* message, std::uint32_t size,
                                                      const std::vector<GuidPrefix>& removed);

/// Returns whether a message announces a participant that has removed `participant`.
[[nodiscard]] bool names_removal_of(const GuidPrefix& participant, const std::uint8_t* message,
                                    std::uint32_t size) noexcept;

}  // namespace tactus::wire
