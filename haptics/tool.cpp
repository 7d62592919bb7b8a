#include "haptics/tool.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "haptics/rigid_body.hpp"

namespace tactus::haptics {
namespace {

constexpr float kNone = std::numeric_limits<float>::infinity();  // distance of what is not there
constexpr std::uint32_t kMaxObjects = 255;

// Shares of the rounding.
constexpr double kTouching = 0.1;   // what a contact may overlap for good
constexpr double kLookAgain = 0.2;  // what it may before a way is solved for again
constexpr double kBlocked = 0.5;    // never more
constexpr double kStep = 1.5;       // the longest step in contact
constexpr double kMargin = 0.4;     // how far beyond it pairs are gathered
constexpr double kShort = 0.8;      // a way for which more are gathered at once
constexpr double kUseful = 2.6;     // gaps that matter in the next step

constexpr double kAlong = 1.2;       // ways of the device that the tool goes in a cycle, beside what it yields
constexpr double kPress = 1e-3;      // m of a press that is told the solver
constexpr std::uint32_t kWalks = 2;  // pairs of nodes that take as long as a row swept
constexpr double kLinear = 2e-7;     // m by which an answer of the solver may miss a gap
constexpr double kMeeting = 1e-6;    // m; nearer than this the face's normal tells the direction
constexpr double kFloatRoom = 1e-6;  // m; what float coordinates may be off, many times over

SolverSettings solver_settings(const ToolSettings& tool) noexcept {
  SolverSettings settings;
  settings.sweeps = 40;
  settings.quiet = 2e-5;  // 20 nm in a cycle of 1 ms
  settings.push_out = tool.push_out;
  settings.touching = kTouching * tool.collision_margin;
  return settings;
}

}  // namespace

Tool::Tool(const spm::MeshProbe& probe, const ToolSettings& settings)
    : probe_{probe}, settings_{settings}, placed_{probe}, solver_{solver_settings(settings)} {
  const std::size_t blocks = std::max(1u, settings.pairs / kWidth), pairs = blocks * kWidth;
  for (Found& found : found_) {
    found.blocks.resize(blocks);
    found.nearest.resize(blocks);
    found.parts.reserve(kMaxObjects);
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
  taken_.resize(pairs);
  violated_.resize(pairs);
  overlaps_.reserve(pairs);
  reset();
}

void Tool::reset() noexcept {
  started_ = false;
  have_here_ = caught_ = stuck_ = false;
  row_count_ = 0;
  result_ = ToolResult{};
}

double Tool::blocked() const noexcept { return (1 - kBlocked) * settings_.collision_margin; }

ToolPose Tool::moved(const ToolPose& pose, const Way& way) noexcept {
  return {pose.position + way.linear, (exp_map(way.turn) * pose.orientation).normalized()};
}

Tool::Way Tool::to_device(const ToolPose& device) const noexcept {
  return {device.position - pose_.position, log_map(device.orientation * pose_.orientation.conjugate())};
}

// ---- gather ----

Tool::Gap Tool::Nearby::gap(std::uint32_t pair) const noexcept {
  return {distance[pair],
          {normal[0][pair], normal[1][pair], normal[2][pair]},
          {arm[0][pair], arm[1][pair], arm[2][pair]},
          inner[pair] != 0};
}

const Tool::Part& Tool::Found::part(std::uint32_t pair) const noexcept {
  std::size_t at = 0;
  while (parts[at].last * kWidth <= pair) ++at;
  return parts[at];
}

std::uint64_t Tool::Found::id(const Part& part, std::uint32_t pair) const noexcept {
  const spm::NearPairs& eight = blocks[pair / kWidth];
  return std::uint64_t{part.object->index} << 56 | std::uint64_t{eight.triangle[pair % kWidth]} << 32 |
         eight.face_id[pair % kWidth];
}

/// What is near `pose`. False when not all was found: no room, or no work left.
bool Tool::gather(const ToolPose& pose, double margin, std::uint32_t max_pairs, std::uint32_t max_work,
                  spm::Span<const ToolObject> objects, Nearby& into) noexcept {
  const Nearby& other = &into == here_ ? *there_ : *here_;
  Found& found = other.found == &found_[0] ? found_[1] : found_[0];
  found.parts.clear();
  found.pairs = 0;
  found.margin = margin;
  into.pose = pose;
  into.found = &found;
  into.went = 0;
  into.nearest = margin;
  const Eigen::Matrix3d turned = pose.orientation.toRotationMatrix();
  const std::uint32_t capacity = std::min(max_pairs / kWidth, static_cast<std::uint32_t>(found.blocks.size()));
  const std::uint32_t work_end =
      result_.work + std::min(max_work, settings_.work - std::min(settings_.work, result_.work));
  std::uint32_t block = 0;
  for (const ToolObject& object : objects) {
    if (result_.work >= work_end) return false;
    Eigen::Isometry3d in_model = Eigen::Isometry3d::Identity();
    in_model.linear() = object.rotation.transpose() * turned;
    in_model.translation() = object.rotation.transpose() * (pose.position - object.translation) / object.scale;
    placed_.place(in_model, 1 / object.scale);
    const std::uint32_t room = (capacity - block) * kWidth;
    const spm::MeshTouch touch = placed_.near(*object.tree, margin / object.scale, found.blocks.data() + block, room,
                                              kWalks * (work_end - result_.work));
    result_.work += touch.contacts + (touch.work - std::min(touch.work, touch.contacts)) / kWalks;
    if (!touch.complete || touch.contacts > room) return false;
    if (touch.contacts == 0) continue;

    // Corners from here on: metres, along the object's axes, from near the tool's origin.
    const Eigen::Vector3f origin = in_model.translation().cast<float>();
    const auto scale = static_cast<float>(object.scale);
    Part part{&object, block, block + (touch.contacts + kWidth - 1) / kWidth, origin.cast<double>(), Vec3d::Zero()};
    place(pose, part);
    for (; block < part.last; ++block) {
      spm::NearPairs& pairs = found.blocks[block];
      const std::uint32_t here = std::min(kWidth, touch.contacts - (block - part.first) * kWidth);
      for (std::uint32_t lane = here; lane < kWidth; ++lane) {
        pairs.face_id[lane] = spm::kNone;
        pairs.triangle[lane] = pairs.triangle[0];
        for (auto& corner : pairs.face.corner)
          for (auto& axis : corner) axis[lane] = axis[0];
      }
      for (auto& corner : pairs.face.corner)
        for (int axis = 0; axis < 3; ++axis)
          for (float& x : corner[axis]) x = (x - origin[axis]) * scale;
      measure(part, margin, block, into);
      const float* const gaps = into.distance.data() + block * kWidth;
      found.nearest[block] = *std::min_element(gaps, gaps + kWidth);
    }
    found.parts.push_back(part);
  }
  found.pairs = block * kWidth;
  result_.pairs = found.pairs;
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
  const spm::NearPairs& pairs = into.found->blocks[block];
  for (unsigned lane = 0; lane < kWidth; ++lane) {
    const std::array<std::uint32_t, 3>& corners = probe_.corners(pairs.triangle[lane]);
    for (int i = 0; i < 3; ++i)
      for (int axis = 0; axis < 3; ++axis) lanes_.corner[i][axis][lane] = vertices_[axis][corners[i]];
  }
  spm::gaps(pairs.face, lanes_, gaps_, simd_);
  for (unsigned lane = 0; lane < kWidth; ++lane) {
    const std::uint32_t pair = block * kWidth + lane;
    into.distance[pair] = kNone;
    const bool near = gaps_.distance[lane] <= within || (gaps_.may_meet >> lane & 1u) != 0;
    if (!near || pairs.face_id[lane] == spm::kNone) continue;
    const Gap gap = gap_of(part, pairs.face, lane);
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

/// The same pairs as in here_, in a pose to which no point of the tool has further than `length`.
bool Tool::measure_again(const ToolPose& pose, double length, Nearby& into) noexcept {
  if (result_.work >= settings_.work) return false;
  Found& found = *here_->found;
  const double useful = kUseful * settings_.collision_margin;
  into.pose = pose;
  into.found = &found;
  into.went = here_->went + length;
  into.nearest = std::min(useful, found.margin - into.went);
  for (Part& part : found.parts) {
    place(pose, part);
    for (std::uint32_t block = part.first; block < part.last; ++block) {
      if (found.nearest[block] > useful + into.went) {
        std::fill_n(into.distance.begin() + block * kWidth, kWidth, kNone);
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
  if ((gaps_.may_meet >> lane & 1u) != 0 &&
      spm::meet(face, {corner(lanes_, 0), corner(lanes_, 1), corner(lanes_, 2)}, contact)) {
    gap.distance = -contact.depth;
    gap.normal = contact.normal;
    on_tool = contact.point;
  } else if (gap.distance > kMeeting) {
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

/// In the room of rows that did not press in the last solve when there is none.
bool Tool::make_room() noexcept {
  if (row_count_ < kMaxContacts) return true;
  std::size_t kept = 0;
  for (std::size_t i = 0; i < row_count_; ++i) {
    if (i < solver_.contacts().size() && solver_.impulse(i).isZero(0)) continue;
    rows_[kept++] = rows_[i];
  }
  row_count_ = kept;
  if (row_count_ < kMaxContacts) return true;
  ++result_.dropped;
  return false;
}

void Tool::add_row(std::uint64_t id, const Gap& gap, double friction) noexcept {
  if (!make_room()) return;
  Contact& row = rows_[row_count_++];
  row = Contact{};
  row.id = id;
  row.arm_a = gap.arm;
  row.point = pose_.position + gap.arm;
  row.normal = gap.normal;
  row.gap = gap.distance - settings_.collision_margin;
  if (!push_) row.gap = std::max(row.gap, -kTouching * settings_.collision_margin);
  row.friction = friction;
}

/// Those that pressed in the last solve, if they are near.
void Tool::choose_first_rows() noexcept {
  std::array<std::uint64_t, kMaxContacts> pressed;
  std::size_t count = 0;
  for (std::size_t i = 0; i < row_count_; ++i)
    if (i < solver_.contacts().size() && !solver_.impulse(i).isZero(0)) pressed[count++] = rows_[i].id & kPairOfId;
  row_count_ = 0;
  std::fill_n(taken_.begin(), here_->found->pairs, std::uint8_t{0});
  if (count == 0) return;
  for (const Part& part : here_->found->parts)
    for (std::uint32_t pair = part.first * kWidth; pair < part.last * kWidth; ++pair) {
      if (here_->distance[pair] == kNone || (overlapping_ && here_->inner[pair] != 0)) continue;
      const std::uint64_t id = here_->found->id(part, pair);
      if (std::find(pressed.begin(), pressed.begin() + count, id) == pressed.begin() + count) continue;
      taken_[pair] = 1;
      add_row(id, here_->gap(pair), part.object->friction);
      if (row_count_ == kMaxContacts) return;
    }
}

Tool::Way Tool::solve(const Way& wish, double dt) noexcept {
  ++result_.solves;
  SolverBody body;
  body.inverse_mass.diagonal().head<3>().setConstant(1 / grip_.stiffness);
  body.inverse_mass.diagonal().tail<3>().setConstant(1 / grip_.rotational_stiffness);
  body.velocity << wish.linear / dt, wish.turn / dt;
  solver_.begin();
  for (std::size_t i = 0; i < row_count_; ++i) solver_.add(rows_[i]);
  const SolverResult& solved = solver_.solve({&body, 1}, dt);
  result_.work += static_cast<std::uint32_t>(solved.sweeps) * solved.contacts;
  return {body.velocity.head<3>() * dt, body.velocity.tail<3>() * dt};
}

/// Adds the pairs that `way` would bring too near, the worst of each kind; false when there is none.
bool Tool::add_violated(const Way& way, double dt) noexcept {
  constexpr int kAtOnce = 4;
  const float lx = static_cast<float>(way.linear.x()), ly = static_cast<float>(way.linear.y()),
              lz = static_cast<float>(way.linear.z());
  const float tx = static_cast<float>(way.turn.x()), ty = static_cast<float>(way.turn.y()),
              tz = static_cast<float>(way.turn.z());
  const auto collision_margin = static_cast<float>(settings_.collision_margin),
             touching = static_cast<float>(kTouching) * collision_margin;
  const auto share = static_cast<float>(std::min(1.0, SolverSettings{}.push_out_rate * dt)),
             max = static_cast<float>(settings_.push_out * dt);
  constexpr float kOff = static_cast<float>(kLinear);
  const Nearby& near = *here_;
  std::uint32_t count = 0;
  for (std::uint32_t pair = 0; pair < here_->found->pairs; ++pair) {
    const float gap = near.distance[pair] - collision_margin;
    const float ax = near.arm[0][pair], ay = near.arm[1][pair], az = near.arm[2][pair];
    const float closing = near.normal[0][pair] * (lx + ty * az - tz * ay) +
                          near.normal[1][pair] * (ly + tz * ax - tx * az) +
                          near.normal[2][pair] * (lz + tx * ay - ty * ax);
    // As the solver has it: a gap may be closed, an overlap must not grow, and a large one shrinks.
    const float min = gap >= 0 ? -gap : push_ ? std::min(max, share * std::max(0.0f, -gap - touching)) : 0;
    excess_[pair] = closing - min;
    if (closing < min - kOff && taken_[pair] == 0 && near.distance[pair] < kNone &&
        !(overlapping_ && near.inner[pair] != 0))
      violated_[count++] = pair;
  }
  if (count == 0) return false;
  bool added = false;
  for (int i = 0; i < kAtOnce && count > 0; ++i) {
    std::uint32_t worst = violated_[0];
    for (std::uint32_t k = 1; k < count; ++k)
      if (excess_[violated_[k]] < excess_[worst]) worst = violated_[k];
    const Part& part = here_->found->part(worst);
    const Gap gap = near.gap(worst);
    const std::size_t before = row_count_;
    add_row(here_->found->id(part, worst), gap, part.object->friction);
    if (row_count_ == before) return added;
    added = true;
    taken_[worst] = 1;
    // What pushes in nearly the same place and direction may be met by this one.
    std::uint32_t kept = 0;
    const double alike = 0.02 * probe_.radius();
    for (std::uint32_t k = 0; k < count; ++k) {
      const Gap other = near.gap(violated_[k]);
      if (other.normal.dot(gap.normal) > 0.95 && (other.arm - gap.arm).squaredNorm() < alike * alike) continue;
      violated_[kept++] = violated_[k];
    }
    count = kept;
  }
  return added;
}

// ---- look and go ----

/// Where `way` leads. `again` > 0: what comes too near becomes a row, under that number.
Tool::Look Tool::look(const Way& way, int again, spm::Span<const ToolObject> objects) noexcept {
  const double collision_margin = settings_.collision_margin;
  Nearby& there = *there_;
  const double length = longest(way);
  const ToolPose after = moved(pose_, way);
  const bool again_will_do = here_->went + length <= here_->found->margin - collision_margin - kFloatRoom;
  if (!(again_will_do ? measure_again(after, length, there)
                      : gather(after, (1 + kMargin) * collision_margin + kFloatRoom, ~0u, ~0u, objects, there)))
    return Look::kBlocked;
  // What meets already is known by name.
  if (std::max(here_->nearest, 0.0) + std::max(there.nearest, 0.0) <= length && !overlapping_) return Look::kBlocked;
  if (there.nearest >= (1 - kLookAgain) * collision_margin) return Look::kFree;
  constexpr std::size_t kMax = 6;
  std::array<std::uint32_t, kMax> worst;
  std::size_t count = 0;
  for (const Part& part : there.found->parts)
    for (std::uint32_t pair = part.first * kWidth; pair < part.last * kWidth; ++pair) {
      const double distance = there.distance[pair];
      if (distance >= (1 - kLookAgain) * collision_margin || (overlapping_ && distance > 0 && there.inner[pair] != 0))
        continue;
      if (distance < (1 - kBlocked) * collision_margin) {  // only what was as near before
        const std::uint64_t id = there.found->id(part, pair);
        const auto before = std::lower_bound(overlaps_.begin(), overlaps_.end(), id,
                                             [](const Overlap& o, std::uint64_t wanted) { return o.id < wanted; });
        if (before == overlaps_.end() || before->id != id || distance < before->distance - kMeeting)
          return Look::kBlocked;
        continue;
      }
      std::size_t to = count;
      if (count < kMax) {
        ++count;
      } else {
        to = static_cast<std::size_t>(
            std::max_element(worst.begin(), worst.end(),
                             [&](std::uint32_t a, std::uint32_t b) { return there.distance[a] < there.distance[b]; }) -
            worst.begin());
        if (there.distance[worst[to]] <= there.distance[pair]) continue;
      }
      worst[to] = pair;
    }
  if (count == 0) return Look::kFree;
  if (again == 0) return Look::kTooNear;
  // The gap there, told as one from here.
  const Eigen::Quaterniond turn = exp_map(way.turn);
  for (std::size_t i = 0; i < count; ++i) {
    Gap gap = there.gap(worst[i]);
    const Vec3d arm = turn.conjugate() * gap.arm;
    gap.distance -= gap.normal.dot(way.linear + gap.arm - arm);
    gap.arm = arm;
    const Part& part = there.found->part(worst[i]);
    add_row(there.found->id(part, worst[i]) | static_cast<std::uint64_t>(again) << kAgainShift, gap,
            part.object->friction);
  }
  return Look::kTooNear;
}

/// What a change of a surface left nearer than a way may lead: it must not come nearer still.
void Tool::find_overlaps() noexcept {
  overlaps_.clear();
  overlapping_ = here_->nearest <= 0;
  const double known = (1 - kBlocked) * settings_.collision_margin + kMeeting;
  if (here_->nearest >= known) return;
  for (const Part& part : here_->found->parts)
    for (std::uint32_t pair = part.first * kWidth; pair < part.last * kWidth; ++pair) {
      const float distance = here_->distance[pair];
      if (distance == kNone) continue;
      if (distance <= kMeeting || (overlapping_ && here_->inner[pair] != 0))
        overlaps_.push_back({here_->found->id(part, pair), -kNone});
      else if (distance < known)
        overlaps_.push_back({here_->found->id(part, pair), distance});
    }
  std::sort(overlaps_.begin(), overlaps_.end(), [](const Overlap& a, const Overlap& b) { return a.id < b.id; });
}

/// Along the normals of what is too near, outer ones where it meets, at `push_out`, and with the device where that
/// leads nearer to nothing, no faster out than the device pulls. Without turning, without the solver, which such a tool
/// keeps busy until the budget is gone, and without a look where it leads, which finds every way blocked.
Tool::Step Tool::come_out(const ToolPose& device, double dt, double limit) noexcept {
  constexpr int kPasses = 2;
  Vec3d out = Vec3d::Zero(), along = to_device(device).linear;
  double nearest = std::numeric_limits<double>::infinity();
  for (int pass = 0; pass < kPasses; ++pass)
    for (const Part& part : here_->found->parts)
      for (std::uint32_t pair = part.first * kWidth; pair < part.last * kWidth; ++pair) {
        const double distance = here_->distance[pair];
        if (distance == kNone || (overlapping_ && distance > 0 && here_->inner[pair] != 0)) continue;
        const Gap gap = here_->gap(pair);
        along -= std::min(0.0, along.dot(gap.normal)) * gap.normal;
        if (pass > 0 || distance >= blocked()) continue;
        out += (settings_.collision_margin - distance) * gap.normal;
        if (distance >= nearest) continue;
        nearest = distance;
        result_.object = part.object->index;
        result_.face = here_->found->blocks[pair / kWidth].face_id[pair % kWidth];
        result_.point = pose_.position + gap.arm;
      }
  Way way;
  if (out.squaredNorm() > 0) {
    result_.normal = out.normalized();
    way.linear = settings_.push_out * dt * result_.normal;
    const double pulled = std::max(0.0, to_device(device).linear.dot(result_.normal));
    along -= std::max(0.0, along.dot(result_.normal) - pulled) * result_.normal;
  }
  const double max = std::min(limit, settings_.collision_margin), size = along.norm();
  way.linear += size > max ? Vec3d(along * (max / size)) : along;
  result_.contacts = 1;
  pose_ = moved(pose_, way);
  have_here_ = false;
  held_back_ = Way{};
  row_count_ = 0;
  return {longest(way), true};
}

Tool::Step Tool::step_towards(const ToolPose& device, double dt, double limit,
                              spm::Span<const ToolObject> objects) noexcept {
  constexpr int kRounds = 10, kLooks = 3, kHalvings = 3;
  ++result_.steps;
  const double collision_margin = settings_.collision_margin;
  if (!have_here_) {
    // One look around does for a short way; for a longer one it takes another at its end.
    const double wanted = std::min(longest(to_device(device)), limit);
    const double beyond =
        wanted < kShort * collision_margin ? std::max(wanted, kMargin * collision_margin) : kMargin * collision_margin;
    if (!gather(pose_, collision_margin + beyond + 2 * kFloatRoom, ~0u, ~0u, objects, *here_)) return {};
    have_here_ = true;
  }
  find_overlaps();
  const bool too_near = here_->nearest < (1 - 2 * kLookAgain) * collision_margin;
  result_.too_near = result_.too_near || too_near;
  caught_ = here_->nearest < blocked() && (caught_ || stuck_);
  if (caught_) return come_out(device, dt, limit);

  Way wish = to_device(device);
  const double need = longest(wish);
  const double longest_step =
      overlapping_ ? (2 - 2 * kBlocked) * collision_margin : std::max(kStep * collision_margin, here_->nearest);
  const double max = std::min({need, limit, longest_step});
  // A push out may exceed what the device asks for.
  const double allowed = std::max(max, too_near && push_ ? settings_.push_out * dt : 0);
  // Nearly all of a deep press is what the surfaces hold back, as they did before. A part of that does as well as the
  // whole, and lets the solver see what has changed.
  const double held = longest(held_back_), bound = std::max(kPress, 2 * device_went_);
  const double left_out = held > bound ? 1 - bound / held : 0;
  wish = wish - held_back_ * left_out;
  choose_first_rows();
  Way way;
  Look seen = Look::kTooNear;
  bool cut = false;
  for (int looks = kLooks; seen == Look::kTooNear && looks > 0; --looks) {
    for (int round = 0; round < kRounds && (round == 0 || result_.work < settings_.work); ++round) {
      way = solve(wish, dt);
      if (const double length = longest(way); length > allowed) {
        // What nothing holds back is cut to the step, and what is held back stays: so the surfaces around, not those
        // further on, and the whole press decide, and with it friction.
        cut = cut || length > max;
        const Way excess = way * (1 - allowed / length);
        wish = wish - excess;
        way = way - excess;
      }
      if (!add_violated(way, dt)) break;
    }
    seen = look(way, looks - 1, objects);
  }
  held_back_ = wish - way - held_back_ * -left_out;
  for (int halving = 0; seen == Look::kBlocked && halving < kHalvings; ++halving) {
    cut = true;
    way = way * 0.5;
    seen = look(way, 0, objects);
  }
  if (seen == Look::kBlocked) return {};
  pose_ = there_->pose;
  std::swap(here_, there_);
  return {longest(way), cut};
}

/// All of `wish` when nothing is near; false when that would take long to find out.
bool Tool::go_freely(const Way& wish, double margin, spm::Span<const ToolObject> objects) noexcept {
  constexpr std::uint32_t kFewPairs = 64, kLittleWork = 300;
  have_here_ = false;
  if (!gather(pose_, margin, kFewPairs, kLittleWork, objects, *here_) || here_->nearest < margin) return false;
  pose_ = moved(pose_, wish);
  have_here_ = false;
  held_back_ = Way{};
  row_count_ = 0;
  return true;
}

const ToolResult& Tool::step(const ToolPose& at, double dt, spm::Span<const ToolObject> objects,
                             bool surface_changed) noexcept {
  if (!at.position.allFinite() || !at.orientation.coeffs().allFinite() || !(at.orientation.norm() > 0.5) || !(dt > 0))
    return result_;
  const ToolPose device{at.position, at.orientation.normalized()};
  const bool outside_only = result_.outside_only, was_in_contact = result_.in_contact;
  const Vec3d normal = result_.normal, point = result_.point;
  result_ = ToolResult{};
  result_.normal = normal;
  result_.point = point;
  if (surface_changed) have_here_ = false;
  if (!started_ || outside_only) {
    pose_ = device;
    const double margin = settings_.collision_margin + kFloatRoom;
    result_.outside_only =
        !gather(pose_, margin, ~0u, ~0u, objects, *here_) || here_->nearest < settings_.collision_margin;
    started_ = true;
    caught_ = stuck_ = false;
    owed_ = 0;
    held_back_ = Way{};
    row_count_ = 0;
  } else {
    device_went_ = longest({device.position - device_before_.position,
                            log_map(device.orientation * device_before_.orientation.conjugate())});
    if (was_in_contact) owed_ = 0;
    owed_ += kAlong * device_went_;
    const double limit = std::min(settings_.longest_way, owed_ + settings_.max_yield / grip_.stiffness * dt);
    const Way wish = to_device(device);
    const double need = longest(wish);
    const bool free =
        !was_in_contact && need <= limit && go_freely(wish, settings_.collision_margin + need + kFloatRoom, objects);
    double went = free ? need : 0;
    for (std::uint32_t i = 0; !free && i < settings_.steps; ++i) {
      push_ = i == 0;
      const Step step = step_towards(device, dt, limit - went, objects);
      went += step.length;
      result_.lagging = step.cut;
      if (caught_) break;
      if (!step.cut || step.length <= 0 || went >= 0.99 * limit) break;
    }
    stuck_ = have_here_ && went <= 0 && here_->nearest < blocked();
    owed_ = result_.lagging ? std::max(0.0, owed_ - went) : 0;
  }
  device_before_ = device;
  tell(device);
  return result_;
}

void Tool::tell(const ToolPose& device) noexcept {
  result_.pose = pose_;
  if (result_.outside_only) return;
  result_.displacement = pose_.position - device.position;
  result_.rotation = log_map(pose_.orientation * device.orientation.conjugate());
  Vec3d normal = Vec3d::Zero(), point = Vec3d::Zero();
  double whole = 0, max = 0;
  result_.in_contact = caught_;
  if (caught_) return;
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
