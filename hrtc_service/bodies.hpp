/// Movable objects in the haptic thread: their poses, the forces of probes on them, and their forces on hands.
///
///     place:  orders, copies of peers, received poses --> Cycle::move       before Cycle::touch
///     limit:  forces of the touch --[ port's energy ]--> forces on hands    after it
///     step:   springs of the touch --> SharedObject --> Cycle::move         once the forces are out
///
/// This class simulates a body from the moment a probe touches it, alone or as one of several copies, as the orders
/// say. After the release it goes on until a received pose shows that another program simulates the body. All other
/// bodies follow the received poses. The cycle's proxy is the spring between hand and body: the body receives the force
/// on the hand with the opposite sign, scaled as the limits scaled it, so the energy is counted on both sides
/// (haptics/passivity.hpp).
///
/// Simulated time advances in steps of a period of session time: the next step makes up for a skipped cycle, and a
/// cycle that is late by less than half a period changes nothing. So the waves of peers are played evenly.
///
/// Allocates at construction only. Realtime; the haptic thread's, except the link.
#pragma once

#include <array>
#include <boost/lockfree/spsc_queue.hpp>
#include <cstdint>
#include <vector>

#include "haptics/mailbox.hpp"
#include "haptics/passivity.hpp"
#include "haptics/ramp.hpp"
#include "haptics/shared_object.hpp"
#include "hrtc_service/cycle.hpp"
#include "session/clock.hpp"
#include "sharing/pose_interpolator.hpp"

namespace tactus::hrtc_service {

/// The service's order for one body.
struct BodyOrder {
  std::uint32_t object = spm::kNone;          ///< index
  haptics::CopyCoupling* coupling = nullptr;  ///< to simulate it with while it is held here; null: alone
  std::uint64_t group = 0;                    ///< fencing number of the coupling's group
  std::uint64_t publish = 0;                  ///< fencing number under which its poses count; 0: they do not
  sharing::ReceivedPose received;             ///< the newest pose that another program published
};

struct BodyOrders {
  std::uint64_t number = 0;  ///< grows with each
  session::ClockMap clock;
  std::uint32_t count = 0;
  std::array<BodyOrder, kMaxBodies> bodies;
};

/// A peer's sample on its way to the haptic thread.
struct CopyArrival {
  std::uint32_t object = 0, place = 0;
  std::uint64_t group = 0;
  haptics::CopySample sample;
};
using CopyRing = boost::lockfree::spsc_queue<CopyArrival>;

struct BodyReport {
  std::uint32_t object = 0;
  bool held = false;       ///< a probe touches it, or touched it a moment ago
  bool simulated = false;  ///< here
  std::uint64_t publish = 0, group = 0;
  std::uint32_t copies = 0, place = 0;  ///< size of its group, and its number there; 0 copies: simulated alone
  haptics::BodyState state;
  haptics::CopyCoupling::Ledger ledger;  ///< of its current group, or else of its last one
  haptics::CopySample sample;            ///< to send, when it has copies
};

struct BodyReports {
  std::uint64_t orders_seen = 0;  ///< the newest order taken; couplings that only older ones name are unused
  std::int64_t time_ns = 0;
  std::int64_t session_ns = 0;
  std::uint32_t count = 0;
  std::array<BodyReport, kMaxBodies> bodies;
  std::array<haptics::PassivityController::Ledger, kMaxProbes> ports;  ///< of hands, on bodies
  std::array<haptics::PassivityController::Ledger, kMaxProbes> turns;  ///< the same, of their torques
  std::uint64_t grabs = 0, refused = 0;  ///< how often a grab succeeded, and how often it failed
};

/// The exchange between Bodies and the gateway.
struct BodyLink {
  BodyLink();

  haptics::Mailbox<BodyOrders> orders;                                    ///< to the servo
  CopyRing copies{1024};                                                  ///< to the servo
  haptics::Mailbox<BodyReports> reports_for_sender, reports_for_gateway;  ///< from the servo
};

class Bodies {
 public:
  /// `link` must outlive it.
  Bodies(const CycleSettings& settings, BodyLink& link);

  void place(Cycle& cycle, std::int64_t now_ns) noexcept;
  /// Removes the bodies of objects that were withdrawn; call it right after `touch`.
  void forget_withdrawn(const Cycle& cycle) noexcept;
  /// `outputs`: of the last touch.
  void limit(const Cycle& cycle, const std::array<ProbeInput, kMaxProbes>& inputs,
             std::array<ProbeOutput, kMaxProbes>& outputs) noexcept;
  /// Moves the bodies that are simulated here for the next touch, and reports.
  void step(Cycle& cycle, std::int64_t now_ns) noexcept;

  [[nodiscard]] bool empty() const noexcept { return count_ == 0; }

 private:
  enum class Mode : std::uint8_t { kFollows, kHeld, kLetGo };
  struct Body {
    const TouchObject* object = nullptr;
    Mode mode = Mode::kFollows;
    BodyOrder order;
    haptics::CopyCoupling* coupling = nullptr;  // in use
    sharing::PoseInterpolator pose_interpolator;
    std::int64_t touched_ns = 0, let_go_ns = 0;
    std::int64_t simulated_ns = 0;  // session time up to which it is simulated
    std::uint64_t received_at_release = 0, interpolated = 0;
    haptics::CopyCoupling::Ledger ledger;
    haptics::BodyState placed;  // as the cycle knows it
  };
  struct Spring {
    std::uint32_t body = kMaxBodies;  // none
    haptics::PointSpring spring;
    bool holds = false;
    haptics::RotationalSpring turn;  // while it holds
    Vec3d torque = Vec3d::Zero();    // N m on the body, of a tool that pushes
  };

  void find_new(const Cycle& cycle) noexcept;
  void limit_touch(const Cycle& cycle, std::uint32_t probe, const haptics::DeviceState& device, double passed_on,
                   ProbeOutput& output) noexcept;
  void limit_tool(const Cycle& cycle, std::uint32_t probe, const haptics::DeviceState& device, double passed_on,
                  ProbeOutput& output) noexcept;
  void limit_held(const Cycle& cycle, std::uint32_t probe, const haptics::DeviceState& device, double passed_on,
                  ProbeOutput& output) noexcept;
  /// The share of a force on the hand that its port permits.
  [[nodiscard]] Vec3d through_port(std::uint32_t probe, const Vec3d& force, const haptics::DeviceState& device,
                                   double passed_on, double stored, const ProbeOutput& output) noexcept;
  /// The share of a torque that the rotational port permits.
  [[nodiscard]] Vec3d through_turn_port(std::uint32_t probe, const Vec3d& torque, bool control, double stored,
                                        const ProbeOutput& output) noexcept;
  void fade_reduction(std::uint32_t probe, ProbeOutput& output) noexcept;
  void take_orders() noexcept;
  void simulate_as_ordered(std::uint32_t i) noexcept;
  /// Simulates from the last simulated time to now.
  [[nodiscard]] std::uint32_t steps_due(Body& body, std::int64_t session_ns) const noexcept;
  void follow_if_requested(Body& body, haptics::SharedObject& simulated, std::int64_t now_ns,
                           std::int64_t session_ns) noexcept;
  /// Fixed objects near a body, with the meshes that the cycle shows; null for none.
  [[nodiscard]] const haptics::SurfaceDistance* scene_around(const Cycle& cycle,
                                                             const haptics::RigidBody& body) noexcept;
  void show(Cycle& cycle, Body& body, const haptics::BodyState& state) const noexcept;
  void report(std::int64_t now_ns, std::int64_t session_ns) noexcept;
  [[nodiscard]] std::uint32_t body_of(std::uint32_t object) const noexcept;

  CycleSettings settings_;
  BodyLink& link_;
  BodyOrders current_;
  std::uint64_t objects_changed_ = 0;  // of the cycle, as seen
  std::uint32_t count_ = 0;
  std::array<Body, kMaxBodies> bodies_;
  std::vector<haptics::SharedObject> simulated_;  // beside bodies_, kMaxBodies
  std::array<haptics::PassivityController, kMaxProbes> ports_;
  std::array<double, kMaxProbes> passed_on_{};  // J, to a body since the last step of the port
  struct Turning {
    haptics::PassivityController port;
    double passed_on = 0;         // J
    Vec3d angle = Vec3d::Zero();  // rad, of the device, summed over its turns
    Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity();
  };
  std::array<Turning, kMaxProbes> turning_;
  /// The part of a force and a torque that a port took away, N and N m. When its body is withdrawn, the hand gets it
  /// back gradually, so that the force decreases from the force that the hand felt.
  struct Reduction {
    Vec3d force = Vec3d::Zero(), torque = Vec3d::Zero();
    haptics::Ramp fading, fading_torque;
  };
  std::array<Reduction, kMaxProbes> reductions_;
  std::array<std::uint32_t, kMaxProbes> status_before_{};
  std::array<Spring, kMaxProbes> springs_;
  sharing::Scene scene_;
  BodyReports reports_;
  CopyArrival arrival_;
};

}  // namespace tactus::hrtc_service
