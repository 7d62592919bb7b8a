/// The proxy (god-object): a sphere that follows the device but stays on its side of every surface.
///
///            device in the air            device pressed in, moving right
///                  o  = proxy                   ( )->  proxy slides on the surface
///     ___________________________      ________________________________
///                                                o->    device; force = stiffness (proxy - device)
///
/// World frame, metres, seconds. The proxy moves by sweeps that stop before the time of impact, so it passes through no
/// surface at any speed.
///
/// - Where objects move, it first goes along with the one that it touches, as if it were part of it, and in front of
///   any that comes its way: by sweeps relative to each object, so that none passes it at any speed either.
/// - Friction pulls the goal of a slide back towards where the proxy was, to the rim of the cone or, while it sticks,
///   all the way. The cone stands on the normal where the slide ends, which the last one foretells.
/// - When the surface changes, the last slide is done again. If it ends in the same place, nothing that matters has
///   changed, and the proxy is to the bit what it would have been; else it keeps its side and is pushed out. What the
///   hand feels of that is for ForceRenderer to ramp, which needs to know where the proxy would be without the change:
///   see `unchanged`.
///
/// One thread at a time. Realtime: at most 45 sweeps and 43 closest points a step, 21 sweeps more when something moves;
/// usually 2 (with friction and slipping 3 to 5) and 1. Source: Zilles, Salisbury 1995 (god-object, constraint planes);
/// Ruspini, Kolarov, Khatib 1997 (spherical proxy); Salisbury et al. 1995 (friction cone with stick and slip).
#pragma once

#include "haptics/carried.hpp"
#include "haptics/surface.hpp"

namespace tactus::haptics {

struct ProxySettings {
  double radius = 0.003;
  /// A surface that changes by less than this cannot pass the proxy: it keeps its side and is pushed out. Wants to
  /// exceed the greatest distance of the base mesh from the finest; larger costs time.
  double reach = 0.01;
  /// How far to look for the surface around a proxy that starts, or around which an object appears, inside.
  double start_reach = 1;
};

/// How the touched object feels, as far as the proxy is concerned.
struct Grip {
  double static_friction = 0;
  double dynamic_friction = 0;  ///< at most the static one
};

struct ProxyResult {
  Vec3d proxy = Vec3d::Zero();    ///< centre, where the surface lets it be
  Vec3d anchor = Vec3d::Zero();   ///< pulls the device; the proxy, unless something else holds the hand (BodyTouch)
  Vec3d normal = Vec3d::UnitZ();  ///< of the contact, or of the last one
  Vec3d surface_velocity = Vec3d::Zero();  ///< m/s, of the object that was touched, where the proxy was
  bool in_contact = false;
  bool sticking = false;       ///< held by static friction
  bool surface_moved = false;  ///< in this step a changed surface, or the first one, moved the proxy
  bool near_surface = false;   ///< there is one within ProxySettings::reach
  bool outside_only = false;   ///< inside a surface since it started or the surface appeared: touches nothing until out
  std::uint32_t object = spm::kNone;  ///< touched
  std::uint32_t face = spm::kNone;
};

class Proxy {
 public:
  explicit Proxy(const ProxySettings& settings = {}) noexcept : settings_{settings} {}

  /// From the next step on. Realtime.
  void set_grip(const Grip& grip) noexcept { grip_ = grip; }
  /// Of ProxySettings, from the next step on: objects may come later than the proxy. Realtime.
  void set_reach(double reach) noexcept { settings_.reach = reach; }

  /// Forgets everything; the next step starts at the device.
  void reset() noexcept { *this = Proxy{settings_}; }

  /// One cycle of `dt` seconds with the device's tip at `device`. `surface_changed`: the surface near the tip is not
  /// the one of the last step. A position that is not finite leaves everything as it was. Realtime.
  ///
  /// - A proxy that a changed surface has passed or overlaps returns to the side it was on, and so does one that starts
  ///   with its centre outside, or outside of a surface that appears: it is in contact at once.
  /// - A proxy whose centre starts inside, or around which a surface appears, touches nothing until it has come out; an
  ///   open sheet counts as inside from behind. It cannot be trapped.
  /// - Where objects that move leave no room for the proxy, its centre stays outside while there is room for a
  ///   sixteenth of its radius; without that it touches nothing until it has come out.
  [[nodiscard]] const ProxyResult& step(const Vec3d& device, double dt, Surface& surface,
                                        bool surface_changed) noexcept;

  /// Where `step` would take it on a surface that has not changed. Called before the step, with the surface as it was.
  /// A proxy that has not started would be in the air. Realtime.
  [[nodiscard]] ProxyResult unchanged(const Vec3d& device, double dt, Surface& before) const noexcept;

  /// What one step leaves to the next, but for the settings; see haptics/carried.hpp. Realtime if `visit` is.
  template <class Visit>
  void for_each_carried(Visit& visit) noexcept {
    static_assert(sizeof(ProxyResult) == 112 && sizeof(Way) == 160, "carry the new member");
    visit.number("static friction", grip_.static_friction), visit.number("dynamic friction", grip_.dynamic_friction);
    visit.number("proxy", result_.proxy), visit.number("anchor", result_.anchor);
    visit.number("normal", result_.normal), visit.number("surface velocity", result_.surface_velocity);
    for (bool* flag : {&result_.in_contact, &result_.sticking, &result_.surface_moved, &result_.near_surface,
                       &result_.outside_only, &way_.probed, &way_.under.sided, &started_, &slipping_})
      visit.flag("flag of a proxy", *flag);
    visit.any("object", result_.object), visit.any("face", result_.face);
    visit.number("start of a slide", way_.start), visit.number("goal of a slide", way_.goal);
    visit.number("probe of a slide", way_.probe);
    visit.number("time under a slide", way_.under.time), visit.number("point under a slide", way_.under.point);
    visit.number("normal under a slide", way_.under.normal),
        visit.number("distance under a slide", way_.under.distance);
    visit.any("object under a slide", way_.under.object), visit.any("face under a slide", way_.under.face);
    visit.choice("side", side_, Side::kInner, Side::kOuter);
  }

  [[nodiscard]] bool started() const noexcept { return started_; }
  [[nodiscard]] const ProxyResult& last() const noexcept { return result_; }

 private:
  enum class Side : std::int8_t { kInner = -1, kUnknown = 0, kOuter = 1 };
  struct Slide;
  struct Grasp;
  /// How the proxy came where it is: the last slide, and what its first plane was had from.
  struct Way {
    Vec3d start = Vec3d::Zero(), goal = Vec3d::Zero();
    bool probed = false;
    Vec3d probe = Vec3d::Zero();
    SurfaceHit under{};
  };

  [[nodiscard]] Slide slide(const Vec3d& start, const Vec3d& goal, Surface& surface,
                            const SurfaceHit* known = nullptr) const noexcept;
  [[nodiscard]] Grasp grasp(const Vec3d& device, const Vec3d& normal, const Vec3d& held_at,
                            double stick_within) const noexcept;
  [[nodiscard]] bool slide_in_cone(const Vec3d& device, Vec3d normal, const Vec3d& held_at, Surface& surface,
                                   Slide& found) noexcept;
  [[nodiscard]] Slide slide_with_friction(const Vec3d& device, Surface& surface) noexcept;
  [[nodiscard]] bool push(const Vec3d& wish, double radius, Surface& surface, Vec3d& to) const noexcept;
  void carry(double dt, Surface& surface) noexcept;
  [[nodiscard]] bool inside(const Surface& surface) const noexcept;
  [[nodiscard]] bool closest(const Vec3d& x, const Surface& surface, SurfaceHit& hit) const noexcept;
  void keep_side(const Surface& surface) noexcept;
  [[nodiscard]] bool holds_still(Surface& surface) const noexcept;
  void follow_change(Surface& surface) noexcept;
  void find_side(const Surface& surface) noexcept;
  void follow(const Vec3d& device, Surface& surface) noexcept;

  ProxySettings settings_;
  Grip grip_;
  ProxyResult result_;
  Way way_;
  Side side_ = Side::kUnknown;  // of the surface within reach
  bool started_ = false;
  bool slipping_ = false;
};

}  // namespace tactus::haptics
