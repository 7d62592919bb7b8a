#pragma once

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstddef>
#include <cstring>
#include <stdexcept>
#include <string>

namespace tactus::test_support {

/// The three DDS domains of a session in a test. Until this object is destroyed, no other test on this machine uses
/// them: some tests capture the messages of their domains, or send datagrams to all ports of these. A socket, whose
/// name only one process can have, reserves the domains; tests/python/session_test.py uses the same names.
class TestDomain {
 public:
  TestDomain() : socket_{::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0)} {
    constexpr int kSessions = 31, kFirst = 4;
    for (int tried = 0; tried < kSessions; ++tried) {
      first_ = kFirst + 3 * ((::getpid() + tried) % kSessions);
      const std::string name = "tactus.test.domain." + std::to_string(first_);
      sockaddr_un at{};
      at.sun_family = AF_UNIX;
      std::memcpy(at.sun_path + 1, name.data(), name.size());  // a name that begins with a zero is not a file
      const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + 1 + name.size());
      if (::bind(socket_, reinterpret_cast<const sockaddr*>(&at), size) == 0) return;
    }
    ::close(socket_);
    throw std::runtime_error("other tests use all domains");
  }
  ~TestDomain() { ::close(socket_); }
  TestDomain(const TestDomain&) = delete;
  TestDomain& operator=(const TestDomain&) = delete;

  /// 4, 7, ... or 94.
  [[nodiscard]] int first() const noexcept { return first_; }

 private:
  int socket_, first_ = 0;
};

/// The first domain of the sessions of this process, for tests whose sessions may share it: these have different names.
inline int test_domain() {
  static const TestDomain domain;
  return domain.first();
}

}  // namespace tactus::test_support
