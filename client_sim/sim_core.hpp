/// Runs a scenario in a session: waits for HRTCs and objects, adds users, runs their scripts, ends the session,
/// reports.
///
///     kGathering  waits until the HRTCs and objects of the scenario are present
///     kJoining    waits until HRTCs have given probes to all users
///     kRunning    runs the scripts
///     kEnding     waits for the last figures of hosts and HRTCs
///     kEnded
///     kFailed     reached from any state; stop_reason() returns the reason
///
/// If two programs have the same name, the program that joined later leaves, as with hosts and HRTCs. The session
/// continues.
///
/// The core has no socket, thread or clock. The adapter passes arriving samples to on_...() and sends the samples that
/// tick() returns. One thread at a time. Not realtime.
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
  std::string name;  ///< of this participant; users at a second HRTC belong to participant `name.2`
  std::uint64_t incarnation = 0;
  std::string mode;       ///< published at the start, format of session::parse_mode; empty: none
  double patience = 20;   ///< s, max wait for HRTCs, objects and probes
  double name_check = 1;  ///< s to wait before joining, after the first sample of others, to detect a name conflict
  /// s to wait for further HRTCs and objects after the first; then n of "#n" is taken modulo their number.
  double settle = 2;
  double linger = 2;  ///< s, max wait at the end for the last figures of hosts and HRTCs
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

  // The core ignores samples of other sessions. Times are of this program's monotonic clock, except those with
  // `session` in the name.
  void on_catalogue(const session::CatalogueEntry& entry);
  void on_roster(const session::RosterEntry& entry, std::int64_t now_ns);
  void on_probe_state(const session::ProbeState& state, std::int64_t session_now_ns);
  void on_metrics(const session::Metrics& metrics, std::int64_t now_ns);
  void on_object_pose(const session::ObjectPose& pose);
  void on_stop(const session::EmergencyStop& stop);
  void on_reset(const session::ForceReset& reset);
  /// If another participant sent `end`, this program ends too.
  void on_end(const session::SessionEnd& end);

  /// Returns the samples to send. Call it every few milliseconds.
  [[nodiscard]] SimMessages tick(std::int64_t now_ns, std::int64_t session_now_ns);

  /// Ends the session early, in the normal order of states, during the next ticks.
  void stop(const std::string& reason);

  /// Sets the present session time and the time at which this program joined. Of two programs with one name, the one
  /// that joined later leaves.
  void set_own_presence(std::int64_t session_time_ns, std::int64_t joined_ns) noexcept {
    roster_.set_own_presence(session_time_ns, joined_ns);
  }

  [[nodiscard]] SimState state() const noexcept { return state_; }
  [[nodiscard]] bool finished() const noexcept { return state_ == SimState::kEnded || state_ == SimState::kFailed; }
  /// Returns whether the core failed because an older program has one of the names of this program.
  [[nodiscard]] bool name_taken() const noexcept { return !taken_name_.empty(); }
  /// Returns the condition for which the core waits, or the reason why it failed. Empty otherwise.
  [[nodiscard]] const std::string& stop_reason() const noexcept { return stop_reason_; }
  [[nodiscard]] Report report() const;

 private:
  /// A participant of this program. There is one for each HRTC that serves users of this program.
  struct Presence {
    session::RosterEntry entry;
    std::int64_t sent_ns = 0;
  };
  struct SimUser {
    Operator script_operator;
    TouchTally touch;
    session::RemoteProbe probe;  // without playout delay, because the operator needs the newest state
    std::string hrtc;
    std::size_t presence = 0;
  };
  struct Peer {
    std::string name;
    session::Role role;
    bool is_present = true;
    bool present_at_end = true;  // was present when the end of the session was announced
    std::map<std::string, double> figures;
    std::int64_t figures_ns = INT64_MIN;
  };

  void log_event(const std::string& text);
  void gather(std::int64_t now_ns);
  void assign_users(const std::vector<std::string>& hrtcs);
  [[nodiscard]] std::string missing_probes() const;
  void log_unfinished_scripts();
  void begin_ending(std::int64_t now_ns, SimMessages& out);
  [[nodiscard]] bool last_figures_are_in() const;
  void process_events(const std::vector<session::RosterEvent>& events);
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
  std::string stop_reason_, requested_stop_;
  std::string taken_name_;  // name of this program that an older program has
  std::vector<Presence> presences_;
  std::vector<SimUser> users_;
  struct Movable {
    session::CatalogueEntry entry;  // with its newest pose
    session::PoseAdmission pose_admission;
    MoveTally tally;
  };

  Objects objects_;
  std::map<std::uint64_t, Movable> movables_;                 // by object
  std::uint64_t implausible_ = 0;                             // probe states
  std::map<std::string, std::uint64_t> record_counts_;        // by object
  std::map<std::uint64_t, Peer> peers_;                       // all present and past hosts and HRTCs, by participant
  std::vector<std::pair<std::int64_t, std::string>> events_;  // by this program's clock
  std::uint32_t control_sequence_ = 0;
  std::int64_t now_ns_ = 0;
  // Times of events; -1: the event has not happened yet.
  std::int64_t first_tick_ns_ = -1, first_peer_ns_ = -1;
  std::int64_t found_ns_ = -1;                         // an HRTC and an object were present
  std::int64_t start_ns_ = -1, session_start_ns_ = 0;  // the scenario started
  std::int64_t end_ns_ = -1;                           // the end was announced
};

}  // namespace tactus::client_sim
