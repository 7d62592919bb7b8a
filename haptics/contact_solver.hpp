/// Contact impulses between rigid bodies: one solver for tools and shared objects.
///
/// Each body has the velocity u that it would have without contacts, and the inverse W = M^-1 of its effective mass (6
/// x 6; M includes implicit springs and dampers). The result v is the velocity closest to u, in the metric M, among
/// those that the contacts allow (Gauss's principle of least constraint):
///
///     v = u + W J^T l,   l = argmin over l >= 0 of  1/2 l^T (J W J^T) l + l^T (J u + gap / dt)
///
/// So bodies may close a gap within the step but not pass through it. Friction: |l_t| <= mu l_n, opposite to the
/// sliding.
///
///     bodies, contacts --> select <= kMaxContacts --> rows --> warm start by id --> iterate until converged --> v
///
/// Projected Gauss-Seidel over normal and tangents of each contact; the tangents are solved exactly in their disc.
/// Without friction each iteration lowers the objective. With friction that can fail, so the result is scaled back
/// along the cone until the objective is at most 0. Contacts therefore add no energy after any number of iterations,
/// except the push-out of overlaps.
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
inline constexpr std::size_t kMaxContacts = 24;            ///< solved in one step
inline constexpr std::size_t kMaxCandidateContacts = 128;  ///< candidates; the solved contacts are selected from these

struct SolverBody {
  Mat6d inverse_mass = Mat6d::Zero();
  Vec6d velocity = Vec6d::Zero();  ///< linear at the centre, then angular; in: without contacts, out: with contacts
};

struct Contact {
  std::uint64_t id = 0;          ///< equal in two steps when the contact is the same
  std::uint32_t a = 0;           ///< body that `normal` points to
  std::uint32_t b = spm::kNone;  ///< the other body; kNone: static geometry
  Vec3d point = Vec3d::Zero();
  Vec3d arm_a = Vec3d::Zero();  ///< `point` minus the centre of a
  Vec3d arm_b = Vec3d::Zero();
  Vec3d normal = Vec3d::UnitZ();  ///< unit
  double gap = 0;                 ///< m; negative: overlap
  double friction = 0;            ///< coefficient
};

struct SolverSettings {
  int iterations = 60;            ///< maximum
  double tolerance = 1e-7;        ///< m/s; iteration ends when no contact velocity changes by more than this
  double push_out = 0.005;        ///< m/s, maximum speed at which an overlap is removed
  double push_out_rate = 100;     ///< 1/s: share of an overlap that is removed per second, up to `push_out`
  double allowed_overlap = 2e-5;  ///< m of overlap that is left in place
};

struct SolverResult {
  int iterations = 0;
  bool converged = true;          ///< false: stopped at the maximum number of iterations
  std::uint32_t contacts = 0;     ///< solved
  std::uint32_t dropped = 0;      ///< contacts that did not fit
  double objective = 0;           ///< J; at most 0
  bool scaled = false;            ///< the safeguard against added energy acted
  Vec3d impulse = Vec3d::Zero();  ///< N s, sum over contacts of bodies `a` with static geometry
};

class ContactSolver {
 public:
  explicit ContactSolver(const SolverSettings& settings = {}) noexcept : settings_{settings} {}

  /// Removes the contacts of the last step; their impulses stay for the warm start.
  void begin() noexcept;
  /// Counts the contact as dropped when there are already kMaxCandidateContacts. Realtime.
  void add(const Contact& contact) noexcept;
  /// Solves and writes the velocities. Every body index in a contact must exist. Realtime.
  const SolverResult& solve(std::span<SolverBody> bodies, double dt) noexcept;

  [[nodiscard]] const SolverResult& last() const noexcept { return result_; }
  /// Contacts selected by the last `solve`, and the impulse on body a of each, N s.
  [[nodiscard]] std::span<const Contact> contacts() const noexcept { return {selected_.data(), selected_count_}; }
  [[nodiscard]] const Vec3d& impulse(std::size_t kept) const noexcept { return impulses_[kept]; }

  /// What the next `solve`, and `impulse` until then, go by; see haptics/carried.hpp.
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
  struct Row {                 // along one direction
    Vec6d on_a, on_b;          // J
    Vec6d change_a, change_b;  // W J^T
    double diagonal = 0;       // J W J^T
  };
  struct Block {  // one contact: normal, then two tangents in which its 2 x 2 block is diagonal
    std::array<Row, 3> rows;
    std::array<Vec3d, 3> axes;
    std::array<double, 3> lambda{};
    std::array<double, 3> free{};  // velocity along the axes without contacts
    double target = 0;             // gap / dt: added to the normal velocity
  };
  struct WarmStart {
    std::uint64_t id;
    Vec3d impulse;
  };

  void reduce() noexcept;
  void build(Block& block, const Contact& contact, std::span<const SolverBody> bodies, double dt) const noexcept;
  [[nodiscard]] static Row row_of(const Contact& contact, const Vec3d& axis,
                                  std::span<const SolverBody> bodies) noexcept;

  SolverSettings settings_;
  std::array<Contact, kMaxCandidateContacts> candidates_;
  std::size_t candidate_count_ = 0;
  std::uint32_t overflow_ = 0;
  std::array<Contact, kMaxContacts> selected_;
  std::size_t selected_count_ = 0;
  std::array<Block, kMaxContacts> blocks_;
  std::array<Vec3d, kMaxContacts> impulses_;
  std::array<WarmStart, kMaxContacts> warm_start_{};
  std::size_t warm_start_count_ = 0;
  SolverResult result_;
};

}  // namespace tactus::haptics
