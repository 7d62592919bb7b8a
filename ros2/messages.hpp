/// The ROS messages that Tactus sends and receives, as structs for trace/cdr.hpp. idl/ros2.idl has the same types.
///
/// The hash of a type is that of REP 2016 over its description, for the definitions since ROS 2 Humble. tests/ros2
/// recomputes it. Metres, newton, seconds; unit quaternions x, y, z, w.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "wire/ros2.hpp"

namespace tactus::ros2 {

struct Time {
  std::int32_t sec = 0;  ///< since 1970
  std::uint32_t nanosec = 0;
  [[nodiscard]] static Time from_ns(std::int64_t since_1970_ns) noexcept {
    constexpr std::int64_t kSecond = 1'000'000'000;
    return {static_cast<std::int32_t>(since_1970_ns / kSecond), static_cast<std::uint32_t>(since_1970_ns % kSecond)};
  }
  template <class Self, class Visit>
  static void fields(Self& self, Visit&& visit) {
    visit(self.sec), visit(self.nanosec);
  }
};

struct Header {
  Time stamp;
  std::string frame_id;
  template <class Self, class Visit>
  static void fields(Self& self, Visit&& visit) {
    visit(self.stamp), visit(self.frame_id);
  }
};

struct Pose {
  std::array<double, 3> position{0, 0, 0};
  std::array<double, 4> orientation{0, 0, 0, 1};
  template <class Self, class Visit>
  static void fields(Self& self, Visit&& visit) {
    visit(self.position), visit(self.orientation);
  }
};

struct PoseStamped {
  static constexpr wire::RosType kType{"geometry_msgs::msg::dds_::PoseStamped_",
                                       "RIHS01_10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8"};
  Header header;
  Pose pose;
  template <class Self, class Visit>
  static void fields(Self& self, Visit&& visit) {
    visit(self.header), visit(self.pose);
  }
};

struct WrenchStamped {
  static constexpr wire::RosType kType{"geometry_msgs::msg::dds_::WrenchStamped_",
                                       "RIHS01_8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77"};
  Header header;
  std::array<double, 3> force{0, 0, 0}, torque{0, 0, 0};
  template <class Self, class Visit>
  static void fields(Self& self, Visit&& visit) {
    visit(self.header), visit(self.force), visit(self.torque);
  }
};

struct TwistStamped {
  static constexpr wire::RosType kType{"geometry_msgs::msg::dds_::TwistStamped_",
                                       "RIHS01_5f0fcd4f81d5d06ad9b4c4c63e3ea51b82d6ae4d0558f1d475229b1121db6f64"};
  Header header;
  std::array<double, 3> linear{0, 0, 0}, angular{0, 0, 0};
  template <class Self, class Visit>
  static void fields(Self& self, Visit&& visit) {
    visit(self.header), visit(self.linear), visit(self.angular);
  }
};

/// The pose of a child frame in the frame of the header.
struct TransformStamped {
  Header header;
  std::string child_frame_id;
  Pose pose;
  template <class Self, class Visit>
  static void fields(Self& self, Visit&& visit) {
    visit(self.header), visit(self.child_frame_id), visit(self.pose);
  }
};

struct TfMessage {
  static constexpr wire::RosType kType{"tf2_msgs::msg::dds_::TFMessage_",
                                       "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087"};
  std::vector<TransformStamped> transforms;
  template <class Self, class Visit>
  static void fields(Self& self, Visit&& visit) {
    visit(self.transforms);
  }
};

using Color = std::array<float, 4>;  ///< red, green, blue, opacity: 0 to 1

/// A list of triangles. The other fields of visualization_msgs/Marker are no members here, because Tactus does not use
/// them: `fields` writes them empty.
struct Marker {
  enum class Action : std::int32_t { kAdd = 0, kDelete = 2 };
  Header header;
  std::string ns;  ///< together with the id, the name of a marker
  std::int32_t id = 0;
  Action action = Action::kAdd;
  std::array<double, 3> scale{1, 1, 1};       ///< of the points
  std::vector<std::array<double, 3>> points;  ///< three for each triangle
  std::vector<Color> colors;                  ///< one for each point
  template <class Self, class Visit>
  static void fields(Self& self, Visit&& visit) {
    const std::int32_t type = 11;  // TRIANGLE_LIST
    const auto action = static_cast<std::int32_t>(self.action);
    const Pose pose;
    const Color color{1, 1, 1, 1};
    const std::array<std::uint32_t, 2> lifetime{0, 0};  // zero: until the marker is replaced or deleted
    const bool moves_with_frame = true, has_embedded_materials = false;
    const std::string none;
    const std::vector<std::uint8_t> no_bytes;
    visit(self.header), visit(self.ns), visit(self.id), visit(type), visit(action), visit(pose), visit(self.scale);
    visit(color), visit(lifetime), visit(moves_with_frame), visit(self.points), visit(self.colors);
    visit(none);                                    // texture_resource
    visit(Header{}), visit(none), visit(no_bytes);  // texture
    visit(no_bytes);                                // uv_coordinates
    visit(none), visit(none);                       // text, mesh_resource
    visit(none), visit(no_bytes);                   // mesh_file
    visit(has_embedded_materials);
  }
};

struct MarkerArray {
  static constexpr wire::RosType kType{"visualization_msgs::msg::dds_::MarkerArray_",
                                       "RIHS01_86cb8800b6fb05b5eff1abd7a56f62a5641d3ae9a1c29e78e67e704f1d067dcf"};
  std::vector<Marker> markers;
  template <class Self, class Visit>
  static void fields(Self& self, Visit&& visit) {
    visit(self.markers);
  }
};

}  // namespace tactus::ros2
