#include "haptics/proxy.hpp"

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

/// Keeps the centre at normal . x >= offset.
struct Plane {
  Vec3d normal;
  double offset;
  std::uint32_t object, face;
};

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
      constexpr double kRounding = 1e-12;
      if ((set >> i & 1u) == 0 && planes_[i].normal.dot(found) < planes_[i].offset - kRounding) return false;
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
};

Proxy::Slide Proxy::slide(const Vec3d& goal, const Surface& surface) const noexcept {
  Slide slide{goal, result_.proxy};
  Planes planes;
  Vec3d target = goal;
  for (int sweep = 0; sweep < kMaxSweeps; ++sweep) {
    SurfaceHit hit;
    if (!surface.sweep(slide.end, target, settings_.radius, hit)) {
      slide.end = target;
      break;
    }
    const Vec3d motion = target - slide.end;
    const double closing = -motion.dot(hit.normal);
    if (closing > 0) slide.end += motion * std::max(0.0, hit.time - kSkin / closing);
    const double offset = hit.normal.dot(hit.point) + settings_.radius + kSkin;
    if (!planes.add({hit.normal, offset, hit.object, hit.face})) break;
    if (!planes.nearest(goal, target)) break;
  }
  if (const Plane* plane = planes.holding(goal); plane != nullptr && (slide.end - goal).norm() > kNoMotion) {
    slide.held = true;
    slide.object = plane->object;
    slide.face = plane->face;
  }
  return slide;
}

Proxy::Slide Proxy::slide_with_friction(const Vec3d& device, const Surface& surface) noexcept {
  const Slide free = slide(device, surface);
  result_.sticking = false;
  if (!free.held || !(grip_.static_friction > 0)) {
    slipping_ = false;
    return free;
  }
  // The reaction of a frictionless surface gives normal and depth; friction then pulls the goal back towards the
  // proxy's foot, inside the cone of friction or to its rim.
  const Vec3d reaction = free.end - device;
  const double depth = reaction.norm();
  const Vec3d normal = reaction / depth;
  const Vec3d wish = device - result_.proxy;
  const Vec3d along = wish - normal * normal.dot(wish);
  const double length = along.norm();
  // A sliding proxy trails on the dynamic cone, so it may stick again only within that, and well within the static one
  // where the two are close: it does not flicker between the states.
  constexpr double kStickAgain = 0.7;
  const double coefficient =
      slipping_ ? std::min(kStickAgain * grip_.static_friction, grip_.dynamic_friction) : grip_.static_friction;
  const double cone = coefficient * depth;
  if (length <= cone) {
    slipping_ = false;
    result_.sticking = true;
    return slide(device - along, surface);
  }
  slipping_ = true;
  const double drag = std::min(1.0, grip_.dynamic_friction * depth / length);
  return slide(device - along * drag, surface);
}

bool Proxy::inside_from_start(const Surface& surface) const noexcept {
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
  if (closest(result_.proxy, surface, hit) && hit.sided) {
    side_ = hit.distance < 0 ? Side::kInner : Side::kOuter;
  }
}

void Proxy::keep_side(const Surface& surface) noexcept {
  constexpr int kMaxPushes = 8;
  constexpr double kLeastShare = 1.0 / 16;
  const double sign = static_cast<double>(side_);
  // Where the gap is narrower than the proxy, its centre at least comes to the right side.
  for (double share = 1; share >= kLeastShare; share /= 2) {
    const double room = settings_.radius * share;
    Vec3d x = result_.proxy;
    for (int push = 0; push < kMaxPushes; ++push) {
      SurfaceHit hit;
      if (!closest(x, surface, hit)) {
        result_.proxy = x;
        return;
      }
      const double distance = hit.sided ? sign * hit.distance : std::abs(hit.distance);
      if (distance >= room) {
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

void Proxy::follow_change(const Surface& surface) noexcept {
  if (side_ == Side::kUnknown) {
    result_.outside_only = inside_from_start(surface);
    if (result_.outside_only) return;
  } else {
    keep_side(surface);
  }
}

const ProxyResult& Proxy::step(const Vec3d& device, double dt, const Surface& surface, bool surface_changed) noexcept {
  if (!device.allFinite()) return result_;
  result_.surface_moved = false;
  if (!started_) {
    started_ = true;
    result_.proxy = goal_ = device;
    result_.outside_only = inside_from_start(surface);
  } else if (surface_changed && !result_.outside_only) {
    // Where the new surface puts the proxy for the goal of the last step: that difference is the change's doing alone.
    const Vec3d before = result_.proxy;
    follow_change(surface);
    if (!result_.outside_only) result_.proxy = slide(goal_, surface).end;
    const Vec3d change = result_.proxy - before;
    if (change.norm() > kSkin) {
      offset_ += change;
      result_.surface_moved = true;
    }
  }

  if (result_.outside_only) {
    result_.proxy = goal_ = device;
    result_.in_contact = result_.sticking = false;
    result_.object = result_.face = spm::kNone;
    result_.outside_only = inside_from_start(surface);
  } else {
    const Slide slide = slide_with_friction(device, surface);
    result_.proxy = slide.end;
    goal_ = slide.goal;
    result_.in_contact = slide.held;
    result_.object = slide.object;
    result_.face = slide.face;
    if (slide.held) result_.normal = (slide.end - slide.goal).normalized();
  }
  if (!result_.outside_only) find_side(surface);

  const double step = settings_.ramp * dt / grip_.stiffness;
  const double length = offset_.norm();
  offset_ = length > step ? Vec3d(offset_ * (1 - step / length)) : Vec3d::Zero();
  // A ramp may press less than the surface would, but never pull.
  const double pull = (result_.proxy - offset_ - device).dot(result_.normal);
  if (pull < 0 && length > 0) offset_ += result_.normal * pull;
  result_.ramping = !offset_.isZero(0);
  result_.anchor = result_.proxy - offset_;
  return result_;
}

}  // namespace tactus::haptics
