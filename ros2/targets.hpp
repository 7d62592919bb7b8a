/// Target poses from ROS: each topic /tactus/USER/target_pose with a publisher brings a user, whose hand follows it.
///
/// A user joins with the first target pose, and leaves when none has arrived for 2 s (viewer/pointed_users.hpp).
///
/// One thread at a time. Not realtime.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "ros2/messages.hpp"
#include "viewer/pointed_users.hpp"
#include "wire/ros2.hpp"

namespace tactus::ros2 {

/// Returns the user whose target poses a topic carries, as DDS names the topic; none for other topics.
[[nodiscard]] std::optional<std::string> target_user(const std::string& dds_topic);

/// Returns the fault of a target pose, or an empty text. `frame`: the world frame.
[[nodiscard]] std::string fault_of(const PoseStamped& target, const std::string& frame);

struct TargetSettings {
  std::string frame;  ///< name of the world frame; poses in other frames are refused
  std::string hrtc;   ///< HRTC that gives the probes; empty: the one with the fewest users
};

class Targets {
 public:
  static constexpr std::size_t kMaxTopics = 64;

  /// `users` and `domain` must outlive the targets, which set `users.on_refused`. `on_event` receives one line for each
  /// event.
  Targets(viewer::PointedUsers& users, wire::RosDomain& domain, TargetSettings settings,
          std::function<void(const std::string&)> on_event);

  /// Passes the newest target poses to the users. Call it every few milliseconds.
  void step(std::int64_t now_ns);

 private:
  struct Topic {
    std::string user;
    wire::RosReader reader;
    std::int64_t used_ns = 0;     // last time with a publisher
    std::int64_t refused_ns = 0;  // time of the last refusal; 0: none
    std::string report;           // last reported fault or refusal
    std::int64_t reported_ns = 0;
  };
  void add_topic(const wire::RosDomain::Discovered& writer, std::int64_t now_ns);
  void process(viewer::SourceId source, Topic& topic, std::int64_t now_ns);
  void report(Topic& topic, const std::string& text) const;

  viewer::PointedUsers& users_;
  wire::RosDomain& domain_;
  TargetSettings settings_;
  std::function<void(const std::string&)> on_event_;
  std::map<viewer::SourceId, Topic> topics_;  // by user id
  std::int64_t now_ns_ = 0;                   // of the last step
  std::vector<std::uint8_t> message_;
};

}  // namespace tactus::ros2
