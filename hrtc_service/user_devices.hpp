/// Manages the devices of this HRTC's users, and the endpoints of devices at clients.
///
///     at this machine               LocalUser                                  --> Device
///     at a client, simulated here   intent          --> service's inbox        --> SimulatedDevice
///     at a client                   device_pose     --> (DDS)                  --> RemoteDevice
///                                   device_command  <-- sender <-- reports     <--
///
/// The haptic thread receives all devices in its commands. The sender receives the devices at clients by a Handover.
/// When a user has left, the user's devices are destroyed as soon as neither thread uses them. Service thread, unless a
/// comment names another one.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "haptics/remote_device.hpp"
#include "haptics/simulated_device.hpp"
#include "hrtc_service/handover.hpp"
#include "hrtc_service/haptic_thread.hpp"
#include "session/messages.hpp"
#include "session/sequence_window.hpp"
#include "wire/endpoints.hpp"

namespace tactus::hrtc_service {

class UserDevices {
 public:
  using OnIntent = std::function<void(session::Intent&&)>;
  /// `on_intent` receives the intents of this HRTC's users, in threads of DDS. `participants`, `orders` and the objects
  /// that `on_intent` uses must outlive this object.
  UserDevices(wire::Participants& participants, HapticCommandPoster& orders, OnIntent on_intent);
  ~UserDevices();

  /// Adds a user whose device is at this machine.
  void add_local(std::uint32_t probe, const std::string& user, std::unique_ptr<haptics::Device> device);
  /// Adds a client's user: opens the endpoints of its intents and poses.
  void add(std::uint32_t probe, const std::string& user, std::uint64_t client);
  /// Removes a user: closes the endpoints, and commands the haptic thread to stop using the device.
  void remove(std::uint32_t probe);

  /// Sets the path that a simulated hand follows. `ahead_ns`: local clock minus session time.
  void on_intent(const session::Intent& intent, std::int64_t ahead_ns);
  /// Passes to the haptic thread the devices that have sent their first pose since the last call.
  void open_remote_devices();
  /// Destroys the devices of users who have left, if no thread uses them any more. Call it every few milliseconds.
  void free_departed();
  /// Returns the number of users who have left and whose devices still exist.
  [[nodiscard]] std::size_t departed_count() const noexcept { return departed_users_.size(); }
  /// Sets the offset for later poses: session time minus local clock.
  void on_clock(std::int64_t session_offset_ns) noexcept { session_offset_ns_ = session_offset_ns; }

  void add_figures(std::vector<session::Figure>& figures) const;
  /// Returns the number of device poses that were dropped outside their plausible windows. Any thread.
  [[nodiscard]] std::uint64_t implausible() const noexcept { return implausible_.load(std::memory_order_relaxed); }

  /// Returns the id of the probe's user, or 0. Any thread.
  [[nodiscard]] std::uint64_t user_at(std::uint32_t probe) const noexcept {
    return user_ids_[probe].load(std::memory_order_relaxed);
  }
  /// Sends the forces of the last cycle to the devices at clients. Sender thread. Takes no lock.
  void send_commands(const ProbeReports& latest);

 private:
  struct User {
    std::string name;
    std::uint64_t id = 0;
    std::uint64_t client = 0;                                        // participant; 0: the device is at this machine
    std::unique_ptr<haptics::Device> local_device;                   // device at this machine
    std::unique_ptr<haptics::SimulatedDevice> hand;                  // after its first intent
    std::unique_ptr<haptics::RemoteDevice> remote;                   // receives the poses of a device at the client
    std::unique_ptr<wire::Writer<session::DeviceCommand>> commands;  // after the first pose
    std::unique_ptr<wire::Reader<session::Intent>> intents;
    std::unique_ptr<wire::Reader<session::DevicePose>> poses;  // declared last: its callback uses `remote`
  };
  /// A user who has left. `orders` and `remotes`: numbers of the first lists that do not name the user's devices.
  struct DepartedUser {
    User user;
    std::uint64_t orders = 0, remotes = 0;
  };
  /// A remote device and its writer, for the sender.
  struct RemoteEndpoint {
    haptics::RemoteDevice* device = nullptr;  // null: this probe has none
    std::uint64_t user_id = 0;
    wire::Writer<session::DeviceCommand>* commands = nullptr;
  };
  using RemoteEndpoints = std::array<RemoteEndpoint, kMaxProbes>;

  void listen_to_device(User& user);
  void set_device(std::uint32_t probe, haptics::Device* device);

  wire::Participants& participants_;
  HapticCommandPoster& orders_;
  OnIntent on_intent_;
  std::array<std::atomic<std::uint64_t>, kMaxProbes> user_ids_{};
  std::atomic<std::int64_t> session_offset_ns_{0};
  std::atomic<std::uint64_t> implausible_{0};
  RemoteEndpoints remote_endpoints_;
  Handover<RemoteEndpoints> remote_endpoints_out_;  // to the sender
  std::vector<DepartedUser> departed_users_;
  // By probe. Declared last, so that callbacks end before the members that they use are destroyed.
  std::map<std::uint32_t, User> users_;
};

}  // namespace tactus::hrtc_service
