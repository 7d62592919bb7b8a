/// The results of a session, as text and as JSON.
///
/// Users are judged by the probe states received, HRTCs and hosts by the figures they publish (session/figures.hpp).
/// Not realtime.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "session/messages.hpp"
#include "session/percentile.hpp"
#include "session/sequence_window.hpp"

namespace tactus::client_sim {

/// Sums up one user's probe states.
class TouchTally {
 public:
  /// `start_ns`, `received_ns`: session times of the start of the run and of the arrival of this sample.
  void add(const session::ProbeState& state, std::int64_t start_ns, std::int64_t received_ns);

  std::uint64_t states = 0;
  std::uint64_t states_lost = 0;         ///< gaps in their sequence
  double served = 0;                     ///< s covered by probe states
  double contact = 0;                    ///< s
  double exact = 0;                      ///< s of contact
  double first_touch = -1;               ///< s since the start; < 0: none
  double first_exact = -1;               ///< s since the start, of the first exact contact
  double force_max = 0;                  ///< N
  std::uint32_t touches = 0;             ///< times that contact began, after at least 20 ms without
  std::uint32_t faults = 0;              ///< times that a fault was latched
  std::string fault_reason;              ///< of the last fault
  session::Samples<> age_us{1'000'000};  ///< of probe states at arrival

  [[nodiscard]] double force_mean() const noexcept { return contact > 0 ? force_seconds_ / contact : 0; }
  [[nodiscard]] double exact_share() const noexcept { return contact > 0 ? exact / contact : 0; }

 private:
  double force_seconds_ = 0;
  session::SenderWindow window_{session::kCycleNumbers};
  session::ProbeState last_;
  std::int64_t left_ns_ = INT64_MIN;  // time of the last contact
  bool started_ = false;
};

/// Sums up the poses of a movable object.
class MoveTally {
 public:
  /// `height` of its centre, m.
  void add(const session::ObjectPose& pose, double height);

  std::uint64_t poses = 0;
  std::uint32_t simulators = 0;  ///< times that another program took over its simulation
  double raised = 0;             ///< m, maximum above its first height
  double left = 0;               ///< m above its first height, at the end
  /// s, the longest unbroken time above nine tenths of `raised`. O(time).
  [[nodiscard]] double held() const;

 private:
  double first_ = 0;
  session::ObjectPose last_;
  struct Sample {
    std::int64_t ns;
    double raised;
  };
  std::vector<Sample> heights_;  // since the start, one per 10 ms while it moves
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
  double time;  ///< s since the start, negative before it; without a start, since the program's start
  std::string text;
};

struct Report {
  std::string session;
  std::string scenario;
  double duration = 0;              ///< s that it ran
  std::string trouble;              ///< why it stopped early; empty when it did not
  std::uint64_t records_total = 0;  ///< of all models in the catalogue
  /// Samples that the client dropped: a number or a time outside its window.
  std::uint64_t implausible = 0;
  std::vector<UserReport> users;
  std::vector<ObjectReport> objects;            ///< movable objects
  std::vector<ParticipantReport> participants;  ///< hosts and HRTCs
  std::vector<ReportEvent> events;
};

/// J given by couplings to the copies of all HRTCs minus J taken from them: energy that the network added.
[[nodiscard]] double injected(const Report& report);

/// Lines of at most 100 columns.
[[nodiscard]] std::string text(const Report& report);
/// One JSON object with every figure of every participant under its name.
[[nodiscard]] std::string json(const Report& report);

}  // namespace tactus::client_sim
