#include "hrtc_service/servo/cycle.hpp"

#include <algorithm>
#include <limits>

#include "realtime/periodic_clock.hpp"

namespace tactus::hrtc_service {
namespace {

constexpr std::uint32_t kAllProbes = (1u << kMaxProbes) - 1;

std::uint32_t lap_ns(std::int64_t& mark) noexcept {
  const std::int64_t now = realtime::monotonic_ns();
  const auto passed = static_cast<std::uint32_t>(now - mark);
  mark = now;
  return passed;
}

}  // namespace

Cycle::Cycle(const CycleSettings& settings, const std::array<haptics::DeviceSpec, kMaxProbes>& specs,
             DepartureRing& departures, LogRing* log)
    : settings_{settings},
      reach_{std::max(settings.radius, shape_of_probe(settings.tool, settings.radius).reach())},
      departures_{departures},
      query_{settings.radius, log},
      targets_{settings.targets} {
  objects_.reserve(kMaxObjects);
  withdrawn_.reserve(kMaxObjects);
  departed_.reserve(departures.write_available());
  dropped_pages_.reserve(2 * departures.write_available());
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
    surfaces_[i].set_caches(&candidate_caches_);
    spheres_.emplace_back(settings.radius);
    forces_.emplace_back(settings.force, specs[i]);
    if (settings.tool != nullptr) tools_.emplace_back(*settings.tool);
  }
}

std::uint64_t Cycle::movable_objects_at(std::uint32_t probe, const Vec3d& proxy) const noexcept {
  constexpr double kMargin = 0.001;  // m
  std::uint64_t found = 0;
  for (const TouchObject* object : objects_)
    if (can_move(object->index) && is_near(probe, *object) &&
        sharing::overlaps_bounds(placement(*object), object->bounds, proxy, reach_ + kMargin))
      found |= std::uint64_t{1} << object->index;
  return found;
}

void Cycle::stop(haptics::Fault fault) noexcept {
  if (observer_ != nullptr) observer_->stopped(fault);
  stop_fault_ = fault;
  for (haptics::ForceRenderer& force : forces_) force.latch(fault);
}

void Cycle::reset_faults() noexcept {
  if (observer_ != nullptr) observer_->reset();
  stop_fault_ = haptics::Fault::kNone;
  for (haptics::ForceRenderer& force : forces_) force.reset();
}

void Cycle::move(const TouchObject& object, const Placement& placement) noexcept {
  if (!placement.valid() || std::find(objects_.begin(), objects_.end(), &object) == objects_.end()) return;
  if (observer_ != nullptr) observer_->moved(object, placement);
  ObjectState& state = states_[object.index];
  const Vec3d centre = 0.5 * (object.bounds.low + object.bounds.high);
  const bool appears = (placement.to_world(centre) - state.placement.to_world(centre)).norm() > kMaxStep;
  if (!state.moved) state.previous_placement = state.placement;
  state.moved = !appears;
  state.placement = placement;
  if (appears) {
    state.changed = kAllProbes;
    for (UnchangedSphere& unchanged : state.unchanged) unchanged.appeared = true;
  }
  moved_objects_ |= std::uint64_t{1} << object.index;
}

const TouchObject& Cycle::object(std::uint32_t index) const noexcept {
  return **std::find_if(objects_.begin(), objects_.end(), [&](const auto* one) { return one->index == index; });
}

// ---- touch ----

const CycleResult& Cycle::touch(const std::array<ProbeInput, kMaxProbes>& probes, std::int64_t now_ns,
                                const Arrival* arrivals, std::uint32_t arrival_count) noexcept {
  std::int64_t mark = touch_began_ns_ = realtime::monotonic_ns();
  CycleCosts& costs = result_.costs;
  for (std::uint32_t i = 0; i < arrival_count; ++i) process_arrival(arrivals[i]);
  costs.arrivals = arrival_count;
  costs.load = lap_ns(mark);
  costs.query = costs.force = 0;
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
    const ProbeInput& input = probes[i];
    near_[i] = input.active ? input.near.at(input.device.position) | moved_objects_ : 0;
    tips_[i] = {input.device.position, input.device.velocity};
    surfaces_[i].clear();
    if (!input.active) {
      reset_probe(i);
      continue;
    }
    const bool all_have_meshes = gather_surface(i);
    ProbeOutput output;
    output.active = true;
    output.device = plain(input.device.position);
    output.velocity = plain(input.device.velocity);
    output.pose_age = static_cast<float>(input.pose_age);
    output.pose_sequence = input.device.sequence;
    if (result_.nodes_full) output.status |= session::kPoolFull;
    if (result_.budget_spent) output.status |= session::kBudgetSpent;
    if (result_.targets_dropped) output.status |= session::kTargetsDropped;
    if (tools_.empty())
      query_.run(i, input.device.position, now_ns, surfaces_[i], cycles_since_change_, output);
    else if (query_.is_logging())
      query_.run(i, tools_[i].coupling_point(), now_ns, surfaces_[i], cycles_since_change_, output);
    costs.query += lap_ns(mark);
    render(i, input, output);
    if (!all_have_meshes) {
      output.status &= ~static_cast<std::uint32_t>(session::kExact);
      output.error_bound = std::numeric_limits<float>::max();
    }
    costs.force += lap_ns(mark);
    result_.probes[i] = output;
  }
  for (const TouchObject* object : objects_) states_[object->index].moved = false;
  if (observer_ != nullptr) observer_->touched(probes, now_ns, arrivals, arrival_count, result_);
  return result_;
}

void Cycle::process_arrival(const Arrival& arrival) noexcept {
  switch (arrival.kind) {
    case Arrival::Kind::kObject:
      TACTUS_ASSERT(objects_.size() + withdrawn_.size() < kMaxObjects);
      objects_.push_back(arrival.object);
      ++objects_changed_;
      states_[arrival.object->index].placement = arrival.object->placement;
      if (arrival.object->body && movable_count_ < kMaxBodies) {
        ++movable_count_;
        movable_ |= std::uint64_t{1} << arrival.object->index;
      }
      set_reach();
      break;
    case Arrival::Kind::kRegion:
      arrival.object->forest->add(arrival.region, arrival.list);
      break;
    case Arrival::Kind::kPage:
      arrival.object->forest->add(*arrival.page);
      break;
    case Arrival::Kind::kDropPage:
      arrival.object->forest->remove(*arrival.page);
      // The intake drops no further pages while it cannot answer. If it did, this page would be freed with its object.
      if (dropped_pages_.size() < dropped_pages_.capacity())
        dropped_pages_.push_back({arrival.object->index, spm::RegionId{spm::kNone}, arrival.page});
      break;
    case Arrival::Kind::kRetire:
      arrival.object->forest->retire(arrival.region);
      break;
    case Arrival::Kind::kWithdraw:
      withdraw(*arrival.object);
      break;
  }
}

/// Refinement of a region may move the surface by up to the object's deviation.
void Cycle::set_reach() noexcept {
  double reach = haptics::ProxySettings{}.reach;
  for (const TouchObject* object : objects_)
    reach = std::max(reach, object->deviation * object->placement.scale() + settings_.radius);
  for (SphereTouch& sphere : spheres_) sphere.set_reach(reach);
}

void Cycle::withdraw(TouchObject& object) noexcept {
  const std::uint64_t bit = std::uint64_t{1} << object.index;
  objects_.erase(std::find(objects_.begin(), objects_.end(), &object));
  set_reach();
  withdrawn_.push_back(&object);
  ++objects_changed_;
  object.forest->store_previous(false);
  object.forest->withdraw();
  if ((movable_ & bit) != 0) --movable_count_;
  movable_ &= ~bit;
  moved_objects_ &= ~bit;
  states_[object.index] = {};
  cycles_since_change_[object.index] = 0;
  clear_gathered_pairs();
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
    near_[i] &= ~bit;
    const bool held = held_[i].lose_object(object.index);
    ProbeOutput& output = result_.probes[i];
    if (held || output.object == object.index) forces_[i].release();
    if (output.object == object.index) output.object = spm::kNone;
  }
}

/// Resets a probe without a user, so that the next user does not start with the state of the previous one.
void Cycle::reset_probe(std::uint32_t number) noexcept {
  held_[number].reset();
  if (result_.probes[number].active) {
    spheres_[number].reset();
    if (!tools_.empty()) tools_[number].reset();
    forces_[number].reset();
    if (stop_fault_ != haptics::Fault::kNone) forces_[number].latch(stop_fault_);
  }
  result_.probes[number] = ProbeOutput{};
}

/// Adds the objects near the probe to its surface. Returns false if one of them has no mesh yet.
bool Cycle::gather_surface(std::uint32_t number) noexcept {
  bool all_have_meshes = true;
  for (const TouchObject* object : objects_) {
    if (!is_near(number, *object)) continue;
    const ObjectState& state = states_[object->index];
    if (object->forest->is_base_shown())
      surfaces_[number].add(*object, state.placement, state.moved ? &state.previous_placement : nullptr,
                            state.unchanged[number]);
    else
      all_have_meshes = false;
  }
  return all_have_meshes;
}

void Cycle::render(std::uint32_t number, const ProbeInput& input, ProbeOutput& output) noexcept {
  ObjectsSurface& surface = surfaces_[number];
  haptics::ForceRenderer& renderer = forces_[number];
  HeldObject& hand = held_[number];
  bool changed = false, changed_here = false;
  for (std::uint32_t i = 0; i < surface.count(); ++i) {
    changed = changed || cycles_since_change_[surface[i].index] == 0;
    changed_here = changed_here || (states_[surface[i].index].changed >> number & 1u) != 0;
  }
  const ProbeStep step{input, surface, changed, changed_here, settings_.period, renderer, output};
  if (input.failed) renderer.latch(haptics::Fault::kDeviceFailed);
  with_probe(number, [&](auto& probe) {
    if (const std::uint32_t held = hand.release_if_open(input.device); held != spm::kNone) {
      const ObjectState& state = states_[held];
      hand.follow_object(step, object(held), state.moved ? state.previous_placement : state.placement, state.placement);
      probe.move_to(step, hand.state().hold.pose);
      add_force(hand.render(step, settings_.force.zero_force_age), output);
      return;
    }
    add_force(probe.render(step), output);
    if (output.object != spm::kNone)
      hand.hold_if_closed(step, probe.coupling_point(), states_[output.object].placement, can_move(output.object));
  });
}

void Cycle::add_force(const haptics::ForceResult& force, ProbeOutput& output) noexcept {
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

// ---- refine ----

const CycleResult& Cycle::refine(spm::Budget budget, const RefineLimit& limit) noexcept {
  std::int64_t mark = realtime::monotonic_ns();
  double began = 0;  // start of the first portion
  CycleCosts& costs = result_.costs;
  costs.visits = costs.changes = costs.nodes_marked = costs.granted = costs.predicted_total = 0;
  result_.budget_spent = result_.nodes_full = result_.targets_dropped = false;
  departed_.clear();
  spm::Budget granted;
  coarsen_withdrawn(budget, granted, limit, began);
  // Near a surface a user may feel a change of the mesh, so the forest stores the previous version.
  bool is_near_surface = false;
  for (const SphereTouch& sphere : spheres_) is_near_surface = is_near_surface || sphere.proxy().last().near_surface;
  for (TouchObject* object : objects_) {
    object->forest->store_previous(is_near_surface);
    const spm::Forest& forest = *object->forest;
    const spm::ForestCounters before = forest.counters();
    const bool base_was_shown = forest.is_base_shown();
    select_targets(*object);
    const spm::Advance result = advance(*object, budget, granted, limit, began);
    result_.budget_spent =
        result_.budget_spent || result == spm::Advance::kBudget || result == spm::Advance::kPreviousFull;
    result_.nodes_full = result_.nodes_full || result == spm::Advance::kNodesFull;
    const std::uint32_t changes = count_work(forest, before);
    reset_changes(*object, changes, !base_was_shown && forest.is_base_shown());
    return_retired_regions(*object);
  }
  costs.refine = lap_ns(mark);
  for (TouchObject* object : objects_) costs.nodes_marked += refit(*object);
  for (TouchObject* object : withdrawn_) costs.nodes_marked += object->forest->refit().marked;
  return_dropped_pages();
  return_removed_objects();
  costs.refit = lap_ns(mark);
  if (observer_ != nullptr) observer_->refined(*this, departed_, departures_.write_available() > 0);
  return result_;
}

/// Adds the work of a forest since `before` to the costs. Returns its number of splits and collapses.
std::uint32_t Cycle::count_work(const spm::Forest& forest, const spm::ForestCounters& before) noexcept {
  const spm::ForestCounters& after = forest.counters();
  const auto changes = static_cast<std::uint32_t>(after.splits - before.splits + after.collapses - before.collapses);
  result_.costs.visits += static_cast<std::uint32_t>(after.visits - before.visits);
  result_.costs.changes += changes;
  return changes;
}

/// Coarsens withdrawn objects with their share of the budget.
void Cycle::coarsen_withdrawn(spm::Budget& budget, spm::Budget& granted, const RefineLimit& limit,
                              double& began) noexcept {
  spm::Budget share{std::min(budget.units, kWithdrawnUnits)};
  budget.units -= share.units;
  for (TouchObject* object : withdrawn_) {
    const spm::ForestCounters before = object->forest->counters();
    (void)advance(*object, share, granted, limit, began);
    (void)count_work(*object->forest, before);
    return_retired_regions(*object);
  }
  budget.units += share.units;
}

/// Returns to the intake the pages that the grids no longer have, before their objects.
void Cycle::return_dropped_pages() noexcept {
  std::size_t returned = 0;
  for (;
       returned < dropped_pages_.size() && departures_.write_available() > 0 && departed_.size() < departed_.capacity();
       ++returned) {
    departed_.push_back(dropped_pages_[returned]);
    departures_.push(departed_.back());
  }
  dropped_pages_.erase(dropped_pages_.begin(), dropped_pages_.begin() + static_cast<std::ptrdiff_t>(returned));
}

/// Returns to the intake the withdrawn objects whose nodes and records are all free.
void Cycle::return_removed_objects() noexcept {
  for (auto at = withdrawn_.begin(); at != withdrawn_.end();) {
    TouchObject& object = **at;
    if (!object.forest->is_fully_hidden() || departures_.write_available() == 0 ||
        departed_.size() == departed_.capacity()) {
      ++at;
      continue;
    }
    departed_.push_back({.object = object.index});
    departures_.push(departed_.back());
    at = withdrawn_.erase(at);
  }
}

void Cycle::select_targets(TouchObject& object) noexcept {
  const double scale = placement(object).scale();
  targets_.begin(*object.forest, {settings_.refine_margin / scale, settings_.retain_margin / scale});
  for (std::uint32_t i = 0; i < kMaxProbes; ++i)
    if (is_near(i, object)) add_probe_targets(i, object);
  add_targets_under_bodies(object);
  const std::span<const spm::RegionId> targets = targets_.finish();
  object.forest->set_targets(targets.data(), static_cast<std::uint32_t>(targets.size()), spm::Unrequested::kRetain);
  result_.targets_dropped = result_.targets_dropped || !targets_.complete();
}

void Cycle::add_probe_targets(std::uint32_t number, const TouchObject& object) noexcept {
  const Placement& placement = this->placement(object);
  const auto place = [&](const TouchSphere& sphere) {
    return placed(sphere, placement, settings_.period, settings_.refine_ahead);
  };
  if (!tools_.empty()) {
    ToolTouch::Spheres in_world;
    for (const TouchSphere& sphere : tools_[number].spheres(in_world)) targets_.add_sphere(place(sphere));
    return;
  }
  targets_.add_sphere(place({tips_[number].position, tips_[number].velocity, settings_.radius}));
  if (result_.probes[number].object != object.index) return;
  // When a device is pressed into a surface, its proxy stays on the surface, away from the device. The proxy needs
  // targets, too.
  const double scale = placement.scale();
  targets_.add_soon(placement.to_model(vec(result_.probes[number].proxy)),
                    settings_.radius / scale + settings_.refine_margin / scale);
}

void Cycle::add_targets_under_bodies(const TouchObject& object) noexcept {
  if (object.body || movable_ == 0) return;
  const Placement& stands = placement(object);
  const auto has_hand_near = [&](const Vec3d& centre, double distance) {
    for (std::uint32_t i = 0; i < kMaxProbes; ++i)
      if (result_.probes[i].active && (tips_[i].position - centre).squaredNorm() < distance * distance) return true;
    return false;
  };
  for (const TouchObject* const body : objects_)
    if (can_move(body->index))
      for_each_sphere_under(*body->body, placement(*body), object.bounds, stands, has_hand_near,
                            [&](const Vec3d& place, double radius) { targets_.add_soon(place, radius); });
}

spm::Advance Cycle::advance(TouchObject& object, spm::Budget& budget, spm::Budget& granted, const RefineLimit& limit,
                            double& began) noexcept {
  CycleCosts& costs = result_.costs;
  spm::Advance result = object.forest->advance(granted);  // with units that earlier objects have not used
  while (result == spm::Advance::kBudget && budget.units > 0) {
    const auto now = static_cast<double>(realtime::monotonic_ns() - touch_began_ns_);
    const std::uint32_t spent = costs.granted - granted.units;
    if (costs.granted == 0)
      began = now;
    else if (!limit.allows(began, now, spent))
      break;
    costs.predicted_total = static_cast<std::uint32_t>(limit.predicted_end(now, spent));
    const std::uint32_t portion = std::min(kPortion, budget.units);
    budget.units -= portion;
    granted.units += portion;
    costs.granted += portion;
    result = object.forest->advance(granted);
  }
  return result;
}

/// Clears the marks of an object's changes. `refit` then sets them for the next touch.
void Cycle::reset_changes(const TouchObject& object, std::uint32_t changes, bool appeared) noexcept {
  ObjectState& state = states_[object.index];
  state.changed = appeared ? kAllProbes : 0;
  for (UnchangedSphere& unchanged : state.unchanged) {
    unchanged = UnchangedSphere{};
    unchanged.appeared = appeared;
  }
  std::uint32_t& since = cycles_since_change_[object.index];
  since = changes > 0 ? 0 : since + 1;
}

/// Returns to the intake the retired regions without applied records.
void Cycle::return_retired_regions(TouchObject& object) noexcept {
  while (departures_.write_available() > 0 && departed_.size() < departed_.capacity()) {
    const spm::RegionId region = object.forest->take_retired();
    if (region == spm::kNone) return;
    departed_.push_back({.object = object.index, .region = region});
    departures_.push(departed_.back());
  }
}

std::uint32_t Cycle::refit(TouchObject& object) noexcept {
  // A proxy is close to the faces that stop it. Changes further away do not move it.
  constexpr double kProxyMargin = 1.01;  // tip radii
  ObjectState& state = states_[object.index];
  const Placement& placement = state.moved ? state.previous_placement : state.placement;  // placement in the last touch
  const double scale = placement.scale();
  std::array<spm::ChangeDetector, kMaxProbes> change_detectors;
  std::array<std::uint32_t, kMaxProbes> probes;
  std::uint32_t count = 0;
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
    if (!is_near(i, object) || !tools_.empty()) continue;  // a tool detects changes itself
    probes[count] = i;
    change_detectors[count++] = {placement.to_model(vec(result_.probes[i].proxy)),
                                 kProxyMargin * settings_.radius / scale};
  }
  const spm::RefitCount refitted = object.forest->refit(change_detectors.data(), count);
  for (std::uint32_t i = 0; i < count; ++i) {
    if (change_detectors[i].is_changed) state.changed |= 1u << probes[i];
    UnchangedSphere& unchanged = state.unchanged[probes[i]];
    unchanged.centre = plain(change_detectors[i].centre);
    unchanged.squared_radius = change_detectors[i].squared_distance;
  }
  return refitted.marked;
}

}  // namespace tactus::hrtc_service
