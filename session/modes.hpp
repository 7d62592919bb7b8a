/// Selects the mode in which each user's probe states are sent, and the endpoints that this needs.
///
///     large-scale   deadband-coded states of every user, to the whole session, with playout at the receivers. Always
///                   on, so that everybody sees everybody, late joiners too.
///     collaborate   full-rate states of the users near one object, among their HRTCs; shown at once.
///
///              near, or by command                       peers matched
///     apart -----------------------> endpoints created --------------> together: full-rate states sent
///       ^                                                                |  apart for `dwell_ns`, or by command
///       +---- endpoints deleted <---- `linger_ns` <----------------------+
///
/// Which user is near which object follows from positions and catalogue alone. Every HRTC has these, so each decides
/// for itself and all agree. A user belongs to one group at most: that of the object that it came near first. The group
/// of an object has the object's id; the group of a command has an id made of its users' names.
///
/// Commands are Control samples of kind kMode; the newest one counts. `auto` selects the rule above. `collaborate` and
/// `large-scale` apply to everyone, or with a list, as in `collaborate ann,bob`, to these users; `auto` to the others.
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
  double near = 0.05;                    ///< m, distance from an object's bounds at which a probe becomes near
  double apart = 0.10;                   ///< m, distance at which it stops being near, after `dwell_ns`
  std::size_t max_together = 8;          ///< users near one object; with more, all of them stay in large-scale
  std::int64_t dwell_ns = 500'000'000;   ///< time that a probe must be apart
  std::int64_t linger_ns = 200'000'000;  ///< time that the endpoints of a finished group remain
  std::int64_t forget_ns = 300'000'000;  ///< silence after which a probe is dropped
};

/// A parsed mode command.
struct ModeCommand {
  enum class Kind : std::uint8_t { kAuto, kCollaborate, kLargeScale } kind = Kind::kAuto;
  std::set<std::uint64_t> users;  ///< ids; empty: everyone
};
/// Throws std::invalid_argument with the value found and the values expected.
[[nodiscard]] ModeCommand parse_mode(const std::string& text);

/// Distance of a world position from the bounds of an object; 0 inside.
[[nodiscard]] double distance_from(const CatalogueEntry& object, const std::array<double, 3>& position);

class Modes {
 public:
  /// `self`: participant id of this HRTC.
  explicit Modes(std::uint64_t self, const ModeSettings& settings = {}) : self_{self}, settings_{settings} {}

  void on_catalogue(const CatalogueEntry& entry);
  /// This HRTC no longer has the object.
  void forget_object(std::uint64_t object) { objects_.erase(object); }
  /// Position of a probe of `participant`'s user; for own probes too.
  void on_probe(std::uint64_t user, std::uint64_t participant, const std::array<double, 3>& position,
                std::int64_t now_ns);
  /// Replaces the previous command.
  void command(const ModeCommand& command) { command_ = command; }
  /// A user has left.
  void forget(std::uint64_t user) { probes_.erase(user); }

  void tick(std::int64_t now_ns);

  /// Groups that need endpoints, ascending.
  [[nodiscard]] std::vector<std::uint64_t> groups() const;
  /// Whether both endpoints of the group have matched peers.
  void on_peers(std::uint64_t group, bool matched);
  /// The group to which the full-rate states of an own user are sent; 0: none.
  [[nodiscard]] std::uint64_t group_of(std::uint64_t user) const;

 private:
  struct Probe {
    std::uint64_t participant = 0;
    std::array<double, 3> position{};
    std::int64_t seen_ns = 0, near_ns = 0;
    std::uint64_t object = 0;  // that it is near; 0: none
  };
  struct Group {
    bool over = false;
    bool matched = false;
    std::int64_t over_ns = 0;
    std::set<std::uint64_t> ours;
  };

  void assign_object(Probe& probe, std::int64_t now_ns) const;
  [[nodiscard]] bool commanded(std::uint64_t user) const;
  [[nodiscard]] std::uint64_t group_wanted(std::uint64_t user, const Probe& probe) const;

  std::uint64_t self_;
  ModeSettings settings_;
  ModeCommand command_;
  std::map<std::uint64_t, CatalogueEntry> objects_;
  std::map<std::uint64_t, Probe> probes_;  // by user
  std::map<std::uint64_t, Group> groups_;
};

}  // namespace tactus::session
