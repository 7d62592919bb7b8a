#include "latency/control_connection.hpp"

#include <arpa/inet.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <nlohmann/json.hpp>

#include "latency/test_case.hpp"

namespace tactus::latency {
namespace {

using namespace std::chrono_literals;

constexpr std::size_t kMaxLineBytes = 64 * 1024;
constexpr int kPollPeriodMs = 100;  // of the flag `cancelled`

/// Waits until `socket` is readable. Returns false after `timeout`. Throws LatencyError when cancelled.
bool wait_readable(int socket, std::chrono::milliseconds timeout, const std::atomic<bool>& cancelled) {
  const auto end = std::chrono::steady_clock::now() + timeout;
  do {
    if (cancelled) throw LatencyError("interrupted");
    pollfd on{socket, POLLIN, 0};
    if (::poll(&on, 1, kPollPeriodMs) == 1) return true;
  } while (std::chrono::steady_clock::now() < end);
  return false;
}

}  // namespace

ControlConnection::ControlConnection(int socket, const std::atomic<bool>& cancelled) noexcept
    : socket_{socket}, cancelled_{cancelled} {}

ControlConnection::~ControlConnection() { ::close(socket_); }

void ControlConnection::send(const nlohmann::ordered_json& message) {
  const std::string line = message.dump() + "\n";
  send_block(line.data(), line.size());
}

void ControlConnection::send_block(const void* data, std::size_t bytes) {
  for (const char* at = static_cast<const char*>(data); bytes > 0;) {
    const ssize_t sent = ::send(socket_, at, bytes, MSG_NOSIGNAL);
    if (sent < 0 && errno == EINTR) continue;
    if (sent <= 0) throw LatencyError(std::string{"the other side is gone: "} + std::strerror(errno));
    at += sent;
    bytes -= static_cast<std::size_t>(sent);
  }
}

void ControlConnection::append_received(std::chrono::milliseconds timeout) {
  if (!wait_readable(socket_, timeout, cancelled_))
    throw LatencyError("no answer from the other side within " + std::to_string(timeout.count()) + " ms");
  std::array<char, 65536> block;
  const ssize_t got = ::recv(socket_, block.data(), block.size(), 0);
  if (got < 0 && errno == EINTR) return;
  if (got <= 0) throw LatencyError("the other side has closed the connection");
  received_.append(block.data(), static_cast<std::size_t>(got));
}

nlohmann::ordered_json ControlConnection::receive(std::chrono::milliseconds timeout) {
  std::size_t end = 0;
  while ((end = received_.find('\n')) == std::string::npos) {
    if (received_.size() > kMaxLineBytes)
      throw LatencyError("the other side sent 64 KiB without a line end; is it tactus-latency serve?");
    append_received(timeout);
  }
  const std::string line = received_.substr(0, end);
  received_.erase(0, end + 1);
  try {
    auto message = nlohmann::ordered_json::parse(line);
    if (message.is_object() && message.contains("error"))
      throw LatencyError("the other side: " + message.at("error").get<std::string>());
    return message;
  } catch (const nlohmann::json::exception& error) {
    throw LatencyError(std::string{"the other side is not tactus-latency: "} + error.what());
  }
}

bool ControlConnection::wait() {
  if (!received_.empty()) return true;
  while (!wait_readable(socket_, 1s, cancelled_)) {
  }
  char next = 0;
  return ::recv(socket_, &next, 1, MSG_PEEK) == 1;
}

void ControlConnection::receive_block(void* data, std::size_t bytes, std::chrono::milliseconds timeout) {
  while (received_.size() < bytes) append_received(timeout);
  std::memcpy(data, received_.data(), bytes);
  received_.erase(0, bytes);
}

int listen_at(const std::string& address, std::uint16_t port) {
  sockaddr_in own{};
  own.sin_family = AF_INET;
  own.sin_port = htons(port);
  if (::inet_pton(AF_INET, address.c_str(), &own.sin_addr) != 1)
    throw LatencyError("--listen: found '" + address +
                       "', expected an IPv4 address of this machine, or 0.0.0.0 for all");
  const int listener = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const int yes = 1;
  ::setsockopt(listener, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
  if (::bind(listener, reinterpret_cast<sockaddr*>(&own), sizeof own) != 0 || ::listen(listener, 4) != 0) {
    const int error = errno;
    ::close(listener);
    throw LatencyError("port " + std::to_string(port) + ": " + std::strerror(error) +
                       "; expected a free port (--port)");
  }
  return listener;
}

std::uint16_t port_of(int listener) {
  sockaddr_in own{};
  socklen_t size = sizeof own;
  ::getsockname(listener, reinterpret_cast<sockaddr*>(&own), &size);
  return ntohs(own.sin_port);
}

int accept_from(int listener, const std::atomic<bool>& cancelled) {
  while (!cancelled) {
    pollfd on{listener, POLLIN, 0};
    if (::poll(&on, 1, kPollPeriodMs) != 1) continue;
    const int connection = ::accept4(listener, nullptr, nullptr, SOCK_CLOEXEC);
    const int yes = 1;
    if (connection >= 0) ::setsockopt(connection, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
    if (connection >= 0) return connection;
  }
  return -1;
}

int connect_to(const std::string& host, std::uint16_t port) {
  addrinfo hints{}, *found = nullptr;
  hints.ai_family = AF_INET;
  hints.ai_socktype = SOCK_STREAM;
  const std::string service = std::to_string(port);
  if (const int error = ::getaddrinfo(host.c_str(), service.c_str(), &hints, &found); error != 0)
    throw LatencyError("host '" + host + "': " + ::gai_strerror(error));
  const int connection = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const int refused = ::connect(connection, found->ai_addr, found->ai_addrlen) != 0 ? errno : 0;
  ::freeaddrinfo(found);
  if (refused != 0) {
    ::close(connection);
    throw LatencyError(host + " port " + service + ": " + std::strerror(refused) +
                       "; expected `tactus-latency serve` there, and no firewall between");
  }
  const int yes = 1;
  ::setsockopt(connection, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
  return connection;
}

}  // namespace tactus::latency
