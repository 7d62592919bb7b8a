/// Poses of users at clients, from the gateway to the servo.
///
///     gateway                                                    servo
///     UserDevices -- orders: where a probe's poses come from --> ProbeDevices
///                 -- paths of simulated hands ----------------->
///                 -- poses of devices at clients -------------->
///
/// Devices at this machine belong to the servo, so nothing about them crosses. Plain values only.
#pragma once

#include <array>
#include <cstdint>

#include "haptics/remote_device.hpp"
#include "haptics/simulated_device.hpp"
#include "hrtc_service/servo/shared_mailbox.hpp"
#include "hrtc_service/servo/touch_object.hpp"

namespace tactus::hrtc_service {

enum class PoseSource : std::uint32_t {
  kNone,   ///< no user, or a user whose first pose has not arrived
  kHand,   ///< a simulated hand, which follows paths
  kRemote  ///< a device at a client
};

/// Order for one probe.
struct ProbeOrder {
  PoseSource source = PoseSource::kNone;
  std::uint32_t seed = 1;                         ///< of a simulated hand's tremor
  std::uint64_t user = 0;                         ///< number of the user; a later user of the probe has a larger one
  std::uint64_t user_id = 0;                      ///< id_of that user, for a later gateway; 0: none
  std::array<double, 3> start{};                  ///< position of a simulated hand until its first path, world, m
  std::array<double, 4> orientation{0, 0, 0, 1};  ///< of that hand, unit quaternion x, y, z, w
};
using ProbeOrders = std::array<ProbeOrder, kMaxProbes>;

struct UserPath {
  std::uint64_t user = 0;  ///< as in ProbeOrder
  haptics::HandPath path;
};
struct UserPose {
  std::uint64_t user = 0;  ///< as in ProbeOrder
  haptics::TimedPose pose;
};

struct DeviceLink {
  SharedMailbox<ProbeOrders> orders;
  std::array<SharedMailbox<UserPath>, kMaxProbes> paths;  ///< by probe
  std::array<SharedMailbox<UserPose>, kMaxProbes> poses;  ///< by probe
};

}  // namespace tactus::hrtc_service
