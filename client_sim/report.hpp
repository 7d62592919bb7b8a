/// Computes the results of a session, and writes them as text and as JSON.
///
/// The results of users come from received probe states. The results of HRTCs and hosts come from the figures that they
/// publish (session/figures.hpp). Not realtime.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "client_sim/touch_course.hpp"
#include "session/messages.hpp"
#include "session/percentile.hpp"
#include "session/sequence_window.hpp"

namespace tactus::client_sim {

/// Counts and sums over the probe states of one user.
class TouchTally {
 public:
  /// `start_ns`: session time of the start of the scenario. `received_ns`: session time of the arrival of `state`.
  void add(const session::ProbeState& state, std::int64_t start_ns, std::int64_t received_ns);

  std::uint64_t states = 0;
  std::uint64_t states_lost = 0;            ///< missing sequence numbers
  double served = 0;                        ///< s covered by probe states; each covers at most 50 ms until the next
  double contact = 0;                       ///< s of `served` in contact
  double exact = 0;                         ///< s of `contact` in exact contact
  double first_touch = -1;                  ///< s from the start to the first contact; < 0: none
  double first_exact = -1;                  ///< s from the start to the first exact contact; < 0: none
  double force_max = 0;                     ///< N
  std::uint32_t touches = 0;                ///< number of contacts that began after at least 20 ms without contact
  std::uint32_t faults = 0;                 ///< number of faults that were latched
  std::string fault_reason;                 ///< of the last fault
  session::Samples<float> age_us{100'000};  ///< ages of the newest probe states at arrival
  TouchCourse course;

  [[nodiscard]] double force_mean() const noexcept { return contact > 0 ? force_seconds_ / contact : 0; }
  [[nodiscard]] double exact_share() const noexcept { return contact > 0 ? exact / contact : 0; }

 private:
  double force_seconds_ = 0;  // N s, integral of the force in contact
  session::SenderWindow window_{session::kCycleNumbers};
  session::ProbeState last_;
  std::int64_t contact_ns_ = INT64_MIN;  // session time of the newest state in contact
  bool started_ = false;
};

/// Counts the poses of a movable object and measures its height.
class MoveTally {
 public:
  /// `height`: of the object's centre, m.
  void add(const session::ObjectPose& pose, double height);

  std::uint64_t poses = 0;
  std::uint32_t takeovers = 0;  ///< number of times that another program took over the simulation
  double max_raised = 0;        ///< m, max height minus first height
  double last_raised = 0;       ///< m, last height minus first height
  /// Returns the longest time for which the object was raised by at least 90 % of `max_raised`, s. O(number of poses).
  [[nodiscard]] double held_time() const;

 private:
  double first_height_ = 0;
  session::ObjectPose last_;
  struct Sample {
    std::int64_t ns;
    double raised;
  };
  std::vector<Sample> heights_;  // at most one in 10 ms
};

struct ObjectReport {
  std::string name;
  MoveTally movement;
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
  bool present_at_end = true;
  std::map<std::string, double> figures;
};

struct ReportEvent {
  double time;  ///< s since the start of the scenario; if it never started, since the start of the program
  std::string text;
};

struct Report {
  std::string session;
  std::string scenario;
  double duration = 0;              ///< s for which the scenario ran
  std::string stop_reason;          ///< reason why the scenario stopped early; empty if it did not
  std::uint64_t records_total = 0;  ///< number of records of all models in the catalogue
  std::uint64_t implausible = 0;    ///< samples that the client dropped: a number or a time was not plausible
  std::vector<UserReport> users;
  std::vector<ObjectReport> objects;            ///< movable objects
  std::vector<ParticipantReport> participants;  ///< hosts and HRTCs
  std::vector<ReportEvent> events;
};

/// Returns the energy that the network added, J, at least 0: the sum of the net energy that the couplings of each HRTC
/// gave to its copies (session::figures::kCopyGiven).
[[nodiscard]] double injected_energy(const Report& report);

/// Writes the report as text, with lines of at most 100 columns.
[[nodiscard]] std::string text(const Report& report);
/// Writes the report as one JSON object, with every figure of every participant under its name.
[[nodiscard]] std::string json(const Report& report);

}  // namespace tactus::client_sim
