/// Names of users and objects as parts of ROS names. ROS allows letters, digits and single `_`; a part does not begin
/// with a digit, and with `_` it would be hidden.
///
/// Other bytes become `qx_` and two hexadecimal digits: user "ann 2" has the topics /tactus/annqx_202/. A `q` that would
/// look like the beginning of such a group is written the same way, so two names never become equal.
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace tactus::ros2 {

/// `name`: not empty.
[[nodiscard]] std::string ros_name(std::string_view name);

/// Returns the name of which `ros_name` makes `part`; none if there is no such name.
[[nodiscard]] std::optional<std::string> name_of(std::string_view part);

}  // namespace tactus::ros2
