/// A viewer's part in a session: a ViewerCore with its endpoints, and a participant for each pointed user. The programs
/// `tactus view` and `tactus ros2` each add an output: pages, or topics of ROS.
///
/// One thread at a time.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <string>

#include "viewer/pointed_users.hpp"
#include "viewer/viewer_core.hpp"
#include "wire/participants.hpp"

namespace tactus::viewer {

struct ParticipantOptions {
  wire::SessionAddress address;
  ViewerSettings settings;  ///< the names of participant and session are those of the address
  std::string source;       ///< word for a source of targets in messages, for example "page"
};

class ViewerParticipant {
 public:
  /// Joins the session. Throws wire::WireError.
  explicit ViewerParticipant(const ParticipantOptions& options);
  ~ViewerParticipant();
  ViewerParticipant(const ViewerParticipant&) = delete;
  ViewerParticipant& operator=(const ViewerParticipant&) = delete;

  [[nodiscard]] ViewerCore& core() noexcept;
  [[nodiscard]] PointedUsers& users() noexcept;

  /// From now on, loads the meshes of the objects. Before, no host and no HRTC sends any.
  void load_meshes();

  /// Waits at most `timeout` for samples and applies them. Sends what is due.
  void step(std::chrono::microseconds timeout);
  /// All pointed users and this participant leave. Blocks for 30 ms.
  void leave();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tactus::viewer
