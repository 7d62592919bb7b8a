/// Publishes the state of a session in a ROS domain: wrench, poses and twist of each user, poses of objects as
/// transforms, and meshes as markers (docs/how-to/ros2.md).
///
/// One thread at a time. Not realtime.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <map>
#include <set>
#include <string>

#include "ros2/messages.hpp"
#include "session/messages.hpp"
#include "session/periodic.hpp"
#include "trace/cdr.hpp"
#include "viewer/viewer_core.hpp"
#include "wire/ros2.hpp"

namespace tactus::ros2 {

/// The messages of one user for one time.
struct UserMessages {
  WrenchStamped wrench;  ///< force on the user's hand; the torque is 0, because probe states have none
  PoseStamped device;
  PoseStamped proxy;   ///< with the orientation of the device
  TwistStamped twist;  ///< of the device; the angular velocity is 0, because probe states have none
};
/// Extrapolates a probe state to a session time; `header` is that of the messages.
[[nodiscard]] UserMessages messages_of(const session::ProbeState& state, std::int64_t session_time_ns,
                                       const Header& header);

/// The shown faces of an object in its frame `frame`: orange at full resolution, otherwise blue.
[[nodiscard]] Marker marker_of(const viewer::SeenObject& object, const std::string& frame);

/// Name of the frame of an object.
[[nodiscard]] std::string frame_of(const session::CatalogueEntry& object);

class Publisher {
 public:
  /// A probe is not published if its newest state is older than this. HRTCs send a state at least every 40 ms.
  static constexpr std::int64_t kMaxStateAgeNs = 200'000'000;
  /// Max number of users with topics.
  static constexpr std::size_t kMaxUsers = 64;

  /// `core` and `domain` must outlive the publisher. `frame`: name of the world frame. `on_event` receives one line for
  /// each event. Throws wire::WireError.
  Publisher(const viewer::ViewerCore& core, wire::RosDomain& domain, std::string frame,
            std::function<void(const std::string&)> on_event);

  /// Publishes probes and poses, and meshes that changed if they are due. `since_1970_ns`: stamp of the messages.
  void publish(std::int64_t now_ns, std::int64_t since_1970_ns);

  /// Returns whether a reader of the markers exists.
  [[nodiscard]] bool wants_meshes() const { return markers_.matched() > 0; }

 private:
  struct UserTopics {
    wire::RosWriter wrench, device, proxy, twist;
  };
  [[nodiscard]] UserTopics* topics_of(std::uint64_t user);
  void update_names();
  void publish_probes(std::int64_t now_ns, const Header& header);
  void publish_transforms(std::int64_t now_ns, const Header& header);
  void publish_markers();
  template <class Message>
  void send(wire::RosWriter& writer, const Message& message);

  const viewer::ViewerCore& core_;
  wire::RosDomain& domain_;
  std::string frame_;
  std::function<void(const std::string&)> on_event_;
  trace::CdrWriter encoder_;
  std::uint32_t scene_number_ = 0;              // of the core, when `names_` was made
  std::map<std::uint64_t, std::string> names_;  // of served users, by id
  std::map<std::uint64_t, UserTopics> users_;   // by user id
  std::set<std::uint64_t> refused_;             // users without topics, reported
  wire::RosWriter transforms_, markers_;
  session::PeriodicTimer all_transforms_, markers_due_;
  std::map<std::uint64_t, session::Pose> sent_poses_;  // by object
  std::map<std::string, std::uint32_t> sent_meshes_;   // by frame of the object: ShownMesh::change_number
  int marker_matches_ = 0;                             // at the last publication
};

}  // namespace tactus::ros2
