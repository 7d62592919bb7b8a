/// In which mode each user's probe states travel, and which ends of topics that takes.
///
///     large-scale   every user's, to the whole session: coded, played out by those who hear them. Always there, so
///                   that everybody sees everybody, late comers too.
///     collaborate   those of users near one object, among their controllers: every cycle's, shown at once.
///
///                near, or told to                 peers matched
///     apart -----------------------> ends built ----------------> together: states sent whole
///       ^                                                            |  apart for a while, or told to
///       +---- ends dropped <---- linger <----------------------------+
///
/// Who is near what follows from positions and catalogue alone, which every controller has, so each decides for itself
/// and all come to the same. A user belongs to one group at most: the object that it came near first. A group of an
/// object has the object's id, one that was commanded the id of its users' names.
///
/// Commands are Control samples of kind kMode, the newest of all counts: `auto`, or `collaborate` or `large-scale` for
/// everyone, or for some: `collaborate ann,bob`. Everyone else stays with `auto`.
///
/// No clock and no DDS in it. One thread at a time.
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
  double near = 0.05;                    ///< m from an object's bounds at which a probe comes near
  double apart = 0.10;                   ///< m at which it no longer is
  std::size_t max_together = 8;          ///< users near one object, beyond which all of them stay apart
  std::int64_t dwell_ns = 500'000'000;   ///< for which it has to be apart
  std::int64_t linger_ns = 200'000'000;  ///< for which the ends of a group that is over stay
  std::int64_t forget_ns = 300'000'000;  ///< silence after which a probe is gone
};

/// What a mode command says.
struct ModeCommand {
  enum class Kind : std::uint8_t { kAuto, kCollaborate, kLargeScale } kind = Kind::kAuto;
  std::set<std::uint64_t> users;  ///< ids; empty: everyone
};
/// Throws std::invalid_argument naming what was found and what was expected.
[[nodiscard]] ModeCommand parse_mode(const std::string& text);

/// Distance of a world position from the bounds of an object; 0 inside.
[[nodiscard]] double distance_from(const CatalogueEntry& object, const std::array<double, 3>& position);

class Modes {
 public:
  /// `self`: this controller's participant.
  explicit Modes(std::uint64_t self, const ModeSettings& settings = {}) : self_{self}, settings_{settings} {}

  void on_catalogue(const CatalogueEntry& entry);
  /// This controller has it no more.
  void forget_object(std::uint64_t object) { objects_.erase(object); }
  /// A probe of `participant`'s user, our own ones too.
  void on_probe(std::uint64_t user, std::uint64_t participant, const std::array<double, 3>& position,
                std::int64_t now_ns);
  /// Replaces the command before it.
  void command(const ModeCommand& command) { command_ = command; }
  /// A user has left.
  void forget(std::uint64_t user) { probes_.erase(user); }

  void tick(std::int64_t now_ns);

  /// Groups whose ends are needed, ascending.
  [[nodiscard]] std::vector<std::uint64_t> groups() const;
  /// Peers have been found at both ends of the group, or no longer.
  void on_peers(std::uint64_t group, bool matched);
  /// Where our user's whole states go; 0: nowhere.
  [[nodiscard]] std::uint64_t group_of(std::uint64_t user) const;

 private:
  struct Probe {
    std::uint64_t participant = 0;
    std::array<double, 3> position{};
    std::int64_t seen_ns = 0, near_ns = 0;
    std::uint64_t object = 0;  // near it; 0: none
  };
  struct Group {
    bool over = false;
    bool matched = false;
    std::int64_t over_ns = 0;
    std::set<std::uint64_t> ours;
  };

  void place(Probe& probe, std::int64_t now_ns) const;
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
