/// Moves the proxy (god-object), a sphere that follows the device but stays on its side of every surface.
///
///            device in the air            device pressed in, moving right
///                  o  = proxy                   ( )->  proxy slides on the surface
///     ___________________________      ________________________________
///                                                o->    device; force = stiffness (proxy - device)
///
/// World frame, metres, seconds. The proxy moves by sweeps that stop before the time of impact, so it passes through no
/// surface at any speed.
///
/// - When objects move, the proxy first moves with the touched object, as if it were a part of that object. Then any
///   object that moves into the proxy pushes it. These sweeps are relative to each object, so no object passes through
///   the proxy at any speed.
/// - Friction moves the goal of a motion back towards the previous proxy position: to the rim of the friction cone, or
///   fully while the proxy sticks. The axis of the cone is the normal at the end of the motion, predicted from the last
///   motion.
/// - When the surface changes, the last motion is repeated. If it ends at the same position, the touched surfaces have
///   not changed, and the proxy does not move. Otherwise the proxy remains on its side of the surface and is pushed
///   out. ForceRenderer ramps the effect on the force. For the ramp it needs the proxy's position without the change
///   (`unchanged`).
///
/// One thread at a time. Realtime: at most 45 sweeps and 48 closest points per step, and 21 more sweeps when objects
/// move; usually 2 sweeps (3 to 5 with friction and slip) and 1 closest point. Source: Zilles, Salisbury 1995
/// (god-object, constraint planes); Ruspini, Kolarov, Khatib 1997 (spherical proxy); Salisbury et al. 1995 (friction
/// cone with stick and slip).
#pragma once

#include "haptics/carried.hpp"
#include "haptics/surface.hpp"

namespace tactus::haptics {

struct ProxySettings {
  double radius = 0.003;  ///< m
  /// m. A surface that changes by less than this distance pushes the proxy out and cannot pass it. The value should
  /// exceed the maximum distance of the base mesh from the finest mesh. A larger value costs time.
  double reach = 0.01;
  /// m. Radius of the surface search around a proxy that starts, and around a proxy near which an object appears.
  double start_reach = 1;
};

/// Friction of the touched object.
struct Grip {
  double static_friction = 0;
  double dynamic_friction = 0;  ///< at most static_friction
};

struct ProxyResult {
  Vec3d proxy = Vec3d::Zero();  ///< centre of the proxy, m
  Vec3d anchor =
      Vec3d::Zero();  ///< end of the spring to the device: the proxy, or with a grab the grabbed point (BodyTouch)
  Vec3d normal = Vec3d::UnitZ();           ///< of the contact; without contact: of the last contact
  Vec3d surface_velocity = Vec3d::Zero();  ///< m/s, velocity of the touched object at the proxy
  bool in_contact = false;
  bool sticking = false;       ///< static friction holds the proxy
  bool surface_moved = false;  ///< in this step a changed or appearing surface moved the proxy
  bool near_surface = false;   ///< a surface is within ProxySettings::reach
  bool outside_only =
      false;  ///< the proxy started inside, or a surface appeared around it: no contact until it is outside
  std::uint32_t object = spm::kNone;  ///< the touched object
  std::uint32_t face = spm::kNone;
};

class Proxy {
 public:
  explicit Proxy(const ProxySettings& settings = {}) noexcept : settings_{settings} {}

  /// Applies from the next step on. Realtime.
  void set_grip(const Grip& grip) noexcept { grip_ = grip; }
  /// Sets ProxySettings::reach from the next step on, because objects may appear later than the proxy. Realtime.
  void set_reach(double reach) noexcept { settings_.reach = reach; }

  /// Clears all state; the next step starts at the device.
  void reset() noexcept { *this = Proxy{settings_}; }

  /// Computes one cycle of `dt` seconds with the device's tip at `device`. `surface_changed`: the surface near the tip
  /// has changed since the last step. A position that is not finite changes nothing. Realtime.
  ///
  /// - If a changed surface has passed or overlaps the proxy, the proxy returns to its side. If the proxy starts, or a
  ///   surface appears near it, and its centre is outside, its side is the outside. Contact begins at once.
  /// - A proxy whose centre starts inside a surface, or around which a surface appears, touches nothing until it is
  ///   outside. The back of an open sheet counts as inside. So the proxy cannot be trapped.
  /// - If there is no space for the proxy between moving objects, its centre stays outside as long as a sphere with a
  ///   sixteenth of its radius fits. If that sphere does not fit either, the proxy touches nothing until it is outside.
  [[nodiscard]] const ProxyResult& step(const Vec3d& device, double dt, Surface& surface,
                                        bool surface_changed) noexcept;

  /// Returns the result that `step` would have if the surface had not changed. Call it before `step`, with the surface
  /// before the change. A proxy that has not started is not in contact. Realtime.
  [[nodiscard]] ProxyResult unchanged(const Vec3d& device, double dt, Surface& before) const noexcept;

  /// Visits the state that one step leaves for the next, without the settings (haptics/carried.hpp). Realtime if
  /// `visit` is.
  template <class Visit>
  void for_each_carried(Visit& visit) noexcept {
    static_assert(sizeof(ProxyResult) == 112 && sizeof(LastMotion) == 160, "carry the new member");
    visit.number("static friction", grip_.static_friction), visit.number("dynamic friction", grip_.dynamic_friction);
    visit.number("proxy", result_.proxy), visit.number("anchor", result_.anchor);
    visit.number("normal", result_.normal), visit.number("surface velocity", result_.surface_velocity);
    for (bool* flag :
         {&result_.in_contact, &result_.sticking, &result_.surface_moved, &result_.near_surface, &result_.outside_only,
          &last_motion_.probed, &last_motion_.under.is_side_known, &started_, &slipping_})
      visit.flag("flag of a proxy", *flag);
    visit.any("object", result_.object), visit.any("face", result_.face);
    visit.number("start of the last motion", last_motion_.start),
        visit.number("goal of the last motion", last_motion_.goal);
    visit.number("probe of the last motion", last_motion_.probe);
    visit.number("time under the last motion", last_motion_.under.time),
        visit.number("point under the last motion", last_motion_.under.point);
    visit.number("normal under the last motion", last_motion_.under.normal),
        visit.number("distance under the last motion", last_motion_.under.distance);
    visit.any("object under the last motion", last_motion_.under.object),
        visit.any("face under the last motion", last_motion_.under.face);
    visit.choice("side", side_, Side::kInner, Side::kOuter);
  }

  [[nodiscard]] bool started() const noexcept { return started_; }
  [[nodiscard]] const ProxyResult& last() const noexcept { return result_; }

 private:
  enum class Side : std::int8_t { kInner = -1, kUnknown = 0, kOuter = 1 };
  struct Motion;
  struct ConstrainedGoal;
  /// The last constrained motion, and the closest point from which its first plane was taken.
  struct LastMotion {
    Vec3d start = Vec3d::Zero(), goal = Vec3d::Zero();
    bool probed = false;          // the first plane was taken from a closest point; `probe` and `under` are valid
    Vec3d probe = Vec3d::Zero();  // end of the sweep that finds this point again
    SurfaceHit under{};           // this point
  };

  [[nodiscard]] Motion move(const Vec3d& start, const Vec3d& goal, Surface& surface,
                            const SurfaceHit* first_hit = nullptr) const noexcept;
  [[nodiscard]] ConstrainedGoal friction_goal(const Vec3d& device, const Vec3d& normal, const Vec3d& held_at,
                                              double stick_within) const noexcept;
  [[nodiscard]] bool move_in_cone(const Vec3d& device, Vec3d normal, const Vec3d& held_at, Surface& surface,
                                  Motion& found) noexcept;
  [[nodiscard]] Motion move_with_friction(const Vec3d& device, Surface& surface) noexcept;
  [[nodiscard]] bool push(const Vec3d& wanted, double radius, Surface& surface, Vec3d& to) const noexcept;
  void move_with_objects(double dt, Surface& surface) noexcept;
  [[nodiscard]] bool inside(const Surface& surface) const noexcept;
  [[nodiscard]] bool closest(const Vec3d& x, const Surface& surface, SurfaceHit& hit) const noexcept;
  void keep_side(const Surface& surface) noexcept;
  [[nodiscard]] bool repeats_motion(Surface& surface) const noexcept;
  void follow_change(Surface& surface) noexcept;
  void find_side(const Surface& surface) noexcept;
  void follow(const Vec3d& device, Surface& surface) noexcept;

  ProxySettings settings_;
  Grip grip_;
  ProxyResult result_;
  LastMotion last_motion_;
  Side side_ = Side::kUnknown;  // of the surface within reach
  bool started_ = false;
  bool slipping_ = false;
};

}  // namespace tactus::haptics
