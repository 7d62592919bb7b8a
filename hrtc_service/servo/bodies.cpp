#include "hrtc_service/servo/bodies.hpp"

#include <algorithm>
#include <utility>

#include "hrtc_service/servo/shared_check.hpp"

namespace tactus::hrtc_service {
namespace {

// Time for which a body counts as held after the last touch, so that a bounce does not release it.
constexpr std::int64_t kReleaseDelayNs = 100'000'000;
// Time for which a released body is simulated without a new owner. Longer than a lease.
constexpr std::int64_t kMaxUnownedNs = 300'000'000;
// Number of peers' samples in one cycle. Peers send one in each of their cycles.
constexpr std::uint32_t kMaxCopyArrivals = 4 * kMaxBodies * haptics::kMaxCopies;

Placement placement_of(const haptics::BodyState& state, const TouchObject& object) {
  return Placement{sharing::pose_of(state, object.body->centre), object.placement.scale()};
}

/// Returns the ratio of the limited force to the force before the limits, at most 1.
double force_share(double limited, double unlimited) noexcept {
  return unlimited > 0 ? std::min(1.0, limited / unlimited) : 0.0;
}

/// Returns the factor that reduces `size` to `max`, at most 1.
double clamp_factor(double size, double max) noexcept { return size <= max ? 1.0 : max / size; }

/// Returns the part of `vector` that has the length `length`, at most the whole vector.
Vec3d part_of(const Vec3d& vector, double length) noexcept {
  return length > 0 ? Vec3d(std::min(1.0, length / vector.norm()) * vector) : Vec3d(Vec3d::Zero());
}

/// Returns the rendered force of a spring with a rest length. `rendered`: the force without the rest length, with the
/// limits of haptics/force.hpp; `whole`: before these limits; `wanted`: before these limits, with the rest length.
Vec3d with_rest_length(const Vec3d& rendered, const Vec3d& whole, const Vec3d& wanted, double strength,
                       double max) noexcept {
  if (wanted == whole) return rendered;
  // The part that remains after the limits on the change of the force.
  const double remains = force_share(rendered.norm(), strength * std::min(whole.norm(), max));
  return remains * strength * clamp_factor(wanted.norm(), max) * wanted;
}

/// Returns the force of a spring with a rest length as a share of the force without it.
double rest_factor(const haptics::LimitedSpring& spring, double length, double rest_length) noexcept {
  return rest_length > 0 ? spring.force(length - rest_length) / spring.force(length) : 1.0;
}

/// Returns the limits of a rotational port, for the wrist of a hand and a grip of some centimetres.
haptics::PassivitySettings rotational_port_settings() noexcept {
  haptics::PassivitySettings settings;
  settings.acceleration = 500;  // rad/s^2
  settings.min_speed = 0.02;    // rad/s
  settings.device_mass = 1e-4;  // kg m^2
  return settings;
}

}  // namespace

Bodies::Bodies(const CycleSettings& settings, BodyLink& link, BodyOrderLink& orders)
    : settings_{settings}, copies_{link.copies}, reports_out_{link.reports}, order_link_{orders} {
  for (RotationalPort& rotational : rotational_ports_)
    rotational.port = haptics::PassivityController{rotational_port_settings()};
  simulated_.resize(kMaxBodies, haptics::SharedObject{haptics::BodySettings{}});
}

std::uint32_t Bodies::body_of(std::uint32_t object) const noexcept {
  for (std::uint32_t i = 0; i < count_; ++i)
    if (bodies_[i].object->index == object) return i;
  return kMaxBodies;
}

void Bodies::add_new_bodies(const Cycle& cycle) noexcept {
  if (cycle.objects_changed() == objects_changed_) return;
  objects_changed_ = cycle.objects_changed();
  for (const TouchObject* const object : cycle.objects()) {
    if (!object->body || count_ == kMaxBodies || body_of(object->index) != kMaxBodies) continue;
    Body& body = bodies_[count_];
    body = Body{};
    body.object = object;
    body.state_in_cycle = object->body->start;
    body.pose_interpolator.set_state(body.state_in_cycle, 0);
    simulated_[count_] = haptics::SharedObject{object->body->settings, body.state_in_cycle};
    simulated_[count_].follow();
    ++count_;
  }
}

void Bodies::forget_withdrawn(const Cycle& cycle) noexcept {
  if (cycle.objects_changed() == objects_changed_) return;
  const std::vector<TouchObject*>& objects = cycle.objects();
  const auto present = [&](std::uint32_t body) {
    return std::find(objects.begin(), objects.end(), bodies_[body].object) != objects.end();
  };
  for (std::uint32_t p = 0; p < kMaxProbes; ++p) {
    if (springs_[p].body == kMaxBodies || present(springs_[p].body)) continue;
    reductions_[p].fading.set(reductions_[p].force);
    reductions_[p].fading_torque.set(reductions_[p].torque);
  }
  bool any = false;
  for (std::uint32_t i = 0; i < count_;) {
    if (present(i)) {
      ++i;
      continue;
    }
    any = true;
    if (--count_ == i) break;
    bodies_[i] = bodies_[count_];
    simulated_[i] = simulated_[count_];
  }
  if (!any) return;
  for (HandSpring& spring : springs_) spring.body = kMaxBodies;  // its index is from before the removal
  if (count_ > 0) return;
  energy_to_body_.fill(0);
  for (std::uint32_t p = 0; p < kMaxProbes; ++p) {  // `limit_forces` steps no port without bodies, so they reset here
    ports_[p].limited(Vec3d::Zero());
    rotational_ports_[p].port.limited(Vec3d::Zero());
    rotational_ports_[p].energy_to_body = 0;
  }
}

void Bodies::apply_coupling_order(std::uint32_t i) noexcept {
  Body& body = bodies_[i];
  haptics::CopyCoupling* const coupling = body.mode == Mode::kTouched ? body.order.coupling : nullptr;
  if (coupling == body.coupling) return;
  body.coupling = coupling;
  if (coupling != nullptr)
    simulated_[i].couple(*coupling);
  else
    simulated_[i].simulate_alone();
}

void Bodies::process_orders() noexcept {
  if (order_link_.orders.take(orders_)) {
    for (std::uint32_t k = 0; k < orders_.count; ++k) {
      newest_number_ = std::max(newest_number_, orders_.bodies[k].received.number);
      const std::uint32_t i = body_of(orders_.bodies[k].object);
      if (i == kMaxBodies) continue;
      bodies_[i].order = orders_.bodies[k];
      if (bodies_[i].mode != Mode::kFollows) apply_coupling_order(i);
    }
    order_link_.seen.store(orders_.number, std::memory_order_release);
  }
  CopyArrival arrived;
  for (std::uint32_t left = kMaxCopyArrivals; left > 0 && copies_.pop(arrived); --left) {
    const std::uint32_t i = body_of(arrived.object);
    if (i == kMaxBodies || bodies_[i].order.coupling == nullptr ||
        bodies_[i].order.coupling_fencing != arrived.coupling_fencing || !is_valid(arrived.sample))
      continue;
    bodies_[i].order.coupling->on_sample(arrived.copy_index, arrived.sample);
  }
}

void Bodies::set_pose(Cycle& cycle, Body& body, const haptics::BodyState& state) const noexcept {
  const bool moved = state.position != body.state_in_cycle.position ||
                     state.orientation.coeffs() != body.state_in_cycle.orientation.coeffs();
  body.state_in_cycle = state;
  if (moved) cycle.move(*body.object, placement_of(state, *body.object));
}

void Bodies::follow_if_superseded(Body& body, haptics::SharedObject& simulated, std::int64_t now_ns,
                                  std::int64_t session_ns) noexcept {
  const bool superseded = body.order.received.number > body.pose_number_at_release;
  if (!superseded && now_ns - body.released_ns < kMaxUnownedNs) return;
  body.mode = Mode::kFollows;
  body.pose_interpolator.set_state(simulated.state(), session_ns);
  body.interpolated_number = body.pose_number_at_release;
  simulated.follow();
}

void Bodies::forget_poses() noexcept {
  for (std::uint32_t i = 0; i < count_; ++i) bodies_[i].is_pose_unknown = true;
  forgotten_number_ = newest_number_;
}

std::uint64_t Bodies::unknown_poses() const noexcept {
  std::uint64_t objects = 0;
  for (std::uint32_t i = 0; i < count_; ++i)
    if (bodies_[i].is_pose_unknown) objects |= std::uint64_t{1} << bodies_[i].object->index;
  return objects;
}

void Bodies::apply_received_poses(Cycle& cycle, std::int64_t now_ns) noexcept {
  add_new_bodies(cycle);
  process_orders();  // also without bodies, so that no orders wait that name a freed coupling
  if (count_ == 0) return;
  const std::int64_t session_ns = orders_.clock.session_time(now_ns);
  for (std::uint32_t i = 0; i < count_; ++i) {
    Body& body = bodies_[i];
    const bool becomes_known = body.is_pose_unknown && body.order.received.number > forgotten_number_;
    if (becomes_known) body.is_pose_unknown = false;
    if (body.mode == Mode::kReleased) follow_if_superseded(body, simulated_[i], now_ns, session_ns);
    if (body.mode != Mode::kFollows) continue;
    if (body.order.received.number > body.interpolated_number) {
      // A pose replaces the start pose or an unknown one at once, without a fading jump.
      if (body.interpolated_number == 0 || becomes_known)
        body.pose_interpolator.set_state(body.order.received.state, body.order.received.session_ns);
      body.interpolated_number = body.order.received.number;
      body.pose_interpolator.on_pose(body.order.received, session_ns);
    }
    set_pose(cycle, body, body.pose_interpolator.state_at(session_ns));
  }
}

double Bodies::rest_length(const Cycle& cycle, std::uint32_t probe, const haptics::DeviceState& device,
                           double energy_to_body, const haptics::LimitedSpring& spring, double length) noexcept {
  const double energy = ports_[probe].energy_at(device.position, energy_to_body);
  return spring_limiters_[probe].step(cycle.renderer(probe).strength(), spring, length, energy);
}

haptics::ContactImpedance Bodies::stable_impedance(const session::Material& material,
                                                   const haptics::DeviceState& device) const noexcept {
  return haptics::ForceRenderer::with_stable_damping({material.stiffness, material.damping}, settings_.period,
                                                     device.round_trip);
}

/// A stale pose and a fault make a force zero at once.
Vec3d Bodies::slewed(const Vec3d& wanted, const Vec3d& felt, double max_slew, const haptics::ForceRenderer& renderer,
                     ProbeOutput& output) const noexcept {
  constexpr double kRounding = 1 + 1e-9;  // the renderer has limited its force in the same way
  const double max_change = max_slew * settings_.period;
  const bool must_end = (output.status & session::kFault) != 0 || renderer.strength() <= 0;
  if ((must_end && wanted.isZero(0)) || (wanted - felt).norm() <= max_change * kRounding) return wanted;
  output.status |= session::kForceRamped;
  return haptics::slewed(wanted, felt, max_change);
}

/// The passivity controller may reduce a force at once. The damping that it adds obeys the limit on the change of a
/// force, and does not act where no force is wanted.
Vec3d Bodies::damped(const Vec3d& allowed, const Vec3d& wanted, const Vec3d& felt, double max_slew) const noexcept {
  if (wanted.isZero(0)) return wanted;
  const Vec3d limited = haptics::slewed(allowed, felt, max_slew * settings_.period);
  if (limited.squaredNorm() >= allowed.squaredNorm()) return allowed;
  return limited.dot(allowed) > 0 ? limited : Vec3d(Vec3d::Zero());
}

Vec3d Bodies::limit_force(const Cycle& cycle, std::uint32_t probe, const Vec3d& force,
                          const haptics::DeviceState& device, double energy_to_body, double stored,
                          ProbeOutput& output) noexcept {
  const Vec3d limited = clamp_factor(force.norm(), cycle.renderer(probe).max_force()) * force;
  const double max_slew = settings_.force.max_slew;
  const Vec3d wanted = slewed(limited, felt_[probe].force, max_slew, cycle.renderer(probe), output);
  Vec3d allowed = ports_[probe].step(wanted, device.position, energy_to_body, settings_.period, true, stored);
  allowed = damped(allowed, wanted, felt_[probe].force, max_slew);
  allowed *= clamp_factor(allowed.norm(), cycle.renderer(probe).max_force());
  if ((output.status & session::kFault) != 0) allowed.setZero();
  ports_[probe].limited(allowed);
  return allowed;
}

Vec3d Bodies::limit_torque(const Cycle& cycle, std::uint32_t probe, const Vec3d& torque, bool control, double stored,
                           ProbeOutput& output) noexcept {
  RotationalPort& rotational = rotational_ports_[probe];
  const double energy_to_body = std::exchange(rotational.energy_to_body, 0);
  const Vec3d limited = clamp_factor(torque.norm(), cycle.renderer(probe).max_torque()) * torque;
  const double max_slew = settings_.force.max_torque_slew;
  const Vec3d wanted = slewed(limited, felt_[probe].torque, max_slew, cycle.renderer(probe), output);
  Vec3d allowed = rotational.port.step(wanted, rotational.angle, energy_to_body, settings_.period, control, stored);
  allowed = damped(allowed, wanted, felt_[probe].torque, max_slew);
  allowed *= clamp_factor(allowed.norm(), cycle.renderer(probe).max_torque());
  if ((output.status & session::kFault) != 0) allowed.setZero();
  rotational.port.limited(allowed);
  return allowed;
}

/// Limits the force of a tip that pushes the body, and sets the spring between them. The spring has the limits of
/// haptics/force.hpp, but not those of the port.
void Bodies::limit_touch(const Cycle& cycle, std::uint32_t p, const haptics::DeviceState& device, double energy_to_body,
                         ProbeOutput& output) noexcept {
  HandSpring& hand = springs_[p];
  const TouchObject& object = *bodies_[hand.body].object;
  const haptics::ProxyResult& touch = cycle.proxy(p).last();
  const haptics::ForceRenderer& renderer = cycle.renderer(p);
  const double stiffness = output.stiffness;
  const double damping = stable_impedance(object.material, device).damping;
  const Vec3d relative = device.velocity - touch.surface_velocity;
  const Vec3d stretch = touch.anchor - device.position;
  const haptics::LimitedSpring spring{stiffness, renderer.max_force()};
  const Vec3d rest = part_of(stretch, rest_length(cycle, p, device, energy_to_body, spring, stretch.norm()));

  // The force before the limits of haptics/force.hpp, and the share of it that remains after them.
  const auto pushed = [&](Vec3d force) noexcept {
    const double push = std::max(0.0, force.dot(touch.normal));
    force += std::max(-push, -damping * relative.dot(touch.normal)) * touch.normal;
    return force;
  };
  const Vec3d wanted = pushed(stiffness * (stretch - rest));
  Vec3d force = with_rest_length(vec(output.force), pushed(stiffness * stretch), wanted, renderer.strength(),
                                 renderer.max_force());
  const double share = force_share(force.norm(), wanted.norm());

  // The spring on the body damps motion along the surface, too. So the force on the hand must damp this motion.
  force -= share * damping * (relative - relative.dot(touch.normal) * touch.normal);
  output.force = plain(limit_force(cycle, p, force, device, energy_to_body, spring.energy(stretch.norm()), output));
  hand.spring = {touch.anchor, device.position + rest, device.velocity, share * stiffness, share * damping};
}

/// Limits the force of a tool that pushes the body. Sets its coupling as a spring at the contact point, and the
/// remaining torque about that point.
void Bodies::limit_tool(const Cycle& cycle, std::uint32_t p, const haptics::DeviceState& device, double energy_to_body,
                        ProbeOutput& output) noexcept {
  HandSpring& hand = springs_[p];
  const Body& body = bodies_[hand.body];
  const haptics::ToolResult& tool = cycle.tool(p)->last();
  const haptics::ForceRenderer& renderer = cycle.renderer(p);
  const haptics::ContactImpedance impedance = stable_impedance(body.object->material, device);
  const double stiffness = output.stiffness, damping = impedance.damping;
  const Vec3d relative = device.velocity - body.state_in_cycle.velocity_at(tool.point);
  const haptics::LimitedSpring spring{stiffness, renderer.max_force()};
  const double length = tool.displacement.norm();
  const double rest = rest_length(cycle, p, device, energy_to_body, spring, length);
  const Vec3d stretch = tool.displacement - part_of(tool.displacement, rest);

  const auto pushed = [&](const Vec3d& force) noexcept {
    const double push = std::max(0.0, force.dot(tool.normal));
    return Vec3d(force + std::max(-push, -damping * relative.dot(tool.normal)) * tool.normal);
  };
  const Vec3d wanted = pushed(stiffness * stretch);
  Vec3d force = with_rest_length(vec(output.force), pushed(stiffness * tool.displacement), wanted, renderer.strength(),
                                 renderer.max_force());
  const double factor = rest_factor(spring, length, rest);
  output.torque = plain(
      slewed(factor * vec(output.torque), felt_[p].torque, settings_.force.max_torque_slew, cycle.renderer(p), output));
  const double share = force_share(force.norm(), wanted.norm());
  force -= share * damping * (relative - relative.dot(tool.normal) * tool.normal);
  output.force = plain(limit_force(cycle, p, force, device, energy_to_body, spring.energy(length), output));
  hand.spring = {tool.point, tool.point - stretch, device.velocity, share * stiffness, share * damping};

  const Vec3d coupling_torque =
      renderer.tool_grip(impedance, settings_.period, device.round_trip).rotational_stiffness * tool.rotation;
  const Vec3d torque = renderer.has_torque()
                           ? vec(output.torque)
                           : Vec3d(factor * renderer.strength() *
                                   clamp_factor(coupling_torque.norm(), settings_.force.max_torque) * coupling_torque);
  hand.torque = -torque - (tool.pose.position - tool.point).cross(share * stiffness * stretch);
}

/// Limits the force and torque of a hand that holds the body, and sets its springs. A device without torque can still
/// rotate the body.
void Bodies::limit_held(const Cycle& cycle, std::uint32_t p, const haptics::DeviceState& device, double energy_to_body,
                        ProbeOutput& output) noexcept {
  HandSpring& hand = springs_[p];
  const Cycle::HoldState& held = cycle.hold_state(p);
  const haptics::ForceRenderer& renderer = cycle.renderer(p);
  const double damping = held.impedance.damping;
  const haptics::ToolGrip& grip = held.grip;
  const haptics::LimitedSpring spring{grip.stiffness, renderer.max_force()};
  const Vec3d stretch = held.hold.pose.position - device.position;
  const double length = stretch.norm(), rest = rest_length(cycle, p, device, energy_to_body, spring, length);
  const Vec3d at_rest = part_of(stretch, rest);
  const Vec3d wanted = held.pull.force - grip.stiffness * at_rest;
  const Vec3d force =
      with_rest_length(vec(output.force), held.pull.force, wanted, renderer.strength(), renderer.max_force());
  const double share = force_share(force.norm(), wanted.norm());
  output.force = plain(limit_force(cycle, p, force, device, energy_to_body, spring.energy(length), output));
  hand.spring = {held.hold.pose.position, device.position + at_rest, device.velocity, share * grip.stiffness,
                 share * damping};

  Vec3d turn = haptics::rotation_to(held.hold, device);
  const double factor = rest_factor(spring, length, rest);
  double torque_share =
      factor * renderer.strength() * clamp_factor(held.pull.torque.norm(), settings_.force.max_torque);
  if (renderer.has_torque()) {
    const haptics::LimitedSpring rotational_spring{grip.rotational_stiffness, renderer.max_torque()};
    RotationalPort& rotational = rotational_ports_[p];
    const double energy = rotational.port.energy_at(rotational.angle, rotational.energy_to_body);
    const double stored = rotational_spring.energy(turn.norm());
    const Vec3d turn_at_rest =
        part_of(turn, rotational.limiter.step(renderer.strength(), rotational_spring, turn.norm(), energy));
    const Vec3d wanted_torque = held.pull.torque - grip.rotational_stiffness * turn_at_rest;
    const Vec3d torque = with_rest_length(vec(output.torque), held.pull.torque, wanted_torque, renderer.strength(),
                                          renderer.max_torque());
    torque_share = force_share(torque.norm(), wanted_torque.norm());
    output.torque = plain(limit_torque(cycle, p, torque, true, stored, output));
    turn -= turn_at_rest;
  }
  hand.rotational_spring = {-turn, renderer.angular_velocity(), torque_share * grip.rotational_stiffness,
                            torque_share * grip.angular_damping};
}

void Bodies::limit_forces(const Cycle& cycle, const std::array<ProbeInput, kMaxProbes>& inputs,
                          std::array<ProbeOutput, kMaxProbes>& outputs) noexcept {
  for (std::uint32_t p = 0; p < kMaxProbes; ++p) {
    const std::uint32_t began = outputs[p].status & ~std::exchange(status_before_[p], outputs[p].status);
    reports_.grabs += (began & session::kHolding) != 0 ? 1 : 0;
    reports_.refused += (began & session::kHoldRefused) != 0 ? 1 : 0;
  }
  for (std::uint32_t p = 0; p < kMaxProbes; ++p) fade_reduction(cycle, p, outputs[p]);
  if (count_ > 0) limit_at_bodies(cycle, inputs, outputs);
  for (std::uint32_t p = 0; p < kMaxProbes; ++p) felt_[p] = {vec(outputs[p].force), vec(outputs[p].torque)};
}

void Bodies::limit_at_bodies(const Cycle& cycle, const std::array<ProbeInput, kMaxProbes>& inputs,
                             std::array<ProbeOutput, kMaxProbes>& outputs) noexcept {
  for (std::uint32_t p = 0; p < kMaxProbes; ++p) {
    ProbeOutput& output = outputs[p];
    const Vec3d force = vec(output.force), torque = vec(output.torque);
    HandSpring& hand = springs_[p];
    hand.body = kMaxBodies;
    const std::uint32_t object_before = std::exchange(hand.object, spm::kNone);
    const double energy_to_body = std::exchange(energy_to_body_[p], 0);
    if (!output.active) {  // reset for the next user
      reductions_[p] = {};
      ports_[p].reset();
      spring_limiters_[p].reset();
      rotational_ports_[p].port.reset();
      rotational_ports_[p].energy_to_body = 0;
      continue;
    }
    const haptics::DeviceState& device = inputs[p].device;
    RotationalPort& rotational = rotational_ports_[p];
    const Vec3d turned = haptics::log_map(device.orientation * rotational.orientation.conjugate());
    if (turned.allFinite()) {  // otherwise the angle would never be finite again
      rotational.angle += turned;
      rotational.orientation = device.orientation;
    }
    // After a fault the hand exerts nothing on the body, because the state of its device may not be finite.
    const bool has_fault = (output.status & session::kFault) != 0;
    hand.is_hold = (output.status & session::kHolding) != 0;
    if ((output.status & session::kInContact) != 0) hand.body = body_of(output.object);
    if (hand.body != kMaxBodies) hand.object = output.object;
    hand.torque.setZero();
    if (hand.object == spm::kNone) spring_limiters_[p].interrupt();
    const bool is_other = hand.object != spm::kNone && std::exchange(hand.last_object, hand.object) != hand.object;
    if (is_other || has_fault) spring_limiters_[p].reset();
    if (hand.object != object_before || has_fault || !hand.is_hold) rotational.limiter.reset();
    if (hand.body == kMaxBodies) {
      // The renderer limits the change of its own force; the hand may have felt another one at a body.
      output.force = plain(slewed(force, felt_[p].force, settings_.force.max_slew, cycle.renderer(p), output));
      output.torque =
          plain(slewed(torque, felt_[p].torque, settings_.force.max_torque_slew, cycle.renderer(p), output));
      (void)ports_[p].step(Vec3d::Zero(), device.position, energy_to_body, settings_.period, false);
    } else if (has_fault) {
      hand.spring = {};
      hand.rotational_spring = {};
      output.force = plain(limit_force(cycle, p, Vec3d::Zero(), device, energy_to_body, 0, output));
    } else if (hand.is_hold) {
      limit_held(cycle, p, device, energy_to_body, output);
    } else if (cycle.tool(p) != nullptr) {
      limit_tool(cycle, p, device, energy_to_body, output);
    } else {
      limit_touch(cycle, p, device, energy_to_body, output);
    }
    if (!hand.is_hold || hand.body == kMaxBodies || has_fault)
      (void)limit_torque(cycle, p, Vec3d::Zero(), false, 0, output);
    reductions_[p].force = vec(output.force) - force;
    reductions_[p].torque = vec(output.torque) - torque;
  }
}

/// Adds the fading reduction to the rendered force and torque, within the limits of the device. The added vector is
/// never longer than the rendered one, so a fault or a stop still makes the force zero.
void Bodies::fade_reduction(const Cycle& cycle, std::uint32_t p, ProbeOutput& output) noexcept {
  Reduction& reduction = reductions_[p];
  const auto add = [](haptics::Ramp& ramp, Plain3& rendered, double step, double max) {
    if (ramp.done()) return;
    const double share = std::min(1.0, vec(rendered).norm() / ramp.remaining().norm());
    const Vec3d sum = vec(rendered) + share * ramp.remaining();
    rendered = plain(Vec3d(clamp_factor(sum.norm(), max) * sum));
    ramp.advance(step);
  };
  const haptics::ForceRenderer& renderer = cycle.renderer(p);
  add(reduction.fading, output.force, haptics::kSurfaceRamp * settings_.period, renderer.max_force());
  add(reduction.fading_torque, output.torque, haptics::kTorqueRamp * settings_.period, renderer.max_torque());
}

std::uint32_t Bodies::steps_due(Body& body, std::int64_t session_ns) const noexcept {
  constexpr std::int64_t kMaxSteps = 10;
  const auto period_ns = static_cast<std::int64_t>(settings_.period * 1e9 + 0.5);
  const std::int64_t due = (session_ns - body.simulated_ns + period_ns / 2) / period_ns;
  if (due < 0 || due > kMaxSteps) {  // after the first touch, or after a jump of session time
    body.simulated_ns = session_ns - period_ns;
    return 1;
  }
  return static_cast<std::uint32_t>(due);
}

const haptics::SurfaceDistance* Bodies::scene_around(const Cycle& cycle, const haptics::RigidBody& body) noexcept {
  // m: max displacement of a body in a cycle plus the distance at which the solver finds contacts
  constexpr double kMargin = 0.02;
  scene_.clear();
  const double reach = body.settings().half.norm() + kMargin;
  for (const TouchObject* object : cycle.objects())
    if (!object->body && object->forest->is_base_shown() &&
        sharing::overlaps_bounds(object->placement, object->bounds, body.state().position, reach))
      scene_.add({&object->forest->tree(), &object->placement, object->index});
  return scene_.empty() ? nullptr : &scene_;
}

void Bodies::simulate(Cycle& cycle, std::int64_t now_ns, std::uint64_t released) noexcept {
  if (count_ == 0) return;
  const std::int64_t session_ns = orders_.clock.session_time(now_ns);
  for (std::uint32_t i = 0; i < count_; ++i) {
    Body& body = bodies_[i];
    const bool must_release = (released >> body.object->index & 1u) != 0;
    std::array<haptics::PointSpring, kMaxProbes> springs;
    std::array<haptics::RotationalSpring, kMaxProbes> rotational_springs;
    std::array<std::uint32_t, kMaxProbes> probes{}, holder_probes{};
    std::uint32_t count = 0, holding = 0;
    haptics::ImplicitForce pushing;
    for (std::uint32_t p = 0; p < kMaxProbes; ++p) {
      if (springs_[p].body != i || must_release) continue;
      probes[count] = p;
      springs[count++] = springs_[p].spring;
      pushing.impulse.tail<3>() += settings_.period * springs_[p].torque;
      if (!springs_[p].is_hold) continue;
      holder_probes[holding] = p;
      rotational_springs[holding++] = springs_[p].rotational_spring;
    }
    haptics::SharedObject& simulated = simulated_[i];
    if (count > 0) {
      body.last_touch_ns = now_ns;
      if (body.mode == Mode::kFollows) {
        simulated.set_state(body.state_in_cycle);
        simulated.simulate_alone();
        body.coupling = nullptr;
      }
      body.mode = Mode::kTouched;
      apply_coupling_order(i);
    } else if (body.mode == Mode::kTouched && (must_release || now_ns - body.last_touch_ns > kReleaseDelayNs)) {
      body.mode = Mode::kReleased;
      body.released_ns = now_ns;
      body.pose_number_at_release = body.order.received.number;
      apply_coupling_order(i);
    }
    if (body.mode == Mode::kFollows) continue;

    const haptics::Surroundings around{true, body.object->body->ground, scene_around(cycle, simulated.body())};
    for (std::uint32_t left = steps_due(body, session_ns); left > 0; --left) {
      body.simulated_ns += static_cast<std::int64_t>(settings_.period * 1e9 + 0.5);
      const haptics::BodyState before = simulated.state();
      simulated.step(body.simulated_ns, {springs.data(), count}, around, settings_.period,
                     count > 0 ? &pushing : nullptr, {rotational_springs.data(), holding});
      const haptics::BodyState& after = simulated.state();
      for (std::uint32_t k = 0; k < count; ++k) {
        const Vec3d velocity = after.velocity + after.angular_velocity.cross(springs[k].point - before.position);
        const Vec3d displacement = settings_.period * velocity;
        energy_to_body_[probes[k]] += springs[k].force(velocity, settings_.period).dot(displacement);
        energy_to_body_[probes[k]] += settings_.period * springs_[probes[k]].torque.dot(after.angular_velocity);
        springs[k].point += displacement;  // the position in the next step
        springs[k].target += settings_.period * springs[k].target_velocity;
      }
      for (std::uint32_t k = 0; k < holding; ++k) {
        const Vec3d torque = rotational_springs[k].torque(after.angular_velocity, settings_.period);
        rotational_ports_[holder_probes[k]].energy_to_body += settings_.period * torque.dot(after.angular_velocity);
        rotational_springs[k].rotation +=
            settings_.period * (rotational_springs[k].target_angular_velocity - after.angular_velocity);
      }
    }
    if (body.coupling != nullptr) body.ledger = body.coupling->ledger();
    set_pose(cycle, body, simulated.state());
  }
  report(now_ns, session_ns);
}

void Bodies::report(std::int64_t now_ns, std::int64_t session_ns) noexcept {
  reports_.time_ns = now_ns;
  reports_.session_ns = session_ns;
  reports_.count = count_;
  for (std::uint32_t i = 0; i < count_; ++i) {
    const Body& body = bodies_[i];
    BodyReport& report = reports_.bodies[i];
    report.object = body.object->index;
    report.is_touched = body.mode == Mode::kTouched;
    report.is_simulated = body.mode != Mode::kFollows;
    report.publish_fencing = report.is_touched ? body.order.publish_fencing : 0;
    report.coupling_fencing = body.order.coupling_fencing;
    report.state = body.state_in_cycle;
    report.ledger = body.ledger;
    report.copies = body.coupling != nullptr ? static_cast<std::uint32_t>(body.coupling->copies()) : 0;
    if (report.copies == 0) continue;
    report.copy_index = static_cast<std::uint32_t>(body.coupling->index());
    report.sample = body.coupling->sample();
  }
  for (std::uint32_t p = 0; p < kMaxProbes; ++p) reports_.ports[p] = ports_[p].ledger();
  for (std::uint32_t p = 0; p < kMaxProbes; ++p) reports_.rotational_ports[p] = rotational_ports_[p].port.ledger();
  reports_out_.post(reports_);
}

}  // namespace tactus::hrtc_service
