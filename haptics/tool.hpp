/// Moves a rigid mesh as a tool: a god-object with six degrees of freedom that follows the device and passes through no
/// surface.
///
///      device pose            o---------      spring and rotational spring ("virtual coupling"),
///                            /                 at the tool's origin, which is the device's tip
///      tool's pose      o---/------
///     ____________________(____)________     contact where the tool, with its collision margin, touches a surface
///
/// The tool moves to the reachable pose in which the coupling stores the least energy. A cycle has several steps. Each
/// step has four parts (n: contact normal, d: displacement of the tool):
///
///     gather    finds all pairs of triangles within a margin (AbTree against the probe's tree). One search is enough
///               for several steps.
///     solve     computes with ContactSolver the d that is closest, in the coupling's metric, to the displacement to
///               the device, so that n . d + gap >= 0 for these pairs. Adds pairs that d violates, and solves again.
///     check     measures the gaps of the pairs at the new pose. If some are too small, adds these pairs to `solve`
///               and repeats it.
///     move      moves by d. If a pair would be closer than half of `collision_margin`, moves by d/2, d/4 or d/8
///               instead, or not at all.
///
/// So in contact the triangles are `collision_margin` apart. At both ends of a step no pair is closer than half of
/// `collision_margin`. A step is shorter than the sum of the gaps at its two ends. Pairs that were not gathered are
/// further away than the tool moves. Hence no motion leads through a fixed surface, for any device speed, sheet
/// thickness or work budget. When the budget is used up, the tool stops and continues in the next cycle; `lagging`
/// reports this.
///
/// If a changed surface is too close to the tool or overlaps it, the tool is pushed out along the outer normals of the
/// faces, at no more than `push_out`, so that the force does not jump. If contacts block every motion, for instance
/// after a surface rose far into the tool, the tool moves out without contacts, and the hand may pull it out. A tool
/// that starts inside a surface touches nothing until it is outside. Otherwise both sides of a surface count.
///
/// World frame, SI. One thread at a time. Realtime: the settings bound the work. Same input, same bits.
/// Source: Ortega, Redon, Coquillart 2007 (god-object with six degrees of freedom by Gauss's principle); Colgate et al.
/// 1995 (virtual coupling). We differ: positions instead of accelerations, a tool with a margin, and gaps instead of
/// times of impact.
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "haptics/contact_solver.hpp"
#include "spm/mesh_probe.hpp"

namespace tactus::haptics {

struct ToolSettings {
  double collision_margin = 1e-4;  ///< m, distance from the triangles at which contact begins
  double max_displacement = 2e-3;  ///< m, maximum displacement of any point of the tool per cycle
  double push_out = 0.02;          ///< m/s, max speed of a push-out
  /// N/s, maximum rate at which the coupling force may fall because the tool moves while the device rests, for instance
  /// when the tool slips off an edge. The tool moves faster only if the device moves.
  double max_yield = 40;
  std::uint32_t steps = 8;     ///< max steps per cycle
  std::uint32_t pairs = 2048;  ///< max pairs of triangles near the tool; with more, it makes shorter steps or stops
  /// Work budget per cycle, in units of about 0.1 us. A gathered pair of triangles costs 1 unit, eight pairs that are
  /// measured again 1, a contact in one iteration of the solver 1, and a visited pair of tree nodes 1/2. The last run
  /// of the solver may exceed the budget.
  std::uint32_t work = 2400;
};

/// Stiffness of the virtual coupling.
struct ToolGrip {
  double stiffness = 1000;            ///< N/m
  double rotational_stiffness = 0.1;  ///< N m/rad
  double angular_damping = 1e-3;      ///< N m s, damps only the torque on the hand
};

struct ToolPose {
  Vec3d position = Vec3d::Zero();  ///< of the tool's origin, m
  Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity();
};

/// An object that the tool may touch: world = rotation * (scale * model) + translation.
struct ToolObject {
  const spm::AbTree* tree = nullptr;
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Vec3d translation = Vec3d::Zero();
  double scale = 1;  ///< m per model unit
  double friction = 0;
  std::uint32_t index = 0;  ///< below 256; returned in ToolResult
};

struct ToolResult {
  ToolPose pose;
  /// Displacement of the origin, m, and rotation vector, rad, from the device to the tool. Multiplied by the stiffness
  /// and the rotational stiffness of the ToolGrip they are the force and the torque on the hand, before damping.
  Vec3d displacement = Vec3d::Zero(), rotation = Vec3d::Zero();
  Vec3d normal =
      Vec3d::UnitZ();  ///< mean of the contact normals, weighted by force; without contact: of the last contact
  Vec3d point = Vec3d::Zero();  ///< mean of the contact points, weighted in the same way
  bool in_contact = false;
  bool lagging = false;        ///< the last step was shorter than wanted, because of a limit or a blocked motion
  bool outside_only = false;   ///< the tool started inside a surface and touches nothing until it is outside
  bool too_near = false;       ///< a changed surface is too close; the tool is being pushed out
  std::uint32_t contacts = 0;  ///< contacts with a force
  std::uint32_t dropped = 0;   ///< contacts above the limits of the solver
  std::uint32_t steps = 0, solves = 0, pairs = 0, work = 0;  ///< counts of this cycle; pairs: of its last gather
  std::uint32_t object = spm::kNone;                         ///< object with the largest contact force
  std::uint32_t face = spm::kNone;                           ///< FaceId of that contact
};

class Tool {
 public:
  /// `probe`: the mesh of the tool in metres; must outlive the tool. Allocates.
  explicit Tool(const spm::MeshProbe& probe, const ToolSettings& settings = {});
  Tool(const Tool&) = delete;
  Tool& operator=(const Tool&) = delete;

  /// Applies from the next step on. Realtime.
  void set_grip(const ToolGrip& grip) noexcept { grip_ = grip; }
  /// Clears all state; the next step starts at the device.
  void reset() noexcept;

  /// Computes one cycle of `dt` seconds with the device at `device`. `objects`: the objects near the tool, at most 255.
  /// `surface_changed`: the list, a pose or a face of these objects has changed since the last cycle. A pose that is
  /// not finite changes nothing. Realtime.
  const ToolResult& step(const ToolPose& device, double dt, std::span<const ToolObject> objects,
                         bool surface_changed) noexcept;

  [[nodiscard]] const ToolResult& last() const noexcept { return result_; }

  /// Discards the gathered pairs, so that the next cycle gathers them anew. Realtime.
  void clear_gathered_pairs() noexcept { gathered_ = false; }
  /// Visits the state that one cycle leaves for the next (haptics/carried.hpp), and discards the gathered pairs. A tool
  /// of the same shape and settings can continue from this state. Realtime if `visit` is.
  template <class Visit>
  void for_each_carried(Visit& visit) noexcept {
    static_assert(sizeof(void*) != 8 || (sizeof(ToolGrip) == 24 && sizeof(ToolPose) == 64 &&
                                         sizeof(ToolResult) == 208 && sizeof(Contact) == 128),
                  "carry the new member");
    gathered_ = false;
    visit.number("stiffness", grip_.stiffness), visit.number("rotational stiffness", grip_.rotational_stiffness);
    visit.number("angular damping", grip_.angular_damping);
    for (ToolPose* pose : {&result_.pose, &pose_, &device_before_})
      visit.number("position of a tool", pose->position), visit.number("orientation of a tool", pose->orientation);
    for (Vec3d* vector : {&result_.displacement, &result_.rotation, &result_.normal, &result_.point, &prevented_.linear,
                          &prevented_.angular})
      visit.number("vector of a tool", *vector);
    for (bool* flag : {&result_.in_contact, &result_.lagging, &result_.outside_only, &result_.too_near, &started_,
                       &stuck_, &trapped_})
      visit.flag("flag of a tool", *flag);
    for (std::uint32_t* count : {&result_.contacts, &result_.dropped, &result_.steps, &result_.solves, &result_.pairs,
                                 &result_.work, &result_.object, &result_.face})
      visit.any("count of a tool", *count);
    visit.number("motion of the device", device_moved_), visit.number("backlog of motion", backlog_);
    visit.count("count of rows", row_count_, kMaxContacts);
    for (std::size_t i = 0; i < row_count_; ++i) {
      Contact& row = rows_[i];  // between the tool, body 0, and static geometry
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
  /// The id of a contact consists of object, number of the check that added it, triangle of the tool, and face.
  static constexpr int kAgainShift = 52;
  static constexpr std::uint64_t kPairOfId = ~(std::uint64_t{15} << kAgainShift);
  struct Displacement {
    Vec3d linear = Vec3d::Zero(), angular = Vec3d::Zero();
    [[nodiscard]] Displacement operator*(double share) const noexcept { return {share * linear, share * angular}; }
    [[nodiscard]] Displacement operator-(const Displacement& other) const noexcept {
      return {linear - other.linear, angular - other.angular};
    }
  };
  /// Distance from a triangle of the tool to one of an object, negative when they overlap; world frame.
  struct Gap {
    double distance;
    Vec3d normal;  // unit, from the object to the tool
    Vec3d arm;     // from the tool's origin to its closest point
    bool inner;    // the tool is on the inner side of the face
  };
  /// Pairs of one object, in blocks of eight. Coordinates in the object's axes are in metres from `origin`.
  struct Part {
    const ToolObject* object;
    std::uint32_t first, last;  // blocks
    Vec3d origin;               // model frame
    Vec3d tool;                 // origin of the tool, in the object's axes
  };
  /// All pairs within a margin of one pose.
  struct PairSet {
    double margin = 0;  // m
    std::vector<spm::NearPairs> blocks;
    std::vector<float> nearest;  // smallest gap of each block at that pose, m
    std::vector<Part> parts;
    std::uint32_t pairs = 0;  // slots in use
    [[nodiscard]] const Part& part(std::uint32_t pair) const noexcept;
    [[nodiscard]] std::uint64_t id(const Part& part, std::uint32_t pair) const noexcept;
  };
  /// The gaps of the pairs of a set at another pose; infinite for a pair that is too far away to matter.
  struct Nearby {
    ToolPose pose;
    PairSet* set = nullptr;
    double travel = 0;   // m, longest displacement of a point since the pairs were gathered
    double nearest = 0;  // m, lower bound of the distance of all pairs, gathered or not
    std::vector<float> distance;
    std::array<std::vector<float>, 3> normal, arm;
    std::vector<std::uint8_t> inner;
    [[nodiscard]] Gap gap(std::uint32_t pair) const noexcept;
  };
  /// A pair that is too close at the start of a step.
  struct Overlap {
    std::uint64_t id;
    double distance;
  };
  struct Step {
    double length = 0;         // m, longest displacement of a point
    bool is_shortened = true;  // the step is shorter than wanted
  };
  enum class Check : std::uint8_t { kFree, kTooNear, kBlocked };

  /// Smallest gap that a motion may lead to, m.
  [[nodiscard]] double min_allowed_gap() const noexcept;
  /// Upper bound of the displacement of any point of the tool, m.
  [[nodiscard]] double longest(const Displacement& displacement) const noexcept {
    return displacement.linear.norm() + displacement.angular.norm() * probe_.radius();
  }
  [[nodiscard]] static ToolPose moved(const ToolPose& pose, const Displacement& displacement) noexcept;
  [[nodiscard]] Displacement to_device(const ToolPose& device) const noexcept;

  [[nodiscard]] bool gather(const ToolPose& pose, double margin, std::uint32_t max_pairs, std::uint32_t max_work,
                            std::span<const ToolObject> objects, Nearby& into) noexcept;
  void place(const ToolPose& pose, Part& part) noexcept;
  void measure(const Part& part, double within, std::uint32_t block, Nearby& into) noexcept;
  [[nodiscard]] bool measure_again(const ToolPose& pose, double length, Nearby& into) noexcept;
  [[nodiscard]] Gap gap_of(const Part& part, const spm::TriangleLanes& faces, unsigned lane) const noexcept;

  void find_overlaps() noexcept;
  [[nodiscard]] bool free_row() noexcept;
  void add_row(std::uint64_t id, const Gap& gap, double friction) noexcept;
  void choose_first_rows() noexcept;
  [[nodiscard]] Displacement solve(const Displacement& wanted, double dt) noexcept;
  [[nodiscard]] bool add_violated(const Displacement& displacement, double dt) noexcept;

  [[nodiscard]] Check check(const Displacement& displacement, int again, std::span<const ToolObject> objects) noexcept;
  [[nodiscard]] Step step_towards(const ToolPose& device, double dt, double limit,
                                  std::span<const ToolObject> objects) noexcept;
  [[nodiscard]] Step push_out(const ToolPose& device, double dt, double limit) noexcept;
  [[nodiscard]] bool move_freely(const Displacement& wanted, double margin,
                                 std::span<const ToolObject> objects) noexcept;
  void write_result(const ToolPose& device) noexcept;

  const spm::MeshProbe& probe_;
  ToolSettings settings_;
  ToolGrip grip_;
  ToolResult result_;
  ToolPose pose_, device_before_;
  bool started_ = false;
  double device_moved_ = 0;  // m, longest displacement of a point of the device in this cycle
  double backlog_ = 0;       // m, path by which the tool may still follow the device, without max_yield
  bool stuck_ = false;       // the tool is too close to a surface, and no motion was possible in the last cycle
  bool trapped_ = false;     // the tool was stuck and is not yet outside
  Displacement prevented_;   // part of the last wanted displacement that surfaces prevented

  spm::PlacedProbe placed_;
  spm::Simd simd_ = spm::best_simd();
  std::array<std::vector<float>, 3> vertices_;  // of the tool at the pose placed last
  spm::TriangleLanes lanes_{};
  spm::TriangleGaps gaps_{};
  std::array<PairSet, 2> pair_sets_;
  std::array<Nearby, 2> nearby_;
  Nearby* current_ = &nearby_[0];    // at pose_
  Nearby* candidate_ = &nearby_[1];  // at the end of a displacement
  bool gathered_ = false;
  std::vector<Overlap> overlaps_;      // pairs of current_ that are too close, by id
  bool overlapping_ = false;           // some pairs overlap; then pairs on the inner side of a face do not count
  bool pushes_out_ = false;            // this step pushes the tool out
  std::vector<float> excess_;          // m, by pair; negative: the displacement closes the gap too far
  std::vector<std::uint8_t> has_row_;  // by pair: the solver has a row for the pair
  std::vector<std::uint32_t> violated_;

  ContactSolver solver_;
  std::array<Contact, kMaxContacts> rows_;
  std::size_t row_count_ = 0;
};

}  // namespace tactus::haptics
