#include "realtime/service_manager.hpp"

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <cstddef>
#include <cstdlib>
#include <string>

namespace tactus::realtime {
namespace {

constexpr std::int64_t kSecond = 1'000'000'000;

/// The socket of a service manager, with an abstract address.
class ManagerSocket {
 public:
  ManagerSocket() : socket_{::socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0)} {
    const std::string name = "tactus-test-" + std::to_string(::getpid());
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    name.copy(address.sun_path + 1, sizeof address.sun_path - 1);
    const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + 1 + name.size());
    EXPECT_EQ(::bind(socket_, reinterpret_cast<const sockaddr*>(&address), size), 0);
    ::setenv("NOTIFY_SOCKET", ("@" + name).c_str(), 1);
  }
  ~ManagerSocket() {
    ::close(socket_);
    ::unsetenv("NOTIFY_SOCKET");
    ::unsetenv("WATCHDOG_USEC");
  }
  ManagerSocket(const ManagerSocket&) = delete;
  ManagerSocket& operator=(const ManagerSocket&) = delete;
  /// The oldest message, or an empty string.
  std::string next() {
    std::array<char, 100> text{};
    const ssize_t size = ::recv(socket_, text.data(), text.size(), 0);
    return size > 0 ? std::string(text.data(), static_cast<std::size_t>(size)) : std::string{};
  }

 private:
  int socket_;
};

TEST(ServiceManager, ReportsStartAndEnd) {
  ManagerSocket socket;
  const ServiceManager manager;
  manager.ready();
  EXPECT_EQ(socket.next(), "READY=1");
  manager.stopping();
  EXPECT_EQ(socket.next(), "STOPPING=1");
}

TEST(ServiceManager, ReportsThatItWorksThreeTimesInTheTimeOfTheWatchdog) {
  ManagerSocket socket;
  ::setenv("WATCHDOG_USEC", "3000000", 1);
  ServiceManager manager;
  manager.alive(10 * kSecond);
  EXPECT_EQ(socket.next(), "WATCHDOG=1");
  manager.alive(10 * kSecond + kSecond - 1);
  EXPECT_EQ(socket.next(), "");
  manager.alive(11 * kSecond);
  EXPECT_EQ(socket.next(), "WATCHDOG=1");
}

TEST(ServiceManager, WithoutAWatchdogReportsNoWork) {
  ManagerSocket socket;
  ServiceManager manager;
  manager.alive(10 * kSecond);
  EXPECT_EQ(socket.next(), "");
}

TEST(ServiceManager, WithoutSystemdDoesNothing) {
  ManagerSocket socket;
  ::unsetenv("NOTIFY_SOCKET");
  ServiceManager manager;
  manager.ready();
  manager.alive(10 * kSecond);
  manager.stopping();
  EXPECT_EQ(socket.next(), "");
}

TEST(ServiceManager, IgnoresAnAddressThatIsTooLong) {
  ManagerSocket socket;
  ::setenv("NOTIFY_SOCKET", (std::getenv("NOTIFY_SOCKET") + std::string(200, 'x')).c_str(), 1);
  const ServiceManager manager;
  manager.ready();
  EXPECT_EQ(socket.next(), "");
}

}  // namespace
}  // namespace tactus::realtime
