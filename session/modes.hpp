/// Decides in which mode the probe states of each user are sent, and which groups need endpoints.
///
///     large-scale   the deadband-coded states of all users go to the whole session, and receivers delay them by
///                   playout. This mode is always on, so that participants that join later receive all users too.
///     collaborate   the full-rate states of users near one object also go to the HRTCs of these users, without playout
///
///              near, or by command                       peers matched
///     apart -----------------------> endpoints created --------------> together: full-rate states sent
///       ^                                                                |  apart for `dwell_ns`, or by command
///       +---- endpoints deleted <---- `linger_ns` <----------------------+
///
/// The positions of probes and the catalogue decide which user is near which object. Every HRTC receives both, so all
/// HRTCs make the same decision without messages. A user belongs to at most one group: the group of the object to
/// which the user came near first. A group has the id of its object. If a command makes the group, its id is computed
/// from the ids of its users.
///
/// Commands are Control samples of kind kMode; the newest one applies. `auto` selects groups by nearness. `collaborate`
/// and `large-scale` apply to all users or to listed ones, as in `collaborate ann,bob`; `auto` then applies to the
/// others.
///
/// If a link is too slow for full-rate states (session/full_rate_check.hpp), the HRTC behind it leaves all groups for a
/// time. Its users then have deadband-coded states only.
///
/// No clock and no DDS. One thread at a time.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "session/messages.hpp"

namespace tactus::session {

struct ModeSettings {
  double near_distance = 0.05;   ///< m, distance from an object's bounds below which a probe becomes near
  double apart_distance = 0.10;  ///< m, distance above which the probe is apart, after `dwell_ns`
  std::size_t max_collaborating =
      8;  ///< max users near one object that collaborate; if there are more, none of them does
  std::int64_t dwell_ns = 500'000'000;   ///< time that a probe must be apart
  std::int64_t linger_ns = 200'000'000;  ///< time that the endpoints of a finished group remain
  std::int64_t forget_ns = 300'000'000;  ///< time without a state after which a probe is dropped
  /// Time for which the HRTC leaves all groups if its link is too slow. Doubles each time, four times at most.
  std::int64_t pause_ns = 30'000'000'000;
  std::int64_t forget_pauses_ns = 60'000'000'000;  ///< time after a pause until the next one is short again
};

/// A parsed mode command.
struct ModeCommand {
  enum class Kind : std::uint8_t { kAuto, kCollaborate, kLargeScale } kind = Kind::kAuto;
  std::set<std::uint64_t> users;  ///< ids; empty: all users
};
/// Parses a mode command. Throws std::invalid_argument with the value found and the values expected.
[[nodiscard]] ModeCommand parse_mode(const std::string& text);

/// Distance of a world position from the bounds of an object, m; 0 inside.
[[nodiscard]] double distance_from(const CatalogueEntry& object, const std::array<double, 3>& position);

class Modes {
 public:
  /// `self`: participant id of this HRTC.
  explicit Modes(std::uint64_t self, const ModeSettings& settings = {}) : self_{self}, settings_{settings} {}

  void on_catalogue(const CatalogueEntry& entry);
  /// Forgets an object that this HRTC no longer has.
  void forget_object(std::uint64_t object) { objects_.erase(object); }
  /// Sets the position of a user's probe, own or remote. `participant`: the HRTC of the user.
  void on_probe(std::uint64_t user, std::uint64_t participant, const std::array<double, 3>& position,
                std::int64_t now_ns);
  /// Replaces the previous command.
  void set_command(const ModeCommand& command) { command_ = command; }
  /// Forgets a user who has left.
  void forget_user(std::uint64_t user) { probes_.erase(user); }

  /// Leaves all groups for a time, because the link is too slow for full-rate states.
  void pause(std::int64_t now_ns);
  /// Whether the HRTC had left all groups for a time at the last tick.
  [[nodiscard]] bool is_paused() const noexcept { return is_paused_; }

  /// Decides the groups anew.
  void tick(std::int64_t now_ns);

  /// Ids of the groups that need endpoints, ascending.
  [[nodiscard]] std::vector<std::uint64_t> groups() const;
  /// Sets whether this HRTC's writer and reader of the group have both matched endpoints of peers.
  void on_peers(std::uint64_t group, bool matched);
  /// The group to which the full-rate states of an own user are sent; 0: none.
  [[nodiscard]] std::uint64_t group_of(std::uint64_t user) const;

 private:
  struct Probe {
    std::uint64_t participant = 0;
    std::array<double, 3> position{};
    std::int64_t received_ns = 0, near_ns = 0;  // when a position arrived, and when it was last near `object`
    std::uint64_t object = 0;                   // object to which the probe is near; 0: none
  };
  struct Group {
    bool ended = false;
    bool matched = false;  // with endpoints of peers
    std::int64_t ended_ns = 0;
    std::set<std::uint64_t> own_users;
  };

  void assign_object(Probe& probe, std::int64_t now_ns) const;
  [[nodiscard]] bool is_commanded(std::uint64_t user) const;
  [[nodiscard]] std::uint64_t group_for(std::uint64_t user, const Probe& probe) const;

  std::uint64_t self_;
  ModeSettings settings_;
  ModeCommand command_;
  std::map<std::uint64_t, CatalogueEntry> objects_;
  std::map<std::uint64_t, Probe> probes_;  // by user
  std::map<std::uint64_t, Group> groups_;
  std::int64_t paused_until_ns_ = INT64_MIN / 2;
  int pauses_ = 0;  // successive ones
  bool is_paused_ = false;
};

}  // namespace tactus::session
