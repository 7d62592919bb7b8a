#include "haptics/proxy.hpp"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>

namespace tactus::haptics {

namespace {

constexpr int kMaxSweeps = 6;
constexpr double kSkin = 1e-6;           // m kept between proxy and surface: far above rounding, far below feeling
constexpr double kSamePlane = 1 - 1e-6;  // cosine
constexpr double kNoMotion = 1e-9;       // m
constexpr double kMinShare = 1.0 / 16;   // of the radius, that a proxy without room for all of it keeps

/// Keeps the centre at normal . x >= offset.
struct Plane {
  Vec3d normal;
  double offset;
  std::uint32_t object, face;
};

Plane plane_at(const SurfaceHit& hit, double radius) noexcept {
  return {hit.normal, hit.normal.dot(hit.point) + radius + kSkin, hit.object, hit.face};
}

/// At most three planes and the point allowed by them that is nearest to a goal.
class Planes {
 public:
  /// False when three other planes already hold the proxy.
  [[nodiscard]] bool add(const Plane& plane) noexcept {
    for (int i = 0; i < count_; ++i) {
      if (planes_[i].normal.dot(plane.normal) > kSamePlane) {
        planes_[i] = plane;
        return true;
      }
    }
    if (count_ < 3) {
      planes_[count_++] = plane;
      return true;
    }
    for (int i = 0; i < count_; ++i) {
      if ((active_ >> i & 1u) == 0) {
        planes_[i] = plane;
        return true;
      }
    }
    return false;
  }

  /// min |x - goal| subject to all planes: of every set of planes taken as equalities, the one whose multipliers do not
  /// pull and whose point the other planes allow. False when the planes leave no room.
  [[nodiscard]] bool nearest(const Vec3d& goal, Vec3d& x) noexcept {
    static constexpr std::array<unsigned, 8> kBySize{0, 1, 2, 4, 3, 5, 6, 7};
    for (const unsigned set : kBySize) {
      if (set >> count_ != 0) continue;
      if (!nearest_on(set, goal, x)) continue;
      active_ = set;
      return true;
    }
    return false;
  }

  /// The plane that holds the proxy most; null when none does.
  [[nodiscard]] const Plane* holding(const Vec3d& goal) const noexcept {
    const Plane* best = nullptr;
    double depth = 0;
    for (int i = 0; i < count_; ++i) {
      const double d = planes_[i].offset - planes_[i].normal.dot(goal);
      if (d > depth) {
        depth = d;
        best = &planes_[i];
      }
    }
    return best;
  }

 private:
  [[nodiscard]] bool nearest_on(unsigned set, const Vec3d& goal, Vec3d& x) const noexcept {
    std::array<int, 3> rows{};
    int size = 0;
    for (int i = 0; i < count_; ++i) {
      if ((set >> i & 1u) != 0) rows[size++] = i;
    }
    // x = goal + N' m with N x = d, so (N N') m = d - N goal. Unused rows stay those of the identity.
    Eigen::Matrix3d gram = Eigen::Matrix3d::Identity();
    Vec3d gap = Vec3d::Zero();
    for (int i = 0; i < size; ++i) {
      gap[i] = planes_[rows[i]].offset - planes_[rows[i]].normal.dot(goal);
      for (int j = 0; j < size; ++j) gram(i, j) = planes_[rows[i]].normal.dot(planes_[rows[j]].normal);
    }
    constexpr double kSingular = 1e-10;
    if (gram.determinant() < kSingular) return false;
    const Vec3d multipliers = gram.inverse() * gap;
    if (multipliers.minCoeff() < 0) return false;
    Vec3d found = goal;
    for (int i = 0; i < size; ++i) found += multipliers[i] * planes_[rows[i]].normal;
    for (int i = 0; i < count_; ++i) {
      constexpr double kCollisionMargin = 1e-12;
      if ((set >> i & 1u) == 0 && planes_[i].normal.dot(found) < planes_[i].offset - kCollisionMargin) return false;
    }
    x = found;
    return true;
  }

  std::array<Plane, 3> planes_{};
  int count_ = 0;
  unsigned active_ = 0;
};

}  // namespace

/// Where the proxy can go towards a goal, and what holds it there.
struct Proxy::Slide {
  Vec3d goal;
  Vec3d end;
  bool held = false;
  std::uint32_t object = spm::kNone;
  std::uint32_t face = spm::kNone;
  [[nodiscard]] Vec3d normal() const noexcept { return (end - goal).normalized(); }
};

/// What friction makes of the goal.
struct Proxy::Grasp {
  Vec3d goal;
  bool sticking;
};

Proxy::Slide Proxy::slide(const Vec3d& start, const Vec3d& goal, Surface& surface,
                          const SurfaceHit* known) const noexcept {
  Slide slide{goal, start};
  Planes planes;
  Vec3d target = goal;
  if (known != nullptr && !(planes.add(plane_at(*known, settings_.radius)) && planes.nearest(goal, target)))
    return slide;
  for (int sweep = 0; sweep < kMaxSweeps; ++sweep) {
    SurfaceHit hit;
    if (!surface.sweep(slide.end, target, settings_.radius, hit)) {
      slide.end = target;
      break;
    }
    const Vec3d motion = target - slide.end;
    const double closing = -motion.dot(hit.normal);
    if (closing > 0) slide.end += motion * std::max(0.0, hit.time - kSkin / closing);
    if (!planes.add(plane_at(hit, settings_.radius))) break;
    if (!planes.nearest(goal, target)) break;
  }
  if (const Plane* plane = planes.holding(goal); plane != nullptr && (slide.end - goal).norm() > kNoMotion) {
    slide.held = true;
    slide.object = plane->object;
    slide.face = plane->face;
  }
  return slide;
}

Proxy::Grasp Proxy::grasp(const Vec3d& device, const Vec3d& normal, const Vec3d& held_at,
                          double stick_within) const noexcept {
  const double depth = std::max(0.0, normal.dot(held_at - device));
  const Vec3d wish = device - result_.proxy;
  const Vec3d along = wish - normal * normal.dot(wish);
  const double length = along.norm();
  if (length <= stick_within * depth) return {device - along, true};
  return {device - along * std::min(1.0, grip_.dynamic_friction * depth / length), false};
}

bool Proxy::slide_in_cone(const Vec3d& device, Vec3d normal, const Vec3d& held_at, Surface& surface,
                          Slide& found) noexcept {
  constexpr int kMaxRounds = 2;
  constexpr double kTurned = 5e-4, kTurnedFar = 5e-3;  // rad
  constexpr double kOne = 0.99;                        // cosine
  // A sliding proxy trails on the dynamic cone, so it may stick again only within that, and well within the static one
  // where the two are close: it does not flicker between the states.
  constexpr double kStickAgain = 0.7;
  const double coefficient =
      slipping_ ? std::min(kStickAgain * grip_.static_friction, grip_.dynamic_friction) : grip_.static_friction;
  Grasp grasp = this->grasp(device, normal, held_at, coefficient);
  found = slide(result_.proxy, grasp.goal, surface);
  if (!found.held) return false;
  way_ = {result_.proxy, grasp.goal};
  // It has gone along the tangent of where it was; what is under it now may slope otherwise, and be further down.
  for (int round = 0; round < kMaxRounds && !grasp.sticking; ++round) {
    SurfaceHit under;
    // Several surfaces hold it where what is under it is not what holds it: then their sum is upright.
    const bool one =
        surface.sweep(found.end, grasp.goal, settings_.radius, under) && under.normal.dot(found.normal()) > kOne;
    const Vec3d upright = one ? under.normal : found.normal();
    const double turned = upright.cross(normal).norm();
    if (turned < kTurned) break;
    const Vec3d there = one ? Vec3d(under.point + upright * (settings_.radius + kSkin)) : found.end;
    const Grasp right = this->grasp(device, upright, there, 0);  // it slips, whatever it finds there
    const Slide better = slide(found.end, right.goal, surface, one ? &under : nullptr);
    if (!better.held) break;
    way_ = {found.end, right.goal, one, grasp.goal, under};
    found = better;
    grasp = right;
    normal = upright;
    if (turned < kTurnedFar) break;
  }
  result_.sticking = grasp.sticking;
  slipping_ = !grasp.sticking;
  return true;
}

Proxy::Slide Proxy::slide_with_friction(const Vec3d& device, Surface& surface) noexcept {
  // The cone of friction stands on the normal of the contact, which is known when the proxy has gone there. The first
  // guess is that of the last step, else that of a surface without friction.
  const bool rough = grip_.static_friction > 0;
  Slide found;
  if (rough && result_.in_contact && result_.normal.dot(result_.proxy - device) > 0 &&
      slide_in_cone(device, result_.normal, result_.proxy, surface, found))
    return found;
  const Slide free = slide(result_.proxy, device, surface);
  if (rough && free.held && slide_in_cone(device, free.normal(), free.end, surface, found)) return found;
  result_.sticking = slipping_ = false;
  way_ = {result_.proxy, device};
  return free;
}

bool Proxy::inside(const Surface& surface) const noexcept {
  SurfaceHit hit;
  return surface.closest(result_.proxy, settings_.start_reach, hit) && hit.sided &&
         hit.distance < (result_.outside_only ? settings_.radius : 0);
}

bool Proxy::closest(const Vec3d& x, const Surface& surface, SurfaceHit& hit) const noexcept {
  // What holds a proxy is at hand; only in the air is it worth while to look far.
  constexpr double kAtHand = 1e-5;  // m
  return surface.closest(x, settings_.radius + kAtHand, hit) || surface.closest(x, settings_.reach, hit);
}

void Proxy::find_side(const Surface& surface) noexcept {
  SurfaceHit hit;
  side_ = Side::kUnknown;
  result_.near_surface = closest(result_.proxy, surface, hit);
  if (result_.near_surface && hit.sided) {
    side_ = hit.distance < 0 ? Side::kInner : Side::kOuter;
  }
}

void Proxy::keep_side(const Surface& surface) noexcept {
  constexpr int kMaxPushes = 8;
  const double sign = side_ == Side::kInner ? -1 : 1;
  // Where the gap is narrower than the proxy, its centre at least comes to the right side.
  for (double share = 1; share >= kMinShare; share /= 2) {
    const double room = settings_.radius * share;
    Vec3d x = result_.proxy;
    for (int push = 0; push < kMaxPushes; ++push) {
      SurfaceHit hit;
      if (!closest(x, surface, hit)) {
        result_.proxy = x;
        return;
      }
      const double distance = hit.sided ? sign * hit.distance : std::abs(hit.distance);
      if (distance >= room - kSkin) {
        result_.proxy = x;
        return;
      }
      Vec3d outwards = distance < 0 ? Vec3d(hit.point - x) : Vec3d(x - hit.point);
      if (outwards.norm() > kNoMotion) {
        outwards.normalize();
      } else {
        outwards = sign * hit.normal;
      }
      x = hit.point + outwards * (room + kSkin);
    }
  }
}

bool Proxy::holds_still(Surface& surface) const noexcept {
  SurfaceHit under;
  if (way_.probed) {
    if (!surface.sweep(way_.start, way_.probe, settings_.radius, under)) return false;
    constexpr double kSameNormal = 1e-6;
    if ((under.point - way_.under.point).norm() > kSkin || (under.normal - way_.under.normal).norm() > kSameNormal)
      return false;
  }
  const Slide again = slide(way_.start, way_.goal, surface, way_.probed ? &under : nullptr);
  return again.held && (again.end - result_.proxy).norm() <= kSkin;
}

void Proxy::follow_change(Surface& surface) noexcept {
  // What held it holds it there still: nothing has changed that it touches, and it stays where it is to the bit.
  if (result_.in_contact && holds_still(surface)) return;
  if (side_ == Side::kUnknown) {
    result_.outside_only = inside(surface);
    if (result_.outside_only) return;
  }
  const Vec3d before = result_.proxy;
  keep_side(surface);
  result_.proxy = slide(result_.proxy, way_.goal, surface).end;
  result_.surface_moved = (result_.proxy - before).norm() > kSkin;
}

bool Proxy::push(const Vec3d& wish, double radius, Surface& surface, Vec3d& to) const noexcept {
  Planes planes;
  to = wish;
  SurfaceHit hit;
  for (int sweep = 0; sweep < kMaxSweeps; ++sweep) {
    if (!surface.sweep_moving(result_.proxy, to, radius, hit)) return true;
    if (!planes.add(plane_at(hit, radius)) || !planes.nearest(wish, to)) break;
  }
  // As far as it can go along with what is in its way, if that is all there is.
  const Vec3d at = surface.carried(hit.object, result_.proxy);
  const Vec3d motion = to - at;
  const double closing = -motion.dot(hit.normal);
  to = at;
  if (closing > 0) to += motion * std::max(0.0, hit.time - kSkin / closing);
  return !surface.sweep_moving(result_.proxy, to, radius, hit);
}

void Proxy::carry(double dt, Surface& surface) noexcept {
  const bool held = result_.in_contact;
  const Vec3d wish = held ? surface.carried(result_.object, result_.proxy) : result_.proxy;
  if (dt > 0) result_.surface_velocity = (wish - result_.proxy) / dt;
  // Where objects close on it the centre at least stays outside.
  for (double share = 1; share >= kMinShare; share /= 4) {
    Vec3d to;
    if (!push(wish, settings_.radius * share, surface, to)) continue;
    result_.proxy = to;
    if (held) {
      for (Vec3d* point : {&way_.start, &way_.goal, &way_.probe, &way_.under.point})
        *point = surface.carried(result_.object, *point);
      for (Vec3d* direction : {&result_.normal, &way_.under.normal})
        *direction = surface.turned(result_.object, *direction);
    }
    return;
  }
  result_.outside_only = true;
}

void Proxy::follow(const Vec3d& device, Surface& surface) noexcept {
  const Slide slide = slide_with_friction(device, surface);
  result_.proxy = slide.end;
  result_.in_contact = slide.held;
  result_.object = slide.object;
  result_.face = slide.face;
  if (slide.held) result_.normal = slide.normal();
}

ProxyResult Proxy::unchanged(const Vec3d& device, double dt, Surface& before) const noexcept {
  if (!device.allFinite()) return result_;
  Proxy there = *this;
  there.result_.surface_velocity.setZero();
  if (!started_) there.result_.outside_only = true;
  if (before.moving() && !there.result_.outside_only) there.carry(dt, before);
  if (there.result_.outside_only) {
    there.result_.proxy = device;
    there.result_.in_contact = false;
  } else {
    there.follow(device, before);
  }
  there.result_.anchor = there.result_.proxy;
  return there.result_;
}

const ProxyResult& Proxy::step(const Vec3d& device, double dt, Surface& surface, bool surface_changed) noexcept {
  if (!device.allFinite()) return result_;
  result_.surface_moved = false;
  result_.surface_velocity.setZero();
  if (!started_) {
    started_ = true;
    result_.proxy = way_.goal = device;
    surface_changed = true;  // from none
  } else if (surface.moving() && !result_.outside_only) {
    carry(dt, surface);
  }
  if (surface_changed && !result_.outside_only) follow_change(surface);

  if (result_.outside_only) {
    result_.proxy = way_.goal = device;
    result_.in_contact = result_.near_surface = result_.sticking = slipping_ = false;
    result_.object = result_.face = spm::kNone;
    result_.outside_only = inside(surface);
    side_ = Side::kUnknown;
  } else {
    follow(device, surface);
    find_side(surface);
  }
  result_.anchor = result_.proxy;
  return result_;
}

}  // namespace tactus::haptics
