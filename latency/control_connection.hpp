/// Control connection between the two sides of a test: lines of JSON and blocks of bytes over a stream socket.
#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string>

namespace tactus::latency {

/// Owns the socket. One thread at a time. The functions throw LatencyError if the other side closes (except `wait`) or
/// sends something unexpected, or if `cancelled` becomes true while they wait to receive.
class ControlConnection {
 public:
  /// `cancelled` must outlive this.
  ControlConnection(int socket, const std::atomic<bool>& cancelled) noexcept;
  ~ControlConnection();
  ControlConnection(const ControlConnection&) = delete;
  ControlConnection& operator=(const ControlConnection&) = delete;

  void send(const nlohmann::ordered_json& message);
  /// Returns the next line, of at most 64 KiB. If the message has a member "error", throws a LatencyError with its
  /// text.
  [[nodiscard]] nlohmann::ordered_json receive(std::chrono::milliseconds timeout);
  /// Waits for data without a time limit. Returns false when the other side closes.
  [[nodiscard]] bool wait();

  void send_block(const void* data, std::size_t bytes);
  void receive_block(void* data, std::size_t bytes, std::chrono::milliseconds timeout);

 private:
  void append_received(std::chrono::milliseconds timeout);

  int socket_;
  const std::atomic<bool>& cancelled_;
  std::string received_;  // not yet consumed
};

/// Returns a socket that listens on `port` of the interface with this IPv4 address, 0.0.0.0 for all; port 0 means a free
/// port. Throws LatencyError.
[[nodiscard]] int listen_at(const std::string& address, std::uint16_t port);
/// Returns the port of a socket that listen_at returned.
[[nodiscard]] std::uint16_t port_of(int listener);
/// Waits for the next incoming connection and returns its socket, or -1 if `cancelled` becomes true first.
[[nodiscard]] int accept_from(int listener, const std::atomic<bool>& cancelled);
/// Throws LatencyError that names host and port.
[[nodiscard]] int connect_to(const std::string& host, std::uint16_t port);

}  // namespace tactus::latency
