/// A rigid mesh as a tool: a god-object with six degrees of freedom that follows the device but passes through nothing.
///
///      device pose            o---------      spring and torsion spring ("virtual coupling"),
///                            /                 at the tool's origin, which is the device's tip
///      tool's pose      o---/------
///     ____________________(____)________     contact where the tool, rounded by `rounding`, meets a surface
///
/// Among the poses that it can get to, the tool takes the one in which the coupling holds least energy. One cycle is a
/// few steps of this:
///
///     gather    all pairs of triangles within a margin (AbTree against the probe's tree): enough for several steps
///     solve     the way d closest to e, the way to the device, in the coupling's metric, with n . d + gap >= 0 for all
///               those pairs: ContactSolver, fed by and by with the pairs that its answer violates
///     look      at their gaps where d leads; what is too near there goes back to `solve`
///     go        there when nothing is; else half the way, or less, or not at all
///
/// So a contact is kept at `rounding`, never at the triangles themselves. No pair is nearer than half of that at either
/// end of a step, a step is shorter than the gaps at both its ends together, and what was not gathered is further away
/// than the tool goes. Hence no way leads through a surface that stands still, however fast the device, thin the sheet
/// or small the budget. When the budget is gone the tool stays where it is and goes on in the next cycle: it lags, and
/// says so.
///
/// Where a change of a surface leaves the tool too near, or in it, it is pushed out along the faces' outer normals at
/// `push_out` at most, so that the force does not jump; where contacts leave no way out, as where a surface has risen
/// far into it, it comes out without them, and the hand may pull it out. A tool that starts in a surface touches
/// nothing until it has come out. Surfaces have two sides, but for that.
///
/// World frame, SI. One thread at a time. Realtime: its work is bounded by the settings. Same input, same bits.
/// Source: Ortega, Redon, Coquillart 2007 (god-object with six degrees of freedom by Gauss's principle); Colgate et al.
/// 1995 (virtual coupling). We differ: positions instead of accelerations, a rounded tool, and gaps instead of times of
/// impact.
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <vector>

#include "haptics/contact_solver.hpp"
#include "spm/mesh_probe.hpp"

namespace tactus::haptics {

struct ToolSettings {
  double collision_margin = 1e-4;  ///< m by which the tool is thicker than its triangles
  double longest_way = 2e-3;       ///< m that any of its points goes in one cycle
  double push_out = 0.02;          ///< m/s
  /// N/s; how fast the tool may ease the coupling by what it does of its own, as when it slips off an edge under a hand
  /// at rest. Beyond that it goes as far as the device.
  double max_yield = 40;
  std::uint32_t steps = 8;     ///< in a cycle
  std::uint32_t pairs = 2048;  ///< of triangles within the margin; with more steps become shorter
  /// In a cycle: pairs of triangles looked at again and rows swept by the solver (of its last run beyond), some 0.1 us
  /// each; pairs of nodes met while searching count half.
  std::uint32_t work = 2400;
};

/// How strongly the tool is held, and how the object feels.
struct ToolGrip {
  double stiffness = 1000;            ///< N/m
  double rotational_stiffness = 0.1;  ///< N m/rad
  double angular_damping = 1e-3;      ///< N m s; of the torque on the hand alone
};

struct ToolPose {
  Vec3d position = Vec3d::Zero();  ///< of the tool's origin
  Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity();
};

/// Something to touch: world = rotation * (scale * model) + translation.
struct ToolObject {
  const spm::AbTree* tree = nullptr;
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Vec3d translation = Vec3d::Zero();
  double scale = 1;  ///< m in a model unit
  double friction = 0;
  std::uint32_t index = 0;  ///< below 256; told again in ToolResult
};

struct ToolResult {
  ToolPose pose;
  /// From the device to the tool: way of the origin, and turn (along its axis, as long as its angle). Times stiffness
  /// and torsion it is the wrench on the hand, at the origin.
  Vec3d way = Vec3d::Zero(), turn = Vec3d::Zero();
  Vec3d normal = Vec3d::UnitZ();  ///< mean of the contacts', by their forces; the last one without contact
  Vec3d point = Vec3d::Zero();    ///< the same of the places
  bool in_contact = false;
  bool lagging = false;        ///< stopped by the budget or the longest way
  bool outside_only = false;   ///< in a surface since it started: touches nothing until it is out
  bool too_near = false;       ///< a surface has changed under it; it is being pushed out
  std::uint32_t contacts = 0;  ///< that press
  std::uint32_t dropped = 0;   ///< that the solver had no room for
  std::uint32_t steps = 0, solves = 0, pairs = 0, work = 0;  ///< pairs: of the last step
  std::uint32_t object = spm::kNone;                         ///< that is pressed most
  std::uint32_t face = spm::kNone;                           ///< its FaceId
};

class Tool {
 public:
  /// `probe` in metres; must outlive it. Allocates.
  explicit Tool(const spm::MeshProbe& probe, const ToolSettings& settings = {});
  Tool(const Tool&) = delete;
  Tool& operator=(const Tool&) = delete;

  /// From the next step on. Realtime.
  void set_grip(const ToolGrip& grip) noexcept { grip_ = grip; }
  /// Forgets everything; the next step starts at the device.
  void reset() noexcept;

  /// One cycle of `dt` seconds with the device at `device`. `surface_changed`: the objects near the tool, at most 255,
  /// are not those of the last step, stand elsewhere or show other faces. A pose that is not finite leaves everything
  /// as it was. Realtime.
  const ToolResult& step(const ToolPose& device, double dt, spm::Span<const ToolObject> objects,
                         bool surface_changed) noexcept;

  [[nodiscard]] const ToolResult& last() const noexcept { return result_; }

  /// The next step looks anew at what is around it. Realtime.
  void forget_surroundings() noexcept { have_here_ = false; }
  /// What one step leaves to the next, but for its surroundings, which are forgotten; see haptics/carried.hpp. A tool
  /// of the same shape and settings goes on from it. Realtime if `visit` is.
  template <class Visit>
  void for_each_carried(Visit& visit) noexcept {
    static_assert(
        sizeof(ToolGrip) == 24 && sizeof(ToolPose) == 64 && sizeof(ToolResult) == 208 && sizeof(Contact) == 128,
        "carry the new member");
    have_here_ = false;
    visit.number("stiffness", grip_.stiffness), visit.number("rotational stiffness", grip_.rotational_stiffness);
    visit.number("angular damping", grip_.angular_damping);
    for (ToolPose* pose : {&result_.pose, &pose_, &device_before_})
      visit.number("position of a tool", pose->position), visit.number("orientation of a tool", pose->orientation);
    for (Vec3d* vector :
         {&result_.way, &result_.turn, &result_.normal, &result_.point, &held_back_.linear, &held_back_.turn})
      visit.number("vector of a tool", *vector);
    for (bool* flag : {&result_.in_contact, &result_.lagging, &result_.outside_only, &result_.too_near, &started_,
                       &stuck_, &caught_})
      visit.flag("flag of a tool", *flag);
    for (std::uint32_t* count : {&result_.contacts, &result_.dropped, &result_.steps, &result_.solves, &result_.pairs,
                                 &result_.work, &result_.object, &result_.face})
      visit.any("count of a tool", *count);
    visit.number("way of the device", device_went_), visit.number("way owed", owed_);
    visit.count("count of rows", row_count_, kMaxContacts);
    for (std::size_t i = 0; i < row_count_; ++i) {
      Contact& row = rows_[i];  // between the tool, body 0, and what does not move
      visit.any("id of a row", row.id);
      visit.number("point of a row", row.point), visit.number("arm of a row", row.arm_a);
      visit.number("normal of a row", row.normal);
      visit.number("gap of a row", row.gap), visit.number("friction of a row", row.friction);
    }
    solver_.for_each_carried(visit);
  }
  [[nodiscard]] const spm::MeshProbe& probe() const noexcept { return probe_; }
  [[nodiscard]] const ToolSettings& settings() const noexcept { return settings_; }

 private:
  static constexpr std::uint32_t kWidth = spm::NearPairs::kWidth;
  /// A contact's id: object, how often it was looked at again, triangle of the tool, face.
  static constexpr int kAgainShift = 52;
  static constexpr std::uint64_t kPairOfId = ~(std::uint64_t{15} << kAgainShift);
  struct Way {
    Vec3d linear = Vec3d::Zero(), turn = Vec3d::Zero();
    [[nodiscard]] Way operator*(double share) const noexcept { return {share * linear, share * turn}; }
    [[nodiscard]] Way operator-(const Way& other) const noexcept { return {linear - other.linear, turn - other.turn}; }
  };
  /// How far a triangle of the tool is from one of an object, below zero when they meet; world frame.
  struct Gap {
    double distance;
    Vec3d normal;  // unit, from the object to the tool
    Vec3d arm;     // the tool's nearest point from its origin
    bool inner;    // the tool is on the face's inner side
  };
  /// Pairs of one object, by blocks of eight. What is in the object's axes is in metres from `origin`.
  struct Part {
    const ToolObject* object;
    std::uint32_t first, last;  // blocks
    Vec3d origin;               // model frame
    Vec3d tool;                 // the tool's origin, in the object's axes
  };
  /// All pairs within a margin of one pose.
  struct Found {
    double margin = 0;  // m
    std::vector<spm::NearPairs> blocks;
    std::vector<float> nearest;  // of a block's pairs, there
    std::vector<Part> parts;
    std::uint32_t pairs = 0;  // places in use
    [[nodiscard]] const Part& part(std::uint32_t pair) const noexcept;
    [[nodiscard]] std::uint64_t id(const Part& part, std::uint32_t pair) const noexcept;
  };
  /// Their gaps in another pose; infinite distance where one does not matter.
  struct Nearby {
    ToolPose pose;
    Found* found = nullptr;
    double went = 0;     // m, longest way of a point since they were found
    double nearest = 0;  // m; nothing is nearer, found or not
    std::vector<float> distance;
    std::array<std::vector<float>, 3> normal, arm;
    std::vector<std::uint8_t> inner;
    [[nodiscard]] Gap gap(std::uint32_t pair) const noexcept;
  };
  struct Overlap {
    std::uint64_t id;
    double distance;
  };
  struct Step {
    double length = 0;
    bool cut = true;  // not all that was wanted
  };
  enum class Look : std::uint8_t { kFree, kTooNear, kBlocked };

  /// m; no way leads nearer.
  [[nodiscard]] double blocked() const noexcept;
  /// No point of the tool goes further.
  [[nodiscard]] double longest(const Way& way) const noexcept {
    return way.linear.norm() + way.turn.norm() * probe_.radius();
  }
  [[nodiscard]] static ToolPose moved(const ToolPose& pose, const Way& way) noexcept;
  [[nodiscard]] Way to_device(const ToolPose& device) const noexcept;

  [[nodiscard]] bool gather(const ToolPose& pose, double margin, std::uint32_t max_pairs, std::uint32_t max_work,
                            spm::Span<const ToolObject> objects, Nearby& into) noexcept;
  void place(const ToolPose& pose, Part& part) noexcept;
  void measure(const Part& part, double within, std::uint32_t block, Nearby& into) noexcept;
  [[nodiscard]] bool measure_again(const ToolPose& pose, double length, Nearby& into) noexcept;
  [[nodiscard]] Gap gap_of(const Part& part, const spm::TriangleLanes& faces, unsigned lane) const noexcept;

  void find_overlaps() noexcept;
  [[nodiscard]] bool make_room() noexcept;
  void add_row(std::uint64_t id, const Gap& gap, double friction) noexcept;
  void choose_first_rows() noexcept;
  [[nodiscard]] Way solve(const Way& wish, double dt) noexcept;
  [[nodiscard]] bool add_violated(const Way& way, double dt) noexcept;

  [[nodiscard]] Look look(const Way& way, int again, spm::Span<const ToolObject> objects) noexcept;
  [[nodiscard]] Step step_towards(const ToolPose& device, double dt, double limit,
                                  spm::Span<const ToolObject> objects) noexcept;
  [[nodiscard]] Step come_out(const ToolPose& device, double dt, double limit) noexcept;
  [[nodiscard]] bool go_freely(const Way& wish, double margin, spm::Span<const ToolObject> objects) noexcept;
  void tell(const ToolPose& device) noexcept;

  const spm::MeshProbe& probe_;
  ToolSettings settings_;
  ToolGrip grip_;
  ToolResult result_;
  ToolPose pose_, device_before_;
  bool started_ = false;
  double device_went_ = 0;  // m, longest way of a point of the device in this cycle
  double owed_ = 0;         // m, of the device's ways those that the tool has not gone yet, through air
  bool stuck_ = false;      // too near a surface, it found no way in the last step
  bool caught_ = false;     // since then, until it is out
  Way held_back_;           // what surfaces did of the last wish

  spm::PlacedProbe placed_;
  spm::Simd simd_ = spm::best_simd();
  std::array<std::vector<float>, 3> vertices_;  // of the tool as placed last
  spm::TriangleLanes lanes_{};
  spm::TriangleGaps gaps_{};
  std::array<Found, 2> found_;
  std::array<Nearby, 2> nearby_;
  Nearby* here_ = &nearby_[0];   // around pose_
  Nearby* there_ = &nearby_[1];  // around where a way leads
  bool have_here_ = false;
  std::vector<Overlap> overlaps_;    // of here_: those that are too near already, by id
  bool overlapping_ = false;         // some meet; then what is on its inner side may come out
  bool push_ = false;                // this step pushes out
  std::vector<float> excess_;        // of a way, over what the pair allows
  std::vector<std::uint8_t> taken_;  // has a row
  std::vector<std::uint32_t> violated_;

  ContactSolver solver_;
  std::array<Contact, kMaxContacts> rows_;
  std::size_t row_count_ = 0;
};

}  // namespace tactus::haptics
