/// Names of status bits, for people who read them.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace tactus::session {

/// Returns the names of the bits that are set in the status of a probe state or device command, lowest bit first, as
/// docs/reference/status-bits.md lists them. A set bit without a name is "bit 14". Omits the reason of a fault, which
/// fault_reason returns.
[[nodiscard]] std::vector<std::string> status_names(std::uint32_t status);

}  // namespace tactus::session
