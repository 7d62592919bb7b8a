/// Who is in the session, as their roster samples tell: joins, changes, silence, departures and clashes of names.
///
/// A participant is late and then gone by the time since its last heartbeat. A newer incarnation replaces an older one.
/// Two programs that beat under one name are told apart by their incarnations and reported, once for each pair; when
/// the newer one ends, the older takes its place again. Which of the two gives way follows from how long each has been
/// in the session, not from incarnations: these come from wall clocks, which may be wrong.
///
/// No clock in it; one thread at a time. At most kMaxParticipants are kept.
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
  std::int64_t forget_ns = 10'000'000'000;  ///< since the last heartbeat; no sample is under way for so long
};

enum class RosterChange : std::uint8_t {
  kJoined,
  kRestarted,  ///< a newer incarnation took over
  kChanged,    ///< users, slots or controller differ
  kLate,
  kBack,          ///< was late and beats again
  kLeft,          ///< said so
  kGone,          ///< silent for too long
  kWrongVersion,  ///< refused; `other` is its protocol version
  kNameConflict,  ///< two programs beat under this name; `other` is the incarnation of the second
  kFull           ///< no room for it
};

struct RosterEvent {
  RosterChange change;
  RosterEntry entry;
  std::uint64_t other = 0;
  bool entry_yields = false;  ///< kNameConflict: the program of `entry` has to give way, else that of `other`
};

/// One line for a log.
[[nodiscard]] std::string text(const RosterEvent& event);
/// Role and name.
[[nodiscard]] std::string text(const RosterEntry& entry);

class Roster {
 public:
  /// `self` is this program: its own samples give no events, those of another with its name do.
  Roster(const Origin& self, const RosterSettings& settings);

  /// Entries of other sessions are ignored.
  [[nodiscard]] std::vector<RosterEvent> on_entry(const RosterEntry& entry, std::int64_t now_ns);
  /// Lets time pass: late and gone.
  [[nodiscard]] std::vector<RosterEvent> tick(std::int64_t now_ns);

  /// Null when not here. Until the next call that changes the roster.
  [[nodiscard]] const RosterEntry* find(std::uint64_t participant) const;
  /// Everyone here but this program, by id.
  [[nodiscard]] std::vector<RosterEntry> entries() const;
  /// Calls with each of these, without copies.
  template <class Visit>
  void for_each(Visit&& visit) const {
    for (const auto& [id, known] : known_)
      if (known.here) visit(known.entry);
  }
  [[nodiscard]] bool is_late(std::uint64_t participant) const;
  /// Entries dropped because their heartbeat is outside its window (session/sequence_window.hpp).
  [[nodiscard]] std::uint64_t implausible() const noexcept { return implausible_; }
  /// When the last sample of somebody who is here arrived; 0 for all others.
  [[nodiscard]] std::int64_t seen_ns(std::uint64_t participant) const;
  /// How long this program has been in the session: what its own entries say.
  void set_own_presence(std::int64_t session_time_ns, std::int64_t joined_ns) noexcept {
    own_.entry.session_time_ns = session_time_ns;
    own_.entry.joined_ns = joined_ns;
  }
  /// Those who are here, and those who were a moment ago.
  [[nodiscard]] std::size_t remembered() const noexcept { return known_.size(); }

 private:
  /// A program that beats under a name that another incarnation holds.
  struct Rival {
    SequenceWindow heartbeats{kHeartbeatNumbers};
    std::uint32_t beats = 0;  // by which its heartbeat grew
    bool reported = false;
    std::int64_t seen_ns = 0;
  };
  struct Known {
    RosterEntry entry;
    SequenceWindow heartbeats{kHeartbeatNumbers};
    std::int64_t seen_ns = 0;
    bool here = false;  // false: left or gone; remembered to know its late samples
    bool left = false;
    bool late = false;
    std::map<std::uint64_t, Rival> rivals;  // by incarnation
  };

  bool watch_rival(Known& known, const RosterEntry& entry, std::int64_t now_ns, std::vector<RosterEvent>& events) const;
  void forget_rivals(Known& known, std::int64_t now_ns) const;
  void forget_absent();

  Origin self_;
  RosterSettings settings_;
  Known own_;
  std::uint64_t implausible_ = 0;
  std::map<std::uint64_t, Known> known_;                                      // by participant
  std::map<std::pair<std::uint64_t, std::uint64_t>, std::uint32_t> refused_;  // participant, incarnation -> version
};

/// Of the hosts and HRTCs that are there and their incarnations, `self` with its `role` among them: equal wherever
/// programs agree on who serves whom.
[[nodiscard]] std::uint64_t scene_hash(const Roster& roster, const Origin& self, Role role);

/// The users that an HRTC has accepted and the probe number of each.
class UserSlots {
 public:
  /// `capacity` at most kMaxSlots.
  explicit UserSlots(std::size_t capacity);

  /// The user's slot, the same again for a user who has one; none when all are taken.
  [[nodiscard]] std::optional<std::uint32_t> grant(const std::string& user);
  /// False when the user had none.
  bool release(const std::string& user);
  [[nodiscard]] std::vector<UserSlot> list() const;

 private:
  std::vector<std::string> users_;  // by slot; empty: free
};

}  // namespace tactus::session
