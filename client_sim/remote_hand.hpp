/// Simulates a user's hand on a device at the client: sends its poses to the HRTC and applies the commands of the HRTC.
///
///     paths --> simulated device --> device_pose (1 kHz) --> HRTC
///                      ^ force <------- device_command <------'
///
/// A thread of this class sends the poses. If no new command arrives, the force is constant until 10 ms after the last
/// command, and then falls linearly to zero at 60 ms.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <thread>

#include "haptics/mailbox.hpp"
#include "haptics/simulated_device.hpp"
#include "session/clock.hpp"
#include "session/sequence_window.hpp"
#include "wire/endpoints.hpp"

namespace tactus::client_sim {

struct RemoteHandSettings {
  std::string user;
  std::string hrtc;       ///< only commands of this HRTC are accepted
  double radius = 0.003;  ///< m, of the tip
  double rate = 1000;     ///< Hz, of poses
  haptics::HandSettings hand;
};

class RemoteHand {
 public:
  /// `participants` must outlive this object. Throws wire::WireError.
  RemoteHand(wire::Participants& participants, const RemoteHandSettings& settings);
  ~RemoteHand();

  /// Sets the path of the hand from now on, and the map from the local clock to session time. One thread.
  void set_intent(const session::Intent& intent, const session::ClockMap& map);
  /// Returns the number of commands that were dropped because their sequence number was not plausible. Any thread.
  [[nodiscard]] std::uint64_t implausible() const noexcept { return implausible_.load(std::memory_order_relaxed); }

 private:
  struct ReceivedCommand {
    std::array<double, 3> force{}, torque{};
    std::uint32_t sequence = 0;
    std::int64_t arrived_ns = 0;
  };

  void on_command(const session::DeviceCommand& command);
  void run();

  wire::Participants& participants_;
  RemoteHandSettings settings_;
  std::uint64_t user_id_, hrtc_id_;
  haptics::SimulatedDevice device_;
  haptics::Mailbox<session::ClockMap> clock_;
  haptics::Mailbox<ReceivedCommand> command_;
  session::SenderWindow commands_seen_{session::kCycleNumbers};  // used in the thread of `commands_`
  std::atomic<std::uint64_t> implausible_{0};
  wire::Writer<session::DevicePose> poses_;
  wire::Reader<session::DeviceCommand> commands_;
  std::atomic<bool> running_{true};
  std::thread thread_;
};

}  // namespace tactus::client_sim
