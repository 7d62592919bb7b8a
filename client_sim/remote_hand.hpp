/// A simulated user's hand on a device of its own: it sends poses to its HRTC and applies the commands that come back.
///
///     paths --> simulated device --> device_pose (1 kHz) --> HRTC
///                      ^ force <------- device_command <------'
///
/// A thread of its own keeps the rate. A force without a new command is held for 10 ms and reaches zero at 60 ms.
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
  std::string hrtc;  ///< commands of this HRTC are accepted
  double radius = 0.003;
  double rate = 1000;  ///< Hz of poses
  haptics::HandSettings hand;
};

class RemoteHand {
 public:
  /// `participants` must outlive it. Throws wire::WireError.
  RemoteHand(wire::Participants& participants, const RemoteHandSettings& settings);
  ~RemoteHand();

  /// The hand's target from now on, and the session clock's map. One thread.
  void set_intent(const session::Intent& intent, const session::ClockMap& map);
  /// Commands dropped because their number is outside its window. Any thread.
  [[nodiscard]] std::uint64_t implausible() const noexcept { return implausible_.load(std::memory_order_relaxed); }

 private:
  /// The newest command.
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
  session::SenderWindow commands_seen_{session::kCycleNumbers};  // used by the reader
  std::atomic<std::uint64_t> implausible_{0};
  wire::Writer<session::DevicePose> poses_;
  wire::Reader<session::DeviceCommand> commands_;
  std::atomic<bool> running_{true};
  std::thread thread_;
};

}  // namespace tactus::client_sim
