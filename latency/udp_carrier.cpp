#include <netdb.h>
#include <netinet/in.h>
#include <netinet/ip.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <cstring>
#include <mutex>
#include <thread>

#include "latency/carrier.hpp"
#include "realtime/realtime.hpp"

namespace tactus::latency {
namespace {

constexpr std::uint32_t kMagic = 0x7ac705;
constexpr int kBufferBytes = 1 << 20;              // as in the profiles of the probe class
constexpr int kExpeditedTos = 184, kPriority = 6;  // marks of the probe class in qos/flow.yaml

/// The first bytes of a datagram; the rest is zero.
struct Datagram {
  std::uint32_t magic;
  std::uint32_t reserved;
  Packet packet;
};
static_assert(sizeof(Datagram) == kMinPayload);

class UdpCarrier final : public Carrier {
 public:
  UdpCarrier(Role role, std::uint32_t payload, const UdpSettings& settings, OnPacket callback)
      : payload_{payload}, priority_{settings.priority}, callback_{std::move(callback)} {
    if (role == Role::kPinger) find_echoers(settings);
    socket_ = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    if (socket_ < 0) throw LatencyError(std::string{"raw UDP: no socket: "} + std::strerror(errno));
    ::setsockopt(socket_, SOL_SOCKET, SO_RCVBUF, &kBufferBytes, sizeof kBufferBytes);
    ::setsockopt(socket_, SOL_SOCKET, SO_SNDBUF, &kBufferBytes, sizeof kBufferBytes);
    ::setsockopt(socket_, IPPROTO_IP, IP_TOS, &kExpeditedTos, sizeof kExpeditedTos);
    ::setsockopt(socket_, SOL_SOCKET, SO_PRIORITY, &kPriority, sizeof kPriority);
    sockaddr_in own{};
    own.sin_family = AF_INET;
    ::bind(socket_, reinterpret_cast<sockaddr*>(&own), sizeof own);
    socklen_t size = sizeof own;
    ::getsockname(socket_, reinterpret_cast<sockaddr*>(&own), &size);
    port_ = ntohs(own.sin_port);
    receiver_ = std::thread{[this] { receive(); }};
  }
  ~UdpCarrier() override {
    closing_ = true;
    ::shutdown(socket_, SHUT_RDWR);  // fails for a socket without a peer, but still ends the receive call
    receiver_.join();
    ::close(socket_);
  }

  bool send(const Packet& packet) noexcept override {
    std::array<std::uint8_t, 1472> bytes{};
    const Datagram datagram{kMagic, 0, packet};
    std::memcpy(bytes.data(), &datagram, sizeof datagram);
    bool all = true;
    const std::lock_guard lock{mutex_};
    for (const sockaddr_in& to : peers_)
      all &= ::sendto(socket_, bytes.data(), payload_, MSG_DONTWAIT, reinterpret_cast<const sockaddr*>(&to),
                      sizeof to) == static_cast<ssize_t>(payload_);
    return all;
  }
  [[nodiscard]] std::uint32_t matched() const noexcept override {
    const std::lock_guard lock{mutex_};
    return static_cast<std::uint32_t>(peers_.size());
  }
  [[nodiscard]] std::uint16_t port() const noexcept { return port_; }

 private:
  void find_echoers(const UdpSettings& settings) {
    addrinfo hints{}, *found = nullptr;
    hints.ai_family = AF_INET;
    hints.ai_socktype = SOCK_DGRAM;
    const int error = ::getaddrinfo(settings.echo_address.c_str(), nullptr, &hints, &found);
    if (error != 0) throw LatencyError("raw UDP: '" + settings.echo_address + "': " + ::gai_strerror(error));
    for (const std::uint16_t port : settings.echo_ports) {
      sockaddr_in to{};
      std::memcpy(&to, found->ai_addr, sizeof to);
      to.sin_port = htons(port);
      peers_.push_back(to);
    }
    ::freeaddrinfo(found);
  }

  void receive() {
    if (priority_ > 0) (void)realtime::enter_realtime("receiver", priority_);
    std::array<std::uint8_t, 2048> bytes;
    while (!closing_) {
      sockaddr_in from{};
      socklen_t size = sizeof from;
      const ssize_t got = ::recvfrom(socket_, bytes.data(), bytes.size(), 0, reinterpret_cast<sockaddr*>(&from), &size);
      const std::int64_t now = realtime::monotonic_ns();
      Datagram datagram{};
      if (got != static_cast<ssize_t>(payload_)) continue;
      std::memcpy(&datagram, bytes.data(), sizeof datagram);
      if (datagram.magic != kMagic) continue;
      {
        const std::lock_guard lock{mutex_};
        if (peers_.empty()) peers_.push_back(from);  // an echoer answers the first sender
      }
      callback_(datagram.packet, now);
    }
  }

  const std::uint32_t payload_;
  const int priority_;
  const OnPacket callback_;
  std::atomic<bool> closing_{false};
  int socket_ = -1;
  std::uint16_t port_ = 0;
  mutable std::mutex mutex_;  // for peers_
  std::vector<sockaddr_in> peers_;
  std::thread receiver_;
};

}  // namespace

std::unique_ptr<Carrier> make_udp(Role role, std::uint32_t payload, const UdpSettings& settings, OnPacket callback) {
  return std::make_unique<UdpCarrier>(role, payload, settings, std::move(callback));
}

std::uint16_t port_of(const Carrier& udp) { return dynamic_cast<const UdpCarrier&>(udp).port(); }

}  // namespace tactus::latency
