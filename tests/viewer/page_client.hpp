/// A browser's side of a page server, with blocking calls, for tests.
#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>

namespace tactus::test_support {

/// Sends an HTTP request with these headers to 127.0.0.1. Returns the status code, or 0 without an answer.
[[nodiscard]] unsigned http_status(std::uint16_t port, const std::string& path,
                                   const std::map<std::string, std::string>& headers = {}, std::string* body = nullptr);

/// An open WebSocket of a page. It reports the messages that it has seen, as a page has to.
class PageClient {
 public:
  bool reports_seen = true;

  struct Message {
    bool is_text = false;
    std::string bytes;
  };
  /// Throws std::runtime_error if the server refuses the connection.
  explicit PageClient(std::uint16_t port, const std::string& origin = {});
  ~PageClient();

  /// Sends a text message.
  void send(const std::string& text);
  /// Returns the next message; none if the server has closed the connection or `patience` is over.
  [[nodiscard]] std::optional<Message> receive(std::chrono::milliseconds patience = std::chrono::seconds{5});

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tactus::test_support
