/// The devices and endpoints of the users who have a probe here.
///
///     at this machine               LocalUser                                  --> Device
///     at a client, simulated here   intent          --> service's inbox        --> SimulatedDevice
///     at a client                   device_pose     --> (DDS)                  --> RemoteDevice
///                                   device_command  <-- sender <-- reports     <--
///
/// The haptic thread receives the devices in its commands, the sender receives those at clients by a Handover. The
/// devices of a user who has left are destroyed once neither thread uses them. Service thread, except where a comment
/// says otherwise.
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
  /// `on_intent` receives the intents of users here, in threads of DDS. `participants`, `orders` and the references in
  /// `on_intent` must outlive this.
  UserDevices(wire::Participants& participants, HapticOrders& orders, OnIntent on_intent);
  ~UserDevices();

  /// Adds a user whose device is at this machine.
  void add_local(std::uint32_t probe, const std::string& user, std::unique_ptr<haptics::Device> device);
  /// Adds a client's user: opens the endpoints of its intents and poses.
  void add(std::uint32_t probe, const std::string& user, std::uint64_t client);
  /// Removes a user: closes the endpoints and takes the device from the haptic thread.
  void remove(std::uint32_t probe);

  /// Sets the path that a user requests of a simulated hand. `ahead_ns`: our clock minus session time.
  void on_intent(const session::Intent& intent, std::int64_t ahead_ns);
  /// Passes to the haptic thread the devices that have sent their first pose since the last call.
  void open_remote_devices();
  /// Destroys the devices of users who have left, when no thread uses them any more. Call it at times.
  void free_left();
  /// Users whose devices are not destroyed yet.
  [[nodiscard]] std::size_t left() const noexcept { return left_.size(); }
  /// Sets session time minus our clock for later poses.
  void on_clock(std::int64_t session_offset_ns) noexcept { session_offset_ns_ = session_offset_ns; }

  void write(std::vector<session::Figure>& figures) const;
  /// Device poses dropped because their origin or number is outside its window; any thread.
  [[nodiscard]] std::uint64_t implausible() const noexcept { return implausible_.load(std::memory_order_relaxed); }

  /// Any thread: 0 where there is no user.
  [[nodiscard]] std::uint64_t user_at(std::uint32_t probe) const noexcept {
    return user_ids_[probe].load(std::memory_order_relaxed);
  }
  /// Sender's thread: sends the haptic thread's report of its last cycle to the devices at clients. Takes no lock.
  void send_commands(const ProbeReports& latest);

 private:
  struct User {
    std::string name;
    std::uint64_t id = 0;
    std::uint64_t client = 0;                                        // participant; 0: a device of our own
    std::unique_ptr<haptics::Device> own;                            // at this machine
    std::unique_ptr<haptics::SimulatedDevice> hand;                  // once it has an intent
    std::unique_ptr<haptics::RemoteDevice> remote;                   // receives its poses, if it sends any
    std::unique_ptr<wire::Writer<session::DeviceCommand>> commands;  // once it has
    std::unique_ptr<wire::Reader<session::Intent>> intents;
    std::unique_ptr<wire::Reader<session::DevicePose>> poses;  // last, so that no callback outlives what it fills
  };
  /// A user who has left; `orders` and `remotes` are the first without its devices.
  struct Left {
    User user;
    std::uint64_t orders = 0, remotes = 0;
  };
  /// Where the forces of a remote device go, for the sender.
  struct RemoteEnd {
    haptics::RemoteDevice* device = nullptr;  // null: this probe has none
    std::uint64_t user_id = 0;
    wire::Writer<session::DeviceCommand>* commands = nullptr;
  };
  using RemoteEnds = std::array<RemoteEnd, kMaxProbes>;

  void listen_to_device(User& user);
  void give_device(std::uint32_t probe, haptics::Device* device);

  wire::Participants& participants_;
  HapticOrders& orders_;
  OnIntent on_intent_;
  std::array<std::atomic<std::uint64_t>, kMaxProbes> user_ids_{};
  std::atomic<std::int64_t> session_offset_ns_{0};
  std::atomic<std::uint64_t> implausible_{0};
  RemoteEnds remote_ends_;
  Handover<RemoteEnds> remote_ends_out_;  // to the sender
  std::vector<Left> left_;
  std::map<std::uint32_t, User> users_;  // by slot; last, so that no callback outlives what it fills
};

}  // namespace tactus::hrtc_service
