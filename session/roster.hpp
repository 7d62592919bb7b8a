/// Tracks the participants of a session by their roster entries: joins, changes, silence, departures and name
/// conflicts.
///
/// A participant that sends no heartbeat is first late, then gone. A newer incarnation of a name replaces the older
/// one. If both send heartbeats, the name conflict is reported once for each pair. The program that joined the session
/// later has to leave. Incarnations do not decide this, because they come from wall clocks, which may be wrong. When
/// the newer incarnation ends, the older one becomes the participant of that name again.
///
/// No clock; one thread at a time. Stores at most kMaxParticipants.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "session/messages.hpp"
#include "session/sequence_window.hpp"
#include "session/severity.hpp"

namespace tactus::session {

inline constexpr std::size_t kMaxParticipants = 1024;

struct RosterSettings {
  // Times since the last heartbeat.
  std::int64_t late_ns = 250'000'000;       ///< the participant is late
  std::int64_t gone_ns = 500'000'000;       ///< the participant is gone
  std::int64_t max_tick_ns = 100'000'000;   ///< a longer time between two ticks means that this program did not run
  std::int64_t forget_ns = 10'000'000'000;  ///< its record is deleted; longer than any transit
};

enum class RosterChange : std::uint8_t {
  kJoined,
  kRestarted,     ///< a newer incarnation replaced an older one
  kChanged,       ///< users, served users or requested HRTC differ
  kLate,          ///< sent no heartbeat for RosterSettings::late_ns; `other` is this time in ms
  kRecovered,     ///< a late participant has sent a heartbeat
  kLeft,          ///< sent a leave message
  kGone,          ///< sent no heartbeat for RosterSettings::gone_ns
  kWrongVersion,  ///< refused; `other` is its protocol version
  kNameConflict,  ///< two programs send heartbeats under this name; `other` is the incarnation of the second
  kFull           ///< refused: kMaxParticipants reached
};

struct RosterEvent {
  RosterChange change;
  RosterEntry entry;
  std::uint64_t other = 0;
  bool entry_must_leave = false;  ///< kNameConflict: the program of `entry` has to leave, otherwise that of `other`
};

/// Warning for a refused participant and for a name conflict, info for all other events.
[[nodiscard]] Severity severity(const RosterEvent& event) noexcept;
/// Text of an event, one line for a log.
[[nodiscard]] std::string text(const RosterEvent& event);
/// Text for the program that has to leave because another one has its name.
[[nodiscard]] std::string name_taken_text(const std::string& name, const std::string& session);
/// Role and name of a participant.
[[nodiscard]] std::string text(const RosterEntry& entry);

class Roster {
 public:
  /// `self` is this program. Its own entries cause no events; those of another program with its name do.
  Roster(const Origin& self, const RosterSettings& settings);

  /// Applies an entry; ignores entries of other sessions.
  [[nodiscard]] std::vector<RosterEvent> on_entry(const RosterEntry& entry, std::int64_t now_ns);
  /// Detects participants that are late or gone. Of the time since the last tick, at most RosterSettings::max_tick_ns
  /// counts: while this program was suspended, it could not process what others sent.
  [[nodiscard]] std::vector<RosterEvent> tick(std::int64_t now_ns);

  /// The newest entry of a present participant, or null. Valid until the next call that changes the roster.
  [[nodiscard]] const RosterEntry* find(std::uint64_t participant) const;
  /// Entries of all present participants except this program, by id.
  [[nodiscard]] std::vector<RosterEntry> entries() const;
  /// Calls `visit(entry)` for the same entries without copying them.
  template <class Visit>
  void for_each(Visit&& visit) const {
    for (const auto& [id, member] : members_)
      if (member.present) visit(member.entry);
  }
  [[nodiscard]] bool is_late(std::uint64_t participant) const;
  /// Returns whether the newest entry of a participant was a leave message. False again after
  /// RosterSettings::forget_ns.
  [[nodiscard]] bool has_left(std::uint64_t participant) const;
  /// Number of entries dropped because their heartbeat was outside its window (session/sequence_window.hpp).
  [[nodiscard]] std::uint64_t implausible() const noexcept { return implausible_; }
  /// Arrival of the last entry of a present participant; 0 for others.
  [[nodiscard]] std::int64_t received_ns(std::uint64_t participant) const;
  /// Sets how long this program has been in the session, as its own entries state it.
  void set_own_presence(std::int64_t session_time_ns, std::int64_t joined_ns) noexcept {
    own_.entry.session_time_ns = session_time_ns;
    own_.entry.joined_ns = joined_ns;
  }
  /// Number of stored participants: those present, and those that left or were gone recently.
  [[nodiscard]] std::size_t stored_participants() const noexcept { return members_.size(); }

 private:
  /// A program that sends heartbeats under the name of a participant with another incarnation.
  struct Rival {
    SequenceWindow heartbeats{kHeartbeatNumbers};
    std::uint32_t accepted = 0;  // heartbeats after the first
    bool reported = false;
    std::int64_t received_ns = 0;
  };
  struct Member {
    RosterEntry entry;
    SequenceWindow heartbeats{kHeartbeatNumbers};
    std::int64_t received_ns = 0;
    std::int64_t missed_ns = 0;  // since then, in which this program did not run
    bool present = false;        // false: left or gone, stored to recognise its delayed entries
    bool left = false;
    bool late = false;
    std::map<std::uint64_t, Rival> rivals;  // by incarnation
  };

  void on_own_name(const RosterEntry& entry, std::int64_t now_ns, std::vector<RosterEvent>& events);
  void refuse(const RosterEntry& entry, RosterChange change, std::uint64_t other, std::vector<RosterEvent>& events);
  void on_new_name(const RosterEntry& entry, std::int64_t now_ns, std::vector<RosterEvent>& events);
  void on_older_incarnation(Member& member, const RosterEntry& entry, std::int64_t now_ns,
                            std::vector<RosterEvent>& events) const;
  void on_newest_incarnation(Member& member, const RosterEntry& entry, std::int64_t now_ns,
                             std::vector<RosterEvent>& events);
  bool track_rival(Member& member, const RosterEntry& entry, std::int64_t now_ns,
                   std::vector<RosterEvent>& events) const;
  void add_missed_time(std::int64_t now_ns);
  void forget_rivals(Member& member, std::int64_t now_ns) const;
  void forget_absent();

  Origin self_;
  RosterSettings settings_;
  Member own_;
  std::optional<std::int64_t> ticked_ns_;  // time of the last tick
  std::uint64_t implausible_ = 0;
  std::map<std::uint64_t, Member> members_;                                   // by participant
  std::map<std::pair<std::uint64_t, std::uint64_t>, std::uint32_t> refused_;  // participant, incarnation -> version
};

/// Hash of the present hosts and HRTCs with their incarnations, including `self` if `role` is host or HRTC.
/// The hash is equal in all programs whose rosters list the same hosts and HRTCs.
[[nodiscard]] std::uint64_t scene_hash(const Roster& roster, const Origin& self, Role role);

/// Assigns probe numbers to the users that an HRTC has accepted.
class UserTable {
 public:
  /// `earlier`: id_of the users to whom numbers belonged before a restart, by number; 0: none. Throws
  /// std::invalid_argument if `capacity` is above kMaxUsers.
  explicit UserTable(std::size_t capacity, std::span<const std::uint64_t> earlier = {});

  /// Returns the user's probe number, a free one for a new user; none when no number is free. A new user gets the
  /// number of an earlier user only if no other is free.
  [[nodiscard]] std::optional<std::uint32_t> grant(const std::string& user);
  /// Frees the number of a user. Returns false when the user had none.
  bool release(const std::string& user);
  [[nodiscard]] std::vector<UserProbe> list() const;

 private:
  std::vector<std::string> users_;      // by probe; empty: free
  std::vector<std::uint64_t> earlier_;  // by probe: id_of the user before a restart, until another user gets it
};

}  // namespace tactus::session
