#include "haptics/proxy.hpp"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>

namespace tactus::haptics {

namespace {

constexpr int kMaxIterations = 6;
constexpr double kSkin = 1e-6;  // m, distance between proxy and surface: far above rounding errors, too small to feel
constexpr double kSamePlane = 1 - 1e-6;  // cosine
constexpr double kNoMotion = 1e-9;       // m
constexpr double kMinShare = 1.0 / 16;   // min share of the radius that a proxy needs in a narrow gap

/// A constraint on the centre x: normal . x >= offset.
struct Plane {
  Vec3d normal;
  double offset;
  std::uint32_t object, face;
};

Plane plane_at(const SurfaceHit& hit, double radius) noexcept {
  return {hit.normal, hit.normal.dot(hit.point) + radius + kSkin, hit.object, hit.face};
}

/// At most three planes. Finds the point nearest to a goal that satisfies all of them.
class Planes {
 public:
  /// Adds a plane. Replaces a nearly parallel plane, or else, if there are three, a plane that does not constrain the
  /// proxy. Returns false if all three constrain it.
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

  /// Minimises |x - goal| subject to all planes. Tries every set of planes as equalities. The solution is the set with
  /// multipliers >= 0 whose point satisfies the other planes. Returns false if no point satisfies all planes.
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

  /// Returns the plane that the goal violates most; null: the goal satisfies all planes.
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
    // The rows of N are the normals of the set, d its offsets, and m its multipliers. x = goal + N' m with N x = d, so
    // (N N') m = d - N goal. If the set has fewer than three planes, the other rows are those of the identity matrix.
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
      constexpr double kTolerance = 1e-12;
      if ((set >> i & 1u) == 0 && planes_[i].normal.dot(found) < planes_[i].offset - kTolerance) return false;
    }
    x = found;
    return true;
  }

  std::array<Plane, 3> planes_{};
  int count_ = 0;
  unsigned active_ = 0;
};

}  // namespace

/// Result of a constrained motion towards a goal.
struct Proxy::Motion {
  Vec3d goal;
  Vec3d end;
  bool held = false;
  std::uint32_t object = spm::kNone;
  std::uint32_t face = spm::kNone;
  [[nodiscard]] Vec3d normal() const noexcept { return (end - goal).normalized(); }
};

/// The goal that friction leaves for the motion.
struct Proxy::ConstrainedGoal {
  Vec3d goal;
  bool sticking;
};

Proxy::Motion Proxy::move(const Vec3d& start, const Vec3d& goal, Surface& surface,
                          const SurfaceHit* first_hit) const noexcept {
  Motion motion{goal, start};
  Planes planes;
  Vec3d target = goal;
  if (first_hit != nullptr && !(planes.add(plane_at(*first_hit, settings_.radius)) && planes.nearest(goal, target)))
    return motion;
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    SurfaceHit hit;
    if (!surface.sweep(motion.end, target, settings_.radius, hit)) {
      motion.end = target;
      break;
    }
    const Vec3d delta = target - motion.end;
    const double closing = -delta.dot(hit.normal);
    if (closing > 0) motion.end += delta * std::max(0.0, hit.time - kSkin / closing);
    if (!planes.add(plane_at(hit, settings_.radius))) break;
    if (!planes.nearest(goal, target)) break;
  }
  if (const Plane* plane = planes.holding(goal); plane != nullptr && (motion.end - goal).norm() > kNoMotion) {
    motion.held = true;
    motion.object = plane->object;
    motion.face = plane->face;
  }
  return motion;
}

Proxy::ConstrainedGoal Proxy::friction_goal(const Vec3d& device, const Vec3d& normal, const Vec3d& held_at,
                                            double stick_within) const noexcept {
  const double depth = std::max(0.0, normal.dot(held_at - device));
  const Vec3d wanted = device - result_.proxy;
  const Vec3d along = wanted - normal * normal.dot(wanted);
  const double length = along.norm();
  if (length <= stick_within * depth) return {device - along, true};
  return {device - along * std::min(1.0, grip_.dynamic_friction * depth / length), false};
}

bool Proxy::move_in_cone(const Vec3d& device, Vec3d normal, const Vec3d& held_at, Surface& surface,
                         Motion& found) noexcept {
  constexpr int kMaxRounds = 2;
  constexpr double kSmallTurn = 5e-4, kMediumTurn = 5e-3;  // rad, between the normals of two rounds
  constexpr double kSameNormal = 0.99;                     // cosine
  // A slipping proxy is on the rim of the dynamic cone. It may stick again only inside that cone and well inside the
  // static cone, so that it does not alternate between sticking and slipping.
  constexpr double kStickAgain = 0.7;
  const double coefficient =
      slipping_ ? std::min(kStickAgain * grip_.static_friction, grip_.dynamic_friction) : grip_.static_friction;
  ConstrainedGoal friction = friction_goal(device, normal, held_at, coefficient);
  found = move(result_.proxy, friction.goal, surface);
  if (!found.held) return false;
  last_motion_ = {result_.proxy, friction.goal};
  // The goal lies on the tangent plane at the old position, but at the new position the surface may have another slope
  // or height. So the friction is corrected with the normal at the new position.
  for (int round = 0; round < kMaxRounds && !friction.sticking; ++round) {
    SurfaceHit under;
    // If the surface below is not the only constraint, several surfaces constrain the proxy, and the normal is that of
    // the motion.
    const bool is_single = surface.sweep(found.end, friction.goal, settings_.radius, under) &&
                           under.normal.dot(found.normal()) > kSameNormal;
    const Vec3d normal_below = is_single ? under.normal : found.normal();
    const double turned = normal_below.cross(normal).norm();
    if (turned < kSmallTurn) break;
    const Vec3d contact = is_single ? Vec3d(under.point + normal_below * (settings_.radius + kSkin)) : found.end;
    const ConstrainedGoal corrected = friction_goal(device, normal_below, contact, 0);  // 0: the proxy slips
    const Motion better = move(found.end, corrected.goal, surface, is_single ? &under : nullptr);
    if (!better.held) break;
    last_motion_ = {found.end, corrected.goal, is_single, friction.goal, under};
    found = better;
    friction = corrected;
    normal = normal_below;
    if (turned < kMediumTurn) break;
  }
  result_.sticking = friction.sticking;
  slipping_ = !friction.sticking;
  return true;
}

Proxy::Motion Proxy::move_with_friction(const Vec3d& device, Surface& surface) noexcept {
  // The axis of the friction cone is the contact normal, which is known only after the motion. The first guess is the
  // normal of the last step, or without contact that of a motion without friction.
  const bool has_friction = grip_.static_friction > 0;
  Motion found;
  if (has_friction && result_.in_contact && result_.normal.dot(result_.proxy - device) > 0 &&
      move_in_cone(device, result_.normal, result_.proxy, surface, found))
    return found;
  const Motion free = move(result_.proxy, device, surface);
  if (has_friction && free.held && move_in_cone(device, free.normal(), free.end, surface, found)) return found;
  result_.sticking = slipping_ = false;
  last_motion_ = {result_.proxy, device};
  return free;
}

bool Proxy::inside(const Surface& surface) const noexcept {
  SurfaceHit hit;
  return surface.closest(result_.proxy, settings_.start_reach, hit) && hit.is_side_known &&
         hit.distance < (result_.outside_only ? settings_.radius : 0);
}

bool Proxy::closest(const Vec3d& x, const Surface& surface, SurfaceHit& hit) const noexcept {
  // A surface in contact is close. A search over the full reach is worthwhile only without contact.
  constexpr double kContactTolerance = 1e-5;  // m
  return surface.closest(x, settings_.radius + kContactTolerance, hit) || surface.closest(x, settings_.reach, hit);
}

void Proxy::find_side(const Surface& surface) noexcept {
  SurfaceHit hit;
  side_ = Side::kUnknown;
  result_.near_surface = closest(result_.proxy, surface, hit);
  if (result_.near_surface && hit.is_side_known) {
    side_ = hit.distance < 0 ? Side::kInner : Side::kOuter;
  }
}

void Proxy::keep_side(const Surface& surface) noexcept {
  constexpr int kMaxPushes = 8;
  const double sign = side_ == Side::kInner ? -1 : 1;
  // If the gap between surfaces is narrower than the proxy, the proxy's centre still moves to the correct side.
  for (double share = 1; share >= kMinShare; share /= 2) {
    const double radius = settings_.radius * share;
    Vec3d x = result_.proxy;
    for (int push = 0; push < kMaxPushes; ++push) {
      SurfaceHit hit;
      if (!closest(x, surface, hit)) {
        result_.proxy = x;
        return;
      }
      const double distance = hit.is_side_known ? sign * hit.distance : std::abs(hit.distance);
      if (distance >= radius - kSkin) {
        result_.proxy = x;
        return;
      }
      Vec3d outwards = distance < 0 ? Vec3d(hit.point - x) : Vec3d(x - hit.point);
      if (outwards.norm() > kNoMotion) {
        outwards.normalize();
      } else {
        outwards = sign * hit.normal;
      }
      x = hit.point + outwards * (radius + kSkin);
    }
  }
}

bool Proxy::repeats_motion(Surface& surface) const noexcept {
  SurfaceHit under;
  if (last_motion_.probed) {
    if (!surface.sweep(last_motion_.start, last_motion_.probe, settings_.radius, under)) return false;
    constexpr double kSameNormal = 1e-6;
    if ((under.point - last_motion_.under.point).norm() > kSkin ||
        (under.normal - last_motion_.under.normal).norm() > kSameNormal)
      return false;
  }
  const Motion again = move(last_motion_.start, last_motion_.goal, surface, last_motion_.probed ? &under : nullptr);
  return again.held && (again.end - result_.proxy).norm() <= kSkin;
}

void Proxy::follow_change(Surface& surface) noexcept {
  // If the repeated motion ends at the same position, the touched surfaces did not change, and the proxy does not move.
  if (result_.in_contact && repeats_motion(surface)) return;
  if (side_ == Side::kUnknown) {
    result_.outside_only = inside(surface);
    if (result_.outside_only) return;
  }
  const Vec3d before = result_.proxy;
  keep_side(surface);
  result_.proxy = move(result_.proxy, last_motion_.goal, surface).end;
  result_.surface_moved = (result_.proxy - before).norm() > kSkin;
}

bool Proxy::push(const Vec3d& wanted, double radius, Surface& surface, Vec3d& to) const noexcept {
  Planes planes;
  to = wanted;
  SurfaceHit hit;
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    if (!surface.sweep_moving(result_.proxy, to, radius, hit)) return true;
    if (!planes.add(plane_at(hit, radius)) || !planes.nearest(wanted, to)) break;
  }
  // Moves as far as the last obstacle allows, if that is the only one.
  const Vec3d at = surface.moved_point(hit.object, result_.proxy);
  const Vec3d motion = to - at;
  const double closing = -motion.dot(hit.normal);
  to = at;
  if (closing > 0) to += motion * std::max(0.0, hit.time - kSkin / closing);
  return !surface.sweep_moving(result_.proxy, to, radius, hit);
}

void Proxy::move_with_objects(double dt, Surface& surface) noexcept {
  const bool held = result_.in_contact;
  const Vec3d wanted = held ? surface.moved_point(result_.object, result_.proxy) : result_.proxy;
  if (dt > 0) result_.surface_velocity = (wanted - result_.proxy) / dt;
  // If objects close around the proxy, the proxy's centre still stays outside of them.
  for (double share = 1; share >= kMinShare; share /= 4) {
    Vec3d to;
    if (!push(wanted, settings_.radius * share, surface, to)) continue;
    result_.proxy = to;
    if (held) {
      for (Vec3d* point : {&last_motion_.start, &last_motion_.goal, &last_motion_.probe, &last_motion_.under.point})
        *point = surface.moved_point(result_.object, *point);
      for (Vec3d* direction : {&result_.normal, &last_motion_.under.normal})
        *direction = surface.rotated_direction(result_.object, *direction);
    }
    return;
  }
  result_.outside_only = true;
}

void Proxy::follow(const Vec3d& device, Surface& surface) noexcept {
  const Motion motion = move_with_friction(device, surface);
  result_.proxy = motion.end;
  result_.in_contact = motion.held;
  result_.object = motion.object;
  result_.face = motion.face;
  if (motion.held) result_.normal = motion.normal();
}

ProxyResult Proxy::unchanged(const Vec3d& device, double dt, Surface& before) const noexcept {
  if (!device.allFinite()) return result_;
  Proxy copy = *this;
  copy.result_.surface_velocity.setZero();
  if (!started_) copy.result_.outside_only = true;
  if (before.moving() && !copy.result_.outside_only) copy.move_with_objects(dt, before);
  if (copy.result_.outside_only) {
    copy.result_.proxy = device;
    copy.result_.in_contact = false;
  } else {
    copy.follow(device, before);
  }
  copy.result_.anchor = copy.result_.proxy;
  return copy.result_;
}

const ProxyResult& Proxy::step(const Vec3d& device, double dt, Surface& surface, bool surface_changed) noexcept {
  if (!device.allFinite()) return result_;
  result_.surface_moved = false;
  result_.surface_velocity.setZero();
  if (!started_) {
    started_ = true;
    result_.proxy = last_motion_.goal = device;
    surface_changed = true;  // the surface is new to the proxy
  } else if (surface.moving() && !result_.outside_only) {
    move_with_objects(dt, surface);
  }
  if (surface_changed && !result_.outside_only) follow_change(surface);

  if (result_.outside_only) {
    result_.proxy = last_motion_.goal = device;
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
