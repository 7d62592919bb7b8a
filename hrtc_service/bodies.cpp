#include "hrtc_service/bodies.hpp"

#include <algorithm>
#include <utility>

namespace tactus::hrtc_service {
namespace {

// After the last touch, a body still counts as held, so that a bounce does not release it.
constexpr std::int64_t kHoldNs = 100'000'000;
// Then the simulation waits so long for a new owner: longer than a lease.
constexpr std::int64_t kAloneNs = 300'000'000;

Placement placement_of(const haptics::BodyState& state, const TouchObject& object) {
  return Placement{sharing::pose_of(state, object.body->centre), object.placement.scale()};
}

/// J in a spring of that stiffness and displacement whose force is limited.
double stored_in(double stiffness, double stretch, double max_force) noexcept {
  const double within = std::min(stretch, max_force / std::max(stiffness, 1e-9));
  return 0.5 * stiffness * within * within + max_force * (stretch - within);
}

/// The ratio of the limited to the requested force.
double share_of(double left, double wanted) noexcept { return wanted > 0 ? std::min(1.0, left / wanted) : 0.0; }

/// The factor that reduces a size to at most `most`.
double shortened(double size, double max) noexcept { return size > max ? max / size : 1.0; }

/// The same limits for rotation: the wrist of a hand, a grip of some centimetres.
haptics::PassivitySettings of_turning() noexcept {
  haptics::PassivitySettings settings;
  settings.acceleration = 500;  // rad/s^2
  settings.min_speed = 0.02;    // rad/s
  settings.device_mass = 1e-4;  // kg m^2
  return settings;
}

}  // namespace

BodyLink::BodyLink() {
  while (copies.push(CopyArrival{})) {  // touch the memory before the haptic thread does
  }
  copies.consume_all([](const CopyArrival&) {});
}

Bodies::Bodies(const CycleSettings& settings, BodyLink& link) : settings_{settings}, link_{link} {
  for (Turning& turning : turning_) turning.port = haptics::PassivityController{of_turning()};
  simulated_.resize(kMaxBodies, haptics::SharedObject{haptics::BodySettings{}});
}

std::uint32_t Bodies::body_of(std::uint32_t object) const noexcept {
  for (std::uint32_t i = 0; i < count_; ++i)
    if (bodies_[i].object->index == object) return i;
  return kMaxBodies;
}

void Bodies::find_new(const Cycle& cycle) noexcept {
  if (cycle.objects_changed() == objects_changed_) return;
  objects_changed_ = cycle.objects_changed();
  for (const TouchObject* const object : cycle.objects()) {
    if (!object->body || count_ == kMaxBodies || body_of(object->index) != kMaxBodies) continue;
    Body& body = bodies_[count_];
    body = Body{};
    body.object = object;
    body.placed = object->body->start;
    body.pose_interpolator.show(body.placed, 0);
    simulated_[count_] = haptics::SharedObject{object->body->settings, body.placed};
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
  for (Spring& spring : springs_) spring.body = kMaxBodies;  // indices from before the removal
  if (count_ > 0) return;
  passed_on_.fill(0);
  for (std::uint32_t p = 0; p < kMaxProbes; ++p) {  // `limit` does not run without bodies, so the ports are reset here
    ports_[p].limited(Vec3d::Zero());
    turning_[p].port.limited(Vec3d::Zero());
    turning_[p].passed_on = 0;
  }
}

void Bodies::simulate_as_ordered(std::uint32_t i) noexcept {
  Body& body = bodies_[i];
  haptics::CopyCoupling* const coupling = body.mode == Mode::kHeld ? body.order.coupling : nullptr;
  if (coupling == body.coupling) return;
  body.coupling = coupling;
  if (coupling != nullptr)
    simulated_[i].couple(*coupling);
  else
    simulated_[i].own();
}

void Bodies::take_orders() noexcept {
  if (link_.orders.take(current_)) {
    for (std::uint32_t k = 0; k < current_.count; ++k) {
      const std::uint32_t i = body_of(current_.bodies[k].object);
      if (i == kMaxBodies) continue;
      bodies_[i].order = current_.bodies[k];
      if (bodies_[i].mode != Mode::kFollows) simulate_as_ordered(i);
    }
    reports_.orders_seen = current_.number;
  }
  while (link_.copies.pop(arrival_)) {
    const std::uint32_t i = body_of(arrival_.object);
    if (i == kMaxBodies || bodies_[i].order.coupling == nullptr || bodies_[i].order.group != arrival_.group) continue;
    bodies_[i].order.coupling->on_sample(arrival_.place, arrival_.sample);
  }
}

void Bodies::show(Cycle& cycle, Body& body, const haptics::BodyState& state) const noexcept {
  const bool moved =
      state.position != body.placed.position || state.orientation.coeffs() != body.placed.orientation.coeffs();
  body.placed = state;
  if (moved) cycle.move(*body.object, placement_of(state, *body.object));
}

void Bodies::follow_if_requested(Body& body, haptics::SharedObject& simulated, std::int64_t now_ns,
                                 std::int64_t session_ns) noexcept {
  const bool taken_on = body.order.received.number > body.received_at_release;
  if (!taken_on && now_ns - body.let_go_ns < kAloneNs) return;
  body.mode = Mode::kFollows;
  body.pose_interpolator.show(simulated.state(), session_ns);
  body.interpolated = body.received_at_release;
  simulated.follow();
}

void Bodies::place(Cycle& cycle, std::int64_t now_ns) noexcept {
  find_new(cycle);
  if (count_ == 0) return;
  take_orders();
  const std::int64_t session_ns = current_.clock.session_time(now_ns);
  for (std::uint32_t i = 0; i < count_; ++i) {
    Body& body = bodies_[i];
    if (body.mode == Mode::kLetGo) follow_if_requested(body, simulated_[i], now_ns, session_ns);
    if (body.mode != Mode::kFollows) continue;
    if (body.order.received.number > body.interpolated) {
      // The first pose holds for all times before it.
      if (body.interpolated == 0)
        body.pose_interpolator.show(body.order.received.state, body.order.received.session_ns);
      body.interpolated = body.order.received.number;
      body.pose_interpolator.on_pose(body.order.received, session_ns);
    }
    show(cycle, body, body.pose_interpolator.at(session_ns));
  }
}

Vec3d Bodies::through_port(std::uint32_t probe, const Vec3d& force, const haptics::DeviceState& device,
                           double passed_on, double stored, const ProbeOutput& output) noexcept {
  Vec3d left = ports_[probe].step(force, device.position, passed_on, settings_.period, true, stored);
  left *= shortened(left.norm(), settings_.force.max_force);
  if ((output.status & session::kFault) != 0) left.setZero();
  ports_[probe].limited(left);
  return left;
}

Vec3d Bodies::through_turn_port(std::uint32_t probe, const Vec3d& torque, bool control, double stored,
                                const ProbeOutput& output) noexcept {
  Turning& turning = turning_[probe];
  const double passed_on = std::exchange(turning.passed_on, 0);
  Vec3d left = turning.port.step(torque, turning.angle, passed_on, settings_.period, control, stored);
  left *= shortened(left.norm(), settings_.force.max_torque);
  if ((output.status & session::kFault) != 0) left.setZero();
  turning.port.limited(left);
  return left;
}

/// A push: the body receives the surface's force on the hand with the opposite sign.
void Bodies::limit_touch(const Cycle& cycle, std::uint32_t p, const haptics::DeviceState& device, double passed_on,
                         ProbeOutput& output) noexcept {
  Spring& pulled = springs_[p];
  const TouchObject& object = *bodies_[pulled.body].object;
  const haptics::ProxyResult& touch = cycle.proxy(p).last();
  const double stiffness = output.stiffness;
  const double damping = object.material.damping;
  const Vec3d relative = device.velocity - touch.surface_velocity;

  // The share of the force that the limits left (haptics/force.hpp).
  Vec3d wanted = stiffness * (touch.anchor - device.position);
  const double push = std::max(0.0, wanted.dot(touch.normal));
  wanted += std::max(-push, -damping * relative.dot(touch.normal)) * touch.normal;
  Vec3d force = vec(output.force);
  const double share = share_of(force.norm(), wanted.norm());

  // The damper of the body also acts along the surface, so the damper of the hand must.
  force -= share * damping * (relative - relative.dot(touch.normal) * touch.normal);
  const double stored = stored_in(stiffness, (touch.anchor - device.position).norm(), settings_.force.max_force);
  output.force = plain(through_port(p, force, device, passed_on, stored, output));
  pulled.spring = {touch.anchor, device.position, device.velocity, share * stiffness, share * damping};
}

/// A push by a tool: its coupling as a spring at the contact point, and the remaining torque about that point.
void Bodies::limit_tool(const Cycle& cycle, std::uint32_t p, const haptics::DeviceState& device, double passed_on,
                        ProbeOutput& output) noexcept {
  Spring& pulled = springs_[p];
  const Body& body = bodies_[pulled.body];
  const haptics::ToolResult& tool = cycle.tool(p)->last();
  const haptics::ForceRenderer& renderer = cycle.renderer(p);
  const double stiffness = output.stiffness, damping = body.object->material.damping;
  const Vec3d relative = device.velocity - body.placed.velocity_at(tool.point);
  const Vec3d wanted = stiffness * tool.displacement;
  const double push = std::max(0.0, wanted.dot(tool.normal));
  const Vec3d damped = wanted + std::max(-push, -damping * relative.dot(tool.normal)) * tool.normal;
  Vec3d force = vec(output.force);
  const double share = share_of(force.norm(), damped.norm());
  force -= share * damping * (relative - relative.dot(tool.normal) * tool.normal);
  const double stored = stored_in(stiffness, tool.displacement.norm(), settings_.force.max_force);
  output.force = plain(through_port(p, force, device, passed_on, stored, output));
  pulled.spring = {tool.point, tool.point - tool.displacement, device.velocity, share * stiffness, share * damping};

  const haptics::Feel feel{body.object->material.stiffness, damping};
  const Vec3d turning = renderer.grip(feel, settings_.period, device.loop_delay).rotational_stiffness * tool.rotation;
  const Vec3d torque =
      renderer.bears_torque()
          ? vec(output.torque)
          : Vec3d(renderer.strength() * shortened(turning.norm(), settings_.force.max_torque) * turning);
  pulled.torque = -torque - (tool.pose.position - tool.point).cross(share * wanted);
}

/// A hold: the same in all six degrees of freedom. A device without torque can still rotate the held object.
void Bodies::limit_held(const Cycle& cycle, std::uint32_t p, const haptics::DeviceState& device, double passed_on,
                        ProbeOutput& output) noexcept {
  Spring& pulled = springs_[p];
  const Cycle::Held& held = cycle.held(p);
  const haptics::ForceRenderer& renderer = cycle.renderer(p);
  const double damping = held.feel.damping;
  const Vec3d force = vec(output.force), torque = vec(output.torque);
  const Vec3d turn = haptics::rotation_to(held.hold, device);
  const double max_torque = settings_.force.max_torque, wanted = held.pull.torque.norm();
  const double share = share_of(force.norm(), held.pull.force.norm());
  const double turn_share =
      renderer.bears_torque() ? share_of(torque.norm(), wanted) : renderer.strength() * shortened(wanted, max_torque);
  const haptics::ToolGrip& grip = held.grip;
  const double stretch = (held.hold.pose.position - device.position).norm();
  const double stored = stored_in(grip.stiffness, stretch, settings_.force.max_force);
  output.force = plain(through_port(p, force, device, passed_on, stored, output));
  if (renderer.bears_torque())
    output.torque = plain(
        through_turn_port(p, torque, true, stored_in(grip.rotational_stiffness, turn.norm(), max_torque), output));
  pulled.spring = {held.hold.pose.position, device.position, device.velocity, share * grip.stiffness, share * damping};
  pulled.turn = {-turn, renderer.angular_velocity(), turn_share * grip.rotational_stiffness,
                 turn_share * grip.angular_damping};
}

void Bodies::limit(const Cycle& cycle, const std::array<ProbeInput, kMaxProbes>& inputs,
                   std::array<ProbeOutput, kMaxProbes>& outputs) noexcept {
  for (std::uint32_t p = 0; p < kMaxProbes; ++p) {
    const std::uint32_t began = outputs[p].status & ~std::exchange(status_before_[p], outputs[p].status);
    reports_.grabs += (began & session::kHolding) != 0 ? 1 : 0;
    reports_.refused += (began & session::kHoldRefused) != 0 ? 1 : 0;
  }
  for (std::uint32_t p = 0; p < kMaxProbes; ++p) fade_reduction(p, outputs[p]);
  if (count_ == 0) return;
  for (std::uint32_t p = 0; p < kMaxProbes; ++p) {
    ProbeOutput& output = outputs[p];
    const Vec3d force = vec(output.force), torque = vec(output.torque);
    Spring& pulled = springs_[p];
    pulled.body = kMaxBodies;
    const double passed_on = std::exchange(passed_on_[p], 0);
    if (!output.active) {  // the next user starts elsewhere
      reductions_[p] = {};
      ports_[p].limited(Vec3d::Zero());
      turning_[p].port.limited(Vec3d::Zero());
      continue;
    }
    const haptics::DeviceState& device = inputs[p].device;
    Turning& turning = turning_[p];
    turning.angle += haptics::log_map(device.orientation * turning.orientation.conjugate());
    turning.orientation = device.orientation;
    pulled.holds = (output.status & session::kHolding) != 0;
    if ((output.status & session::kInContact) != 0) pulled.body = body_of(output.object);
    pulled.torque.setZero();
    if (pulled.body == kMaxBodies) {
      (void)ports_[p].step(Vec3d::Zero(), device.position, passed_on, settings_.period, false);
    } else if (pulled.holds) {
      limit_held(cycle, p, device, passed_on, output);
    } else if (cycle.tool(p) != nullptr) {
      limit_tool(cycle, p, device, passed_on, output);
    } else {
      limit_touch(cycle, p, device, passed_on, output);
    }
    if (!pulled.holds || pulled.body == kMaxBodies) (void)through_turn_port(p, Vec3d::Zero(), false, 0, output);
    reductions_[p].force = vec(output.force) - force;
    reductions_[p].torque = vec(output.torque) - torque;
  }
}

/// The reduction is never larger than the rendered force, so a fault or a stop still takes all force.
void Bodies::fade_reduction(std::uint32_t p, ProbeOutput& output) noexcept {
  Reduction& reduction = reductions_[p];
  const auto add = [](haptics::Ramp& ramp, Plain3& rendered, double step) {
    if (ramp.done()) return;
    const double length = ramp.remaining().norm(), max = vec(rendered).norm();
    const double share = std::min(1.0, max / length);
    rendered = plain(Vec3d(vec(rendered) + share * ramp.remaining()));
    ramp.advance(step);
  };
  add(reduction.fading, output.force, haptics::kSurfaceRamp * settings_.period);
  add(reduction.fading_torque, output.torque, haptics::kTorqueRamp * settings_.period);
}

std::uint32_t Bodies::steps_due(Body& body, std::int64_t session_ns) const noexcept {
  constexpr std::int64_t kMax = 10;
  const auto period_ns = static_cast<std::int64_t>(settings_.period * 1e9 + 0.5);
  const std::int64_t due = (session_ns - body.simulated_ns + period_ns / 2) / period_ns;
  if (due < 0 || due > kMax) {  // the first touch, or a step of a clock
    body.simulated_ns = session_ns - period_ns;
    return 1;
  }
  return static_cast<std::uint32_t>(due);
}

const haptics::SurfaceDistance* Bodies::scene_around(const Cycle& cycle, const haptics::RigidBody& body) noexcept {
  // m: the largest displacement of a body until the next cycle, and the distance of contacts found before they touch.
  constexpr double kMargin = 0.02;
  scene_.clear();
  const double reach = body.settings().half.norm() + kMargin;
  for (const TouchObject* object : cycle.objects())
    if (!object->body && object->forest->base_shown() &&
        sharing::overlaps_bounds(object->placement, object->bounds, body.state().position, reach))
      scene_.add({&object->forest->tree(), &object->placement, object->index});
  return scene_.empty() ? nullptr : &scene_;
}

void Bodies::step(Cycle& cycle, std::int64_t now_ns) noexcept {
  if (count_ == 0) return;
  const std::int64_t session_ns = current_.clock.session_time(now_ns);
  for (std::uint32_t i = 0; i < count_; ++i) {
    Body& body = bodies_[i];
    std::array<haptics::PointSpring, kMaxProbes> springs;
    std::array<haptics::RotationalSpring, kMaxProbes> turns;
    std::array<std::uint32_t, kMaxProbes> probes{}, holders{};
    std::uint32_t count = 0, holding = 0;
    haptics::ImplicitForce pushing;
    for (std::uint32_t p = 0; p < kMaxProbes; ++p) {
      if (springs_[p].body != i) continue;
      probes[count] = p;
      springs[count++] = springs_[p].spring;
      pushing.impulse.tail<3>() += settings_.period * springs_[p].torque;
      if (!springs_[p].holds) continue;
      holders[holding] = p;
      turns[holding++] = springs_[p].turn;
    }
    haptics::SharedObject& simulated = simulated_[i];
    if (count > 0) {
      body.touched_ns = now_ns;
      if (body.mode == Mode::kFollows) {
        simulated.place(body.placed);
        simulated.own();
        body.coupling = nullptr;
      }
      body.mode = Mode::kHeld;
      simulate_as_ordered(i);
    } else if (body.mode == Mode::kHeld && now_ns - body.touched_ns > kHoldNs) {
      body.mode = Mode::kLetGo;
      body.let_go_ns = now_ns;
      body.received_at_release = body.order.received.number;
      simulate_as_ordered(i);
    }
    if (body.mode == Mode::kFollows) continue;

    const haptics::Surroundings around{true, body.object->body->ground, scene_around(cycle, simulated.body())};
    for (std::uint32_t left = steps_due(body, session_ns); left > 0; --left) {
      body.simulated_ns += static_cast<std::int64_t>(settings_.period * 1e9 + 0.5);
      const haptics::BodyState before = simulated.state();
      simulated.step(body.simulated_ns, {springs.data(), count}, around, settings_.period,
                     count > 0 ? &pushing : nullptr, {turns.data(), holding});
      const haptics::BodyState& after = simulated.state();
      for (std::uint32_t k = 0; k < count; ++k) {
        const Vec3d velocity = after.velocity + after.angular_velocity.cross(springs[k].point - before.position);
        const Vec3d way = settings_.period * velocity;
        passed_on_[probes[k]] += springs[k].force(velocity, settings_.period).dot(way);
        passed_on_[probes[k]] += settings_.period * springs_[probes[k]].torque.dot(after.angular_velocity);
        springs[k].point += way;  // the position in the next step
        springs[k].target += settings_.period * springs[k].target_velocity;
      }
      for (std::uint32_t k = 0; k < holding; ++k) {
        const Vec3d torque = turns[k].torque(after.angular_velocity, settings_.period);
        turning_[holders[k]].passed_on += settings_.period * torque.dot(after.angular_velocity);
        turns[k].rotation += settings_.period * (turns[k].target_angular_velocity - after.angular_velocity);
      }
    }
    if (body.coupling != nullptr) body.ledger = body.coupling->ledger();
    show(cycle, body, simulated.state());
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
    report.held = body.mode == Mode::kHeld;
    report.simulated = body.mode != Mode::kFollows;
    report.publish = report.held ? body.order.publish : 0;
    report.group = body.order.group;
    report.state = body.placed;
    report.ledger = body.ledger;
    report.copies = body.coupling != nullptr ? static_cast<std::uint32_t>(body.coupling->copies()) : 0;
    if (report.copies == 0) continue;
    report.place = static_cast<std::uint32_t>(body.coupling->index());
    report.sample = body.coupling->sample();
  }
  for (std::uint32_t p = 0; p < kMaxProbes; ++p) reports_.ports[p] = ports_[p].ledger();
  for (std::uint32_t p = 0; p < kMaxProbes; ++p) reports_.turns[p] = turning_[p].port.ledger();
  link_.reports_for_sender.post(reports_);
  link_.reports_for_gateway.post(reports_);
}

}  // namespace tactus::hrtc_service
