/// A servo whose memory that the gateway can write is damaged while it touches a fixed and a movable object. The servo
/// may then lose objects and users, but never exceeds its limits or reads other memory, which AddressSanitizer checks.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstring>
#include <span>
#include <vector>

#include "hrtc_service/servo/probe_devices.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "tests/support/local_session.hpp"

namespace tactus::test_support {

class DamagedLink {
 public:
  DamagedLink() {
    hrtc_service::ProbeInput& second = session_.inputs()[1];
    second.active = true;
    second.device.position = tip_ + spm::Vec3d{1, 0, 0};  // at the movable object
    for (int cycle = 0; cycle < 1000; ++cycle) session_.step(tip_, spm::Vec3d::Zero());
    session_.has_gateway = false;
    hrtc_service::ProbeOrders orders{};
    for (std::uint32_t i = 1; i < hrtc_service::kMaxProbes; ++i) {
      const auto source = i % 2 == 0 ? hrtc_service::PoseSource::kRemote : hrtc_service::PoseSource::kHand;
      orders[i] = {.source = source, .user = i, .start = {1 + tip_.x(), 0, 0}};
    }
    hrtc_service::MailboxWriter{link().devices.orders}.post(orders);
    valid_.resize(sizeof(hrtc_service::ServoLink));
    std::memcpy(valid_.data(), static_cast<const void*>(&link()), valid_.size());
  }

  /// Number of bytes that can be damaged.
  [[nodiscard]] std::size_t size() const noexcept { return valid_.size(); }
  /// Replaces the bytes from `offset`; those beyond the end are ignored.
  void damage(std::size_t offset, std::span<const std::byte> bytes) noexcept {
    if (offset >= size()) return;
    std::memcpy(reinterpret_cast<std::byte*>(&link()) + offset, bytes.data(), std::min(bytes.size(), size() - offset));
  }
  /// Makes all values valid again, as a new gateway that attaches: the intake then reads messages again.
  void restore() {
    std::memcpy(static_cast<void*>(&link()), valid_.data(), valid_.size());
    link().intake.attach_requests = ++attach_requests_;
  }

  /// Runs a cycle as the servo's threads do. Returns whether all forces and torques are within the limits.
  [[nodiscard]] bool run_cycle() {
    now_ns_ += 1'000'000;
    session_.core().tick_servo();
    devices_.read(now_ns_, inputs_);
    hrtc_service::Servo& servo = session_.core().servo();
    const hrtc_service::Servo::Outputs outputs = servo.touch(inputs_, now_ns_);
    devices_.write(outputs);
    servo.publish(now_ns_, now_ns_ + 1'000'000);
    (void)servo.refine(spm::Budget{4000});
    bool is_within = true;
    for (std::uint32_t i = 0; i < hrtc_service::kMaxProbes; ++i) {
      const double force = Eigen::Map<const spm::Vec3d>{outputs[i].force.data()}.norm();
      const double torque = Eigen::Map<const spm::Vec3d>{outputs[i].torque.data()}.norm();
      if (force > 0) ++forces_[i];
      is_within &= force <= limits_.max_force * 1.000001 && torque <= limits_.max_torque * 1.000001;
    }
    return is_within;
  }
  /// Number of cycles in which a probe had a force. Probe 0 is at the fixed object, probe 1 at the movable one.
  [[nodiscard]] int forces(std::uint32_t probe) const noexcept { return forces_[probe]; }

 private:
  [[nodiscard]] hrtc_service::ServoLink& link() { return session_.core().link(); }

  const spm::offline::BuiltModel built_ =
      spm::offline::build_model(spm::offline::generate(spm::offline::Shape::kSphere, 4000));
  const spm::Model model_ = built_.model();
  const spm::Vec3d tip_{model_.summary.bounds_max[0] + 0.0025, 0, 0};
  LocalSession session_{{model_, model_}, 1, spm::PoolSettings::for_slots(3 * model_.summary.parts), 2, {}, {}, 0.8};
  const haptics::ForceSettings limits_ = LocalSession::cycle_settings().force;
  haptics::SimulatedDevice hand_{{.start = tip_}};
  hrtc_service::ProbeDevices devices_{session_.core().link().devices, {&hand_}, haptics::DeviceFrame{}};
  hrtc_service::Servo::Inputs inputs_;
  std::vector<std::byte> valid_;
  std::uint32_t attach_requests_ = 1000;  // larger than those of the gateway
  std::int64_t now_ns_ = 10'000'000'000;
  std::array<int, hrtc_service::kMaxProbes> forces_{};
};

}  // namespace tactus::test_support
