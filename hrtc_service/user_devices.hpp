/// Orders the source of each probe's poses, and owns the endpoints of devices at clients.
///
///     at a client, simulated here   intent          --> service's inbox --> DeviceLink::paths
///     at a client                   device_pose     --> (DDS)           --> DeviceLink::poses
///                                   device_command  <-- sender          <-- reports
///
/// The servo has the devices at this machine. The sender receives the devices at clients by a Handover. When a user has
/// left, the user's writer is destroyed as soon as the sender does not use it. Service thread, unless a comment names
/// another one.
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
#include "hrtc_service/handover.hpp"
#include "hrtc_service/servo/device_link.hpp"
#include "hrtc_service/servo/servo_link.hpp"
#include "session/messages.hpp"
#include "session/sequence_window.hpp"
#include "wire/endpoints.hpp"

namespace tactus::hrtc_service {

class UserDevices {
 public:
  using OnIntent = std::function<void(session::Intent&&)>;
  /// `on_intent` receives the intents of this HRTC's users, in threads of DDS. `participants`, `link` and the objects
  /// that `on_intent` uses must outlive this object.
  UserDevices(wire::Participants& participants, DeviceLink& link, OnIntent on_intent);
  ~UserDevices();

  /// Returns the ids of the users who have the probes, by probe; 0: none. Before the first `add`, these are the users
  /// of an earlier gateway.
  [[nodiscard]] static std::array<std::uint64_t, kMaxProbes> users_in(const DeviceLink& link);

  /// Adds a user whose device is at this machine.
  void add_local(std::uint32_t probe, const std::string& user);
  /// Adds a client's user: opens the endpoints of its intents and poses. If the user had the probe under an earlier
  /// gateway, its device continues without a break.
  void add(std::uint32_t probe, const std::string& user, std::uint64_t client);
  /// Removes a user: closes the endpoints, and orders that the probe has no device.
  void remove(std::uint32_t probe);

  /// Sets the path that a simulated hand follows. `ahead_ns`: local clock minus session time.
  void on_intent(const session::Intent& intent, std::int64_t ahead_ns);
  /// Orders that the servo uses the devices that have sent their first pose since the last call.
  void open_remote_devices();
  /// Removes the users of an earlier gateway who have not come back.
  void remove_earlier_users();
  /// Destroys the writers of users who have left, if the sender does not use them any more. Call it every few
  /// milliseconds.
  void free_departed();
  /// Returns the number of users who have left and whose writers still exist.
  [[nodiscard]] std::size_t departed_count() const noexcept { return departed_users_.size(); }
  [[nodiscard]] const ProbeOrders& orders() const noexcept { return orders_; }
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
    std::uint64_t number = 0;                                        // as in ProbeOrder::user
    std::unique_ptr<haptics::RemoteTiming> remote;                   // of a device at the client
    std::unique_ptr<wire::Writer<session::DeviceCommand>> commands;  // after the first pose
    std::unique_ptr<wire::Reader<session::Intent>> intents;
    std::unique_ptr<wire::Reader<session::DevicePose>> poses;  // declared last: its callback uses `remote`
  };
  /// A user who has left. `remotes`: number of the first list that does not name the user's device.
  struct DepartedUser {
    User user;
    std::uint64_t remotes = 0;
  };
  /// A remote device and its writer, for the sender.
  struct RemoteEndpoint {
    haptics::RemoteTiming* device = nullptr;  // null: this probe has none
    std::uint64_t user_id = 0;
    wire::Writer<session::DeviceCommand>* commands = nullptr;
  };
  using RemoteEndpoints = std::array<RemoteEndpoint, kMaxProbes>;

  void listen_to_device(std::uint32_t probe, User& user);
  void order(std::uint32_t probe, const ProbeOrder& order);

  wire::Participants& participants_;
  DeviceLink& link_;
  MailboxWriter<ProbeOrders> orders_out_;
  ProbeOrders orders_;  // at first those of an earlier gateway
  std::uint64_t users_added_ = 0;
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
