/// Resources that a session needs on a machine: ports, sizes of datagrams and socket buffers, and the library.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

namespace tactus::wire {

/// UDP port of multicast discovery in a DDS domain. All programs of a machine share it.
[[nodiscard]] constexpr int discovery_port(int domain) noexcept { return 7400 + 250 * domain; }
/// UDP port of unicast discovery of the program with number `program` on a machine; numbers begin at 0. The program
/// receives samples at the next port.
[[nodiscard]] constexpr int own_port(int domain, int program) noexcept {
  return discovery_port(domain) + 10 + 2 * program;
}
/// Whether programs receive messages of discovery at this port; all others of RTPS are for samples (RTPS 2.2, 9.6.1.1).
[[nodiscard]] constexpr bool is_discovery_port(std::uint32_t port) noexcept { return port % 2 == 0; }

/// Sizes in bytes, each the largest one that the three traffic classes of a qos directory set.
struct Footprint {
  int message = 0;  ///< of a datagram, without the headers of IP and UDP
  int receive_buffer = 0;
  int send_buffer = 0;
};
/// Throws WireError with the file that lacks a size.
[[nodiscard]] Footprint read_footprint(const std::filesystem::path& qos);

/// Version of Fast DDS at compile time.
[[nodiscard]] std::string library_version();

}  // namespace tactus::wire
