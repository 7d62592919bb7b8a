/// Simulates movable objects in the haptic thread, sets their poses, and limits their forces on hands.
///
///     1. apply_received_poses   orders, samples of peers, received poses --> Cycle::move   before Cycle::touch
///     2. limit_forces           forces of the touch, limited by the energy of ports        after Cycle::touch
///     3. simulate               springs of the touch --> SharedObject --> Cycle::move      after writing forces
///
/// When a probe touches a body, this class begins to simulate it: alone, or coupled to the copies of peers if the
/// orders name a coupling. After the release the simulation continues until a received pose shows that another program
/// simulates the body, but at most 0.3 s. All other bodies follow the received poses.
///
/// After a change of the gateway, the pose of a body is unknown until the new gateway has passed one: other programs
/// may have moved the body. The first pose then replaces the old one at once.
///
/// A spring connects hand and body: from the device to the anchor of the cycle's proxy, to the tool's contact point, or
/// to the held point. The body receives the spring's force with the opposite sign, within the limits of
/// haptics/force.hpp. Only the force on the hand is also limited by the port, which counts the energy of the spring on
/// both sides (haptics/passivity.hpp).
///
/// Simulated time advances in steps of one period of session time. After a skipped cycle the next one computes two
/// steps. A cycle that is late by less than half a period computes one step. So the simulated time of a copy follows
/// session time, and the copy uses the samples of its peers at an even rate.
///
/// This class checks the samples of peers in the link, and ignores wrong ones.
///
/// Allocates at construction only. Realtime. Haptic thread.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <vector>

#include "haptics/mailbox.hpp"
#include "haptics/passivity.hpp"
#include "haptics/ramp.hpp"
#include "haptics/shared_object.hpp"
#include "hrtc_service/servo/cycle.hpp"
#include "hrtc_service/servo/shared_mailbox.hpp"
#include "hrtc_service/servo/shared_ring.hpp"
#include "session/clock.hpp"
#include "sharing/pose_interpolator.hpp"

namespace tactus::hrtc_service {

/// Order for one body in the haptic thread.
struct BodyOrder {
  std::uint32_t object = spm::kNone;          ///< index
  haptics::CopyCoupling* coupling = nullptr;  ///< to peers' copies, used while a probe touches the body; null: none
  std::uint64_t coupling_fencing = 0;         ///< fencing number of the grant for the coupling
  std::uint64_t publish_fencing = 0;          ///< fencing number for the poses to publish; 0: this HRTC publishes none
  sharing::ReceivedPose received;             ///< newest pose from another program
};

struct BodyOrders {
  std::uint64_t number = 0;  ///< increases with each post
  session::ClockMap clock;   ///< local clock to session time
  std::uint32_t count = 0;
  std::array<BodyOrder, kMaxBodies> bodies;
};

/// The exchange between BodyIntake and Bodies, in one process.
struct BodyOrderLink {
  haptics::Mailbox<BodyOrders> orders;
  std::atomic<std::uint64_t> seen{0};  ///< number of the newest orders in use
};

inline constexpr std::int64_t kMinChannelDelayNs = 3'000'000;    ///< a shorter delay makes a coupling unstable
inline constexpr std::int64_t kMaxChannelDelayNs = 400'000'000;  ///< max history that a coupling stores

/// A coupling that a host has granted.
struct GrantedCoupling {
  std::uint64_t fencing = 0;                 ///< of the grant; 0: no coupling
  std::uint32_t copies = 0, copy_index = 0;  ///< number of coupled copies, and index of this copy
  std::int64_t delay_ns = 0;                 ///< of the channels, kMinChannelDelayNs to kMaxChannelDelayNs
};

/// Order of the gateway for one body.
struct GrantedBody {
  std::uint32_t object = spm::kNone;  ///< index
  GrantedCoupling coupling;
  std::uint64_t publish_fencing = 0;  ///< fencing number for the poses to publish; 0: this HRTC publishes none
  sharing::ReceivedPose received;     ///< newest pose from another program
};

struct GrantedBodies {
  session::ClockMap clock;        ///< local clock to session time
  std::uint64_t pose_number = 0;  ///< number of the newest received pose of any body, under any gateway
  std::uint32_t count = 0;
  std::array<GrantedBody, kMaxBodies> bodies;
};

/// A peer's sample of its copy, for the haptic thread.
struct CopyArrival {
  std::uint32_t object = 0, copy_index = 0;  ///< indices of the object, and of the peer's copy
  std::uint64_t coupling_fencing = 0;
  haptics::CopySample sample;
};

struct BodyReport {
  std::uint32_t object = 0;
  bool is_touched = false;    ///< a probe has touched it within the last 0.1 s
  bool is_simulated = false;  ///< by this HRTC
  std::uint64_t publish_fencing = 0, coupling_fencing = 0;
  std::uint32_t copies = 0,
                copy_index = 0;  ///< number of coupled copies, and index of this copy; 0 copies: no coupling
  haptics::BodyState state;
  haptics::CopyCoupling::Ledger ledger;  ///< of its current coupling, or of the last one
  haptics::CopySample sample;            ///< sample to send if `copies` is not 0
};

struct BodyReports {
  std::int64_t time_ns = 0;
  std::int64_t session_ns = 0;
  std::uint32_t count = 0;
  std::array<BodyReport, kMaxBodies> bodies;
  std::array<haptics::PassivityController::Ledger, kMaxProbes> ports;             ///< of forces on hands
  std::array<haptics::PassivityController::Ledger, kMaxProbes> rotational_ports;  ///< of torques on hands
  std::uint64_t grabs = 0, refused = 0;  ///< numbers of successful and of refused grabs
};

/// The exchange between the servo's process and the gateway.
struct BodyLink {
  static constexpr std::uint32_t kCopies = 1024;
  SharedMailbox<GrantedBodies> granted;     ///< to BodyIntake
  SharedRing<CopyArrival, kCopies> copies;  ///< to Bodies
  SharedMailbox<BodyReports> reports;       ///< to the gateway
};

class Bodies {
 public:
  /// `link` and `orders` must outlive this object.
  Bodies(const CycleSettings& settings, BodyLink& link, BodyOrderLink& orders);

  /// Adopts new orders, and moves the bodies that others simulate. Call it before Cycle::touch.
  void apply_received_poses(Cycle& cycle, std::int64_t now_ns) noexcept;
  /// Removes the bodies of withdrawn objects. Call it right after Cycle::touch.
  void forget_withdrawn(const Cycle& cycle) noexcept;
  /// Makes the poses of all present bodies unknown, because another gateway has attached.
  void forget_poses() noexcept;
  /// Returns the objects whose poses are unknown, by index bit.
  [[nodiscard]] std::uint64_t unknown_poses() const noexcept;
  /// Limits the forces of the last touch in `outputs` to the energy that their ports permit.
  void limit_forces(const Cycle& cycle, const std::array<ProbeInput, kMaxProbes>& inputs,
                    std::array<ProbeOutput, kMaxProbes>& outputs) noexcept;
  /// Simulates bodies up to now, moves them for the next touch, and posts reports. `released`: objects, by index bit,
  /// that hands release although they touch them, because their forces are off without a gateway.
  void simulate(Cycle& cycle, std::int64_t now_ns, std::uint64_t released = 0) noexcept;

  [[nodiscard]] bool empty() const noexcept { return count_ == 0; }

 private:
  enum class Mode : std::uint8_t { kFollows, kTouched, kReleased };
  struct Body {
    const TouchObject* object = nullptr;
    Mode mode = Mode::kFollows;
    bool is_pose_unknown = false;
    BodyOrder order;
    haptics::CopyCoupling* coupling = nullptr;  // of the running simulation
    sharing::PoseInterpolator pose_interpolator;
    std::int64_t last_touch_ns = 0, released_ns = 0;
    std::int64_t simulated_ns = 0;  // session time up to which it is simulated
    // Numbers of received poses: the newest at the release, and the newest in the interpolator.
    std::uint64_t pose_number_at_release = 0, interpolated_number = 0;
    haptics::CopyCoupling::Ledger ledger;
    haptics::BodyState state_in_cycle;  // newest state; Cycle::move has received its pose
  };
  /// Springs between a hand and the body that it touches.
  struct HandSpring {
    std::uint32_t body = kMaxBodies;         // index in bodies_, which changes when others leave; kMaxBodies: none
    std::uint32_t object = spm::kNone;       // index of its object
    std::uint32_t last_object = spm::kNone;  // that it has touched
    haptics::PointSpring spring;
    bool is_hold = false;                         // the hand holds the body
    haptics::RotationalSpring rotational_spring;  // valid if `is_hold`
    Vec3d torque = Vec3d::Zero();                 // torque of a tool on the body, N m
  };

  void add_new_bodies(const Cycle& cycle) noexcept;
  void limit_at_bodies(const Cycle& cycle, const std::array<ProbeInput, kMaxProbes>& inputs,
                       std::array<ProbeOutput, kMaxProbes>& outputs) noexcept;
  // `energy_to_body`: work of the probe's spring on the body since the last cycle, J.
  void limit_touch(const Cycle& cycle, std::uint32_t probe, const haptics::DeviceState& device, double energy_to_body,
                   ProbeOutput& output) noexcept;
  void limit_tool(const Cycle& cycle, std::uint32_t probe, const haptics::DeviceState& device, double energy_to_body,
                  ProbeOutput& output) noexcept;
  void limit_held(const Cycle& cycle, std::uint32_t probe, const haptics::DeviceState& device, double energy_to_body,
                  ProbeOutput& output) noexcept;
  [[nodiscard]] haptics::ContactImpedance stable_impedance(const session::Material& material,
                                                           const haptics::DeviceState& device) const noexcept;
  [[nodiscard]] Vec3d damped(const Vec3d& allowed, const Vec3d& wanted, const Vec3d& felt,
                             double max_slew) const noexcept;
  /// Limits the change of a force or torque in a cycle. `max_slew`: N/s or N m/s.
  [[nodiscard]] Vec3d slewed(const Vec3d& wanted, const Vec3d& felt, double max_slew,
                             const haptics::ForceRenderer& renderer, ProbeOutput& output) const noexcept;
  /// Returns the part of a force on the hand that its maximum change and its port permit. `stored`: energy in the
  /// spring, J.
  [[nodiscard]] Vec3d limit_force(const Cycle& cycle, std::uint32_t probe, const Vec3d& force,
                                  const haptics::DeviceState& device, double energy_to_body, double stored,
                                  ProbeOutput& output) noexcept;
  /// Returns the part of a torque on the hand that its maximum change and its rotational port permit. If `control` is
  /// false, the port only observes the energy.
  [[nodiscard]] Vec3d limit_torque(const Cycle& cycle, std::uint32_t probe, const Vec3d& torque, bool control,
                                   double stored, ProbeOutput& output) noexcept;
  /// Returns the rest length of a probe's spring by SpringLimiter, m. `length`: distance of hand and body, m.
  [[nodiscard]] double rest_length(const Cycle& cycle, std::uint32_t probe, const haptics::DeviceState& device,
                                   double energy_to_body, const haptics::LimitedSpring& spring, double length) noexcept;
  void fade_reduction(const Cycle& cycle, std::uint32_t probe, ProbeOutput& output) noexcept;
  void process_orders() noexcept;
  void apply_coupling_order(std::uint32_t i) noexcept;
  /// Returns the number of steps from the simulated time to now. After the first touch or a jump of session time, sets
  /// the simulated time to one step before now.
  [[nodiscard]] std::uint32_t steps_due(Body& body, std::int64_t session_ns) const noexcept;
  void follow_if_superseded(Body& body, haptics::SharedObject& simulated, std::int64_t now_ns,
                            std::int64_t session_ns) noexcept;
  /// Returns the fixed objects near a body, with their active meshes; null if there are none.
  [[nodiscard]] const haptics::SurfaceDistance* scene_around(const Cycle& cycle,
                                                             const haptics::RigidBody& body) noexcept;
  void set_pose(Cycle& cycle, Body& body, const haptics::BodyState& state) const noexcept;
  void report(std::int64_t now_ns, std::int64_t session_ns) noexcept;
  [[nodiscard]] std::uint32_t body_of(std::uint32_t object) const noexcept;

  CycleSettings settings_;
  RingReader<CopyArrival, BodyLink::kCopies> copies_;
  MailboxWriter<BodyReports> reports_out_;
  BodyOrderLink& order_link_;
  BodyOrders orders_;
  std::uint64_t objects_changed_ = 0;  // Cycle::objects_changed at the last update of bodies_
  // Numbers of received poses of all bodies: the newest, and the newest at the last `forget_poses`.
  std::uint64_t newest_number_ = 0, forgotten_number_ = 0;
  std::uint32_t count_ = 0;
  std::array<Body, kMaxBodies> bodies_;
  std::vector<haptics::SharedObject> simulated_;  // simulations, by index in bodies_; size kMaxBodies
  std::array<haptics::PassivityController, kMaxProbes> ports_;
  std::array<double, kMaxProbes> energy_to_body_{};  // J, of each probe since the last step of its port
  std::array<haptics::SpringLimiter, kMaxProbes> spring_limiters_;
  struct RotationalPort {
    haptics::PassivityController port;
    double energy_to_body = 0;    // J
    Vec3d angle = Vec3d::Zero();  // sum of the device's rotation vectors, rad
    Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity();
    haptics::SpringLimiter limiter;
  };
  std::array<RotationalPort, kMaxProbes> rotational_ports_;
  /// The force and torque that a port has removed, N and N m. When its body is withdrawn, the removed part fades out,
  /// so that the force on the hand changes gradually.
  struct Reduction {
    Vec3d force = Vec3d::Zero(), torque = Vec3d::Zero();
    haptics::Ramp fading, fading_torque;
  };
  std::array<Reduction, kMaxProbes> reductions_;
  std::array<haptics::Wrench, kMaxProbes> felt_;  // that each hand feels since the last cycle
  std::array<std::uint32_t, kMaxProbes> status_before_{};
  std::array<HandSpring, kMaxProbes> springs_;
  sharing::Scene scene_;
  BodyReports reports_;
};

}  // namespace tactus::hrtc_service
