/// Computes contact impulses between rigid bodies, for tools and shared objects.
///
/// Each body has the velocity u that it would have without contacts, and the inverse W = M^-1 of its effective mass M.
/// M is a 6 x 6 matrix and includes implicit springs and dampers. The result v is the velocity closest to u, in the
/// metric M, among the velocities that the contacts allow (Gauss's principle of least constraint):
///
///     v = u + W J^T l,   l = argmin over l >= 0 of  1/2 l^T (J W J^T) l + l^T (J u + gap / dt)
///
/// J is the Jacobian of the contacts: it maps the velocities of the bodies to the relative velocities at the contacts.
/// l is the vector of impulses, dt the time step. So two bodies may close their gap within the step but not overlap.
/// The tangential impulse l_t of a contact opposes the sliding velocity and satisfies |l_t| <= mu l_n, with the normal
/// impulse l_n and the coefficient of friction mu.
///
///     bodies, contacts --> select <= kMaxContacts --> rows --> warm start by id --> iterate until converged --> v
///
/// The iteration is projected Gauss-Seidel over the normal and the two tangents of each contact. The tangential impulse
/// is the exact optimum in the friction disc |l_t| <= mu l_n. Without friction each iteration lowers the objective (the
/// minimized function above). With friction the objective may rise. If it is above 0 after the last iteration, all
/// impulses are scaled down by one factor until it is at most 0. So contacts add no energy after any number of
/// iterations, except for the push-out of overlaps.
///
/// World frame, SI. One thread at a time. Realtime: at most `iterations` x 24 contacts x about 150 operations.
/// Source: Ortega, Redon, Coquillart 2007 (tool: Gauss's principle, dual, warm start by contact); Stewart, Trinkle 1996
/// and Anitescu, Potra 1997 (time stepping with gap / dt and friction).
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "haptics/carried.hpp"
#include "spm/model.hpp"

namespace tactus::haptics {

using spm::Vec3d;
using Vec6d = Eigen::Matrix<double, 6, 1>;  ///< linear part first
using Mat6d = Eigen::Matrix<double, 6, 6>;

inline constexpr std::size_t kMaxSolverBodies = 8;
inline constexpr std::size_t kMaxContacts = 24;  ///< max contacts that one step solves
inline constexpr std::size_t kMaxCandidateContacts =
    128;  ///< max candidates, from which a step selects the contacts to solve

struct SolverBody {
  Mat6d inverse_mass = Mat6d::Zero();
  /// Linear velocity of the centre, then angular velocity. `solve` reads the velocity without contacts, and writes the
  /// velocity with contacts.
  Vec6d velocity = Vec6d::Zero();
};

struct Contact {
  std::uint64_t id = 0;          ///< equal for the same contact in two steps
  std::uint32_t a = 0;           ///< index of the body to which `normal` points
  std::uint32_t b = spm::kNone;  ///< index of the other body; kNone: static geometry
  Vec3d point = Vec3d::Zero();
  Vec3d arm_a = Vec3d::Zero();  ///< `point` minus the centre of a
  Vec3d arm_b = Vec3d::Zero();
  Vec3d normal = Vec3d::UnitZ();  ///< unit vector
  double gap = 0;                 ///< m; negative: overlap
  double friction = 0;            ///< coefficient
};

struct SolverSettings {
  int iterations = 60;            ///< maximum
  double tolerance = 1e-7;        ///< m/s; iteration ends when no contact velocity changes by more than this
  double push_out = 0.005;        ///< m/s, maximum speed at which an overlap is removed
  double push_out_rate = 100;     ///< 1/s, push-out speed per metre of overlap, up to `push_out`
  double allowed_overlap = 2e-5;  ///< m, overlap that is not removed
};

struct SolverResult {
  int iterations = 0;
  bool converged = true;          ///< false: the maximum number of iterations was reached
  std::uint32_t contacts = 0;     ///< contacts that were solved
  std::uint32_t dropped = 0;      ///< contacts that exceeded kMaxCandidateContacts or kMaxContacts, not solved
  double objective = 0;           ///< final value of the minimized function, J; at most 0
  bool scaled = false;            ///< the impulses were scaled down so that they add no energy
  Vec3d impulse = Vec3d::Zero();  ///< N s, sum of the impulses of static geometry on bodies
};

class ContactSolver {
 public:
  explicit ContactSolver(const SolverSettings& settings = {}) noexcept : settings_{settings} {}

  /// Removes the contacts of the last step. Their impulses remain for the warm start.
  void begin() noexcept;
  /// Adds a candidate. If there are already kMaxCandidateContacts, the contact is dropped and counted. Realtime.
  void add(const Contact& contact) noexcept;
  /// Solves for the velocities and writes them into `bodies`. Every body index in a contact must exist. Realtime.
  const SolverResult& solve(std::span<SolverBody> bodies, double dt) noexcept;

  [[nodiscard]] const SolverResult& last() const noexcept { return result_; }
  /// The contacts that the last `solve` selected.
  [[nodiscard]] std::span<const Contact> contacts() const noexcept { return {selected_.data(), selected_count_}; }
  /// The impulse on body `a` of contacts()[contact], N s.
  [[nodiscard]] const Vec3d& impulse(std::size_t contact) const noexcept { return impulses_[contact]; }

  /// Visits the state that the next `solve` and `impulse` read (haptics/carried.hpp).
  template <class Visit>
  void for_each_carried(Visit& visit) noexcept {
    visit.count("count of contacts", selected_count_, kMaxContacts);
    for (std::size_t i = 0; i < selected_count_; ++i) visit.number("impulse", impulses_[i]);
    visit.count("count of contacts of the warm start", warm_start_count_, kMaxContacts);
    for (std::size_t i = 0; i < warm_start_count_; ++i) {
      visit.any("contact of the warm start", warm_start_[i].id);
      visit.number("impulse of the warm start", warm_start_[i].impulse);
    }
  }

 private:
  /// The Jacobian J of one contact along one axis.
  struct Row {
    Vec6d on_a, on_b;          // J
    Vec6d change_a, change_b;  // W J^T
    double diagonal = 0;       // J W J^T
  };
  /// One contact: its normal, then two tangents for which the 2 x 2 matrix J W J^T of the tangents is diagonal.
  struct Block {
    std::array<Row, 3> rows;
    std::array<Vec3d, 3> axes;
    std::array<double, 3> lambda{};         // N s, impulse along the axes
    std::array<double, 3> free_velocity{};  // m/s, along the axes without contacts
    double bias = 0;                        // m/s, added to the normal velocity: gap / dt, or minus the push-out speed
  };
  struct WarmStart {
    std::uint64_t id;
    Vec3d impulse;
  };

  void select_contacts() noexcept;
  void build(Block& block, const Contact& contact, std::span<const SolverBody> bodies, double dt) const noexcept;
  [[nodiscard]] static Row row_of(const Contact& contact, const Vec3d& axis,
                                  std::span<const SolverBody> bodies) noexcept;
  static void apply(const Contact& contact, const Row& row, double impulse, std::span<SolverBody> bodies) noexcept;
  [[nodiscard]] static double velocity(const Contact& contact, const Row& row,
                                       std::span<const SolverBody> bodies) noexcept;
  void start_warm(std::span<SolverBody> bodies) noexcept;
  [[nodiscard]] static double solve_normal(const Contact& contact, Block& block, std::span<SolverBody> bodies) noexcept;
  [[nodiscard]] static double solve_friction(const Contact& contact, Block& block,
                                             std::span<SolverBody> bodies) noexcept;
  void iterate(std::span<SolverBody> bodies) noexcept;
  void limit_energy(std::span<SolverBody> bodies) noexcept;
  void store_impulses() noexcept;

  SolverSettings settings_;
  std::array<Contact, kMaxCandidateContacts> candidates_;
  std::size_t candidate_count_ = 0;
  std::uint32_t dropped_candidates_ = 0;
  std::array<Contact, kMaxContacts> selected_;
  std::size_t selected_count_ = 0;
  std::array<Block, kMaxContacts> blocks_;
  std::array<Vec3d, kMaxContacts> impulses_;
  std::array<WarmStart, kMaxContacts> warm_start_{};
  std::size_t warm_start_count_ = 0;
  SolverResult result_;
};

}  // namespace tactus::haptics
