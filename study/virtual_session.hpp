/// A session of a host and a controller with a scenario's users, joined by an emulated link, in virtual time.
///
///     host [DeliveryServer] --records--> link --> [Loader] -> [Cycle] <- [hand] <- [Operator]
///                           <--demands-- link <--            |            local: at the controller
///                                                            +-- link --> [hand] <- [Operator]
///                                                                         remote: beyond a link of its own
///
/// All of it is what the programs run; threads, sockets, clocks, discovery and what the machine does to them are
/// missing. The cycle comes every millisecond, the loader's tick every second one, the host looks for something to send
/// four times a millisecond. What is found to be touched stands at the origin, unturned, in metres. The same settings
/// give the same run to the last bit. One thread at a time.
#pragma once

#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "client_sim/operator.hpp"
#include "haptics/remote_device.hpp"
#include "haptics/simulated_device.hpp"
#include "hrtc_service/hrtc_core.hpp"
#include "session/delivery_server.hpp"
#include "session/sequence_window.hpp"
#include "study/subject.hpp"
#include "study/way.hpp"

namespace tactus::study {

struct SessionSettings {
  netem::LinkSettings link;        ///< forth: from the host, and from remote users, to the controller
  std::uint64_t seed = 1;          ///< of losses, delays and of the hands' tremor
  std::uint32_t slots = 1 << 16;   ///< of the controller's pool, what tactus-hrtc takes unless told
  std::uint32_t budget = 1 << 14;  ///< of a cycle's refinement, units of spm::Budget
  session::Material material;
  hrtc_service::CycleSettings cycle;  ///< with the tool that all users hold, if any

  /// Of every hand's device: one that bears a torque where there is a tool.
  [[nodiscard]] haptics::DeviceSpec device_spec() const {
    haptics::DeviceSpec spec;
    if (cycle.tool != nullptr) spec.max_torque = cycle.force.max_torque;
    return spec;
  }
};

/// One millisecond of a hand.
struct Felt {
  haptics::DeviceState device;  ///< where it is, world
  haptics::Wrench wrench;       ///< on it
  bool exact = false;           ///< a contact on the finest mesh; of a remote hand, as it was told
};

class VirtualSession {
 public:
  /// `subject` must outlive it. Users are one to kMaxProbes; their tips have the radius of the first one's.
  VirtualSession(const Subject& subject, const client_sim::Scenario& scenario, const SessionSettings& settings);
  ~VirtualSession();

  /// Runs without users until the base mesh is shown and a second longer, then lets them act. Throws
  /// std::runtime_error when that takes over a minute.
  void settle();
  /// Lets users act at once, of whom nobody has heard anything yet.
  void begin() noexcept { acting_ = true; }
  /// One millisecond; users act.
  void step();

  /// False until the user knows an object and takes its hand to it.
  [[nodiscard]] bool is_here(std::size_t user) const { return hands_[user]->device.has_value(); }
  /// Of the last step.
  [[nodiscard]] const Felt& felt(std::size_t user) const { return hands_[user]->felt; }
  /// All scripts have ended.
  [[nodiscard]] bool done() const;
  [[nodiscard]] bool base_shown() const;
  /// The last step was the first on another mesh, where tools look anew for what is near.
  [[nodiscard]] bool looked_anew() const noexcept { return looked_anew_; }
  /// Of regions and base mesh, payload.
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
  /// A user with hand and mind.
  struct Hand {
    Hand(const client_sim::User& user, const SessionSettings& settings, std::uint64_t seed);
    client_sim::Operator mind;
    haptics::HandSettings settings;
    std::optional<haptics::SimulatedDevice> device;  // once it is known where it begins
    Felt felt;
    // Of a remote one.
    std::unique_ptr<haptics::RemoteDevice> remote;
    Way<haptics::RemotePose> poses;
    Way<Command> commands;
    Command newest;
    std::int64_t newest_ns = 0;
    std::uint32_t numbered = 0;
    session::SequenceWindow numbers{session::kCycleNumbers};
  };

  void move_network(std::int64_t until_ns);
  void think(Hand& hand);
  void read(std::size_t user);
  void move_remote(Hand& hand);
  void report(std::size_t user, const hrtc_service::ProbeOutput& output);

  SessionSettings settings_;
  session::CatalogueEntry entry_;
  client_sim::Objects objects_;
  std::vector<std::unique_ptr<Hand>> hands_;
  session::DeliveryServer server_;
  hrtc_service::HrtcCore core_;
  Way<session::BulkChunk> records_;
  Way<session::Demand> demands_;
  std::int64_t now_ns_ = 1'000'000'000;
  std::int64_t catalogue_ns_;
  std::uint64_t cycles_ = 0;
  bool acting_ = false;
  bool changed_ = true, looked_anew_ = true;
  hrtc_service::Servo::Inputs inputs_;
};

}  // namespace tactus::study
