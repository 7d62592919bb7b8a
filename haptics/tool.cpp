#include "haptics/tool.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "haptics/rigid_body.hpp"

namespace tactus::haptics {
namespace {

constexpr float kAbsent = std::numeric_limits<float>::infinity();  // distance of a pair that is too far away to matter
constexpr std::uint32_t kMaxObjects = 255;

// Shares of the collision margin.
constexpr double kAllowedOverlap = 0.1;  // overlap of two margins that a contact may have permanently
constexpr double kSolveAgain = 0.2;      // overlap at the new pose above which the step is solved again
constexpr double kMaxOverlap = 0.5;      // overlap above which a motion is blocked
constexpr double kMaxStep = 1.5;         // longest step in contact
constexpr double kGatherBeyond = 0.4;    // distance beyond the margin within which pairs are gathered
constexpr double kShort = 0.8;           // displacement up to which one gather is enough
constexpr double kUsefulGap = 2.6;       // largest gap that can matter in the next step

constexpr double kDeviceShare = 1.2;  // max displacement of the tool per displacement of the device, without max_yield
constexpr double kMinPress = 1e-3;    // m, length of the prevented displacement that the solver always gets
constexpr std::uint32_t kNodePairsPerRow = 2;  // visited pairs of nodes that cost as much as one iterated row
constexpr double kSolverError = 2e-7;          // m, error of a gap after the solver's displacement
constexpr double kTouchDistance = 1e-6;  // m, distance below which the normal of the face is the direction of a gap
constexpr double kFloatError = 1e-6;     // m, upper bound of the errors of float coordinates

SolverSettings solver_settings(const ToolSettings& tool) noexcept {
  SolverSettings settings;
  settings.iterations = 40;
  settings.tolerance = 2e-5;  // m/s; 20 nm in a cycle of 1 ms
  settings.push_out = tool.push_out;
  settings.allowed_overlap = kAllowedOverlap * tool.collision_margin;
  return settings;
}

}  // namespace

Tool::Tool(const spm::MeshProbe& probe, const ToolSettings& settings)
    : probe_{probe}, settings_{settings}, placed_{probe}, solver_{solver_settings(settings)} {
  const std::size_t blocks = std::max(1u, settings.pairs / kWidth), pairs = blocks * kWidth;
  for (PairSet& set : pair_sets_) {
    set.blocks.resize(blocks);
    set.nearest.resize(blocks);
    set.parts.reserve(kMaxObjects);
  }
  for (Nearby& nearby : nearby_) {
    nearby.distance.resize(pairs);
    nearby.inner.resize(pairs);
    for (int axis = 0; axis < 3; ++axis) {
      nearby.normal[axis].resize(pairs);
      nearby.arm[axis].resize(pairs);
    }
  }
  for (int axis = 0; axis < 3; ++axis) vertices_[axis].resize(probe.vertices()[axis].size());
  excess_.resize(pairs);
  has_row_.resize(pairs);
  violated_.resize(pairs);
  overlaps_.reserve(pairs);
  reset();
}

void Tool::reset() noexcept {
  started_ = false;
  gathered_ = trapped_ = stuck_ = false;
  row_count_ = 0;
  result_ = ToolResult{};
}

double Tool::min_allowed_gap() const noexcept { return (1 - kMaxOverlap) * settings_.collision_margin; }

ToolPose Tool::moved(const ToolPose& pose, const Displacement& displacement) noexcept {
  return {pose.position + displacement.linear, (exp_map(displacement.angular) * pose.orientation).normalized()};
}

Tool::Displacement Tool::to_device(const ToolPose& device) const noexcept {
  return {device.position - pose_.position, log_map(device.orientation * pose_.orientation.conjugate())};
}

// ---- gather ----

Tool::Gap Tool::Nearby::gap(std::uint32_t pair) const noexcept {
  return {distance[pair],
          {normal[0][pair], normal[1][pair], normal[2][pair]},
          {arm[0][pair], arm[1][pair], arm[2][pair]},
          inner[pair] != 0};
}

const Tool::Part& Tool::PairSet::part(std::uint32_t pair) const noexcept {
  std::size_t at = 0;
  while (parts[at].last * kWidth <= pair) ++at;
  return parts[at];
}

std::uint64_t Tool::PairSet::id(const Part& part, std::uint32_t pair) const noexcept {
  const spm::NearPairs& eight = blocks[pair / kWidth];
  return std::uint64_t{part.object->index} << 56 | std::uint64_t{eight.triangle[pair % kWidth]} << 32 |
         index(eight.face[pair % kWidth]);
}

/// Gathers the pairs near `pose`. Returns false if the capacity or the work budget is used up before all are found.
bool Tool::gather(const ToolPose& pose, double margin, std::uint32_t max_pairs, std::uint32_t max_work,
                  std::span<const ToolObject> objects, Nearby& into) noexcept {
  const Nearby& other = &into == current_ ? *candidate_ : *current_;
  PairSet& set = other.set == &pair_sets_[0] ? pair_sets_[1] : pair_sets_[0];
  set.parts.clear();
  set.pairs = 0;
  set.margin = margin;
  into.pose = pose;
  into.set = &set;
  into.travel = 0;
  into.nearest = margin;
  const Eigen::Matrix3d turned = pose.orientation.toRotationMatrix();
  const std::uint32_t capacity = std::min(max_pairs / kWidth, static_cast<std::uint32_t>(set.blocks.size()));
  const std::uint32_t work_end =
      result_.work + std::min(max_work, settings_.work - std::min(settings_.work, result_.work));
  std::uint32_t block = 0;
  for (const ToolObject& object : objects) {
    if (result_.work >= work_end) return false;
    Eigen::Isometry3d in_model = Eigen::Isometry3d::Identity();
    in_model.linear() = object.rotation.transpose() * turned;
    in_model.translation() = object.rotation.transpose() * (pose.position - object.translation) / object.scale;
    placed_.set_pose(in_model, 1 / object.scale);
    const std::uint32_t free_slots = (capacity - block) * kWidth;
    const spm::MeshQueryResult touch =
        placed_.find_near_pairs(*object.tree, margin / object.scale, set.blocks.data() + block, free_slots,
                                kNodePairsPerRow * (work_end - result_.work));
    result_.work += touch.contacts + (touch.work - std::min(touch.work, touch.contacts)) / kNodePairsPerRow;
    if (!touch.complete || touch.contacts > free_slots) return false;
    if (touch.contacts == 0) continue;

    // From here on corners are in metres, along the object's axes, relative to the tool's origin.
    const Eigen::Vector3f origin = in_model.translation().cast<float>();
    const auto scale = static_cast<float>(object.scale);
    Part part{&object, block, block + (touch.contacts + kWidth - 1) / kWidth, origin.cast<double>(), Vec3d::Zero()};
    place(pose, part);
    for (; block < part.last; ++block) {
      spm::NearPairs& pairs = set.blocks[block];
      const std::uint32_t count = std::min(kWidth, touch.contacts - (block - part.first) * kWidth);
      for (std::uint32_t lane = count; lane < kWidth; ++lane) {
        pairs.face[lane] = spm::kNone;
        pairs.triangle[lane] = pairs.triangle[0];
        for (auto& corner : pairs.corners.corner)
          for (auto& axis : corner) axis[lane] = axis[0];
      }
      for (auto& corner : pairs.corners.corner)
        for (int axis = 0; axis < 3; ++axis)
          for (float& x : corner[axis]) x = (x - origin[axis]) * scale;
      measure(part, margin, block, into);
      const float* const gaps = into.distance.data() + block * kWidth;
      set.nearest[block] = *std::min_element(gaps, gaps + kWidth);
    }
    set.parts.push_back(part);
  }
  set.pairs = block * kWidth;
  result_.pairs = set.pairs;
  return true;
}

void Tool::place(const ToolPose& pose, Part& part) noexcept {
  const ToolObject& object = *part.object;
  const Eigen::Matrix3d to = object.rotation.transpose() * pose.orientation.toRotationMatrix();
  part.tool = object.rotation.transpose() * (pose.position - object.translation) - part.origin * object.scale;
  const auto& from = probe_.vertices();
  const std::size_t count = from[0].size();
  for (int axis = 0; axis < 3; ++axis) {
    const double x = to(axis, 0), y = to(axis, 1), z = to(axis, 2), t = part.tool[axis];
    float* out = vertices_[axis].data();
    for (std::size_t v = 0; v < count; ++v)
      out[v] = static_cast<float>(x * from[0][v] + y * from[1][v] + z * from[2][v] + t);
  }
}

void Tool::measure(const Part& part, double within, std::uint32_t block, Nearby& into) noexcept {
  const spm::NearPairs& pairs = into.set->blocks[block];
  for (unsigned lane = 0; lane < kWidth; ++lane) {
    const std::array<std::uint32_t, 3>& corners = probe_.corners(pairs.triangle[lane]);
    for (int i = 0; i < 3; ++i)
      for (int axis = 0; axis < 3; ++axis) lanes_.corner[i][axis][lane] = vertices_[axis][corners[i]];
  }
  spm::gaps(pairs.corners, lanes_, gaps_, simd_);
  for (unsigned lane = 0; lane < kWidth; ++lane) {
    const std::uint32_t pair = block * kWidth + lane;
    into.distance[pair] = kAbsent;
    const bool near = gaps_.distance[lane] <= within || (gaps_.may_intersect >> lane & 1u) != 0;
    if (!near || pairs.face[lane] == spm::kNone) continue;
    const Gap gap = gap_of(part, pairs.corners, lane);
    if (gap.distance > within) continue;
    into.nearest = std::min(into.nearest, gap.distance);
    into.distance[pair] = static_cast<float>(gap.distance);
    into.inner[pair] = gap.inner ? 1 : 0;
    for (int axis = 0; axis < 3; ++axis) {
      into.normal[axis][pair] = static_cast<float>(gap.normal[axis]);
      into.arm[axis][pair] = static_cast<float>(gap.arm[axis]);
    }
  }
}

/// Measures the pairs of current_ at another pose, which displaces no point of the tool by more than `length`. Returns
/// false if the work budget is used up.
bool Tool::measure_again(const ToolPose& pose, double length, Nearby& into) noexcept {
  if (result_.work >= settings_.work) return false;
  PairSet& set = *current_->set;
  const double useful = kUsefulGap * settings_.collision_margin;
  into.pose = pose;
  into.set = &set;
  into.travel = current_->travel + length;
  into.nearest = std::min(useful, set.margin - into.travel);
  for (Part& part : set.parts) {
    place(pose, part);
    for (std::uint32_t block = part.first; block < part.last; ++block) {
      if (set.nearest[block] > useful + into.travel) {
        std::fill_n(into.distance.begin() + block * kWidth, kWidth, kAbsent);
        continue;
      }
      ++result_.work;
      measure(part, useful, block, into);
    }
  }
  return true;
}

Tool::Gap Tool::gap_of(const Part& part, const spm::TriangleLanes& faces, unsigned lane) const noexcept {
  const auto corner = [lane](const spm::TriangleLanes& of, int i) -> Vec3d {
    return {of.corner[i][0][lane], of.corner[i][1][lane], of.corner[i][2][lane]};
  };
  const Vec3d on_object{gaps_.on_object[0][lane], gaps_.on_object[1][lane], gaps_.on_object[2][lane]};
  Vec3d on_tool{gaps_.on_probe[0][lane], gaps_.on_probe[1][lane], gaps_.on_probe[2][lane]};
  const Vec3d between = on_tool - on_object;
  Gap gap{between.norm(), Vec3d::UnitZ(), Vec3d::Zero(), false};
  const spm::Triangle3d face{corner(faces, 0), corner(faces, 1), corner(faces, 2)};
  spm::PairContact contact;
  const Vec3d across = (face[1] - face[0]).cross(face[2] - face[0]);
  if ((gaps_.may_intersect >> lane & 1u) != 0 &&
      spm::intersect(face, {corner(lanes_, 0), corner(lanes_, 1), corner(lanes_, 2)}, contact)) {
    gap.distance = -contact.depth;
    gap.normal = contact.normal;
    on_tool = contact.point;
  } else if (gap.distance > kTouchDistance) {
    gap.normal = between / gap.distance;
    gap.inner = between.dot(across) < 0;
  } else if (across.squaredNorm() > 0) {
    gap.normal = across.normalized();
  }
  gap.normal = part.object->rotation * gap.normal;
  gap.arm = part.object->rotation * (on_tool - part.tool);
  return gap;
}

// ---- solve ----

/// Returns whether a row (a contact for the solver) is free. If all are in use, drops those without an impulse in the
/// last solve.
bool Tool::free_row() noexcept {
  if (row_count_ < kMaxContacts) return true;
  std::size_t count = 0;
  for (std::size_t i = 0; i < row_count_; ++i) {
    if (i < solver_.contacts().size() && solver_.impulse(i).isZero(0)) continue;
    rows_[count++] = rows_[i];
  }
  row_count_ = count;
  if (row_count_ < kMaxContacts) return true;
  ++result_.dropped;
  return false;
}

void Tool::add_row(std::uint64_t id, const Gap& gap, double friction) noexcept {
  if (!free_row()) return;
  Contact& row = rows_[row_count_++];
  row = Contact{};
  row.id = id;
  row.arm_a = gap.arm;
  row.point = pose_.position + gap.arm;
  row.normal = gap.normal;
  row.gap = gap.distance - settings_.collision_margin;
  if (!pushes_out_) row.gap = std::max(row.gap, -kAllowedOverlap * settings_.collision_margin);
  row.friction = friction;
}

/// Selects the first rows: the pairs that had an impulse in the last solve and are still near.
void Tool::choose_first_rows() noexcept {
  std::array<std::uint64_t, kMaxContacts> pressed;
  std::size_t count = 0;
  for (std::size_t i = 0; i < row_count_; ++i)
    if (i < solver_.contacts().size() && !solver_.impulse(i).isZero(0)) pressed[count++] = rows_[i].id & kPairOfId;
  row_count_ = 0;
  std::fill_n(has_row_.begin(), current_->set->pairs, std::uint8_t{0});
  if (count == 0) return;
  for (const Part& part : current_->set->parts)
    for (std::uint32_t pair = part.first * kWidth; pair < part.last * kWidth; ++pair) {
      if (current_->distance[pair] == kAbsent || (overlapping_ && current_->inner[pair] != 0)) continue;
      const std::uint64_t id = current_->set->id(part, pair);
      if (std::find(pressed.begin(), pressed.begin() + count, id) == pressed.begin() + count) continue;
      has_row_[pair] = 1;
      add_row(id, current_->gap(pair), part.object->friction);
      if (row_count_ == kMaxContacts) return;
    }
}

Tool::Displacement Tool::solve(const Displacement& wanted, double dt) noexcept {
  ++result_.solves;
  SolverBody body;
  body.inverse_mass.diagonal().head<3>().setConstant(1 / grip_.stiffness);
  body.inverse_mass.diagonal().tail<3>().setConstant(1 / grip_.rotational_stiffness);
  body.velocity << wanted.linear / dt, wanted.angular / dt;
  solver_.begin();
  for (std::size_t i = 0; i < row_count_; ++i) solver_.add(rows_[i]);
  const SolverResult& solved = solver_.solve({&body, 1}, dt);
  result_.work += static_cast<std::uint32_t>(solved.iterations) * solved.contacts;
  return {body.velocity.head<3>() * dt, body.velocity.tail<3>() * dt};
}

/// Adds rows for pairs that `displacement` would bring too close: of several similar pairs, the one that would be
/// closest. Returns false if it added none.
bool Tool::add_violated(const Displacement& displacement, double dt) noexcept {
  constexpr int kAtOnce = 4;
  const float lx = static_cast<float>(displacement.linear.x()), ly = static_cast<float>(displacement.linear.y()),
              lz = static_cast<float>(displacement.linear.z());
  const float tx = static_cast<float>(displacement.angular.x()), ty = static_cast<float>(displacement.angular.y()),
              tz = static_cast<float>(displacement.angular.z());
  const auto collision_margin = static_cast<float>(settings_.collision_margin),
             touching = static_cast<float>(kAllowedOverlap) * collision_margin;
  const auto share = static_cast<float>(std::min(1.0, SolverSettings{}.push_out_rate * dt)),
             max = static_cast<float>(settings_.push_out * dt);
  constexpr float kOff = static_cast<float>(kSolverError);
  const Nearby& near = *current_;
  std::uint32_t count = 0;
  for (std::uint32_t pair = 0; pair < current_->set->pairs; ++pair) {
    const float gap = near.distance[pair] - collision_margin;
    const float ax = near.arm[0][pair], ay = near.arm[1][pair], az = near.arm[2][pair];
    const float closing = near.normal[0][pair] * (lx + ty * az - tz * ay) +
                          near.normal[1][pair] * (ly + tz * ax - tx * az) +
                          near.normal[2][pair] * (lz + tx * ay - ty * ax);
    // As in the solver, a gap may close, an overlap must not grow, and a large overlap must shrink.
    const float min = gap >= 0 ? -gap : pushes_out_ ? std::min(max, share * std::max(0.0f, -gap - touching)) : 0;
    excess_[pair] = closing - min;
    if (closing < min - kOff && has_row_[pair] == 0 && near.distance[pair] < kAbsent &&
        !(overlapping_ && near.inner[pair] != 0))
      violated_[count++] = pair;
  }
  if (count == 0) return false;
  bool added = false;
  for (int i = 0; i < kAtOnce && count > 0; ++i) {
    std::uint32_t worst = violated_[0];
    for (std::uint32_t k = 1; k < count; ++k)
      if (excess_[violated_[k]] < excess_[worst]) worst = violated_[k];
    const Part& part = current_->set->part(worst);
    const Gap gap = near.gap(worst);
    const std::size_t before = row_count_;
    add_row(current_->set->id(part, worst), gap, part.object->friction);
    if (row_count_ == before) return added;
    added = true;
    has_row_[worst] = 1;
    // This row may also constrain the pairs with nearly the same position and direction, so they are not added.
    std::uint32_t remaining = 0;
    const double alike = 0.02 * probe_.radius();
    for (std::uint32_t k = 0; k < count; ++k) {
      const Gap other = near.gap(violated_[k]);
      if (other.normal.dot(gap.normal) > 0.95 && (other.arm - gap.arm).squaredNorm() < alike * alike) continue;
      violated_[remaining++] = violated_[k];
    }
    count = remaining;
  }
  return added;
}

// ---- check and move ----

/// Checks the pose after `displacement`. If `again` is above 0, adds rows for pairs that are too close at this pose.
/// The ids of these rows contain `again`.
Tool::Check Tool::check(const Displacement& displacement, int again, std::span<const ToolObject> objects) noexcept {
  const double collision_margin = settings_.collision_margin;
  Nearby& candidate = *candidate_;
  const double length = longest(displacement);
  const ToolPose after = moved(pose_, displacement);
  const bool enough_gathered = current_->travel + length <= current_->set->margin - collision_margin - kFloatError;
  if (!(enough_gathered
            ? measure_again(after, length, candidate)
            : gather(after, (1 + kGatherBeyond) * collision_margin + kFloatError, ~0u, ~0u, objects, candidate)))
    return Check::kBlocked;
  // The smallest gap before the step plus the smallest gap after it must exceed the step, so that no triangle passes
  // through another. If pairs overlap already, only `overlaps_` decides.
  if (std::max(current_->nearest, 0.0) + std::max(candidate.nearest, 0.0) <= length && !overlapping_)
    return Check::kBlocked;
  if (candidate.nearest >= (1 - kSolveAgain) * collision_margin) return Check::kFree;
  constexpr std::size_t kMax = 6;
  std::array<std::uint32_t, kMax> worst;
  std::size_t count = 0;
  for (const Part& part : candidate.set->parts)
    for (std::uint32_t pair = part.first * kWidth; pair < part.last * kWidth; ++pair) {
      const double distance = candidate.distance[pair];
      if (distance >= (1 - kSolveAgain) * collision_margin ||
          (overlapping_ && distance > 0 && candidate.inner[pair] != 0))
        continue;
      if (distance < (1 - kMaxOverlap) * collision_margin) {  // allowed only if the pair was as close before
        const std::uint64_t id = candidate.set->id(part, pair);
        const auto before = std::lower_bound(overlaps_.begin(), overlaps_.end(), id,
                                             [](const Overlap& o, std::uint64_t wanted) { return o.id < wanted; });
        if (before == overlaps_.end() || before->id != id || distance < before->distance - kTouchDistance)
          return Check::kBlocked;
        continue;
      }
      std::size_t to = count;
      if (count < kMax) {
        ++count;
      } else {
        to = static_cast<std::size_t>(std::max_element(worst.begin(), worst.end(),
                                                       [&](std::uint32_t a, std::uint32_t b) {
                                                         return candidate.distance[a] < candidate.distance[b];
                                                       }) -
                                      worst.begin());
        if (candidate.distance[worst[to]] <= candidate.distance[pair]) continue;
      }
      worst[to] = pair;
    }
  if (count == 0) return Check::kFree;
  if (again == 0) return Check::kTooNear;
  // The gaps were measured at the new pose. The rows are for the present pose, so the gaps are converted to it.
  const Eigen::Quaterniond rotation = exp_map(displacement.angular);
  for (std::size_t i = 0; i < count; ++i) {
    Gap gap = candidate.gap(worst[i]);
    const Vec3d arm = rotation.conjugate() * gap.arm;
    gap.distance -= gap.normal.dot(displacement.linear + gap.arm - arm);
    gap.arm = arm;
    const Part& part = candidate.set->part(worst[i]);
    add_row(candidate.set->id(part, worst[i]) | static_cast<std::uint64_t>(again) << kAgainShift, gap,
            part.object->friction);
  }
  return Check::kTooNear;
}

/// Lists the pairs that are closer than `min_allowed_gap()`, for instance after the surface changed. They must not come
/// closer, except for pairs that overlap already.
void Tool::find_overlaps() noexcept {
  overlaps_.clear();
  overlapping_ = current_->nearest <= 0;
  const double limit_distance = (1 - kMaxOverlap) * settings_.collision_margin + kTouchDistance;
  if (current_->nearest >= limit_distance) return;
  for (const Part& part : current_->set->parts)
    for (std::uint32_t pair = part.first * kWidth; pair < part.last * kWidth; ++pair) {
      const float distance = current_->distance[pair];
      if (distance == kAbsent) continue;
      if (distance <= kTouchDistance || (overlapping_ && current_->inner[pair] != 0))
        overlaps_.push_back({current_->set->id(part, pair), -kAbsent});
      else if (distance < limit_distance)
        overlaps_.push_back({current_->set->id(part, pair), distance});
    }
  std::sort(overlaps_.begin(), overlaps_.end(), [](const Overlap& a, const Overlap& b) { return a.id < b.id; });
}

/// Moves the tool along the normals of the triangles that are too close, at `push_out`. Where several overlap, it uses
/// the outermost. The tool also follows the device in directions that approach no surface. In the direction of the
/// push-out it follows at most as far as the device. It does not rotate. It uses neither solver nor check: the solver
/// would use up the budget, and every check would report a blocked motion.
Tool::Step Tool::push_out(const ToolPose& device, double dt, double limit) noexcept {
  constexpr int kPasses = 2;
  Vec3d out = Vec3d::Zero(), along = to_device(device).linear;
  double nearest = std::numeric_limits<double>::infinity();
  for (int pass = 0; pass < kPasses; ++pass)
    for (const Part& part : current_->set->parts)
      for (std::uint32_t pair = part.first * kWidth; pair < part.last * kWidth; ++pair) {
        const double distance = current_->distance[pair];
        if (distance == kAbsent || (overlapping_ && distance > 0 && current_->inner[pair] != 0)) continue;
        const Gap gap = current_->gap(pair);
        along -= std::min(0.0, along.dot(gap.normal)) * gap.normal;
        if (pass > 0 || distance >= min_allowed_gap()) continue;
        out += (settings_.collision_margin - distance) * gap.normal;
        if (distance >= nearest) continue;
        nearest = distance;
        result_.object = part.object->index;
        result_.face = index(current_->set->blocks[pair / kWidth].face[pair % kWidth]);
        result_.point = pose_.position + gap.arm;
      }
  Displacement displacement;
  if (out.squaredNorm() > 0) {
    result_.normal = out.normalized();
    displacement.linear = settings_.push_out * dt * result_.normal;
    const double pulled = std::max(0.0, to_device(device).linear.dot(result_.normal));
    along -= std::max(0.0, along.dot(result_.normal) - pulled) * result_.normal;
  }
  const double max = std::min(limit, settings_.collision_margin), size = along.norm();
  displacement.linear += size > max ? Vec3d(along * (max / size)) : along;
  result_.contacts = 1;
  pose_ = moved(pose_, displacement);
  gathered_ = false;
  prevented_ = Displacement{};
  row_count_ = 0;
  return {longest(displacement), true};
}

Tool::Step Tool::step_towards(const ToolPose& device, double dt, double limit,
                              std::span<const ToolObject> objects) noexcept {
  constexpr int kRounds = 10, kChecks = 3, kHalvings = 3;
  ++result_.steps;
  const double collision_margin = settings_.collision_margin;
  if (!gathered_) {
    // For a short displacement one gather is enough. After a longer one, `check` gathers again.
    const double wanted = std::min(longest(to_device(device)), limit);
    const double beyond = wanted < kShort * collision_margin ? std::max(wanted, kGatherBeyond * collision_margin)
                                                             : kGatherBeyond * collision_margin;
    if (!gather(pose_, collision_margin + beyond + 2 * kFloatError, ~0u, ~0u, objects, *current_)) return {};
    gathered_ = true;
  }
  find_overlaps();
  const bool too_near = current_->nearest < (1 - 2 * kSolveAgain) * collision_margin;
  result_.too_near = result_.too_near || too_near;
  trapped_ = current_->nearest < min_allowed_gap() && (trapped_ || stuck_);
  if (trapped_) return push_out(device, dt, limit);

  Displacement wanted = to_device(device);
  const double need = longest(wanted);
  const double longest_step = overlapping_ ? (2 - 2 * kMaxOverlap) * collision_margin
                                           : std::max(kMaxStep * collision_margin, current_->nearest);
  const double max = std::min({need, limit, longest_step});
  // A push-out may be longer than the displacement to the device.
  const double allowed = std::max(max, too_near && pushes_out_ ? settings_.push_out * dt : 0);
  // If the device is far inside a surface, the surface prevents nearly all of the wanted displacement, as it did in the
  // previous step. So most of the prevented part is left out. The result is the same, and the solver converges sooner.
  const double held = longest(prevented_), bound = std::max(kMinPress, 2 * device_moved_);
  const double left_out = held > bound ? 1 - bound / held : 0;
  wanted = wanted - prevented_ * left_out;
  choose_first_rows();
  Displacement displacement;
  Check seen = Check::kTooNear;
  bool is_shortened = false;
  for (int checks = kChecks; seen == Check::kTooNear && checks > 0; --checks) {
    for (int round = 0; round < kRounds && (round == 0 || result_.work < settings_.work); ++round) {
      displacement = solve(wanted, dt);
      if (const double length = longest(displacement); length > allowed) {
        // Shortens `displacement` to the length of the step, and `wanted` by the same vector. Their difference, the
        // part that surfaces prevent, remains; it determines contact forces and friction.
        is_shortened = is_shortened || length > max;
        const Displacement excess = displacement * (1 - allowed / length);
        wanted = wanted - excess;
        displacement = displacement - excess;
      }
      if (!add_violated(displacement, dt)) break;
    }
    seen = check(displacement, checks - 1, objects);
  }
  prevented_ = wanted - displacement - prevented_ * -left_out;
  for (int halving = 0; seen == Check::kBlocked && halving < kHalvings; ++halving) {
    is_shortened = true;
    displacement = displacement * 0.5;
    seen = check(displacement, 0, objects);
  }
  if (seen == Check::kBlocked) return {};
  pose_ = candidate_->pose;
  std::swap(current_, candidate_);
  return {longest(displacement), is_shortened};
}

/// Moves by `wanted` if no surface is near. Returns false if one is near, or if the search would cost too much.
bool Tool::move_freely(const Displacement& wanted, double margin, std::span<const ToolObject> objects) noexcept {
  constexpr std::uint32_t kFewPairs = 64, kLittleWork = 300;
  gathered_ = false;
  if (!gather(pose_, margin, kFewPairs, kLittleWork, objects, *current_) || current_->nearest < margin) return false;
  pose_ = moved(pose_, wanted);
  gathered_ = false;
  prevented_ = Displacement{};
  row_count_ = 0;
  return true;
}

const ToolResult& Tool::step(const ToolPose& at, double dt, std::span<const ToolObject> objects,
                             bool surface_changed) noexcept {
  if (!at.position.allFinite() || !at.orientation.coeffs().allFinite() || !(at.orientation.norm() > 0.5) || !(dt > 0))
    return result_;
  const ToolPose device{at.position, at.orientation.normalized()};
  const bool outside_only = result_.outside_only, was_in_contact = result_.in_contact;
  const Vec3d normal = result_.normal, point = result_.point;
  result_ = ToolResult{};
  result_.normal = normal;
  result_.point = point;
  if (surface_changed) gathered_ = false;
  if (!started_ || outside_only) {
    pose_ = device;
    const double margin = settings_.collision_margin + kFloatError;
    result_.outside_only =
        !gather(pose_, margin, ~0u, ~0u, objects, *current_) || current_->nearest < settings_.collision_margin;
    started_ = true;
    trapped_ = stuck_ = false;
    backlog_ = 0;
    prevented_ = Displacement{};
    row_count_ = 0;
  } else {
    device_moved_ = longest({device.position - device_before_.position,
                             log_map(device.orientation * device_before_.orientation.conjugate())});
    if (was_in_contact) backlog_ = 0;
    backlog_ += kDeviceShare * device_moved_;
    const double limit = std::min(settings_.max_displacement, backlog_ + settings_.max_yield / grip_.stiffness * dt);
    const Displacement wanted = to_device(device);
    const double need = longest(wanted);
    const bool free = !was_in_contact && need <= limit &&
                      move_freely(wanted, settings_.collision_margin + need + kFloatError, objects);
    double travelled = free ? need : 0;
    for (std::uint32_t i = 0; !free && i < settings_.steps; ++i) {
      pushes_out_ = i == 0;
      const Step step = step_towards(device, dt, limit - travelled, objects);
      travelled += step.length;
      result_.lagging = step.is_shortened;
      if (trapped_) break;
      if (!step.is_shortened || step.length <= 0 || travelled >= 0.99 * limit) break;
    }
    stuck_ = gathered_ && travelled <= 0 && current_->nearest < min_allowed_gap();
    backlog_ = result_.lagging ? std::max(0.0, backlog_ - travelled) : 0;
  }
  device_before_ = device;
  write_result(device);
  return result_;
}

void Tool::write_result(const ToolPose& device) noexcept {
  result_.pose = pose_;
  if (result_.outside_only) return;
  result_.displacement = pose_.position - device.position;
  result_.rotation = log_map(pose_.orientation * device.orientation.conjugate());
  Vec3d normal = Vec3d::Zero(), point = Vec3d::Zero();
  double whole = 0, max = 0;
  result_.in_contact = trapped_;
  if (trapped_) return;
  for (std::size_t i = 0; i < row_count_ && i < solver_.contacts().size(); ++i) {
    const double press = solver_.impulse(i).dot(rows_[i].normal);
    if (!(press > 0)) continue;
    ++result_.contacts;
    whole += press;
    normal += press * rows_[i].normal;
    point += press * rows_[i].point;
    if (press <= max) continue;
    max = press;
    result_.object = static_cast<std::uint32_t>(rows_[i].id >> 56);
    result_.face = static_cast<std::uint32_t>(rows_[i].id);
  }
  result_.in_contact = result_.contacts > 0;
  if (!result_.in_contact) return;
  result_.point = point / whole;
  if (normal.squaredNorm() > 0) result_.normal = normal.normalized();
}

}  // namespace tactus::haptics
