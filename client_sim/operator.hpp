/// A simulated user: turns a script, known objects and measured forces into hand motions.
///
/// It has no mesh. It uses bounds, surface points and pose of an object from the catalogue, the probe states of its own
/// probe, and the forces of other probes. World frame, SI; times are session time. One thread at a time. Not realtime.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "client_sim/scenario.hpp"
#include "session/messages.hpp"

namespace tactus::client_sim {

/// An object as the catalogue describes it: a box, and points of the surface in it.
struct ObjectView {
  std::uint64_t id = 0;
  Vec3d centre = Vec3d::Zero();                            ///< world, m
  Vec3d half = Vec3d::Zero();                              ///< half edges along the object's axes, m
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();  ///< object's axes to world
  bool moves = false;                                      ///< the object is movable
  struct SurfacePoint {
    Vec3d position, normal;  ///< world, m; the normal is zero where unknown
  };
  std::vector<SurfacePoint> surface;  ///< empty: the whole box counts as solid
  double spacing = 0;                 ///< m; every point of the surface is within this distance of one of these
};
[[nodiscard]] ObjectView view_of(const session::CatalogueEntry& entry);

/// By object name.
using Objects = std::map<std::string, ObjectView>;

/// The object that a scenario names: by name, or with "#n" the n-th fixed object by name, modulo their number. Null
/// when there is none.
[[nodiscard]] const ObjectView* find_object(const Objects& objects, const std::string& reference);

struct OperatorSettings {
  double hand_stiffness = 250;             ///< N/m, the user's estimate for its own hand
  double travel_speed = 0.25;              ///< m/s, in free space
  double clearance = 0.02;                 ///< m outside an object's bounds, for approaches
  std::int64_t period_ns = 10'000'000;     ///< between intents
  std::int64_t lookahead_ns = 40'000'000;  ///< range into the future of an intent
};

/// Counts of what the script has achieved so far.
struct OperatorTally {
  std::uint32_t taps = 0;
  std::uint32_t approaches_missed = 0;  ///< reached the far side of the bounds without contact
  std::uint32_t contacts_lost = 0;      ///< while following
  double following = 0;                 ///< s
  std::uint32_t lifts = 0;              ///< objects raised, held and put down
  std::uint32_t lifts_lost = 0;         ///< contact was lost while lifting
  std::uint32_t grabs = 0;              ///< objects that the hand held
  std::uint32_t grabs_refused = 0;      ///< objects that it touched and could not hold
  std::uint32_t grabs_lost = 0;         ///< holds that ended before release
};

class Operator {
 public:
  Operator(const User& user, const OperatorSettings& settings);

  /// A state of this user's probe; states of others and states older than the newest are ignored.
  void on_probe_state(const session::ProbeState& state);
  /// A state of another user's probe.
  void on_other(const session::ProbeState& state);

  /// Continues the script; returns an intent whenever one is due. Before the first probe state the intent is a point
  /// clear of the first object, where an HRTC may place the hand. The caller sets `origin`.
  [[nodiscard]] std::optional<session::Intent> tick(std::int64_t session_now_ns, const Objects& objects);

  /// The script has ended and does not repeat.
  [[nodiscard]] bool done() const noexcept { return done_; }
  [[nodiscard]] const OperatorTally& tally() const noexcept { return tally_; }
  [[nodiscard]] const User& user() const noexcept { return user_; }
  /// True while the script expects contact.
  [[nodiscard]] bool following() const noexcept { return stage_ == Stage::kFollow; }

 private:
  enum class Stage : std::uint8_t {
    kBegin,
    kTravel,
    kSteady,
    kPressIn,
    kLiftOff,
    kFollow,
    kGrip,
    kCarry,
    kClose,
    kMove,
    kOpen,
    kStill
  };

  void act(double dt, const Objects& objects);
  void orient_hand(double dt);
  [[nodiscard]] bool begin(const Action& action, const Objects& objects);
  [[nodiscard]] Vec3d aim_at(const Action& action, const ObjectView& view) const;
  [[nodiscard]] Vec3d start_of(const Action& action, const ObjectView& view) const;
  [[nodiscard]] std::optional<session::Intent> first_intent(std::int64_t session_now_ns, const Objects& objects);
  void plan_route(const Vec3d& to);
  void next_action();
  void press_in(const Action& action, double dt);
  void lift_off(const Action& action, double dt);
  void follow(const Action& action, double dt);
  void start_gripping();
  void grip(const Action& action, double dt);
  void carry(const Action& action, double dt);
  void close_hand(double dt);
  void move_held(const Action& action, double dt);
  void open_hand();
  void give_up_holding();
  void bear(const Vec3d& load, double within, double dt);
  void press_with(double force, double settling, double dt);
  [[nodiscard]] bool others_press(const Action& action, double force) const;
  void start_following(const Action& action);
  [[nodiscard]] bool go_to(const Vec3d& target, double speed, double dt);
  [[nodiscard]] Vec3d tangent(const Action& action);
  [[nodiscard]] bool touching() const noexcept;

  User user_;
  OperatorSettings settings_;
  std::uint64_t user_id_;
  std::uint32_t sequence_ = 0;
  OperatorTally tally_;

  // Measured state.
  bool has_state_ = false;
  std::int64_t state_ns_ = 0;
  Vec3d device_ = Vec3d::Zero(), proxy_ = Vec3d::Zero();
  Vec3d travel_ = Vec3d::Zero();   // velocity of the proxy, smoothed
  Vec3d normal_ = Vec3d::UnitZ();  // of the surface, estimated from the force
  double force_ = 0;               // N, smoothed
  double raw_force_ = 0;
  bool in_contact_ = false;
  bool holding_ = false, refused_ = false;  // as the HRTC reports
  bool off_ = false;                        // its force is, until a reset
  Vec3d felt_force_ = Vec3d::Zero();        // N, smoothed
  struct Other {
    std::uint64_t object = 0;
    double force = 0;              // N
    std::int64_t received_ns = 0;  // time of arrival
  };
  std::map<std::uint64_t, Other> others_;  // by user

  // Orientation of the hand, when the script tilts it.
  bool leans_ = false;
  Vec3d upright_ = Vec3d::UnitZ();                            // surface normal, smoothed by the wrist
  Eigen::Quaterniond base_ = Eigen::Quaterniond::Identity();  // its z axis is upright_
  Eigen::Quaterniond orientation_ = Eigen::Quaterniond::Identity(), ahead_ = Eigen::Quaterniond::Identity();

  // Wanted motion.
  std::size_t action_ = 0;
  bool done_ = false;
  Stage stage_ = Stage::kBegin;
  std::int64_t ticked_ns_ = 0;
  Vec3d hand_ = Vec3d::Zero(), hand_velocity_ = Vec3d::Zero();
  double clock_ = 0;     // s in this stage
  double followed_ = 0;  // s in this action
  std::uint32_t attempts_ = 0, taps_ = 0;
  std::vector<Vec3d> route_;  // remaining points, last first
  std::uint32_t buttons_ = 0;

  // The object of the action.
  std::string object_;
  ObjectView view_;
  Vec3d outwards_ = Vec3d::UnitZ();  // direction of approach, reversed, world
  Vec3d start_ = Vec3d::Zero();      // outside the bounds
  double depth_ = 0;                 // m from `start_` to the far side of the bounds

  // Contact.
  Vec3d touched_ = Vec3d::Zero();  // where contact began
  bool has_touched_ = false;
  Vec3d cursor_ = Vec3d::Zero();  // target point that leads the proxy along the surface
  double push_ = 0;               // m, wanted depth of the hand below the cursor
  double lost_ = 0;               // s without contact
  double extent_ = 0;
  double row_ = 0, row_step_ = 0, heading_ = 1;  // zigzag
  double plane_ = 0;                             // around: distance of the plane of motion from the centre

  // Lifting.
  Vec3d gripped_ = Vec3d::Zero();  // position of the device when all pressed, or when the hold began
  Vec3d load_ = Vec3d::Zero();     // N, tangential to the press, as the arm carries it
  double both_ = 0;                // s for which all have pressed
  bool released_ = false;          // the route leads away from the object
};

}  // namespace tactus::client_sim
