#include "realtime/service_manager.hpp"

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstddef>
#include <cstdlib>
#include <cstring>

namespace tactus::realtime {

ServiceManager::ServiceManager() {
  const char* const address = std::getenv("NOTIFY_SOCKET");
  if (address == nullptr || (address[0] != '/' && address[0] != '@')) return;
  address_ = address;
  if (address_.size() >= sizeof sockaddr_un::sun_path) return;
  if (address_[0] == '@') address_[0] = '\0';
  socket_ = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  constexpr std::int64_t kReports = 3;  // in the time of the watchdog
  if (const char* const us = std::getenv("WATCHDOG_USEC")) interval_ns_ = std::atoll(us) * 1000 / kReports;
}

ServiceManager::~ServiceManager() {
  if (socket_ >= 0) ::close(socket_);
}

void ServiceManager::alive(std::int64_t now_ns) noexcept {
  if (interval_ns_ <= 0 || now_ns - reported_ns_ < interval_ns_) return;
  reported_ns_ = now_ns;
  send("WATCHDOG=1", MSG_DONTWAIT);
}

void ServiceManager::send(const char* state, int flags) const noexcept {
  if (socket_ < 0) return;
  sockaddr_un to{};
  to.sun_family = AF_UNIX;
  std::memcpy(to.sun_path, address_.data(), address_.size());
  const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + address_.size());
  (void)::sendto(socket_, state, std::strlen(state), MSG_NOSIGNAL | flags, reinterpret_cast<const sockaddr*>(&to),
                 size);
}

}  // namespace tactus::realtime
