/// Reads qos/flow.yaml, the settings of sockets that the XML profiles of Fast DDS 2.9 cannot express.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>

#include "wire/participants.hpp"

namespace tactus::wire {

/// Options of the sockets of a traffic class; 0: the default of the system.
struct SocketOptions {
  int tos = 0;       ///< IP_TOS byte, 0..255
  int priority = 0;  ///< SO_PRIORITY, 0..6
};

struct Flow {
  std::array<SocketOptions, kTrafficClasses> sockets;  ///< by TrafficClass
};

/// Throws WireError, which names file and key, for a missing file or key, an unknown key or a value out of bounds.
[[nodiscard]] Flow read_flow(const std::filesystem::path& file);

}  // namespace tactus::wire
