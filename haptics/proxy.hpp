/// The proxy (god-object): a sphere that follows the device but stays on its side of every surface.
///
///            device in the air            device pressed in, moving right
///                  o  = proxy                   ( )->  proxy slides on the surface
///     ___________________________      ________________________________
///                                                o->    device; force = stiffness (proxy - device)
///
/// World frame, metres, seconds. The proxy moves by sweeps that stop before the time of impact, so it passes through no
/// surface at any speed. One thread at a time. Realtime: at most 13 sweeps and 43 closest points a step, usually 2
/// and 1. Source: Zilles, Salisbury 1995 (god-object, constraint planes); Ruspini, Kolarov, Khatib 1997 (spherical
/// proxy); Salisbury et al. 1995 (friction cone with stick and slip).
#pragma once

#include "haptics/surface.hpp"

namespace tactus::haptics {

struct ProxySettings {
  double radius = 0.003;
  /// A surface that changes by less than this cannot pass the proxy: it keeps its side and is pushed out. Wants to
  /// exceed the greatest distance of the base mesh from the finest; larger costs time.
  double reach = 0.01;
  /// How far to look for the surface around a proxy that starts, or around which an object appears, inside.
  double start_reach = 1;
  /// N/s: the most by which the force may change because the surface did.
  double ramp = 50;
};

/// How the touched object feels, as far as the proxy is concerned.
struct Grip {
  double static_friction = 0;
  double dynamic_friction = 0;  ///< at most the static one
  double stiffness = 1000;      ///< N/m, with which the force will be computed; sets the ramp
};

struct ProxyResult {
  Vec3d proxy = Vec3d::Zero();    ///< centre, where the surface lets it be
  Vec3d anchor = Vec3d::Zero();   ///< pulls the device; differs from `proxy` while a change of the surface is ramped
  Vec3d normal = Vec3d::UnitZ();  ///< of the contact, or of the last one
  bool in_contact = false;
  bool sticking = false;       ///< held by static friction
  bool surface_moved = false;  ///< in this step a changed surface moved the proxy
  bool ramping = false;        ///< `anchor` differs from `proxy`
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
  /// - A proxy that a changed surface has passed or overlaps returns to the side it was on.
  /// - A proxy that starts inside, or around which a surface appears, touches nothing until it has come out; an open
  ///   sheet counts as inside from behind. It cannot be trapped.
  [[nodiscard]] const ProxyResult& step(const Vec3d& device, double dt, const Surface& surface,
                                        bool surface_changed) noexcept;

  [[nodiscard]] const ProxyResult& last() const noexcept { return result_; }

 private:
  enum class Side : std::int8_t { kInner = -1, kUnknown = 0, kOuter = 1 };
  struct Slide;

  [[nodiscard]] Slide slide(const Vec3d& goal, const Surface& surface) const noexcept;
  [[nodiscard]] Slide slide_with_friction(const Vec3d& device, const Surface& surface) noexcept;
  [[nodiscard]] bool inside_from_start(const Surface& surface) const noexcept;
  [[nodiscard]] bool closest(const Vec3d& x, const Surface& surface, SurfaceHit& hit) const noexcept;
  void keep_side(const Surface& surface) noexcept;
  void follow_change(const Surface& surface) noexcept;
  void find_side(const Surface& surface) noexcept;

  ProxySettings settings_;
  Grip grip_;
  ProxyResult result_;
  Vec3d goal_ = Vec3d::Zero();    // of the last slide
  Vec3d offset_ = Vec3d::Zero();  // proxy - anchor
  Side side_ = Side::kUnknown;    // of the surface within reach
  bool started_ = false;
  bool slipping_ = false;
};

}  // namespace tactus::haptics
