#include "hrtc_service/cycle.hpp"

#include <algorithm>
#include <limits>

#include "hrtc_service/flight_recorder.hpp"
#include "hrtc_service/realtime.hpp"

namespace tactus::hrtc_service {
namespace {

constexpr std::uint32_t kAllProbes = (1u << kMaxProbes) - 1;

std::uint32_t since(std::int64_t& mark) noexcept {
  const std::int64_t now = monotonic_ns();
  const auto passed = static_cast<std::uint32_t>(now - mark);
  mark = now;
  return passed;
}

}  // namespace

Cycle::Cycle(const CycleSettings& settings, const std::array<haptics::DeviceSpec, kMaxProbes>& specs,
             DepartureRing& departures, LogRing* log)
    : settings_{settings}, departures_{departures}, log_{log} {
  objects_.reserve(kMaxObjects);
  haptics::ProxySettings proxy;
  proxy.radius = settings.radius;
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
    proxies_[i] = haptics::Proxy{proxy};
    surfaces_[i].set_caches(&candidate_caches_);
    forces_.emplace_back(settings.force, specs[i]);
    if (settings.tool != nullptr) tools_.emplace_back(*settings.tool);
  }
}

void Cycle::stop(haptics::Fault fault) noexcept {
  if (recorder_ != nullptr) recorder_->stopped(fault);
  stopped_ = fault;
  for (haptics::ForceRenderer& force : forces_) force.latch(fault);
}

void Cycle::reset_faults() noexcept {
  if (recorder_ != nullptr) recorder_->reset();
  stopped_ = haptics::Fault::kNone;
  for (haptics::ForceRenderer& force : forces_) force.reset();
}

void Cycle::move(const TouchObject& object, const Placement& placement) noexcept {
  if (!placement.valid()) return;
  if (recorder_ != nullptr) recorder_->moved(object, placement);
  ObjectState& state = states_[object.index];
  if (!state.moved) state.before = state.placement;
  state.moved = true;
  state.placement = placement;
  wandering_ |= std::uint64_t{1} << object.index;
}

void Cycle::take(const Arrival& arrival) noexcept {
  switch (arrival.kind) {
    case Arrival::Kind::kObject:
      if (objects_.size() < kMaxObjects) objects_.push_back(arrival.object);
      states_[arrival.object->index].placement = arrival.object->placement;
      if (arrival.object->body && movable_count_ < kMaxBodies) {
        ++movable_count_;
        movable_ |= std::uint64_t{1} << arrival.object->index;
      }
      // A region that refines may move the surface by as much as the object deviates.
      reach_ = std::max(reach_, arrival.object->deviation * arrival.object->placement.scale() + settings_.radius);
      for (haptics::Proxy& proxy : proxies_) proxy.set_reach(reach_);
      break;
    case Arrival::Kind::kRegion:
      arrival.object->forest->add(arrival.region, arrival.list);
      break;
    case Arrival::Kind::kRetire:
      arrival.object->forest->retire(arrival.region);
      break;
  }
}

void Cycle::add_target(spm::RegionId region, double key) noexcept {
  for (std::uint32_t i = 0; i < target_count_; ++i)
    if (targets_[i].region == region) {
      targets_[i].key = std::min(targets_[i].key, key);
      return;
    }
  if (target_count_ < kMaxTargets) targets_[target_count_++] = {region, key};
}

constexpr double kSoon = 1e12, kLeft = 2e12;  // what orders targets by how urgent they are

/// As for a tip, for each of the balls that a tool consists of; one look at the grid has to do for each.
void Cycle::choose_targets_along(const ToolTouch& tool, const TouchObject& object) noexcept {
  const spm::Forest& forest = *object.forest;
  const Placement& placement = this->placement(object);
  const double scale = placement.scale();
  for (std::uint32_t b = 0; b < tool.spheres(); ++b) {
    const ToolTouch::Sphere sphere = tool.sphere(b);
    const Vec3d centre = placement.to_model(sphere.centre + sphere.velocity * settings_.period);
    const Vec3d ahead = placement.direction_to_model(sphere.velocity) * (settings_.refine_ahead / scale);
    const double radius = sphere.radius / scale, reach = radius + ahead.norm() / 2;
    const double soon = reach + settings_.refine_margin / scale;
    forest.grid().for_each_meeting(centre + ahead / 2, reach + settings_.keep_margin / scale,
                                   [&](spm::RegionId region, double squared) {
                                     if (squared > soon * soon) {
                                       if (forest.is_refined(region)) add_target(region, kLeft + squared);
                                       return;
                                     }
                                     const double now = forest.grid().squared_distance(region, centre);
                                     add_target(region, now <= radius * radius ? now : kSoon + squared);
                                   });
  }
}

/// What stands is to be fine where bodies near a hand stand on it.
void Cycle::choose_targets_under_bodies(const TouchObject& object) noexcept {
  if (object.body || movable_ == 0) return;
  const Placement& stands = placement(object);
  const double around = sharing::kAroundBody / stands.scale();
  for (const TouchObject* const body : objects_) {
    if ((movable_ >> body->index & 1u) == 0) continue;
    const Placement& moved = placement(*body);
    const double near = body->body->settings.half.norm() + kHandNear;
    const Vec3d centre = sharing::centre_of(*body->body, moved);
    bool handled = false;
    for (std::uint32_t i = 0; i < kMaxProbes; ++i)
      handled = handled || (result_.probes[i].active && (tips_[i].position - centre).squaredNorm() < near * near);
    if (!handled) continue;
    sharing::for_each_place_beside(*body->body, moved, stands, object.bounds, [&](const Vec3d& place) {
      object.forest->grid().for_each_meeting(
          place, around, [&](spm::RegionId region, double squared) { add_target(region, kSoon + squared); });
    });
  }
}

void Cycle::choose_targets(TouchObject& object) noexcept {
  // First what a tip meets, then what it is about to meet, last what it has just left; in each by distance.
  target_count_ = 0;
  const spm::Forest& forest = *object.forest;
  const Placement& placement = this->placement(object);
  const double scale = placement.scale();
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
    if (!is_near(i, object)) continue;
    if (!tools_.empty()) {
      choose_targets_along(tools_[i], object);
      continue;
    }
    const Tip& tip = tips_[i];
    const Vec3d centre = placement.to_model(tip.position + tip.velocity * settings_.period);
    const double radius = settings_.radius / scale;
    const Vec3d ahead = placement.direction_to_model(tip.velocity) * (settings_.refine_ahead / scale);
    const double half = ahead.norm() / 2;
    const auto soon = [&](spm::RegionId region, double squared) { add_target(region, kSoon + squared); };
    forest.grid().for_each_meeting(centre, radius,
                                   [&](spm::RegionId region, double squared) { add_target(region, squared); });
    forest.grid().for_each_meeting(centre + ahead / 2, radius + half + settings_.refine_margin / scale, soon);
    if (result_.probes[i].object == object.index)  // the proxy lags behind a device that is pressed in
      forest.grid().for_each_meeting(placement.to_model(vec(result_.probes[i].proxy)),
                                     radius + settings_.refine_margin / scale, soon);
    forest.grid().for_each_meeting(centre, radius + half + settings_.keep_margin / scale,
                                   [&](spm::RegionId region, double squared) {
                                     if (forest.is_refined(region)) add_target(region, kLeft + squared);
                                   });
  }
  choose_targets_under_bodies(object);
  std::sort(targets_.begin(), targets_.begin() + target_count_, [](const Target& a, const Target& b) {
    return a.key != b.key ? a.key < b.key : spm::index(a.region) < spm::index(b.region);
  });
  for (std::uint32_t i = 0; i < target_count_; ++i) target_regions_[i] = targets_[i].region;
  object.forest->target(target_regions_.data(), target_count_, spm::Unrequested::kRest);
}

void Cycle::log(const TouchObject& object, std::uint32_t probe, std::int64_t now_ns, const Vec3d& centre, double radius,
                bool exact, std::uint32_t found, bool truncated) noexcept {
  entry_.time_ns = now_ns;
  entry_.object = object.index;
  entry_.probe = probe;
  entry_.centre = plain(centre);
  entry_.radius = radius;
  entry_.mesh_hash = object.forest->mesh_hash();
  entry_.since_change = states_[object.index].since_change;
  entry_.exact = exact;
  entry_.truncated = truncated || found > trace::LoggedQuery::kMaxContacts;
  entry_.contact_count = std::min(found, trace::LoggedQuery::kMaxContacts);
  for (std::uint32_t i = 0; i < entry_.contact_count; ++i)
    entry_.contacts[i] = {trace::triangle_key(object.forest->tree().corners(contacts_[i])),
                          static_cast<float>(contacts_[i].depth(centre, radius))};
  if (!log_->push(entry_)) ++log_dropped_;
}

void Cycle::query(std::uint32_t number, const Vec3d& tip, std::int64_t now_ns, ProbeOutput& output) noexcept {
  bool exact = tip.allFinite();
  float bound = exact ? 0 : std::numeric_limits<float>::max();
  const ObjectsSurface& surface = surfaces_[number];
  for (std::uint32_t i = 0; i < surface.count(); ++i) {
    const TouchObject& object = surface[i];
    const Placement& placement = surface.placement(i);
    const double scale = placement.scale();
    const Vec3d centre = placement.to_model(tip);
    const double radius = settings_.radius / scale;
    const bool object_exact = object.forest->exact(centre, radius);
    std::uint32_t found = object.forest->tree().touching(centre, radius, contacts_.data(), kMaxContacts);
    if (found > kMaxContacts) output.status |= session::kContactsTruncated;
    const bool truncated = found > kMaxContacts;
    const std::uint32_t held = std::min(found, kMaxContacts);
    if (object_exact) {  // a coarse face in a refined cell belongs elsewhere
      const auto end =
          std::remove_if(contacts_.begin(), contacts_.begin() + held, [](const spm::Contact& c) { return !c.last(); });
      found = static_cast<std::uint32_t>(end - contacts_.begin());
    } else {
      found = held;
      bound = std::max(bound, static_cast<float>(object.deviation * scale));
    }
    exact = exact && object_exact;
    output.contacts += found;
    if (log_ == nullptr) continue;
    bool in_cell = found > 0;
    if (!in_cell)
      object.forest->grid().for_each_meeting(centre, radius, [&](spm::RegionId, double) { in_cell = true; });
    if (in_cell) log(object, number, now_ns, centre, radius, object_exact, found, truncated);
  }
  if (exact) output.status |= session::kExact;
  output.error_bound = bound;
}

/// Where what the hand holds has come to; false when it holds nothing.
bool Cycle::find_held(std::uint32_t number, const ProbeInput& input) noexcept {
  Grasp& grasp = grasps_[number];
  Held& held = held_[number];
  held.object = spm::kNone;
  if ((input.device.buttons & haptics::kGrabButton) == 0) grasp = {};
  if (grasp.object == spm::kNone) return false;
  const auto object =
      std::find_if(objects_.begin(), objects_.end(), [&](const auto* one) { return one->index == grasp.object; });
  const ObjectState& state = states_[grasp.object];
  const Placement& now = state.placement;
  const Placement& before = state.moved ? state.before : now;
  const Eigen::Quaterniond turn{now.rotation()}, turn_before{before.rotation()};
  const Vec3d place = vec(grasp.place);
  held.object = grasp.object;
  held.hold.pose = {now.to_world(place), (turn * quaternion(grasp.orientation)).normalized()};
  held.hold.velocity = (held.hold.pose.position - before.to_world(place)) / settings_.period;
  held.hold.angular_velocity = haptics::log_map(turn * turn_before.conjugate()) / settings_.period;
  const session::Material& material = (*object)->material;
  held.feel = {material.stiffness, material.damping};
  held.grip = forces_[number].hold(held.feel, settings_.period, input.device.loop_delay);
  return true;
}

/// The force of what is held in place of that of the surface.
void Cycle::render_held(std::uint32_t number, const ProbeInput& input, ProbeOutput& output) noexcept {
  Held& held = held_[number];
  haptics::ForceRenderer& renderer = forces_[number];
  if (input.failed) renderer.latch(haptics::Fault::kDeviceFailed);
  const double age = input.pose_age - input.device.transit;
  const haptics::ForceResult& force =
      renderer.step(held.hold, held.grip, input.device, held.feel, age, settings_.period);
  held.pull = haptics::wrench_of(held.hold, held.grip, held.feel.damping, input.device, renderer.angular_velocity());
  output.proxy = plain(held.hold.pose.position);
  output.force = plain(force.force);
  output.torque = plain(force.torque);
  output.object = held.object;
  output.stiffness = static_cast<float>(held.grip.stiffness);
  output.status |= session::kInContact | session::kHolding;
  tell(force, output);
  // A hand that feels nothing any more holds nothing, or what it held would be far away when it feels again.
  if (force.fault == haptics::Fault::kNone && age < settings_.force.zero_by) return;
  grasps_[number] = {};
  grasps_[number].spent = true;
}

/// Takes hold of what was touched at `place`, for the next touch.
void Cycle::close_hand(std::uint32_t number, const ProbeInput& input, const Vec3d& place,
                       ProbeOutput& output) noexcept {
  Grasp& grasp = grasps_[number];
  if ((input.device.buttons & haptics::kGrabButton) == 0 || output.object == spm::kNone) return;
  const bool feels = (output.status & session::kFault) == 0;
  if (grasp.spent || !feels || (movable_ >> output.object & 1u) == 0) {
    output.status |= session::kHoldRefused;
    return;
  }
  const Placement& placement = states_[output.object].placement;
  grasp.object = output.object;
  grasp.place = plain(placement.to_model(place));
  grasp.orientation = plain(Eigen::Quaterniond{placement.rotation()}.conjugate() * input.device.orientation);
}

void Cycle::render(std::uint32_t number, const ProbeInput& input, ProbeOutput& output) noexcept {
  ObjectsSurface& surface = surfaces_[number];
  haptics::ForceRenderer& renderer = forces_[number];
  bool changed = false;
  haptics::Feel feel;
  const session::Material* material = nullptr;
  for (std::uint32_t i = 0; i < surface.count(); ++i) {
    changed = changed || (states_[surface[i].index].changed >> number & 1u) != 0;
    if (material == nullptr || surface[i].index == proxies_[number].last().object) material = &surface[i].material;
  }
  if (material != nullptr) {
    feel = {material->stiffness, material->damping};
    proxies_[number].set_grip({material->static_friction, material->dynamic_friction});
  }
  const haptics::Proxy before = proxies_[number];
  const bool starts = !before.started();
  const haptics::ProxyResult& proxy = proxies_[number].step(input.device.position, settings_.period, surface, changed);
  if (find_held(number, input)) return render_held(number, input, output);
  if (input.failed) renderer.latch(haptics::Fault::kDeviceFailed);
  // Of what refinement has changed under the tip, what matters is where the proxy would be without.
  haptics::ProxyResult unchanged;
  const bool felt = changed || starts || surface.met_change();
  if (felt) {
    ObjectsSurface as_before = surface.on_meshes_before();
    unchanged = before.unchanged(input.device.position, settings_.period, as_before);
  }
  const haptics::ForceResult& force = renderer.step(proxy, input.device, feel, input.pose_age - input.device.transit,
                                                    settings_.period, felt ? &unchanged : nullptr);

  // The force is exact when the surface at the proxy is, too.
  if (proxy.in_contact && (output.status & session::kExact) != 0)
    tell_where_coarse(proxy.proxy, settings_.radius, number, output);
  output.proxy = plain(proxy.proxy);
  output.force = plain(force.force);
  output.object = proxy.in_contact ? proxy.object : spm::kNone;
  if (proxy.in_contact) {
    output.normal = plain(proxy.normal);
    output.stiffness = static_cast<float>(renderer.stiffness(feel, settings_.period, input.device.loop_delay));
  }
  if (proxy.in_contact) output.status |= session::kInContact;
  if (proxy.surface_moved) output.status |= session::kSurfaceMoved;
  tell(force, output);
  close_hand(number, input, proxy.anchor, output);
}

/// Not exact where some object is not the finest within `radius`.
void Cycle::tell_where_coarse(const Vec3d& centre, double radius, std::uint32_t number,
                              ProbeOutput& output) const noexcept {
  const ObjectsSurface& surface = surfaces_[number];
  for (std::uint32_t i = 0; i < surface.count(); ++i) {
    const TouchObject& object = surface[i];
    const double scale = surface.placement(i).scale();
    if (object.forest->exact(surface.placement(i).to_model(centre), radius / scale)) continue;
    output.status &= ~static_cast<std::uint32_t>(session::kExact);
    output.error_bound = std::max(output.error_bound, static_cast<float>(object.deviation * scale));
  }
}

void Cycle::render_tool(std::uint32_t number, const ProbeInput& input, ProbeOutput& output) noexcept {
  const ObjectsSurface& surface = surfaces_[number];
  haptics::ForceRenderer& renderer = forces_[number];
  ToolTouch& touch = tools_[number];
  bool changed = false;
  const session::Material* material = nullptr;
  for (std::uint32_t i = 0; i < surface.count(); ++i) {
    changed = changed || states_[surface[i].index].since_change == 0;
    if (material == nullptr || surface[i].index == touch.last().object) material = &surface[i].material;
  }
  const haptics::Feel feel =
      material != nullptr ? haptics::Feel{material->stiffness, material->damping} : haptics::Feel{};
  const haptics::ToolGrip grip = renderer.grip(feel, settings_.period, input.device.loop_delay);
  // A tool that holds something goes along with that.
  const bool holds = find_held(number, input);
  const haptics::ToolPose goal =
      holds ? held_[number].hold.pose : haptics::ToolPose{input.device.position, input.device.orientation};
  const haptics::ToolResult& tool = touch.step(goal, settings_.period, grip, surface, changed);
  if (holds) {
    output.orientation = plain(tool.pose.orientation);
    return render_held(number, input, output);
  }
  if (input.failed) renderer.latch(haptics::Fault::kDeviceFailed);
  // The damper rides along with what moves.
  haptics::DeviceState device = input.device;
  if (tool.in_contact)
    device.velocity -= (tool.point - surface.carried_from(tool.object, tool.point)) / settings_.period;
  const haptics::ForceResult& force =
      renderer.step(tool, grip, device, feel, input.pose_age - input.device.transit, settings_.period);
  output.status |= session::kExact;
  output.error_bound = 0;
  for (std::uint32_t b = 0; b < touch.spheres(); ++b) {
    const ToolTouch::Sphere sphere = touch.sphere(b);
    tell_where_coarse(sphere.centre, sphere.radius, number, output);
  }
  output.proxy = plain(tool.pose.position);
  output.orientation = plain(tool.pose.orientation);
  output.force = plain(force.force);
  output.torque = plain(force.torque);
  output.contacts = tool.contacts;
  output.object = tool.in_contact ? tool.object : spm::kNone;
  if (tool.in_contact) {
    output.normal = plain(tool.normal);
    output.stiffness = static_cast<float>(grip.stiffness);
    output.status |= session::kInContact;
  }
  if (tool.too_near) output.status |= session::kSurfaceMoved;
  tell(force, output);
  close_hand(number, input, tool.pose.position, output);
}

void Cycle::tell(const haptics::ForceResult& force, ProbeOutput& output) noexcept {
  if ((force.bits & haptics::kForceSaturated) != 0) output.status |= session::kForceSaturated;
  if ((force.bits & (haptics::kForceSoftStart | haptics::kForceSurfaceRamp | haptics::kForceSlewLimited)) != 0)
    output.status |= session::kForceRamped;
  if ((force.bits & haptics::kForceStiffnessCut) != 0) output.status |= session::kStiffnessCut;
  if ((force.bits & haptics::kForceStale) != 0) output.status |= session::kStalePose;
  if (force.fault != haptics::Fault::kNone)
    output.status |= session::kFault | static_cast<std::uint32_t>(force.fault) << session::kFaultReasonShift;
  if (force.began != 0)
    for (std::uint32_t bit = 0; bit < haptics::kForceBits; ++bit) result_.interventions[bit] += force.began >> bit & 1u;
}

const CycleResult& Cycle::touch(const std::array<ProbeInput, kMaxProbes>& probes, std::int64_t now_ns,
                                const Arrival* arrivals, std::uint32_t arrival_count) noexcept {
  std::int64_t mark = touch_began_ns_ = monotonic_ns();
  CycleCosts& costs = result_.costs;
  for (std::uint32_t i = 0; i < arrival_count; ++i) take(arrivals[i]);
  costs.arrivals = arrival_count;
  costs.load = since(mark);
  costs.query = costs.force = 0;
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
    const ProbeInput& input = probes[i];
    near_[i] = input.active ? input.near.at(input.device.position) | wandering_ : 0;
    tips_[i] = {input.device.position, input.device.velocity};
    ProbeOutput output;
    surfaces_[i].clear();
    if (!input.active) {
      grasps_[i] = {};
      held_[i].object = spm::kNone;
      if (result_.probes[i].active) {
        proxies_[i].reset();
        if (!tools_.empty()) tools_[i].reset();
        forces_[i].reset();
        if (stopped_ != haptics::Fault::kNone) forces_[i].latch(stopped_);
      }
      result_.probes[i] = output;
      continue;
    }
    bool all_shown = true;
    for (const TouchObject* object : objects_) {
      if (!is_near(i, *object)) continue;
      const ObjectState& state = states_[object->index];
      if (object->forest->base_shown())
        surfaces_[i].add(*object, state.placement, state.moved ? &state.before : nullptr, state.unchanged[i]);
      else
        all_shown = false;
    }
    output.active = true;
    output.device = plain(input.device.position);
    output.velocity = plain(input.device.velocity);
    output.pose_age = static_cast<float>(input.pose_age);
    output.pose_sequence = input.device.sequence;
    if (result_.nodes_full) output.status |= session::kPoolFull;
    if (result_.budget_spent) output.status |= session::kBudgetSpent;
    if (tools_.empty())
      query(i, input.device.position, now_ns, output);
    else if (log_ != nullptr)
      query(i, tools_[i].last().pose.position, now_ns, output);
    costs.query += since(mark);
    if (tools_.empty())
      render(i, input, output);
    else
      render_tool(i, input, output);
    if (!all_shown) {
      output.status &= ~static_cast<std::uint32_t>(session::kExact);
      output.error_bound = std::numeric_limits<float>::max();
    }
    costs.force += since(mark);
    result_.probes[i] = output;
  }
  for (const TouchObject* object : objects_) states_[object->index].moved = false;
  if (recorder_ != nullptr) recorder_->touched(probes, now_ns, arrivals, arrival_count, result_);
  return result_;
}

spm::Advance Cycle::advance(TouchObject& object, spm::Budget& budget, spm::Budget& granted, const RefineLimit& limit,
                            double& began) noexcept {
  CycleCosts& costs = result_.costs;
  spm::Advance result = object.forest->advance(granted);  // what the object before has left over
  while (result == spm::Advance::kBudget && budget.units > 0) {
    const auto now = static_cast<double>(monotonic_ns() - touch_began_ns_);
    const std::uint32_t spent = costs.granted - granted.units;
    if (costs.granted == 0)
      began = now;
    else if (!limit.allows(began, now, spent))
      break;
    costs.foreseen = static_cast<std::uint32_t>(limit.end(now, spent));
    const std::uint32_t portion = std::min(kPortion, budget.units);
    budget.units -= portion;
    granted.units += portion;
    costs.granted += portion;
    result = object.forest->advance(granted);
  }
  return result;
}

std::uint32_t Cycle::refit(TouchObject& object) noexcept {
  // A proxy rests within a hair of what holds it; what changes further away does not move it.
  constexpr double kHair = 1.01;
  const ObjectState& state = states_[object.index];
  const Placement& placement = state.moved ? state.before : state.placement;  // as of the last touch
  const double scale = placement.scale();
  std::array<spm::ChangeDetector, kMaxProbes> change_detectors;
  std::array<std::uint32_t, kMaxProbes> probes;
  std::uint32_t count = 0;
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
    if (!is_near(i, object) || !tools_.empty()) continue;  // a tool looks for itself
    probes[count] = i;
    change_detectors[count++] = {placement.to_model(vec(result_.probes[i].proxy)), kHair * settings_.radius / scale};
  }
  const spm::RefitCount refitted = object.forest->refit(change_detectors.data(), count);
  for (std::uint32_t i = 0; i < count; ++i) {
    if (change_detectors[i].met) states_[object.index].changed |= 1u << probes[i];
    Unchanged& unchanged = states_[object.index].unchanged[probes[i]];
    unchanged.centre = plain(change_detectors[i].centre);
    unchanged.squared_radius = change_detectors[i].squared_distance;
  }
  return refitted.marked;
}

const CycleResult& Cycle::refine(spm::Budget budget, const RefineLimit& limit) noexcept {
  std::int64_t mark = monotonic_ns();
  double began = 0;  // the first portion
  CycleCosts& costs = result_.costs;
  costs.visits = costs.changes = costs.nodes_marked = costs.granted = costs.foreseen = 0;
  result_.budget_spent = false;
  result_.nodes_full = false;
  spm::Budget granted;
  bool felt = false;  // what changes may be
  for (const haptics::Proxy& proxy : proxies_) felt = felt || proxy.last().near_surface;
  for (TouchObject* object : objects_) {
    object->forest->keep(felt);
    const spm::ForestCounters before = object->forest->counters();
    const bool shown = object->forest->base_shown();
    choose_targets(*object);
    const spm::Advance result = advance(*object, budget, granted, limit, began);
    result_.budget_spent = result_.budget_spent || result == spm::Advance::kBudget || result == spm::Advance::kKeptFull;
    result_.nodes_full = result_.nodes_full || result == spm::Advance::kNodesFull;
    const spm::ForestCounters& after = object->forest->counters();
    const auto changes = static_cast<std::uint32_t>(after.splits - before.splits + after.collapses - before.collapses);
    costs.visits += static_cast<std::uint32_t>(after.visits - before.visits);
    costs.changes += changes;
    ObjectState& state = states_[object->index];
    const bool appeared = !shown && object->forest->base_shown();
    state.changed = appeared ? kAllProbes : 0;
    for (Unchanged& unchanged : state.unchanged) {
      unchanged = Unchanged{};
      unchanged.appeared = appeared;
    }
    state.since_change = changes > 0 ? 0 : state.since_change + 1;
    for (std::uint32_t region;
         departures_.write_available() > 0 && (region = object->forest->take_retired()) != spm::kNone;) {
      departures_.push({object->index, spm::RegionId{region}});
      if (recorder_ != nullptr) recorder_->left(*object, spm::RegionId{region});
    }
  }
  costs.refine = since(mark);
  for (TouchObject* object : objects_) costs.nodes_marked += refit(*object);
  costs.refit = since(mark);
  if (recorder_ != nullptr) recorder_->refined(*this, departures_.write_available() > 0);
  return result_;
}

}  // namespace tactus::hrtc_service
