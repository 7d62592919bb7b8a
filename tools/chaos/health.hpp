/// Judges the health of a session by its samples: who is missing, and whether a sample violates a rule that holds even
/// during faults.
///
/// No DDS and no clock: samples and times are arguments. One thread at a time.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "session/messages.hpp"
#include "session/roster.hpp"

namespace tactus::chaos {

struct HealthSettings {
  double max_force = 8;                       ///< N; largest force that a device may have
  std::int64_t max_silence_ns = 250'000'000;  ///< of a user: deadband-coded states come at least every 40 ms
};

class Health {
 public:
  /// `self`: this program. Samples are those of its session.
  Health(const session::Origin& self, const HealthSettings& settings);

  void on_sample(const session::RosterEntry& entry, std::int64_t now_ns);
  void on_sample(const session::ProbeState& state, std::int64_t now_ns);
  void tick(std::int64_t now_ns);

  /// From now on, `missing` expects all hosts, HRTCs, clients and users of this moment: the reference.
  void set_reference(std::int64_t now_ns);
  /// Returns who of the reference is not present, each as a text such as "host museum". A user is present while fresh
  /// states arrive, its forces are on, and its contacts are exact if they were exact before.
  [[nodiscard]] std::vector<std::string> missing(std::int64_t now_ns) const;
  /// Lists the participants and users of the reference; empty if there are none.
  [[nodiscard]] std::string reference_text() const;
  /// Whether the reference has users.
  [[nodiscard]] bool has_users() const noexcept { return !users_.empty(); }

  /// Violations: forces above the limit, and states of an HRTC's old process after the first state of a new one.
  [[nodiscard]] const std::vector<std::string>& violations() const noexcept { return violations_; }
  /// Number of states that arrived.
  [[nodiscard]] std::uint64_t states() const noexcept { return states_; }
  [[nodiscard]] double max_force() const noexcept { return max_force_; }

 private:
  struct User {
    session::ProbeState newest;
    std::int64_t received_ns = 0;
    std::int64_t exact_ns = 0;  // arrival of the newest exact contact; 0: none
  };
  void report(std::uint64_t user, const char* violation);
  [[nodiscard]] std::string name_of(std::uint64_t user) const;
  [[nodiscard]] const char* obstacle_of(std::uint64_t user, std::int64_t now_ns) const;

  HealthSettings settings_;
  session::Roster roster_;
  std::map<std::uint64_t, User> states_of_;              // by user id
  std::map<std::uint64_t, std::string> names_;           // of users, by id
  std::map<std::uint64_t, std::uint64_t> incarnations_;  // newest in the states of an HRTC
  std::map<std::uint64_t, std::string> participants_;    // of the reference: role and name
  std::map<std::uint64_t, bool> users_;                  // of the reference: whether it had exact contacts
  std::vector<std::string> violations_;
  std::uint64_t states_ = 0;
  double max_force_ = 0;
};

}  // namespace tactus::chaos
