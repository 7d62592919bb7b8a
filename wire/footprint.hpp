/// What a session takes of a machine: ports, sizes of datagrams and socket buffers, the library.
#pragma once

#include <filesystem>
#include <string>

namespace tactus::wire {

/// UDP port of discovery by multicast in one DDS domain, which all programs of a machine share.
[[nodiscard]] constexpr int discovery_port(int domain) noexcept { return 7400 + 250 * domain; }
/// The one at which the n-th program of a machine, from 0, is asked for itself. The next port has its samples.
[[nodiscard]] constexpr int own_port(int domain, int program) noexcept {
  return discovery_port(domain) + 10 + 2 * program;
}

/// The most that the three classes of a qos directory ask for, bytes.
struct Footprint {
  int message = 0;  ///< a datagram, without the headers of IP and UDP
  int receive_buffer = 0;
  int send_buffer = 0;
};
/// Throws WireError naming the file that has no such numbers.
[[nodiscard]] Footprint read_footprint(const std::filesystem::path& qos);

/// Of Fast DDS, as built against.
[[nodiscard]] std::string library_version();

}  // namespace tactus::wire
