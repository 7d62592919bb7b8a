#include "haptics/contact_solver.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace tactus::haptics {

namespace {

/// Computes two unit vectors that form a right-handed frame with the unit vector `n`.
void tangents_of(const Vec3d& n, Vec3d& t1, Vec3d& t2) noexcept {
  const Vec3d side = std::abs(n.x()) < 0.6 ? Vec3d::UnitX() : Vec3d::UnitY();
  t1 = n.cross(side).normalized();
  t2 = n.cross(t1);
}

/// Costs a tenth of std::hypot, because it does not guard against overflow.
double length_of(double x, double y) noexcept { return std::sqrt(x * x + y * y); }

/// Minimises sum a_i (x_i - c_i)^2 over the disc |x| <= radius, for a_i > 0 and c outside the disc.
void closest_in_disc(const double a[2], const double c[2], double radius, double x[2]) noexcept {
  // With the Lagrange multiplier m, x_i = a_i c_i / (a_i + m), and |x| decreases as m grows. 1 / |x| is concave in m,
  // so Newton's method on 1 / |x| from m = 0 approaches |x| = radius without overshoot.
  double m = 0;
  for (int step = 0; step < 20; ++step) {
    x[0] = a[0] * c[0] / (a[0] + m);
    x[1] = a[1] * c[1] / (a[1] + m);
    const double size = length_of(x[0], x[1]);
    if (size <= radius * (1 + 1e-12)) break;
    const double slope = x[0] * x[0] / (a[0] + m) + x[1] * x[1] / (a[1] + m);
    m += (size - radius) / radius * size * size / slope;
  }
  if (const double size = length_of(x[0], x[1]); size > radius) {
    x[0] *= radius / size;
    x[1] *= radius / size;
  }
}

}  // namespace

void ContactSolver::begin() noexcept {
  candidate_count_ = 0;
  dropped_candidates_ = 0;
}

void ContactSolver::add(const Contact& contact) noexcept {
  if (candidate_count_ == kMaxCandidateContacts) {
    ++dropped_candidates_;
    return;
  }
  candidates_[candidate_count_++] = contact;
}

/// Selects the deepest contact first. Then repeatedly selects the contact that differs most, in position or direction,
/// from the selected contacts of the same bodies. So it selects the outermost points of each supporting face: these
/// points carry a body.
void ContactSolver::select_contacts() noexcept {
  if (candidate_count_ <= kMaxContacts) {
    std::copy_n(candidates_.begin(), candidate_count_, selected_.begin());
    selected_count_ = candidate_count_;
    return;
  }
  double extent = 0;
  std::size_t next = 0;
  for (std::size_t i = 0; i < candidate_count_; ++i) {
    extent = std::max(extent, (candidates_[i].point - candidates_[0].point).norm());
    if (candidates_[i].gap < candidates_[next].gap) next = i;
  }
  std::array<double, kMaxCandidateContacts> difference;  // to the most similar selected contact; < 0: selected
  difference.fill(std::numeric_limits<double>::infinity());
  selected_count_ = 0;
  while (selected_count_ < kMaxContacts) {
    const Contact& selected = selected_[selected_count_++] = candidates_[next];
    difference[next] = -1;
    for (std::size_t i = 0; i < candidate_count_; ++i) {
      const bool same_pair = candidates_[i].a == selected.a && candidates_[i].b == selected.b;
      if (difference[i] < 0 || !same_pair) continue;
      difference[i] =
          std::min(difference[i], (candidates_[i].point - selected.point).squaredNorm() +
                                      extent * extent * (candidates_[i].normal - selected.normal).squaredNorm());
    }
    next = static_cast<std::size_t>(std::max_element(difference.begin(), difference.begin() + candidate_count_) -
                                    difference.begin());
  }
}

ContactSolver::Row ContactSolver::row_of(const Contact& contact, const Vec3d& axis,
                                         std::span<const SolverBody> bodies) noexcept {
  Row row;
  row.on_a << axis, contact.arm_a.cross(axis);
  row.change_a = bodies[contact.a].inverse_mass * row.on_a;
  row.diagonal = row.on_a.dot(row.change_a);
  if (contact.b != spm::kNone) {
    row.on_b << -axis, -contact.arm_b.cross(axis);
    row.change_b = bodies[contact.b].inverse_mass * row.on_b;
    row.diagonal += row.on_b.dot(row.change_b);
  } else {
    row.on_b.setZero();
    row.change_b.setZero();
  }
  return row;
}

void ContactSolver::build(Block& block, const Contact& contact, std::span<const SolverBody> bodies,
                          double dt) const noexcept {
  block.axes[0] = contact.normal;
  block.rows[0] = row_of(contact, contact.normal, bodies);
  Vec3d t1, t2;
  tangents_of(contact.normal, t1, t2);
  const Row first = row_of(contact, t1, bodies);
  const Row second = row_of(contact, t2, bodies);
  const double off_diagonal = first.on_a.dot(second.change_a) + first.on_b.dot(second.change_b);
  const double angle = 0.5 * std::atan2(2 * off_diagonal, first.diagonal - second.diagonal);
  block.axes[1] = std::cos(angle) * t1 + std::sin(angle) * t2;
  block.axes[2] = std::cos(angle) * t2 - std::sin(angle) * t1;
  block.rows[1] = row_of(contact, block.axes[1], bodies);
  block.rows[2] = row_of(contact, block.axes[2], bodies);
  for (int axis = 0; axis < 3; ++axis) {
    const Row& row = block.rows[axis];
    block.free_velocity[axis] = row.on_a.dot(bodies[contact.a].velocity);
    if (contact.b != spm::kNone) block.free_velocity[axis] += row.on_b.dot(bodies[contact.b].velocity);
  }
  if (contact.gap >= 0) {
    block.bias = contact.gap / dt;
  } else {
    const double overlap = std::max(0.0, -contact.gap - settings_.allowed_overlap);
    block.bias = -std::min({settings_.push_out, settings_.push_out_rate * overlap, overlap / dt});
  }
}

void ContactSolver::apply(const Contact& contact, const Row& row, double impulse,
                          std::span<SolverBody> bodies) noexcept {
  bodies[contact.a].velocity += row.change_a * impulse;
  if (contact.b != spm::kNone) bodies[contact.b].velocity += row.change_b * impulse;
}

/// Velocity of body a relative to body b along the axis of `row`, m/s.
double ContactSolver::velocity(const Contact& contact, const Row& row, std::span<const SolverBody> bodies) noexcept {
  double along = row.on_a.dot(bodies[contact.a].velocity);
  if (contact.b != spm::kNone) along += row.on_b.dot(bodies[contact.b].velocity);
  return along;
}

/// Applies the impulses that contacts with the same id had in the last step.
void ContactSolver::start_warm(std::span<SolverBody> bodies) noexcept {
  for (std::size_t i = 0; i < selected_count_; ++i) {
    Block& block = blocks_[i];
    block.lambda.fill(0);
    const WarmStart* const end = warm_start_.data() + warm_start_count_;
    const WarmStart* const found = std::find_if(std::as_const(warm_start_).data(), end,
                                                [&](const WarmStart& r) { return r.id == selected_[i].id; });
    if (found == end) continue;
    block.lambda[0] = std::max(0.0, found->impulse.dot(block.axes[0]));
    block.lambda[1] = found->impulse.dot(block.axes[1]);
    block.lambda[2] = found->impulse.dot(block.axes[2]);
    const double max = selected_[i].friction * block.lambda[0];
    if (const double size = length_of(block.lambda[1], block.lambda[2]); size > max) {
      block.lambda[1] *= size > 0 ? max / size : 0;
      block.lambda[2] *= size > 0 ? max / size : 0;
    }
    for (int axis = 0; axis < 3; ++axis) apply(selected_[i], block.rows[axis], block.lambda[axis], bodies);
  }
}

/// Solves one contact along its normal. Returns the change of the contact velocity, m/s.
double ContactSolver::solve_normal(const Contact& contact, Block& block, std::span<SolverBody> bodies) noexcept {
  const Row& normal = block.rows[0];
  if (!(normal.diagonal > 0)) return 0;
  const double unbounded = block.lambda[0] - (velocity(contact, normal, bodies) + block.bias) / normal.diagonal;
  const double change = std::max(0.0, unbounded) - block.lambda[0];
  block.lambda[0] += change;
  apply(contact, normal, change, bodies);
  return std::abs(change) * normal.diagonal;
}

/// Solves one contact along its two tangents. Returns the largest change of the contact velocity along one of them,
/// m/s.
double ContactSolver::solve_friction(const Contact& contact, Block& block, std::span<SolverBody> bodies) noexcept {
  const Row& first = block.rows[1];
  const Row& second = block.rows[2];
  if (contact.friction <= 0 || first.diagonal <= 0 || second.diagonal <= 0) return 0;
  const double max = contact.friction * block.lambda[0];
  const double a[2] = {first.diagonal, second.diagonal};
  double x[2] = {block.lambda[1] - velocity(contact, first, bodies) / a[0],
                 block.lambda[2] - velocity(contact, second, bodies) / a[1]};
  if (max <= 0) {
    x[0] = x[1] = 0;
  } else if (length_of(x[0], x[1]) > max) {
    const double c[2] = {x[0], x[1]};
    closest_in_disc(a, c, max, x);
  }
  double largest = 0;
  for (int t = 0; t < 2; ++t) {
    const double change = x[t] - block.lambda[1 + t];
    block.lambda[1 + t] = x[t];
    apply(contact, block.rows[1 + t], change, bodies);
    largest = std::max(largest, std::abs(change) * a[t]);
  }
  return largest;
}

void ContactSolver::iterate(std::span<SolverBody> bodies) noexcept {
  result_.converged = selected_count_ == 0;
  while (!result_.converged && result_.iterations < settings_.iterations) {
    ++result_.iterations;
    double largest = 0;
    for (std::size_t i = 0; i < selected_count_; ++i) {
      largest = std::max(largest, solve_normal(selected_[i], blocks_[i], bodies));
      largest = std::max(largest, solve_friction(selected_[i], blocks_[i], bodies));
    }
    result_.converged = largest <= settings_.tolerance;
  }
}

/// If the objective of the impulses (the energy that they add, J; see the header) is above 0, scales all impulses down
/// by one factor.
void ContactSolver::limit_energy(std::span<SolverBody> bodies) noexcept {
  // The objective of s times the impulses is s * linear + s^2 * quadratic.
  double linear = 0, quadratic = 0;
  for (std::size_t i = 0; i < selected_count_; ++i) {
    const Block& block = blocks_[i];
    linear += block.lambda[0] * block.bias;
    for (int axis = 0; axis < 3; ++axis) {
      linear += block.lambda[axis] * block.free_velocity[axis];
      quadratic +=
          0.5 * block.lambda[axis] * (velocity(selected_[i], block.rows[axis], bodies) - block.free_velocity[axis]);
    }
  }
  result_.objective = linear + quadratic;
  if (!(result_.objective > 0 && quadratic > 0)) return;
  const double scale = std::clamp(-linear / (2 * quadratic), 0.0, 1.0);
  for (std::size_t i = 0; i < selected_count_; ++i) {
    for (int axis = 0; axis < 3; ++axis) {
      const double before = blocks_[i].lambda[axis];
      blocks_[i].lambda[axis] *= scale;
      apply(selected_[i], blocks_[i].rows[axis], blocks_[i].lambda[axis] - before, bodies);
    }
  }
  result_.scaled = true;
  result_.objective = scale * linear + scale * scale * quadratic;
}

/// Stores the impulses for the warm start of the next step, and adds up those on static geometry.
void ContactSolver::store_impulses() noexcept {
  warm_start_count_ = selected_count_;
  for (std::size_t i = 0; i < selected_count_; ++i) {
    const Block& block = blocks_[i];
    impulses_[i] = block.lambda[0] * block.axes[0] + block.lambda[1] * block.axes[1] + block.lambda[2] * block.axes[2];
    warm_start_[i] = {selected_[i].id, impulses_[i]};
    if (selected_[i].b == spm::kNone) result_.impulse += impulses_[i];
  }
}

const SolverResult& ContactSolver::solve(std::span<SolverBody> bodies, double dt) noexcept {
  select_contacts();
  result_ = SolverResult{};
  result_.contacts = static_cast<std::uint32_t>(selected_count_);
  result_.dropped = dropped_candidates_ + static_cast<std::uint32_t>(candidate_count_ - selected_count_);
  for (std::size_t i = 0; i < selected_count_; ++i) build(blocks_[i], selected_[i], bodies, dt);
  start_warm(bodies);
  iterate(bodies);
  limit_energy(bodies);
  store_impulses();
  return result_;
}

}  // namespace tactus::haptics
