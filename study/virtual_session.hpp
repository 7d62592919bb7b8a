/// A session of a host and an HRTC with the users of a scenario, joined by an emulated link, in virtual time.
///
///     host [HostCore] --records, roster entries--> link --> [HrtcCore] <- [hand] <- [Operator]
///                     <--------- demands --------- link <--     |             local: at the HRTC
///                                                               +-- link --> [hand] <- [Operator]
///                                                                            remote: over a link of its own
///
/// It runs the code of the programs without threads, sockets, clocks, discovery and effects of the machine. The cycle
/// runs every millisecond, the loader every second one, and the host looks for something to send four times per
/// millisecond. The touched object is at the origin, not rotated, in metres. The same settings give the same run to the
/// bit. One thread at a time.
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
#include "study/path.hpp"
#include "study/subject.hpp"

namespace tactus::study {

struct SessionSettings {
  netem::LinkSettings link;        ///< forth: from host and remote users to the HRTC
  std::uint64_t seed = 1;          ///< for losses, delays and the tremor of the hands
  std::uint32_t slots = 1 << 16;   ///< of the HRTC's pool; the default of tactus-hrtc
  std::uint32_t budget = 1 << 14;  ///< of a cycle's refinement, in units of spm::Budget
  session::Material material;
  hrtc_service::CycleSettings cycle;  ///< with the tool of all users, if any

  /// Limits of every hand's device; it can exert a torque if there is a tool.
  [[nodiscard]] haptics::DeviceSpec device_spec() const {
    haptics::DeviceSpec spec;
    if (cycle.tool != nullptr) spec.max_torque = cycle.force.max_torque;
    return spec;
  }
};

/// One millisecond of a hand.
struct Felt {
  haptics::DeviceState device;  ///< world frame
  haptics::Wrench wrench;       ///< on the device
  bool exact = false;           ///< contact on the finest mesh; for a remote hand as received
};

class VirtualSession {
 public:
  /// `subject` must outlive this. One to kMaxProbes users; all tips have the radius of the first one.
  VirtualSession(const Subject& subject, const client_sim::Scenario& scenario, const SessionSettings& settings);
  ~VirtualSession();

  /// Runs without users until one second after the base mesh is shown, then starts the users. Throws std::runtime_error
  /// after a minute.
  void settle();
  /// Starts the users at once, before any data has arrived.
  void begin() noexcept { acting_ = true; }
  /// Advances by one millisecond; users act.
  void step();

  /// False until the user knows an object and has placed its hand.
  [[nodiscard]] bool is_here(std::size_t user) const { return hands_[user]->device.has_value(); }
  /// Of the last step.
  [[nodiscard]] const Felt& felt(std::size_t user) const { return hands_[user]->felt; }
  /// All scripts have ended.
  [[nodiscard]] bool done() const;
  [[nodiscard]] bool base_shown() const;
  /// True when the last step was the first on a changed mesh, where tools gather pairs again.
  [[nodiscard]] bool mesh_changed() const noexcept { return mesh_changed_; }
  /// Payload bytes of regions and base mesh.
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
    client_sim::Operator op;
    haptics::HandSettings settings;
    std::optional<haptics::SimulatedDevice> device;  // created when its start position is known
    Felt felt;
    // For a remote hand.
    std::unique_ptr<haptics::RemoteDevice> remote;
    Path<haptics::RemotePose> poses;
    Path<Command> commands;
    Command newest;
    std::int64_t newest_ns = 0;
    std::uint32_t numbered = 0;
    session::SequenceWindow numbers{session::kCycleNumbers};
  };

  void move_network(std::int64_t until_ns);
  void keep_company();
  void send_clock_to_host(const session::ClockSample& sample);
  void send_clock_to_hrtc(const session::ClockSample& sample);
  void send_intent(Hand& hand);
  void read(std::size_t user);
  void move_remote(Hand& hand);
  void report(std::size_t user, const hrtc_service::ProbeOutput& output);

  SessionSettings settings_;
  client_sim::Objects objects_;
  std::vector<std::unique_ptr<Hand>> hands_;
  std::int64_t now_ns_ = 1'000'000'000;
  host_service::HostCore host_;
  hrtc_service::HrtcCore core_;
  hrtc_service::Membership membership_;
  Path<session::BulkChunk> records_;
  Path<session::Demand> demands_;
  Path<std::function<void()>> to_hrtc_, to_host_;  // roster entries and clock samples
  std::int64_t catalogue_ns_;
  std::uint64_t cycles_ = 0;
  bool acting_ = false;
  bool changed_ = true, mesh_changed_ = true;
  hrtc_service::Servo::Inputs inputs_;
};

}  // namespace tactus::study
