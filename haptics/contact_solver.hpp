/// Contact impulses between rigid bodies: one solver for tools and shared objects.
///
/// Each body comes with the velocity u it would have without contacts and the inverse W = M^-1 of the mass it shows to
/// impulses (6 x 6: springs and dampers taken implicitly belong into M). The velocity with contacts is the one closest
/// to u, in the metric M, of those that no contact forbids (Gauss's least constraint):
///
///     v = u + W J^T l,   l = argmin over l >= 0 of  1/2 l^T (J W J^T) l + l^T (J u + gap / dt)
///
/// so bodies may close a gap within the step but not pass it. Friction: |l_t| <= mu l_n, opposite to the sliding.
///
///     bodies, contacts --> keep <= kMaxContacts --> rows --> warm start by id --> sweeps until quiet --> v
///
/// Projected Gauss-Seidel, normal and tangents of one contact in turn; the tangents are solved exactly in their disc.
/// Without friction each sweep lowers the objective. With it that can fail, so the result is scaled back along the
/// cone until the objective is at most 0: however few sweeps, contacts add no energy, but for pushing out what
/// overlaps.
///
/// World frame, SI. One thread at a time. Realtime: at most `sweeps` x 24 contacts x some 150 operations.
/// Source: Ortega, Redon, Coquillart 2007 (tool: Gauss's principle, dual, warm start by contact); Stewart, Trinkle 1996
/// and Anitescu, Potra 1997 (time stepping with gap / dt and friction).
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstddef>
#include <cstdint>

#include "haptics/carried.hpp"
#include "spm/model.hpp"
#include "spm/span.hpp"

namespace tactus::haptics {

using spm::Vec3d;
using Vec6d = Eigen::Matrix<double, 6, 1>;  ///< linear part first
using Mat6d = Eigen::Matrix<double, 6, 6>;

inline constexpr std::size_t kMaxSolverBodies = 8;
inline constexpr std::size_t kMaxContacts = 24;            ///< solved in one step
inline constexpr std::size_t kMaxCandidateContacts = 128;  ///< from which these are chosen

struct SolverBody {
  Mat6d inverse_mass = Mat6d::Zero();
  Vec6d velocity = Vec6d::Zero();  ///< of the centre, and spin; in: without contacts, out: with them
};

struct Contact {
  std::uint64_t id = 0;          ///< the same in the next step when it is the same contact
  std::uint32_t a = 0;           ///< body that `normal` points to
  std::uint32_t b = spm::kNone;  ///< the other one; kNone: does not move
  Vec3d point = Vec3d::Zero();
  Vec3d arm_a = Vec3d::Zero();  ///< `point` minus the centre of a
  Vec3d arm_b = Vec3d::Zero();
  Vec3d normal = Vec3d::UnitZ();  ///< unit
  double gap = 0;                 ///< m; negative: overlap
  double friction = 0;            ///< coefficient
};

struct SolverSettings {
  int sweeps = 60;             ///< at most
  double quiet = 1e-7;         ///< m/s; the largest change of a contact's velocity in a sweep at which it ends
  double push_out = 0.005;     ///< m/s at most, with which an overlap is undone
  double push_out_rate = 100;  ///< 1/s: share of an overlap that is undone in a second, up to `push_out`
  double touching = 2e-5;      ///< m of overlap that is left alone
};

struct SolverResult {
  int sweeps = 0;
  bool quiet = true;              ///< ended because it had converged
  std::uint32_t contacts = 0;     ///< solved
  std::uint32_t dropped = 0;      ///< that were added beyond those
  double objective = 0;           ///< J; at most 0
  bool scaled = false;            ///< by the safeguard against added energy
  Vec3d impulse = Vec3d::Zero();  ///< N s, sum of those on bodies `a` of contacts with what does not move
};

class ContactSolver {
 public:
  explicit ContactSolver(const SolverSettings& settings = {}) noexcept : settings_{settings} {}

  /// Forgets the contacts of the last step, not their impulses.
  void begin() noexcept;
  /// Beyond kMaxCandidateContacts it is counted as dropped. Realtime.
  void add(const Contact& contact) noexcept;
  /// Solves and writes the velocities. Bodies named by a contact must exist. Realtime.
  const SolverResult& solve(spm::Span<SolverBody> bodies, double dt) noexcept;

  [[nodiscard]] const SolverResult& last() const noexcept { return result_; }
  /// Contacts kept by the last `solve`, and the impulse on body a of each, N s.
  [[nodiscard]] spm::Span<const Contact> contacts() const noexcept { return {kept_.data(), kept_count_}; }
  [[nodiscard]] const Vec3d& impulse(std::size_t kept) const noexcept { return impulses_[kept]; }

  /// What the next `solve`, and `impulse` until then, go by; see haptics/carried.hpp.
  template <class Visit>
  void for_each_carried(Visit& visit) noexcept {
    visit.count("count of contacts", kept_count_, kMaxContacts);
    for (std::size_t i = 0; i < kept_count_; ++i) visit.number("impulse", impulses_[i]);
    visit.count("count of remembered contacts", remembered_count_, kMaxContacts);
    for (std::size_t i = 0; i < remembered_count_; ++i) {
      visit.any("remembered contact", remembered_[i].id);
      visit.number("remembered impulse", remembered_[i].impulse);
    }
  }

 private:
  struct Row {                 // along one direction
    Vec6d on_a, on_b;          // J
    Vec6d change_a, change_b;  // W J^T
    double diagonal = 0;       // J W J^T
  };
  struct Block {  // a contact: normal, then two tangents in which its 2 x 2 block is diagonal
    std::array<Row, 3> rows;
    std::array<Vec3d, 3> axes;
    std::array<double, 3> lambda{};
    std::array<double, 3> free{};  // velocity along the axes without contacts
    double target = 0;             // gap / dt: added to the normal velocity
  };
  struct Remembered {
    std::uint64_t id;
    Vec3d impulse;
  };

  void reduce() noexcept;
  void build(Block& block, const Contact& contact, spm::Span<const SolverBody> bodies, double dt) const noexcept;
  [[nodiscard]] static Row row_of(const Contact& contact, const Vec3d& axis,
                                  spm::Span<const SolverBody> bodies) noexcept;

  SolverSettings settings_;
  std::array<Contact, kMaxCandidateContacts> candidates_;
  std::size_t candidate_count_ = 0;
  std::uint32_t overflow_ = 0;
  std::array<Contact, kMaxContacts> kept_;
  std::size_t kept_count_ = 0;
  std::array<Block, kMaxContacts> blocks_;
  std::array<Vec3d, kMaxContacts> impulses_;
  std::array<Remembered, kMaxContacts> remembered_{};
  std::size_t remembered_count_ = 0;
  SolverResult result_;
};

}  // namespace tactus::haptics
