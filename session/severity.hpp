/// Severity of an event that an operator reads.
#pragma once

#include <cstdint>

namespace tactus::session {

enum class Severity : std::uint8_t {
  kInfo,
  kWarning,  ///< something is refused, lost or stopped; the program goes on
  kError     ///< the program cannot do its work
};

}  // namespace tactus::session
