/// A session from the client's side: waits for HRTCs and objects, adds users, runs their scripts, ends, reports.
///
///     gathering --> joining --> running --> ending --> ended
///     HRTCs and     users have   scripts     last
///     objects seen  their slots  run         figures      (any --> failed: `trouble` has the reason)
///
/// Of two programs with one name the later one leaves, as with hosts and HRTCs, and the session continues without it.
///
/// An adapter carries the messages: arriving samples go into on_...(), and tick() returns samples to send. It has no
/// socket, thread or clock. One thread at a time. Not realtime.
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
  std::string name;  ///< of this participant; the participant for a second HRTC is `name.2`
  std::uint64_t incarnation = 0;
  std::string mode;       ///< published at the start, format of session::parse_mode; empty: none
  double patience = 20;   ///< s to wait for HRTCs, objects and slots
  double name_check = 1;  ///< s between the first sign of other participants and joining, to detect a name conflict
  double settle = 2;      ///< s after the first of them, then "#n" is taken modulo their number
  double linger = 2;      ///< s at the end to wait for the last figures of the others
  std::int64_t heartbeat_ns = 100'000'000;
  session::RosterSettings roster;
  OperatorSettings hand;
};

/// Samples to publish, in this order.
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
  /// Ends this program too when another participant sent it.
  void on_end(const session::SessionEnd& end);

  /// Call every few milliseconds.
  [[nodiscard]] SimMessages tick(std::int64_t now_ns, std::int64_t session_now_ns);

  /// Ends the session early and in order, during the next ticks.
  void stop(const std::string& reason);

  /// When this program joined: of two with one name the later one leaves.
  void set_own_presence(std::int64_t session_time_ns, std::int64_t joined_ns) noexcept {
    roster_.set_own_presence(session_time_ns, joined_ns);
  }

  [[nodiscard]] SimState state() const noexcept { return state_; }
  [[nodiscard]] bool finished() const noexcept { return state_ == SimState::kEnded || state_ == SimState::kFailed; }
  /// It failed because an older program has one of its names.
  [[nodiscard]] bool name_taken() const noexcept { return !taken_name_.empty(); }
  /// What it is waiting for, or why it failed; otherwise empty.
  [[nodiscard]] const std::string& trouble() const noexcept { return trouble_; }
  [[nodiscard]] Report report() const;

 private:
  /// A participant of this program: one per HRTC.
  struct Presence {
    session::RosterEntry entry;
    std::int64_t sent_ns = 0;
  };
  struct SimUser {
    Operator op;
    TouchTally touch;
    session::RemoteProbe probe;  // without playout delay: the hand needs the newest state
    std::string hrtc;
    std::size_t presence = 0;
  };
  struct Peer {
    std::string name;
    session::Role role;
    bool here = true;
    bool present_at_end = true;  // present until the end was announced
    std::map<std::string, double> figures;
    std::int64_t figures_ns = INT64_MIN;
  };

  void log_event(const std::string& text);
  void gather(std::int64_t now_ns);
  void assign_users(const std::vector<std::string>& hrtcs);
  [[nodiscard]] std::string missing_slots() const;
  void begin_ending(std::int64_t now_ns, SimMessages& out);
  [[nodiscard]] bool last_figures_are_in() const;
  void take_events(const std::vector<session::RosterEvent>& events);
  [[nodiscard]] bool is_own(std::uint64_t participant) const;
  void on_name_conflict(const session::RosterEvent& event);
  void send_heartbeats(std::int64_t now_ns, bool leaving, SimMessages& out);
  [[nodiscard]] session::Origin origin_of(std::size_t presence, std::int64_t now_ns) const;
  [[nodiscard]] session::Control control(session::ControlKind kind, std::int64_t now_ns, const std::string& text);

  Scenario scenario_;
  SimSettings settings_;
  session::Origin self_;
  session::Roster roster_;
  session::StopLatch stops_;
  SimState state_ = SimState::kGathering;
  std::string trouble_, stopped_;
  std::string taken_name_;  // the name that an older program has
  std::vector<Presence> presences_;
  std::vector<SimUser> users_;
  struct Movable {
    session::CatalogueEntry entry;  // with its newest pose
    session::PoseGate gate;
    MoveTally tally;
  };

  Objects objects_;
  std::map<std::uint64_t, Movable> movables_;                 // by object
  std::uint64_t implausible_ = 0;                             // probe states
  std::map<std::string, std::uint64_t> record_counts_;        // by object
  std::map<std::uint64_t, Peer> peers_;                       // hosts and HRTCs ever seen, by participant
  std::vector<std::pair<std::int64_t, std::string>> events_;  // by this program's clock
  std::uint32_t control_sequence_ = 0;
  std::int64_t now_ns_ = 0;
  std::int64_t began_ns_ = -1, first_peer_ns_ = -1, found_ns_ = -1;
  std::int64_t start_ns_ = -1, session_start_ns_ = 0, end_ns_ = -1;
};

}  // namespace tactus::client_sim
