/// Serves the viewer's page and its messages to browsers: HTTP files and one WebSocket for each page.
///
/// Everything runs in `poll`, so no lock is needed. A slow page delays nobody: at most one message to a page is being
/// written at a time, and the next one is made only then (viewer/page_feed.hpp). The server disconnects a page and
/// reports an event if the page sends an invalid request, too many requests, or a request that its token does not allow.
///
/// Requests whose Host or Origin is another one are refused, because a foreign web site could otherwise reach the
/// server through a user's browser.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>

#include "viewer/page_feed.hpp"
#include "viewer/page_request.hpp"
#include "viewer/viewer_core.hpp"

namespace tactus::viewer {

/// The server cannot start; the text names the folder or the port, and the cause.
class ServerError : public std::runtime_error {
  using runtime_error::runtime_error;
};

struct ServerSettings {
  std::filesystem::path folder;       ///< of the page; read once, without its subfolders
  std::string address = "127.0.0.1";  ///< IPv4 or IPv6 address to listen at
  std::uint16_t port = 8090;          ///< 0: any free port
  /// A page that sends this token first can stop forces and touch. Empty: every page can, and needs no token.
  std::string control_token;
  /// A page that sends this token first only receives. Empty: there is no such token.
  std::string observer_token;
  /// Mesh of every probe as JSON: `positions`, x y z in m, and `faces`. null: a probe is a sphere.
  std::string tool = "null";
  bool is_plain = false;  ///< the session is not secured although it has several machines: the pages warn
};

/// True if `address` can be reached only from this machine.
[[nodiscard]] bool is_loopback(const std::string& address);
/// Name of this machine.
[[nodiscard]] std::string host_name();

class PageServer {
 public:
  static constexpr std::size_t kMaxPages = 16;
  static constexpr std::size_t kMaxConnections = 64;           ///< with unfinished HTTP requests; more wait
  static constexpr std::size_t kMaxRequestBytes = 4096;        ///< of a WebSocket message
  static constexpr std::uint32_t kMaxRequestsPerSecond = 200;  ///< of a page, whose hand moves up to 144 times a second

  /// Reads the page and listens. `core` and `playback` must outlive the server. `playback`: null in a live session.
  /// Throws ServerError.
  PageServer(const ServerSettings& settings, const ViewerCore& core, const PlaybackStatus* playback = nullptr);
  ~PageServer();

  /// Called with each request that the page's token allows, except tokens.
  std::function<void(PageId page, const PageRequest& request)> on_request;
  /// Called when a page has ended.
  std::function<void(PageId page)> on_page_closed;
  /// Called with one line for each event that an operator should see.
  std::function<void(const std::string& text)> on_event;

  /// Accepts pages, reads their requests and writes due messages, for some 5 ms. Never waits. Call it every few ms.
  void poll(std::int64_t now_ns);

  /// Returns address and port of a page.
  [[nodiscard]] std::string name_of(PageId page) const;
  /// Sends a text to a page, which shows it to its user. A newer text replaces one that was not sent yet.
  void notify(PageId page, const std::string& text);

  [[nodiscard]] std::uint16_t port() const;
  /// Number of connected pages.
  [[nodiscard]] std::size_t pages() const;
  /// True if a page could receive a message within the last second.
  [[nodiscard]] bool has_reader() const;

  struct Impl;

 private:
  std::unique_ptr<Impl> impl_;
};

}  // namespace tactus::viewer
