/// Decides the path of a simulated user's hand from a script, the catalogue and measured forces.
///
/// An operator has no mesh. It uses the bounds, surface points and pose of each object from the catalogue, the states
/// of its own probe, and the forces of other probes. World frame, SI; times are session time. One thread at a time. Not
/// realtime.
#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "client_sim/object_view.hpp"
#include "client_sim/scenario.hpp"
#include "session/messages.hpp"

namespace tactus::client_sim {

struct OperatorSettings {
  double hand_stiffness = 250;             ///< N/m, assumed stiffness of the hand
  double travel_speed = 0.25;              ///< m/s, in free space
  double clearance = 0.02;                 ///< m, distance from an object's bounds at which an approach starts
  std::int64_t period_ns = 10'000'000;     ///< time between two intents
  std::int64_t lookahead_ns = 40'000'000;  ///< time from the first to the last waypoint of an intent
};

/// Results of the script so far.
struct OperatorTally {
  std::uint32_t taps = 0;
  std::uint32_t approaches_missed = 0;  ///< approaches that reached the far side of the bounds without contact
  std::uint32_t contacts_lost = 0;      ///< contacts that ended during `follow` or `hold`
  double following = 0;                 ///< s spent following or holding
  std::uint32_t lifts = 0;              ///< objects raised, held and put down
  std::uint32_t lifts_lost = 0;         ///< lifts that ended early because contact was lost
  std::uint32_t grabs = 0;              ///< objects that the hand held
  std::uint32_t grabs_refused = 0;      ///< objects that the hand touched and could not hold
  std::uint32_t grabs_lost = 0;         ///< holds that ended before the script released the object
};

class Operator {
 public:
  Operator(const User& user, const OperatorSettings& settings);

  /// Processes a state of this user's probe. Ignores states of other users and states that are not newer.
  void on_probe_state(const session::ProbeState& state);
  /// Processes a state of another user's probe.
  void on_other_probe_state(const session::ProbeState& state);

  /// Continues the script, and returns an intent if one is due. Before the first probe state, the intent is a point
  /// outside the first object, at which the HRTC may place the hand. The caller sets the `origin` of the intent.
  [[nodiscard]] std::optional<session::Intent> tick(std::int64_t session_now_ns, const Objects& objects);

  /// True once the script has ended; never for a script that repeats.
  [[nodiscard]] bool done() const noexcept { return is_done_; }
  /// Number of the action at which the script is, from 1; 0 if the script has ended or repeats.
  [[nodiscard]] std::size_t unfinished_action() const noexcept {
    return is_done_ || user_.repeats_script ? 0 : action_ + 1;
  }
  /// Index of the action at which the script is; after its end, that of the last action.
  [[nodiscard]] std::size_t action() const noexcept { return is_done_ ? user_.script.size() - 1 : action_; }
  [[nodiscard]] const OperatorTally& tally() const noexcept { return tally_; }
  [[nodiscard]] const User& user() const noexcept { return user_; }
  /// Number of other users whose newest state is stored.
  [[nodiscard]] std::size_t stored_others() const noexcept { return others_.size(); }
  /// True while the operator follows a surface, or holds with a force.
  [[nodiscard]] bool is_following() const noexcept { return stage_ == Stage::kFollow; }

 private:
  /// The stages of actions. An action begins with kPlan and passes through some of the others:
  ///
  ///     approach  kTravel kSettle kApproach
  ///     tap       kTravel kSettle (kApproach kPullBack) x count
  ///     follow    kTravel kSettle kApproach kFollow; in contact with the same object only kFollow
  ///     hold      kFollow; without force kWait
  ///     lift      kTravel kSettle kApproach kPressTogether kLift kTravel kSettle
  ///     grab      kTravel kSettle kApproach kGrab
  ///     move      kMove
  ///     release   kRelease kTravel kSettle
  ///     retreat   kTravel kSettle
  ///     wait      kWait
  enum class Stage : std::uint8_t {
    kPlan,
    kTravel,         ///< moves along `route_`
    kSettle,         ///< waits until the device has reached the hand's target
    kApproach,       ///< moves towards the object until the contact force is reached
    kPullBack,       ///< moves away from the surface between two taps
    kFollow,         ///< moves along the surface and controls the force
    kPressTogether,  ///< presses until enough users press
    kLift,           ///< raises the object, holds it and lowers it
    kGrab,           ///< waits until the HRTC reports that the hand holds the object
    kMove,           ///< moves the held object
    kRelease,        ///< waits until the HRTC has released the object
    kWait            ///< does not move
  };

  // operator.cpp
  void run_stage(double dt, const Objects& objects);
  void orient_hand(double dt);
  [[nodiscard]] std::optional<session::Intent> first_intent(std::int64_t session_now_ns, const Objects& objects);
  [[nodiscard]] bool begin_action(const Action& action, const Objects& objects);
  void next_action();
  [[nodiscard]] bool move_hand_towards(const Vec3d& target, double speed, double dt);
  [[nodiscard]] bool is_touching() const noexcept;

  // operator_approach.cpp
  [[nodiscard]] Vec3d aim_point(const Action& action, const ObjectView& view) const;
  [[nodiscard]] Vec3d start_point(const Action& action, const ObjectView& view) const;
  void plan_route(const Vec3d& to);
  void approach(const Action& action, double dt);
  [[nodiscard]] Vec3d way_out() const;
  void pull_back(const Action& action, double dt);

  // operator_follow.cpp
  void start_following(const Action& action);
  void follow(const Action& action, double dt);
  [[nodiscard]] Vec3d tangent(const Action& action);

  // operator_hold.cpp
  void start_lift();
  void press_together(const Action& action, double dt);
  void lift(const Action& action, double dt);
  void grab();
  void start_moving();
  void move_object(const Action& action, double dt);
  void start_release();
  void release();
  void end_hold();
  void leave_object();
  void press(double force, double time_constant, double dt);
  void track_load(const Vec3d& load, double time_constant, double dt);
  [[nodiscard]] Vec3d load_offset() const;
  [[nodiscard]] bool others_press(const Action& action, double force) const;

  static constexpr double kWaitingForce = 0.5;  // N, with which a user presses until the others press too

  User user_;
  OperatorSettings settings_;
  std::uint64_t user_id_;
  std::uint32_t sequence_ = 0;
  OperatorTally tally_;

  // Newest state of the own probe.
  bool has_state_ = false;
  std::int64_t state_ns_ = 0;
  Vec3d device_ = Vec3d::Zero(), proxy_ = Vec3d::Zero();
  Vec3d proxy_velocity_ = Vec3d::Zero();  // smoothed
  Vec3d normal_ = Vec3d::UnitZ();         // of the surface, estimated from the force
  Vec3d smoothed_force_ = Vec3d::Zero();  // N
  double force_norm_ = 0;                 // N
  double smoothed_norm_ = 0;              // N
  bool in_contact_ = false;
  bool is_holding_ = false, is_refused_ = false;  // status bits kHolding, kHoldRefused
  bool has_fault_ = false;                        // status bit kFault: there is no force until a reset

  // Newest states of the other users' probes, at most 200 ms old.
  struct Other {
    std::uint64_t object = 0;
    double force = 0;              // N
    std::int64_t received_ns = 0;  // session time of this user's newest state when this one arrived
  };
  std::map<std::uint64_t, Other> others_;  // by user

  // Orientation of the hand.
  bool tilts_hand_ = false;           // an action of the script has a `tilt`
  Vec3d hand_axis_ = Vec3d::UnitZ();  // z axis of the hand without tilt: smoothed normal or direction of approach
  Eigen::Quaterniond untilted_ = Eigen::Quaterniond::Identity();
  Eigen::Quaterniond orientation_ = Eigen::Quaterniond::Identity();
  Eigen::Quaterniond orientation_ahead_ = Eigen::Quaterniond::Identity();  // at the end of the intent

  // Progress in the script.
  std::size_t action_ = 0;
  bool is_done_ = false;
  Stage stage_ = Stage::kPlan;
  std::int64_t ticked_ns_ = 0;
  double stage_time_ = 0;                  // s since the stage began
  double followed_time_ = 0;               // s of kFollow in this action
  std::uint32_t attempts_ = 0, taps_ = 0;  // in this action
  double loss_time_ = 0;                   // s since the loss of contact; in kMove and kWait, of the hold
  bool is_leaving_ = false;                // the route leads away from the object and ends the action

  // Motion of the hand. `hand_` is the target of the device, which lags behind it and stops at surfaces.
  Vec3d hand_ = Vec3d::Zero(), hand_velocity_ = Vec3d::Zero();
  std::vector<Vec3d> route_;  // remaining points, the next one at the end
  std::uint32_t buttons_ = 0;

  // The object of the action.
  std::string object_;
  ObjectView view_;
  Vec3d outwards_ = Vec3d::UnitZ();       // unit vector from the object to the start of the approach, world
  Vec3d approach_start_ = Vec3d::Zero();  // outside the bounds
  double max_travel_ = 0;                 // m from `approach_start_` to the far side of the bounds

  // Contact.
  Vec3d first_contact_ = Vec3d::Zero();  // position of the proxy when contact began
  bool has_first_contact_ = false;
  double push_depth_ = 0;  // m, depth of the hand below the surface; it causes the force

  // Following.
  Vec3d cursor_ = Vec3d::Zero();   // point on the surface ahead of the proxy, which the hand follows
  double extent_ = 0;              // m, size of the pattern
  double row_ = 0, row_step_ = 0;  // zigzag: m, coordinate of the row, and distance to the next row
  double heading_ = 1;             // zigzag: direction along the row, 1 or -1
  double plane_offset_ = 0;        // around: m, distance of the plane of motion from the object's centre

  // Holding.
  Vec3d anchor_ = Vec3d::Zero();  // position of the hand without push, load and displacement
  Vec3d load_ = Vec3d::Zero();    // N, smoothed force of the object's weight and inertia on the arm
  double together_time_ = 0;      // s for which enough users have pressed with enough force
};

}  // namespace tactus::client_sim
