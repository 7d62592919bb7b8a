#include "haptics/contact_solver.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <random>
#include <vector>

#include "tests/support/constants.hpp"

namespace tactus::haptics {
namespace {

/// Random bodies of 0.05 to 2 kg, and random contacts. The 6 x 6 mass matrices are dense, as for bodies with springs.
class Problem {
 public:
  Problem(unsigned seed, std::size_t body_count, std::size_t contact_count, double friction) : random_{seed} {
    for (std::size_t i = 0; i < body_count; ++i) {
      Mat6d mass = Mat6d::Zero();
      mass.diagonal() << Vec3d::Constant(uniform(0.05, 2)), 1e-3 * uniform(0.1, 2), 1e-3 * uniform(0.1, 2),
          1e-3 * uniform(0.1, 2);
      const Eigen::Matrix<double, 3, 6> jacobian = jacobian_of(random_vector(0.05));
      mass += jacobian.transpose() * jacobian * uniform(0, 0.1);
      SolverBody body;
      body.inverse_mass = mass.inverse();
      body.velocity << random_vector(0.3), random_vector(5);
      bodies.push_back(body);
    }
    for (std::size_t i = 0; i < contact_count; ++i) {
      Contact contact;
      contact.id = i + 1;
      contact.a = static_cast<std::uint32_t>(i % body_count);
      if (body_count > 1 && i % 2 == 1) contact.b = static_cast<std::uint32_t>((i + 1) % body_count);
      if (contact.b == contact.a) contact.b = spm::kNone;
      contact.arm_a = random_vector(0.05);
      contact.arm_b = random_vector(0.05);
      contact.normal = random_vector(1).normalized();
      contact.gap = uniform(0, 1e-4);
      contact.friction = friction;
      contacts.push_back(contact);
    }
  }

  double uniform(double low, double high) { return std::uniform_real_distribution<double>{low, high}(random_); }
  Vec3d random_vector(double size) { return {uniform(-size, size), uniform(-size, size), uniform(-size, size)}; }

  static Eigen::Matrix<double, 3, 6> jacobian_of(const Vec3d& arm) {
    Eigen::Matrix<double, 3, 6> jacobian;
    jacobian << Eigen::Matrix3d::Identity(), -skew(arm);
    return jacobian;
  }
  static Eigen::Matrix3d skew(const Vec3d& v) {
    Eigen::Matrix3d m;
    m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
    return m;
  }

  /// The matrix that maps the velocities of all bodies to the normal velocities of all contacts.
  [[nodiscard]] Eigen::MatrixXd normal_jacobian() const {
    Eigen::MatrixXd rows = Eigen::MatrixXd::Zero(contacts.size(), 6 * bodies.size());
    for (std::size_t i = 0; i < contacts.size(); ++i) {
      const Contact& c = contacts[i];
      rows.block<1, 6>(i, 6 * c.a) = c.normal.transpose() * jacobian_of(c.arm_a);
      if (c.b != spm::kNone) rows.block<1, 6>(i, 6 * c.b) = -c.normal.transpose() * jacobian_of(c.arm_b);
    }
    return rows;
  }
  [[nodiscard]] Eigen::MatrixXd inverse_mass() const {
    Eigen::MatrixXd w = Eigen::MatrixXd::Zero(6 * bodies.size(), 6 * bodies.size());
    for (std::size_t i = 0; i < bodies.size(); ++i) w.block<6, 6>(6 * i, 6 * i) = bodies[i].inverse_mass;
    return w;
  }
  [[nodiscard]] Eigen::VectorXd velocity() const {
    Eigen::VectorXd v(6 * bodies.size());
    for (std::size_t i = 0; i < bodies.size(); ++i) v.segment<6>(6 * i) = bodies[i].velocity;
    return v;
  }

  SolverResult solve(ContactSolver& solver) {
    solver.begin();
    for (const Contact& contact : contacts) solver.add(contact);
    return solver.solve(bodies, kCycle);
  }

  std::vector<SolverBody> bodies;
  std::vector<Contact> contacts;

 private:
  std::mt19937 random_;
};

SolverSettings exact() {
  SolverSettings settings;
  settings.iterations = 200'000;
  settings.tolerance = 1e-13;
  return settings;
}

/// Returns the velocity that satisfies all contacts, found by an enumeration of all sets of active contacts. Returns an
/// empty vector if there is no such velocity.
Eigen::VectorXd by_enumeration(const Problem& problem) {
  const Eigen::MatrixXd jacobian = problem.normal_jacobian();
  const Eigen::MatrixXd inverse_mass_matrix = problem.inverse_mass();
  const Eigen::VectorXd velocity_before = problem.velocity();
  Eigen::VectorXd gap_speed(jacobian.rows());
  for (int i = 0; i < gap_speed.size(); ++i) gap_speed[i] = problem.contacts[i].gap / kCycle;
  for (unsigned active_set = 0; active_set < 1u << jacobian.rows(); ++active_set) {
    std::vector<int> active;
    for (int i = 0; i < jacobian.rows(); ++i) {
      if (active_set >> i & 1) active.push_back(i);
    }
    if (active.empty()) {
      if (((jacobian * velocity_before + gap_speed).array() >= -1e-10).all()) return velocity_before;
      continue;
    }
    Eigen::MatrixXd active_jacobian(active.size(), jacobian.cols());
    Eigen::VectorXd required_change(active.size());
    for (std::size_t k = 0; k < active.size(); ++k) {
      active_jacobian.row(k) = jacobian.row(active[k]);
      required_change[k] = -(jacobian.row(active[k]).dot(velocity_before) + gap_speed[active[k]]);
    }
    const Eigen::MatrixXd delassus = active_jacobian * inverse_mass_matrix * active_jacobian.transpose();
    const Eigen::FullPivLU<Eigen::MatrixXd> lu{delassus};
    if (!lu.isInvertible()) continue;
    const Eigen::VectorXd impulses = lu.solve(required_change);
    if (impulses.minCoeff() < 0) continue;
    const Eigen::VectorXd velocity = velocity_before + inverse_mass_matrix * active_jacobian.transpose() * impulses;
    if (((jacobian * velocity + gap_speed).array() >= -1e-10).all()) return velocity;
  }
  return {};
}

TEST(ContactSolver, AgreesWithTheEnumerationOfAllSetsOfActiveContacts) {
  int changed = 0;
  for (unsigned seed = 1; seed <= 300; ++seed) {
    Problem problem{seed, 1 + seed % 3, 1 + seed % 7, 0};
    const Eigen::VectorXd expected = by_enumeration(problem);
    const Eigen::VectorXd before = problem.velocity();
    if (expected.size() == 0) continue;  // no velocity satisfies all contacts
    ContactSolver solver{exact()};
    const SolverResult result = problem.solve(solver);
    ASSERT_TRUE(result.converged) << "seed " << seed;
    ASSERT_LT((problem.velocity() - expected).norm(), 1e-6 * (1 + expected.norm())) << "seed " << seed;
    if ((expected - before).norm() > 1e-3) ++changed;
  }
  EXPECT_GT(changed, 150);
}

TEST(ContactSolver, FrictionOpposesSlidingOnTheConeAndPreventsItInsideTheCone) {
  int slid = 0, stuck = 0;
  for (unsigned seed = 1; seed <= 400; ++seed) {
    Problem problem{seed, 1 + seed % 2, 1 + seed % 3, 0.1 + 0.1 * (seed % 8)};
    ContactSolver solver{exact()};
    if (!problem.solve(solver).converged) continue;
    for (std::size_t i = 0; i < problem.contacts.size(); ++i) {
      const Contact& contact = problem.contacts[i];
      Vec3d velocity = Problem::jacobian_of(contact.arm_a) * problem.bodies[contact.a].velocity;
      if (contact.b != spm::kNone) velocity -= Problem::jacobian_of(contact.arm_b) * problem.bodies[contact.b].velocity;
      const double normal_impulse = solver.impulse(i).dot(contact.normal);
      const Vec3d tangential_impulse = solver.impulse(i) - normal_impulse * contact.normal;
      const Vec3d tangential_velocity = velocity - velocity.dot(contact.normal) * contact.normal;
      ASSERT_GE(normal_impulse, 0) << "seed " << seed;
      ASSERT_GE(velocity.dot(contact.normal) + contact.gap / kCycle, -1e-9) << "seed " << seed;
      ASSERT_LE(tangential_impulse.norm(), contact.friction * normal_impulse * (1 + 1e-9)) << "seed " << seed;
      if (normal_impulse < 1e-9) continue;
      if (tangential_velocity.norm() > 1e-6) {
        ASSERT_LT((tangential_impulse + contact.friction * normal_impulse * tangential_velocity.normalized()).norm(),
                  1e-5 * normal_impulse)
            << "seed " << seed;
        ++slid;
      } else {
        ++stuck;
      }
    }
  }
  EXPECT_GT(slid, 50);
  EXPECT_GT(stuck, 20);
}

TEST(ContactSolver, NeverAddsEnergyEvenAfterFewIterationsAndAWrongWarmStart) {
  for (unsigned seed = 1; seed <= 300; ++seed) {
    SolverSettings settings;
    settings.iterations = static_cast<int>(seed % 4);
    ContactSolver solver{settings};
    Problem other{seed + 1000, 2, 12, 0.5};
    (void)other.solve(solver);  // impulses of another problem under the same ids
    Problem problem{seed, 2, 12, 0.5};
    const auto energy = [&] {
      double sum = 0;
      for (const SolverBody& body : problem.bodies)
        sum += 0.5 * body.velocity.dot(Mat6d(body.inverse_mass.inverse()) * body.velocity);
      return sum;
    };
    const double before = energy();
    const SolverResult result = problem.solve(solver);
    ASSERT_LE(result.objective, 0) << "seed " << seed;
    ASSERT_LE(energy(), before * (1 + 1e-9)) << "seed " << seed;
  }
}

TEST(ContactSolver, StartsFromTheImpulsesOfTheLastStep) {
  int much_faster = 0;
  for (unsigned seed = 1; seed <= 50; ++seed) {
    Problem problem{seed, 1, 8, 0.3};
    const std::vector<SolverBody> bodies = problem.bodies;
    SolverSettings settings;
    settings.iterations = 5000;
    ContactSolver solver{settings};
    const int cold = problem.solve(solver).iterations;
    problem.bodies = bodies;
    const int warm = problem.solve(solver).iterations;
    ASSERT_LE(warm, cold) << "seed " << seed;
    if (warm <= 3 && cold > 5) ++much_faster;
  }
  EXPECT_GT(much_faster, 30);
}

TEST(ContactSolver, SelectsTheDeepestAndOutermostContactsAndCountsTheOthers) {
  SolverBody body;
  body.inverse_mass.setIdentity();
  body.inverse_mass.bottomRightCorner<3, 3>() *= 1000;
  body.velocity << 0, 0, -1, 0, 0, 0;
  ContactSolver solver;
  solver.begin();
  // A plate of 10 x 10 points. The deepest point is in the middle.
  for (int x = 0; x < 10; ++x) {
    for (int y = 0; y < 10; ++y) {
      Contact contact;
      contact.id = 10 * static_cast<std::uint64_t>(x) + static_cast<std::uint64_t>(y);
      contact.arm_a = contact.point = {0.01 * (x - 4.5), 0.01 * (y - 4.5), 0};
      contact.gap = x == 4 && y == 4 ? -1e-5 : 0;
      solver.add(contact);
    }
  }
  const SolverResult& result = solver.solve({&body, 1}, kCycle);
  EXPECT_EQ(result.contacts, kMaxContacts);
  EXPECT_EQ(result.dropped, 100 - kMaxContacts);
  int corners = 0;
  bool deepest = false;
  for (const Contact& contact : solver.contacts()) {
    if (std::abs(std::abs(contact.point.x()) - 0.045) < 1e-9 && std::abs(std::abs(contact.point.y()) - 0.045) < 1e-9)
      ++corners;
    if (contact.gap < 0) deepest = true;
  }
  EXPECT_EQ(corners, 4);
  EXPECT_TRUE(deepest);
  EXPECT_NEAR(body.velocity[2], 0, 1e-4);
  EXPECT_LT(body.velocity.tail<3>().norm(), 1e-2);
}

TEST(ContactSolver, CountsCandidatesBeyondItsCapacity) {
  SolverBody body;
  body.inverse_mass.setIdentity();
  ContactSolver solver;
  solver.begin();
  for (std::size_t i = 0; i < kMaxCandidateContacts + 10; ++i) {
    Contact contact;
    contact.id = i;
    contact.point.x() = static_cast<double>(i);
    solver.add(contact);
  }
  EXPECT_EQ(solver.solve({&body, 1}, kCycle).dropped, kMaxCandidateContacts + 10 - kMaxContacts);
}

TEST(ContactSolver, RemovesAnOverlapAtThePushOutSpeed) {
  SolverBody body;
  body.inverse_mass.setIdentity();
  ContactSolver solver;
  solver.begin();
  Contact contact;
  contact.gap = -0.01;
  solver.add(contact);
  (void)solver.solve({&body, 1}, kCycle);
  EXPECT_NEAR(body.velocity[2], SolverSettings{}.push_out, 1e-12);
}

}  // namespace
}  // namespace tactus::haptics
