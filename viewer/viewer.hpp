/// Runs a viewer: joins a session, and serves the page that shows it to browsers. Or plays a recording to the same
/// page.
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>

#include "viewer/page_server.hpp"
#include "viewer/viewer_core.hpp"
#include "wire/participants.hpp"

namespace tactus::viewer {

struct ViewerOptions {
  wire::SessionAddress address;
  spm::PoolSettings pool;
  std::uint32_t faces = 0;  ///< ViewerSettings::faces
  ServerSettings server;
  std::function<void(const std::string&)> log;  ///< receives one line for each event
};

class Viewer {
 public:
  /// Reads the page, joins the session and listens. Throws ServerError and wire::WireError.
  explicit Viewer(ViewerOptions options);
  ~Viewer();
  Viewer(const Viewer&) = delete;
  Viewer& operator=(const Viewer&) = delete;

  [[nodiscard]] std::uint16_t port() const;
  /// Runs until `stop` is set or an older program has this viewer's name. Returns the exit status: 0, or 2 if the name
  /// is taken. The end of the session does not end the viewer, because another session of this name may begin.
  [[nodiscard]] int run(const std::atomic<bool>& stop);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

struct PlaybackOptions {
  std::filesystem::path file;  ///< a recording of `tactus record`
  spm::PoolSettings pool;
  std::uint32_t faces = 0;  ///< ViewerSettings::faces
  ServerSettings server;
  std::function<void(const std::string&)> log;  ///< receives one line for each event
};

/// Plays a recording until `stop` is set, without a session. Calls `on_open` once pages can connect. Returns the exit
/// status 0. Throws ServerError and trace::McapError.
[[nodiscard]] int play(const PlaybackOptions& options, const std::function<void(std::uint16_t port)>& on_open,
                       const std::atomic<bool>& stop);

}  // namespace tactus::viewer
