/// Serves the viewer's page and its messages to browsers on this machine: HTTP files and one WebSocket for each page.
///
/// Everything runs in `poll`, so no lock is needed. A slow page delays nobody: at most one message to a page is being
/// written at a time, and the next one is made only then (viewer/page_feed.hpp). A page that sends anything except a
/// request, or too many requests, is disconnected and named in an event.
///
/// Requests whose Host or Origin is not this machine are refused, because a foreign web site could otherwise reach the
/// server through a user's browser.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>

#include "viewer/viewer_core.hpp"

namespace tactus::viewer {

/// The server cannot start; the text names the folder or the port, and the cause.
class ServerError : public std::runtime_error {
  using runtime_error::runtime_error;
};

struct ServerSettings {
  std::filesystem::path folder;  ///< of the page; read once, without its subfolders
  std::uint16_t port = 8090;     ///< at 127.0.0.1; 0: any free port
};

class PageServer {
 public:
  static constexpr std::size_t kMaxPages = 16;
  static constexpr std::size_t kMaxConnections = 64;          ///< with unfinished HTTP requests; more wait
  static constexpr std::size_t kMaxRequestBytes = 4096;       ///< of a WebSocket message
  static constexpr std::uint32_t kMaxRequestsPerSecond = 50;  ///< of a page

  /// Reads the page and listens. `core` must outlive the server. Throws ServerError.
  PageServer(const ServerSettings& settings, const ViewerCore& core);
  ~PageServer();

  /// Called when a page requests that all forces stop.
  std::function<void(const std::string& reason)> on_stop_request;
  /// Called with one line for each event that an operator should see.
  std::function<void(const std::string& text)> on_event;

  /// Accepts pages, reads their requests and writes due messages, for some 5 ms. Never waits. Call it every few ms.
  void poll(std::int64_t now_ns);

  [[nodiscard]] std::uint16_t port() const;
  /// Number of connected pages.
  [[nodiscard]] std::size_t pages() const;

  struct Impl;

 private:
  std::unique_ptr<Impl> impl_;
};

}  // namespace tactus::viewer
