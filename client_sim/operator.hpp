/// A simulated user's mind: it knows where objects are and what its hand feels, and says where the hand wants to be.
///
/// It sees no mesh. Of an object it knows the catalogue's bounds, some points of its surface and where it is; of the
/// contact the probe states of its own probe, and of others how hard they press. World frame, SI; times are session
/// time. One thread at a time. Not realtime.
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
  bool moves = false;                                      ///< it can be moved
  struct SurfacePoint {
    Vec3d position, normal;  ///< world, m; the normal is zero where it is unknown
  };
  std::vector<SurfacePoint> surface;  ///< empty: the whole box is taken for solid
  double spacing = 0;                 ///< m; no point of the surface is further than this from all of them
};
[[nodiscard]] ObjectView view_of(const session::CatalogueEntry& entry);

/// By object name.
using Objects = std::map<std::string, ObjectView>;

/// The object that a scenario means: by name, or for "#n" the n-th by name of those that cannot be moved, counted
/// around. Null when there is none.
[[nodiscard]] const ObjectView* find_object(const Objects& objects, const std::string& reference);

struct OperatorSettings {
  double hand_stiffness = 250;             ///< N/m, what the user takes its own hand for
  double travel_speed = 0.25;              ///< m/s, in the air
  double clearance = 0.02;                 ///< m outside an object's bounds where approaches begin
  std::int64_t period_ns = 10'000'000;     ///< between intents
  std::int64_t lookahead_ns = 40'000'000;  ///< for which an intent says how the hand goes on
};

/// What became of the script so far.
struct OperatorTally {
  std::uint32_t taps = 0;
  std::uint32_t approaches_missed = 0;  ///< went through where the object should be and felt nothing
  std::uint32_t contacts_lost = 0;      ///< while following
  double following = 0;                 ///< s
  std::uint32_t lifts = 0;              ///< objects raised, held and put down
  std::uint32_t lifts_lost = 0;         ///< contact was lost meanwhile
  std::uint32_t grabs = 0;              ///< objects that the hand got hold of
  std::uint32_t grabs_refused = 0;      ///< that it touched and could not hold
  std::uint32_t grabs_lost = 0;         ///< that it held and did not let go of
};

class Operator {
 public:
  Operator(const User& user, const OperatorSettings& settings);

  /// Of this user's probe; others are ignored, and so are samples older than one already felt.
  void on_probe_state(const session::ProbeState& state);
  /// Of somebody else's probe, as it comes.
  void on_other(const session::ProbeState& state);

  /// Goes on with the script; an intent whenever one is due. Until the first probe state it asks for a place clear of
  /// the first object, where a controller may put the hand. `origin` is
  /// left to the caller.
  [[nodiscard]] std::optional<session::Intent> tick(std::int64_t session_now_ns, const Objects& objects);

  /// The script has ended and does not repeat.
  [[nodiscard]] bool done() const noexcept { return done_; }
  [[nodiscard]] const OperatorTally& tally() const noexcept { return tally_; }
  [[nodiscard]] const User& user() const noexcept { return user_; }
  /// Following, that is expected to be in contact.
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
  void turn_hand(double dt);
  [[nodiscard]] bool begin(const Action& action, const Objects& objects);
  [[nodiscard]] Vec3d aim_at(const Action& action, const ObjectView& view) const;
  [[nodiscard]] Vec3d start_of(const Action& action, const ObjectView& view) const;
  [[nodiscard]] std::optional<session::Intent> first_wish(std::int64_t session_now_ns, const Objects& objects);
  void plan_way(const Vec3d& to);
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

  // What is felt.
  bool felt_ = false;
  std::int64_t felt_ns_ = 0;
  Vec3d device_ = Vec3d::Zero(), proxy_ = Vec3d::Zero();
  Vec3d travel_ = Vec3d::Zero();   // velocity of the proxy, smoothed
  Vec3d normal_ = Vec3d::UnitZ();  // of the surface, as far as the force tells
  double force_ = 0;               // N, smoothed
  double raw_force_ = 0;
  bool in_contact_ = false;
  bool holding_ = false, refused_ = false;  // as the controller tells
  Vec3d felt_force_ = Vec3d::Zero();        // N, smoothed
  struct Other {
    std::uint64_t object = 0;
    double force = 0;              // N
    std::int64_t received_ns = 0;  // when, however old it was
  };
  std::map<std::uint64_t, Other> others_;  // by user

  // How the hand is turned, when the script has it lean.
  bool leans_ = false;
  Vec3d upright_ = Vec3d::UnitZ();                            // the surface's normal, as slowly as a wrist follows it
  Eigen::Quaterniond base_ = Eigen::Quaterniond::Identity();  // z along it
  Eigen::Quaterniond orientation_ = Eigen::Quaterniond::Identity(), ahead_ = Eigen::Quaterniond::Identity();

  // What is wanted.
  std::size_t action_ = 0;
  bool done_ = false;
  Stage stage_ = Stage::kBegin;
  std::int64_t ticked_ns_ = 0;
  Vec3d hand_ = Vec3d::Zero(), hand_velocity_ = Vec3d::Zero();
  double clock_ = 0;     // s in this stage
  double followed_ = 0;  // s of this action
  std::uint32_t attempts_ = 0, taps_ = 0;
  std::vector<Vec3d> way_;  // still to pass, last first
  std::uint32_t buttons_ = 0;

  // The object of the action.
  std::string object_;
  ObjectView view_;
  Vec3d outwards_ = Vec3d::UnitZ();  // to where the hand comes from, world
  Vec3d start_ = Vec3d::Zero();      // outside the bounds
  double depth_ = 0;                 // m from `start_` to the far side of the bounds

  // Touching.
  Vec3d touched_ = Vec3d::Zero();  // where contact began
  bool has_touched_ = false;
  Vec3d cursor_ = Vec3d::Zero();  // runs along the surface ahead of the proxy
  double push_ = 0;               // m that the hand wants to be below the cursor
  double lost_ = 0;               // s without contact
  double extent_ = 0;
  double row_ = 0, row_step_ = 0, heading_ = 1;  // zigzag
  double plane_ = 0;                             // around: distance of the path's plane from the centre

  // Lifting.
  Vec3d gripped_ = Vec3d::Zero();  // where the device was when both pressed, or when it had hold
  Vec3d load_ = Vec3d::Zero();     // N, across the press, as the arm has come to bear it
  double both_ = 0;                // s for which all have pressed
  bool released_ = false;          // the way that is travelled leads away from the object
};

}  // namespace tactus::client_sim
