/// What a session came to, for people and for machines.
///
/// Users are judged by the probe states they received, controllers and hosts by the figures they publish
/// (session/figures.hpp). Not realtime.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "session/messages.hpp"
#include "session/sequence_window.hpp"

namespace tactus::client_sim {

/// Values of which percentiles are wanted; keeps the newest million.
class Samples {
 public:
  void add(double value);
  /// `share` from 0 to 1; 0 when empty. O(size).
  [[nodiscard]] double percentile(double share) const;
  [[nodiscard]] bool empty() const noexcept { return values_.empty(); }

 private:
  static constexpr std::size_t kKept = 1'000'000;
  std::vector<double> values_;
  std::size_t next_ = 0;
};

/// Adds up what one user's probe states tell.
class TouchTally {
 public:
  /// `start_ns`, `received_ns`: session time when the run began and when this sample came.
  void add(const session::ProbeState& state, std::int64_t start_ns, std::int64_t received_ns);

  std::uint64_t states = 0;
  std::uint64_t states_lost = 0;  ///< gaps in their sequence
  double served = 0;              ///< s covered by probe states
  double contact = 0;             ///< s
  double exact = 0;               ///< s of contact
  double first_touch = -1;        ///< s since the start; < 0: none
  double first_exact = -1;        ///< s since the start, of the first exact contact
  double force_max = 0;           ///< N
  std::uint32_t touches = 0;      ///< times that contact began, after 20 ms or more without
  std::uint32_t faults = 0;       ///< times that a fault was latched
  std::string fault_reason;       ///< of the last
  Samples age_us;                 ///< of probe states when they came

  [[nodiscard]] double force_mean() const noexcept { return contact > 0 ? force_seconds_ / contact : 0; }
  [[nodiscard]] double exact_share() const noexcept { return contact > 0 ? exact / contact : 0; }

 private:
  double force_seconds_ = 0;
  session::SenderWindow window_{session::kCycleNumbers};
  session::ProbeState last_;
  std::int64_t left_ns_ = INT64_MIN;  // when contact last was
  bool started_ = false;
};

/// Adds up what the poses of an object that can be moved tell.
class MoveTally {
 public:
  /// `height` of its centre, m.
  void add(const session::ObjectPose& pose, double height);

  std::uint64_t poses = 0;
  std::uint32_t simulators = 0;  ///< times that somebody else took it on
  double raised = 0;             ///< m above where it was first seen, at most
  double left = 0;               ///< m above where it was first seen, at the end
  /// s, the longest time without a break for which it was raised by nine tenths of `raised`. O(time).
  [[nodiscard]] double held() const;

 private:
  double first_ = 0;
  session::ObjectPose last_;
  struct Sample {
    std::int64_t ns;
    double raised;
  };
  std::vector<Sample> way_;  // since the start, one in 10 ms while it moves
};

struct ObjectReport {
  std::string name;
  MoveTally moved;
};

struct UserReport {
  std::string name;
  std::string hrtc;
  TouchTally touch;
  std::uint32_t taps = 0;
  std::uint32_t approaches_missed = 0;
  std::uint32_t contacts_lost = 0;
  double following = 0;  ///< s
  std::uint32_t lifts = 0, lifts_lost = 0;
  std::uint32_t grabs = 0, grabs_refused = 0, grabs_lost = 0;
};

struct ParticipantReport {
  std::string name;
  session::Role role = session::Role::kHost;
  bool here = true;  ///< at the end
  std::map<std::string, double> figures;
};

struct ReportEvent {
  double time;  ///< s since the start, negative before it; of a session that never started, since the program's
  std::string text;
};

struct Report {
  std::string session;
  std::string scenario;
  double duration = 0;              ///< s that it ran
  std::string trouble;              ///< why it did not run to its end; empty when it did
  std::uint64_t records_total = 0;  ///< of all models in the catalogue
  std::vector<UserReport> users;
  std::vector<ObjectReport> objects;            ///< that can be moved
  std::vector<ParticipantReport> participants;  ///< hosts and HRTCs
  std::vector<ReportEvent> events;
};

/// J that couplings gave to the copies of all controllers together, less what they took: the network's own energy.
[[nodiscard]] double injected(const Report& report);

/// Lines of at most 100 columns.
[[nodiscard]] std::string text(const Report& report);
/// One JSON object; every figure of every participant under its own name.
[[nodiscard]] std::string json(const Report& report);

}  // namespace tactus::client_sim
