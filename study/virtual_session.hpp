/// A session of a host and an HRTC over an emulated link, with the users of a scenario, in virtual time.
///
///     host [HostCore] --records, roster entries--> link --> [HrtcCore] <- [hand] <- [Operator]
///                     <--------- demands --------- link <--     |             local: at the HRTC
///                                                               +-- link --> [hand] <- [Operator]
///                                                                            remote: over a link of its own
///
/// Runs the code of the programs without threads, sockets, clocks and discovery, so the load of the machine has no
/// effect. The haptic cycle runs every millisecond, the loader every 2 ms, and the host sends every 0.25 ms. The object
/// that users touch is at the origin, not rotated, in metres. The same settings give the same run to the bit. One
/// thread at a time.
#pragma once

#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "client_sim/operator.hpp"
#include "haptics/remote_device.hpp"
#include "haptics/simulated_device.hpp"
#include "host_service/host_core.hpp"
#include "hrtc_service/hrtc_core.hpp"
#include "hrtc_service/membership.hpp"
#include "session/sequence_window.hpp"
#include "study/subject.hpp"
#include "study/virtual_link.hpp"

namespace tactus::study {

struct SessionSettings {
  netem::LinkSettings link;        ///< `a_to_b` is from host and remote users to the HRTC
  std::uint64_t seed = 1;          ///< of losses, delays and the tremor of the hands
  std::uint32_t slots = 1 << 16;   ///< pool slots of the HRTC; the default of tactus-hrtc
  std::uint32_t budget = 1 << 14;  ///< refinement of a cycle, in units of spm::Budget
  session::Material material;
  hrtc_service::CycleSettings cycle;  ///< all users have the tool `cycle.tool`; null: tips

  /// Limits of each hand's device. The device exerts torques only if there is a tool.
  [[nodiscard]] haptics::DeviceSpec device_spec() const {
    haptics::DeviceSpec spec;
    if (cycle.tool != nullptr) spec.max_torque = cycle.force.max_torque;
    return spec;
  }
};

/// One millisecond of a hand.
struct Felt {
  haptics::DeviceState device;  ///< world frame
  haptics::Wrench wrench;       ///< wrench on the device
  bool exact = false;           ///< the contact was exact; a remote hand has the value of its last received command
};

class VirtualSession {
 public:
  /// `subject` must outlive this. The scenario has one to kMaxProbes users. All tips have the radius of the first
  /// user's tip.
  VirtualSession(const Subject& subject, const client_sim::Scenario& scenario, const SessionSettings& settings);
  ~VirtualSession();

  /// Runs until the base mesh has been shown for one second, then starts the users. Throws std::runtime_error if the
  /// base mesh is not shown within a minute.
  void settle();
  /// Starts the users at once, before any data has arrived.
  void start_users() noexcept { users_act_ = true; }
  /// Advances by one millisecond.
  void step();

  /// Moves the hand of a user along `intent` from now on, instead of along the user's script. The hand starts at the
  /// first waypoint of its first intent. Times are virtual.
  void move_hand(std::size_t user, const session::Intent& intent);
  /// Replaces the link for samples that are sent from now on. Seeds do not start again.
  void set_link(const netem::LinkSettings& link);
  /// Virtual time.
  [[nodiscard]] std::int64_t now_ns() const noexcept { return now_ns_; }
  [[nodiscard]] const hrtc_service::HrtcCore& hrtc() const noexcept { return core_; }

  /// Returns whether the user has placed its hand, which it does once it has received the catalogue.
  [[nodiscard]] bool has_hand(std::size_t user) const { return hands_[user]->device.has_value(); }
  /// State of the hand after the last step.
  [[nodiscard]] const Felt& felt(std::size_t user) const { return hands_[user]->felt; }
  /// Returns whether all scripts have ended.
  [[nodiscard]] bool done() const;
  [[nodiscard]] bool base_shown() const;
  /// Returns whether the last step was the first on a changed mesh. In such a step, a tool gathers its pairs of
  /// triangles again.
  [[nodiscard]] bool mesh_changed() const noexcept { return mesh_changed_; }
  /// Bytes of payload, of regions and base mesh.
  [[nodiscard]] std::uint64_t bytes_received() const {
    return core_.gateway().loader().delivery_counters().payload_bytes;
  }
  [[nodiscard]] std::uint64_t records_received() const { return core_.gateway().loader().figures().records_received; }

 private:
  struct Command {
    session::ProbeState state;
    haptics::Wrench wrench;
    std::uint32_t number = 0;
  };
  /// A user with its hand and operator.
  struct Hand {
    Hand(const client_sim::User& user, const SessionSettings& settings, std::uint64_t seed);
    client_sim::Operator script_operator;
    bool has_script = true;  // false once move_hand was called
    haptics::HandSettings settings;
    std::optional<haptics::SimulatedDevice> device;  // empty until the hand's start position is known
    Felt felt;
    // The members below are for remote hands.
    std::unique_ptr<haptics::RemoteDevice> remote;
    VirtualLink<haptics::RemotePose> poses;
    VirtualLink<Command> commands;
    Command newest;
    std::int64_t newest_ns = 0;
    std::uint32_t last_pose_number = 0;
    session::SequenceWindow pose_window{session::kCycleNumbers};
  };

  void carry_samples(std::int64_t until_ns);
  void exchange_membership();
  void send_clock_to_host(const session::ClockSample& sample);
  void send_clock_to_hrtc(const session::ClockSample& sample);
  void send_intent(Hand& hand);
  void move_device(Hand& hand, const session::Intent& intent);
  void read_device(std::size_t user);
  void move_remote(Hand& hand);
  void deliver_output(std::size_t user, const hrtc_service::ProbeOutput& output);

  SessionSettings settings_;
  client_sim::Objects objects_;
  std::vector<std::unique_ptr<Hand>> hands_;
  std::int64_t now_ns_ = 1'000'000'000;
  host_service::HostCore host_;
  hrtc_service::HrtcCore core_;
  hrtc_service::Membership membership_;
  VirtualLink<session::BulkChunk> records_;
  VirtualLink<session::Demand> demands_;
  VirtualLink<std::function<void()>> to_hrtc_, to_host_;  // roster entries and clock samples
  std::int64_t catalogue_ns_;
  std::uint64_t cycles_ = 0;
  bool users_act_ = false;
  bool changed_ = true, mesh_changed_ = true;  // the refinement of this step, and of the step before, changed the mesh
  hrtc_service::Servo::Inputs inputs_;
};

}  // namespace tactus::study
