/// The participants of a session, tracked by their roster samples: joins, changes, silence, departures, name conflicts.
///
/// A participant is late and then gone by the time since its last heartbeat. A newer incarnation replaces an older one.
/// If two programs send heartbeats under one name, their incarnations differ; the conflict is reported once for each
/// pair. When the newer program ends, the older one takes the name again. The program that joined the session later
/// yields. Incarnations do not decide, because they come from wall clocks, which may be wrong.
///
/// No clock; one thread at a time. At most kMaxParticipants are recorded.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "session/messages.hpp"
#include "session/sequence_window.hpp"

namespace tactus::session {

inline constexpr std::size_t kMaxParticipants = 1024;

struct RosterSettings {
  std::int64_t late_ns = 250'000'000;       ///< since the last heartbeat
  std::int64_t gone_ns = 500'000'000;       ///< since the last heartbeat
  std::int64_t forget_ns = 10'000'000'000;  ///< since the last heartbeat; longer than any sample is in transit
};

enum class RosterChange : std::uint8_t {
  kJoined,
  kRestarted,  ///< a newer incarnation took over
  kChanged,    ///< users, slots or requested HRTC differ
  kLate,
  kBack,          ///< was late and sends heartbeats again
  kLeft,          ///< sent a leave message
  kGone,          ///< silent for too long
  kWrongVersion,  ///< refused; `other` is its protocol version
  kNameConflict,  ///< two programs send heartbeats under this name; `other` is the incarnation of the second
  kFull           ///< refused: kMaxParticipants reached
};

struct RosterEvent {
  RosterChange change;
  RosterEntry entry;
  std::uint64_t other = 0;
  bool entry_yields = false;  ///< kNameConflict: the program of `entry` has to yield, else that of `other`
};

/// One line for a log.
[[nodiscard]] std::string text(const RosterEvent& event);
/// Role and name.
[[nodiscard]] std::string text(const RosterEntry& entry);

class Roster {
 public:
  /// `self` is this program: its own samples give no events; those of another program with its name do.
  Roster(const Origin& self, const RosterSettings& settings);

  /// Takes an entry; ignores those of other sessions.
  [[nodiscard]] std::vector<RosterEvent> on_entry(const RosterEntry& entry, std::int64_t now_ns);
  /// Detects participants that are late or gone.
  [[nodiscard]] std::vector<RosterEvent> tick(std::int64_t now_ns);

  /// Null when it is not present. Valid until the next call that changes the roster.
  [[nodiscard]] const RosterEntry* find(std::uint64_t participant) const;
  /// All present participants except this program, by id.
  [[nodiscard]] std::vector<RosterEntry> entries() const;
  /// Calls `visit` with each of these entries, without copies.
  template <class Visit>
  void for_each(Visit&& visit) const {
    for (const auto& [id, member] : members_)
      if (member.present) visit(member.entry);
  }
  [[nodiscard]] bool is_late(std::uint64_t participant) const;
  /// Entries that were dropped because their heartbeat is outside its window (session/sequence_window.hpp).
  [[nodiscard]] std::uint64_t implausible() const noexcept { return implausible_; }
  /// Arrival of the last sample of a present participant; 0 for others.
  [[nodiscard]] std::int64_t seen_ns(std::uint64_t participant) const;
  /// Sets how long this program has been in the session, as its own entries state it.
  void set_own_presence(std::int64_t session_time_ns, std::int64_t joined_ns) noexcept {
    own_.entry.session_time_ns = session_time_ns;
    own_.entry.joined_ns = joined_ns;
  }
  /// Number of recorded participants: those present, and those that left a moment ago.
  [[nodiscard]] std::size_t remembered() const noexcept { return members_.size(); }

 private:
  /// A program that sends heartbeats under a name that another incarnation holds.
  struct Rival {
    SequenceWindow heartbeats{kHeartbeatNumbers};
    std::uint32_t beats = 0;  // heartbeats received
    bool reported = false;
    std::int64_t seen_ns = 0;
  };
  struct Member {
    RosterEntry entry;
    SequenceWindow heartbeats{kHeartbeatNumbers};
    std::int64_t seen_ns = 0;
    bool present = false;  // false: left or gone; recorded to detect its late samples
    bool left = false;
    bool late = false;
    std::map<std::uint64_t, Rival> rivals;  // by incarnation
  };

  bool track_rival(Member& member, const RosterEntry& entry, std::int64_t now_ns,
                   std::vector<RosterEvent>& events) const;
  void forget_rivals(Member& member, std::int64_t now_ns) const;
  void forget_absent();

  Origin self_;
  RosterSettings settings_;
  Member own_;
  std::uint64_t implausible_ = 0;
  std::map<std::uint64_t, Member> members_;                                   // by participant
  std::map<std::pair<std::uint64_t, std::uint64_t>, std::uint32_t> refused_;  // participant, incarnation -> version
};

/// Hash of the hosts and HRTCs that are present, with their incarnations, `self` with its `role` included. Equal in all
/// programs that see the same hosts and HRTCs.
[[nodiscard]] std::uint64_t scene_hash(const Roster& roster, const Origin& self, Role role);

/// The users that an HRTC has accepted and the probe number of each.
class UserSlots {
 public:
  /// `capacity` at most kMaxSlots.
  explicit UserSlots(std::size_t capacity);

  /// The user's slot; the same again for a user who has one; none when all are taken.
  [[nodiscard]] std::optional<std::uint32_t> grant(const std::string& user);
  /// False when the user had none.
  bool release(const std::string& user);
  [[nodiscard]] std::vector<UserSlot> list() const;

 private:
  std::vector<std::string> users_;  // by slot; empty: free
};

}  // namespace tactus::session
