#include "tools/doctor/facts.hpp"

#include <arpa/inet.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <netdb.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/utsname.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <memory>
#include <set>
#include <sstream>
#include <thread>

#include "realtime/realtime.hpp"
#include "wire/endpoints.hpp"

namespace tactus::doctor {
namespace {

namespace fs = std::filesystem;

constexpr char kGroup[] = "239.255.0.1";  // multicast group of RTPS discovery
constexpr double kMatchTimeout_s = 5;

template <class Value>
Value read(const fs::path& file, Value otherwise) {
  Value value = otherwise;
  return std::ifstream{file} >> value ? value : otherwise;
}

class Socket {
 public:
  Socket() : fd_{::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)} {}
  ~Socket() {
    if (fd_ >= 0) ::close(fd_);
  }
  Socket(const Socket&) = delete;
  Socket& operator=(const Socket&) = delete;
  [[nodiscard]] int fd() const noexcept { return fd_; }

  [[nodiscard]] bool bind(int port) const {
    const sockaddr_in at = address("0.0.0.0", port);
    return ::bind(fd_, reinterpret_cast<const sockaddr*>(&at), sizeof at) == 0;
  }
  [[nodiscard]] int port() const {
    sockaddr_in at{};
    socklen_t size = sizeof at;
    ::getsockname(fd_, reinterpret_cast<sockaddr*>(&at), &size);
    return ntohs(at.sin_port);
  }
  static sockaddr_in address(const char* host, int port) {
    sockaddr_in at{};
    at.sin_family = AF_INET;
    at.sin_port = htons(static_cast<std::uint16_t>(port));
    ::inet_pton(AF_INET, host, &at.sin_addr);
    return at;
  }

 private:
  int fd_;
};

/// Sends a datagram to the group through this interface. Returns whether it comes back. Needs no other machine.
bool multicast_returns(const std::string& interface) {
  const Socket socket;
  ip_mreq group{};
  ::inet_pton(AF_INET, kGroup, &group.imr_multiaddr);
  ::inet_pton(AF_INET, interface.c_str(), &group.imr_interface);
  const unsigned char loop = 1, ttl = 1;
  if (!socket.bind(0) || ::setsockopt(socket.fd(), IPPROTO_IP, IP_ADD_MEMBERSHIP, &group, sizeof group) != 0 ||
      ::setsockopt(socket.fd(), IPPROTO_IP, IP_MULTICAST_IF, &group.imr_interface, sizeof group.imr_interface) != 0)
    return false;
  ::setsockopt(socket.fd(), IPPROTO_IP, IP_MULTICAST_LOOP, &loop, sizeof loop);
  ::setsockopt(socket.fd(), IPPROTO_IP, IP_MULTICAST_TTL, &ttl, sizeof ttl);
  const sockaddr_in to = Socket::address(kGroup, socket.port());
  const char byte = 't';
  pollfd in{socket.fd(), POLLIN, 0};
  return ::sendto(socket.fd(), &byte, 1, 0, reinterpret_cast<const sockaddr*>(&to), sizeof to) == 1 &&
         ::poll(&in, 1, 500) == 1;
}

std::vector<Interface> list_interfaces() {
  ifaddrs* first = nullptr;
  if (::getifaddrs(&first) != 0) return {};
  const std::unique_ptr<ifaddrs, void (*)(ifaddrs*)> owner{first, ::freeifaddrs};
  const Socket socket;
  std::vector<Interface> found;
  for (const ifaddrs* at = first; at != nullptr; at = at->ifa_next) {
    if (at->ifa_addr == nullptr || at->ifa_addr->sa_family != AF_INET || (at->ifa_flags & IFF_UP) == 0) continue;
    Interface made;
    made.name = at->ifa_name;
    char text[INET_ADDRSTRLEN]{};
    ::inet_ntop(AF_INET, &reinterpret_cast<const sockaddr_in*>(at->ifa_addr)->sin_addr, text, sizeof text);
    made.address = text;
    ifreq request{};
    std::strncpy(request.ifr_name, at->ifa_name, IFNAMSIZ - 1);
    if (::ioctl(socket.fd(), SIOCGIFMTU, &request) == 0) made.mtu = request.ifr_mtu;
    made.is_loopback = (at->ifa_flags & IFF_LOOPBACK) != 0;
    made.can_multicast = (at->ifa_flags & IFF_MULTICAST) != 0;
    made.multicast_returns = !made.is_loopback && multicast_returns(made.address);
    found.push_back(std::move(made));
  }
  return found;
}

/// Returns the reason why the system has no route to this address; empty when it has a route.
std::string route_error(const sockaddr_in& to) {
  const Socket socket;
  return ::connect(socket.fd(), reinterpret_cast<const sockaddr*>(&to), sizeof to) == 0 ? std::string{}
                                                                                        : std::strerror(errno);
}

/// Returns the peers and servers without an address or a route.
std::vector<std::string> unreachable(const wire::Discovery& discovery) {
  std::vector<std::string> hosts = discovery.peers, found;
  for (const std::string& server : discovery.servers) hosts.push_back(server.substr(0, server.rfind(':')));
  for (const std::string& host : hosts) {
    addrinfo hints{}, *first = nullptr;
    hints.ai_family = AF_INET;
    if (const int error = ::getaddrinfo(host.c_str(), "7400", &hints, &first); error != 0) {
      found.push_back(host + " (" + ::gai_strerror(error) + ")");
      continue;
    }
    const std::unique_ptr<addrinfo, void (*)(addrinfo*)> owner{first, ::freeaddrinfo};
    const std::string error = route_error(*reinterpret_cast<const sockaddr_in*>(first->ai_addr));
    if (!error.empty()) found.push_back(host + " (" + error + ")");
  }
  return found;
}

/// Measures in a thread of its own, so that the real-time priority ends with that thread.
void measure_lateness(const Settings& settings, const std::atomic<bool>& cancelled, Facts& facts) {
  std::thread{[&] {
    sched_param requested{};
    requested.sched_priority = settings.priority;
    facts.priority = settings.priority;
    facts.has_fifo = ::pthread_setschedparam(::pthread_self(), SCHED_FIFO, &requested) == 0;
    constexpr std::int64_t kPeriod_ns = 1'000'000;
    std::vector<double> late_us;
    std::int64_t due = realtime::monotonic_ns();
    for (const std::int64_t end = due + static_cast<std::int64_t>(settings.seconds * 1e9); due < end && !cancelled;) {
      due = std::max(due + kPeriod_ns, realtime::monotonic_ns());
      realtime::sleep_until(due);
      late_us.push_back(static_cast<double>(realtime::monotonic_ns() - due) * 1e-3);
    }
    std::sort(late_us.begin(), late_us.end());
    const auto at = [&](double share) {
      return late_us.empty() ? 0 : late_us[static_cast<std::size_t>(share * static_cast<double>(late_us.size() - 1))];
    };
    facts.lateness = {at(0.5), at(0.99), at(1)};
  }}.join();
}

double clock_read_ns() {
  constexpr int kReads = 10'000;
  const std::int64_t begin = realtime::monotonic_ns();
  for (int i = 0; i < kReads; ++i) static_cast<void>(realtime::monotonic_ns());
  return static_cast<double>(realtime::monotonic_ns() - begin) / kReads;
}

/// Returns whether the system locks as much memory as an HRTC with the default pool has. Touches none of it.
bool can_lock_memory() {
  constexpr std::size_t kBytes = 256u << 20;
  void* const memory =
      ::mmap(nullptr, kBytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (memory == MAP_FAILED) return false;
  const bool locked = ::mlock2(memory, kBytes, MLOCK_ONFAULT) == 0;
  ::munmap(memory, kBytes);
  return locked;
}

/// Returns the IPv4 UDP ports that are in use in this network namespace.
std::set<int> bound_ports() {
  std::set<int> ports;
  std::ifstream file{"/proc/net/udp"};
  std::string line, number, local;
  while (std::getline(file, line)) {
    std::istringstream words{line};
    words >> number >> local;
    const std::size_t colon = local.find(':');
    if (colon != std::string::npos && local.size() == colon + 5)
      ports.insert(static_cast<int>(std::strtol(local.c_str() + colon + 1, nullptr, 16)));
  }
  return ports;
}

void inspect_ports(int domain, Facts& facts) {
  const std::set<int> bound = bound_ports();
  facts.domain = domain;
  for (int program = 0; program < 120; ++program)
    facts.local_programs += static_cast<int>(bound.count(wire::own_port(domain, program)));
  for (int traffic = 0; traffic < wire::kTrafficClasses; ++traffic) {
    const int port = wire::discovery_port(domain + traffic);
    const Socket socket;
    const int on = 1;
    ::setsockopt(socket.fd(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    if (!socket.bind(port)) facts.blocked_ports.push_back(port);
  }
  facts.first_ephemeral_port = read("/proc/sys/net/ipv4/ip_local_port_range", 32768);
}

/// Waits until one topic of each traffic class has matched between two participants.
void try_to_match(const Settings& settings, const std::atomic<bool>& cancelled, Facts& facts) {
  try {
    wire::SessionAddress sender = settings.address;
    sender.session = "doctor." + std::to_string(::getpid()) + "." + std::to_string(realtime::monotonic_ns());
    sender.is_test = true;
    wire::SessionAddress receiver = sender;
    sender.participant = "one";
    receiver.participant = "two";
    const std::int64_t begin = realtime::monotonic_ns();
    wire::Participants from{sender}, to{receiver};
    const wire::Writer<session::Metrics> session_writer{from, wire::topics::kMetrics};
    const wire::Writer<session::ProbeState> probe_writer{from, wire::topics::kProbeState};
    const wire::Writer<session::BulkChunk> bulk_writer{from, wire::topics::kBase};
    const wire::Reader<session::Metrics> session_reader{to, wire::topics::kMetrics, [](session::Metrics&&) {}};
    const wire::Reader<session::ProbeState> probe_reader{to, wire::topics::kProbeState, [](session::ProbeState&&) {}};
    const wire::Reader<session::BulkChunk> bulk_reader{to, wire::topics::kBase, [](session::BulkChunk&&) {}};
    while (!cancelled) {
      const double elapsed_s = static_cast<double>(realtime::monotonic_ns() - begin) * 1e-9;
      if (session_writer.matched() + probe_writer.matched() + bulk_writer.matched() == 3)
        facts.match_time_s = elapsed_s;
      if (facts.match_time_s || elapsed_s > kMatchTimeout_s) return;
      std::this_thread::sleep_for(std::chrono::milliseconds{2});  // nothing notifies of a match
    }
  } catch (const wire::WireError& error) {
    facts.join_error = error.what();
  }
}

}  // namespace

std::vector<std::string> stale_segments(const fs::path& folder) {
  std::vector<std::string> found;
  std::error_code ignored;
  for (const auto& entry : fs::directory_iterator{folder, ignored}) {
    const std::string name = entry.path().filename().string();
    for (const char* prefix : {"fastdds_", "fastrtps_", "fast_datasharing_"})  // of Fast DDS 3, 2, and both
      if (name.rfind(prefix, 0) == 0) found.push_back(name);
  }
  if (found.empty()) return found;
  std::set<std::string> used;  // paths; lock files are open, but not mapped
  for (const auto& process : fs::directory_iterator{"/proc", ignored}) {
    std::ifstream maps{process.path() / "maps"};
    for (std::string line; std::getline(maps, line);)
      if (const std::size_t path = line.find('/'); path != std::string::npos) used.insert(line.substr(path));
    for (const auto& file : fs::directory_iterator{process.path() / "fd", ignored})
      used.insert(fs::read_symlink(file.path(), ignored).string());
  }
  found.erase(std::remove_if(found.begin(), found.end(),
                             [&](const std::string& name) { return used.count((folder / name).string()) > 0; }),
              found.end());
  std::sort(found.begin(), found.end());
  return found;
}

Facts collect_facts(const Settings& settings, const std::atomic<bool>& cancelled) {
  Facts facts;
  facts.discovery = settings.address.discovery;
  facts.required = wire::read_footprint(settings.address.qos);
  for (const char* name : wire::kIgnoredVariables)
    if (std::getenv(name) != nullptr) facts.variables.emplace_back(name);  // before wire::Participants removes them
  facts.interfaces = list_interfaces();
  facts.multicast_route_error = route_error(Socket::address(kGroup, 7400));
  facts.unreachable = unreachable(facts.discovery);
  facts.receive_buffer_max = read("/proc/sys/net/core/rmem_max", 0);
  facts.send_buffer_max = read("/proc/sys/net/core/wmem_max", 0);
  facts.can_lock_memory = can_lock_memory();
  facts.rt_runtime_us = read("/proc/sys/kernel/sched_rt_runtime_us", 950000L);
  measure_lateness(settings, cancelled, facts);
  facts.clock_source = read("/sys/devices/system/clocksource/clocksource0/current_clocksource", std::string{});
  facts.clock_read_ns = clock_read_ns();
  inspect_ports(settings.address.domain, facts);
  utsname system{};
  if (::uname(&system) == 0) facts.kernel = system.release;
  facts.library = wire::library_version();
  facts.now = std::time(nullptr);
  try {
    if (!settings.keys.empty()) {
      facts.member = keys::read_member(settings.keys, facts.now);
      facts.revoked = keys::read_revoked(settings.keys);
    }
  } catch (const keys::KeyError& error) {
    facts.keys_error = error.what();
  }
  facts.stale_segments = stale_segments();
  try_to_match(settings, cancelled, facts);
  return facts;
}

}  // namespace tactus::doctor
