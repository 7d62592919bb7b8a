/// Chooses the device of each probe, reads the devices and writes their forces.
///
///     devices at this machine ---------------------------+
///     DeviceLink::paths --> simulated hand of the probe -+--> ProbeInput of the cycle
///     DeviceLink::poses --> newest pose -----------------+
///     DeviceLink::orders --> selects one of them
///
/// A probe with a device at this machine always has this device. The orders decide about the others. This class trusts
/// nothing in the link: a wrong order means no device, and it ignores a wrong path or pose.
///
/// Haptic thread. Realtime.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "haptics/device.hpp"
#include "hrtc_service/servo/device_link.hpp"
#include "hrtc_service/servo/probe.hpp"

namespace tactus::hrtc_service {

/// Devices at this machine, by probe. Null: the probe has none.
using LocalDevices = std::array<haptics::Device*, kMaxProbes>;

/// Limits of the forces that are written to devices at this machine. The limits of haptics/force.hpp are for forces in
/// the world, which the frame of the devices multiplies by its scale.
struct HandLimits {
  double max_force = 8;    ///< N, in the device's frame
  double max_slew = 5000;  ///< N/s, in the device's frame
  double max_speed = 1.5;  ///< m/s, of the device while a force acts; a faster device has failed
  double rise_time = 0.1;  ///< s, from zero to full strength after the clutch
  double period = 0.001;   ///< s, of cycles
};

class ProbeDevices {
 public:
  /// `frame` and `limits` are for the devices at this machine. `link` and the devices must outlive this object.
  ProbeDevices(DeviceLink& link, const LocalDevices& local, const haptics::DeviceFrame& frame,
               const HandLimits& limits = {});

  /// Obeys new orders, and sets the state of each probe's device in `inputs`. If an order replaces a user by another
  /// one, the probe is inactive once, so that the cycle resets it.
  void read(std::int64_t now_ns, std::array<ProbeInput, kMaxProbes>& inputs) noexcept;
  /// Writes forces and torques to devices at this machine and simulated hands. The gateway sends those of devices at
  /// clients.
  void write(const std::array<ProbeOutput, kMaxProbes>& outputs) noexcept;
  /// Writes zero forces.
  void release() noexcept;

 private:
  struct Probe {
    Probe(DeviceLink& link, std::uint32_t number, haptics::Device* local_device,
          const haptics::DeviceFrame& local_frame)
        : local{local_device}, frame{local_frame}, paths{link.paths[number]}, poses{link.poses[number]} {}

    haptics::Device* local;
    haptics::DeviceFrame frame;     // of `local`
    double strength = 1;            // share of the force that `local` gets: below 1 after the clutch
    Vec3d written = Vec3d::Zero();  // N, force that `local` has got
    ProbeOrder order;               // in force
    std::optional<haptics::SimulatedDevice> hand;
    MailboxReader<UserPath> paths;
    MailboxReader<UserPose> poses;
    UserPath path;              // newest
    bool is_path_new = false;   // the hand has not received `path`
    haptics::DeviceState pose;  // newest valid one of a device at a client
    bool has_pose = false;      // of the user in `order`
  };
  [[nodiscard]] bool obey(Probe& probe, const ProbeOrder& order) noexcept;
  void take_path(Probe& probe) noexcept;
  void take_pose(Probe& probe, std::int64_t now_ns) noexcept;
  void read_local(Probe& probe, std::int64_t now_ns, ProbeInput& input) const noexcept;
  void write_local(Probe& probe, const ProbeOutput& output) const noexcept;

  HandLimits limits_;
  MailboxReader<ProbeOrders> orders_;
  std::array<Probe, kMaxProbes> probes_;
};

}  // namespace tactus::hrtc_service
