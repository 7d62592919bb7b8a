#include "haptics/device.hpp"

#include <cmath>

namespace tactus::haptics {

void check(const DeviceSpec& spec, const std::string& library) {
  const auto is_wrong = [&](double value, const char* what, const char* expected) {
    throw DeviceError("device driver " + library + ": " + what + ": found " + std::to_string(value) + ", expected " +
                      expected);
  };
  const auto check_positive = [&](double value, const char* what) {
    if (!(std::isfinite(value) && value > 0)) is_wrong(value, what, "a number above 0");
  };
  if (!(std::isfinite(spec.max_torque) && spec.max_torque >= 0))
    is_wrong(spec.max_torque, "max_torque", "a number that is not below 0");
  check_positive(spec.max_force, "max_force");
  check_positive(spec.max_stiffness, "max_stiffness");
  check_positive(spec.damping, "damping");
  check_positive(spec.workspace_radius, "workspace_radius");
  check_positive(spec.max_rotational_stiffness, "max_rotational_stiffness");
}

}  // namespace tactus::haptics
