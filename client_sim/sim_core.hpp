/// A session as its simulated users run it: finds controllers and objects, brings the users, lets them act, ends,
/// reports.
///
///     gathering --> joining --> running --> ending --> ended
///     HRTCs and     users have   scripts     last
///     objects seen  their slots  act         figures      (any --> failed: `trouble` says why)
///
/// Of two programs with one name the later gives way, as hosts and HRTCs do, and the session goes on without it.
///
/// A program around it only carries messages: what arrives goes into on_...(), what tick() returns goes out. No socket,
/// no thread and no clock in it. One thread at a time. Not realtime.
#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "client_sim/operator.hpp"
#include "client_sim/report.hpp"
#include "client_sim/scenario.hpp"
#include "session/messages.hpp"
#include "session/ownership.hpp"
#include "session/remote_probe.hpp"
#include "session/roster.hpp"
#include "session/stop_latch.hpp"

namespace tactus::client_sim {

struct SimSettings {
  std::string session;
  std::string name;  ///< of this participant; one that brings users of a second HRTC is `name.2`
  std::uint64_t incarnation = 0;
  std::string mode;      ///< told to the session at the start, as session::parse_mode has it; empty: none
  double patience = 20;  ///< s to wait for HRTCs, objects and slots
  double hush = 1;       ///< s after the first sign of others before users join: time to hear that the name is taken
  double settle = 2;     ///< s after the first of them, then "#n" counts around those that are there
  double linger = 2;     ///< s at the end to wait for the others' last figures
  std::int64_t heartbeat_ns = 100'000'000;
  session::RosterSettings roster;
  OperatorSettings hand;
};

/// To be published, in this order.
struct SimMessages {
  std::vector<session::RosterEntry> roster;
  std::vector<session::Control> control;
  std::vector<session::SessionEnd> ends;
  std::vector<session::Intent> intents;
};

enum class SimState : std::uint8_t { kGathering, kJoining, kRunning, kEnding, kEnded, kFailed };

class SimCore {
 public:
  SimCore(const Scenario& scenario, const SimSettings& settings);

  // Samples of other sessions are ignored. Times are of this program's monotonic clock unless the name says session.
  void on_catalogue(const session::CatalogueEntry& entry);
  void on_roster(const session::RosterEntry& entry, std::int64_t now_ns);
  void on_probe_state(const session::ProbeState& state, std::int64_t session_now_ns);
  void on_metrics(const session::Metrics& metrics, std::int64_t now_ns);
  void on_object_pose(const session::ObjectPose& pose);
  void on_stop(const session::EmergencyStop& stop);
  void on_reset(const session::ForceReset& reset);
  /// Ends this program too, when it is of another participant.
  void on_end(const session::SessionEnd& end);

  /// Every few milliseconds.
  [[nodiscard]] SimMessages tick(std::int64_t now_ns, std::int64_t session_now_ns);

  /// Ends the session early, in an orderly way; the next ticks do it.
  void stop(const std::string& reason);

  /// How long this program has been in the session: of two with one name the later gives way.
  void set_own_presence(std::int64_t session_time_ns, std::int64_t joined_ns) noexcept {
    roster_.set_own_presence(session_time_ns, joined_ns);
  }

  [[nodiscard]] SimState state() const noexcept { return state_; }
  [[nodiscard]] bool finished() const noexcept { return state_ == SimState::kEnded || state_ == SimState::kFailed; }
  /// It failed because an older program has a name of this one.
  [[nodiscard]] bool name_taken() const noexcept { return !taken_.empty(); }
  /// What it is waiting for, or why it failed; empty when all is well.
  [[nodiscard]] const std::string& trouble() const noexcept { return trouble_; }
  [[nodiscard]] Report report() const;

 private:
  /// What this program is to one HRTC.
  struct Presence {
    session::RosterEntry entry;
    std::int64_t sent_ns = 0;
  };
  struct Seat {
    Operator mind;
    TouchTally touch;
    session::RemoteProbe probe;  // shown at once: the hand goes by it
    std::string hrtc;
    std::size_t presence = 0;
  };
  struct Peer {
    std::string name;
    session::Role role;
    bool here = true;
    bool stayed = true;  // until the end was announced
    std::map<std::string, double> figures;
    std::int64_t figures_ns = INT64_MIN;
  };

  void note(const std::string& text);
  void gather(std::int64_t now_ns);
  void assign_seats(const std::vector<std::string>& hrtcs);
  [[nodiscard]] std::string missing_slots() const;
  void begin_ending(std::int64_t now_ns, SimMessages& out);
  [[nodiscard]] bool last_figures_are_in() const;
  void take_events(const std::vector<session::RosterEvent>& events);
  [[nodiscard]] bool is_own(std::uint64_t participant) const;
  void on_name_conflict(const session::RosterEvent& event);
  void beat(std::int64_t now_ns, bool leaving, SimMessages& out);
  [[nodiscard]] session::Origin origin_of(std::size_t presence, std::int64_t now_ns) const;
  [[nodiscard]] session::Control control(session::ControlKind kind, std::int64_t now_ns, const std::string& text);

  Scenario scenario_;
  SimSettings settings_;
  session::Origin self_;
  session::Roster roster_;
  session::StopLatch stops_;
  SimState state_ = SimState::kGathering;
  std::string trouble_, stopped_;
  std::string taken_;  // the name that an older program has
  std::vector<Presence> presences_;
  std::vector<Seat> seats_;
  struct Movable {
    session::CatalogueEntry entry;  // with its newest pose
    session::PoseGate gate;
    MoveTally tally;
  };

  Objects objects_;
  std::map<std::uint64_t, Movable> movables_;                 // by object
  std::map<std::string, std::uint64_t> record_counts_;        // by object
  std::map<std::uint64_t, Peer> peers_;                       // hosts and HRTCs ever seen, by participant
  std::vector<std::pair<std::int64_t, std::string>> events_;  // by this program's clock
  std::uint32_t control_sequence_ = 0;
  std::int64_t now_ns_ = 0;
  std::int64_t began_ns_ = -1, received_ns_ = -1, found_ns_ = -1;
  std::int64_t start_ns_ = -1, session_start_ns_ = 0, end_ns_ = -1;
};

}  // namespace tactus::client_sim
