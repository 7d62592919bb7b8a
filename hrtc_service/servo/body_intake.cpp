#include "hrtc_service/servo/body_intake.hpp"

#include <algorithm>
#include <bitset>

#include "hrtc_service/servo/shared_check.hpp"

namespace tactus::hrtc_service {
namespace {

// N/m. With it, the copies of two users who press with 6 N from opposite sides are 1.2 mm apart.
constexpr double kCouplingStiffness = 10'000;

bool is_valid(const GrantedCoupling& coupling) noexcept {
  return coupling.fencing == 0 ||
         (coupling.copies >= 2 && coupling.copies <= haptics::kMaxCopies && coupling.copy_index < coupling.copies &&
          coupling.delay_ns >= kMinChannelDelayNs && coupling.delay_ns <= kMaxChannelDelayNs);
}

}  // namespace

/// Makes a coupling of the body, or releases the one in use. A body with kMaxCouplings gets none for now.
void BodyIntake::set_coupling(Body& body, const GrantedCoupling& granted, const haptics::BodySettings& settings) {
  const bool has_coupling = !body.couplings.empty() && body.couplings.back().first_orders_without == 0;
  if (granted.fencing == (has_coupling ? body.couplings.back().granted.fencing : 0)) return;
  if (has_coupling) body.couplings.back().first_orders_without = posted_ + 1;
  body.order.coupling = nullptr;
  body.order.coupling_fencing = 0;
  if (granted.fencing == 0 || body.couplings.size() >= kMaxCouplings) return;
  haptics::CouplingSettings coupling;
  coupling.copies = granted.copies;
  coupling.stiffness = kCouplingStiffness;
  coupling.delay = 1e-9 * static_cast<double>(granted.delay_ns);
  body.couplings.push_back(
      {granted, std::make_unique<haptics::CopyCoupling>(coupling, granted.copy_index, settings), 0});
  body.order.coupling = body.couplings.back().coupling.get();
  body.order.coupling_fencing = granted.fencing;
}

void BodyIntake::apply(const GrantedBody& granted) {
  const TouchObject* const object = objects_.find(granted.object);
  if (object == nullptr || !object->body || !is_valid(granted.coupling) || !is_valid(granted.received.state) ||
      !is_moderate(granted.received.session_ns) || granted.received.number > granted_.pose_number)
    return;
  Body& body = bodies_[granted.object];
  body.serial = objects_.serial_at(granted.object);
  body.order.object = granted.object;
  body.order.publish_fencing = granted.publish_fencing;
  body.order.received = granted.received;
  set_coupling(body, granted.coupling, object->body->settings);
}

void BodyIntake::post() {
  BodyOrders orders;
  orders.number = ++posted_;
  orders.clock = granted_.clock;
  for (std::uint32_t index = 0; index < kMaxObjects && orders.count < kMaxBodies; ++index) {
    const TouchObject* const object = objects_.find(index);
    if (object == nullptr || !object->body || bodies_[index].order.object == spm::kNone) continue;
    orders.bodies[orders.count++] = bodies_[index].order;
  }
  order_link_.orders.post(orders);
}

void BodyIntake::free_unused() {
  const std::uint64_t seen = order_link_.seen.load(std::memory_order_acquire);
  for (std::uint32_t index = 0; index < kMaxObjects; ++index) {
    Body& body = bodies_[index];
    if (body.order.object == spm::kNone) continue;
    // The haptic thread has returned the object. Another one may have its index since the last pass.
    if (objects_.serial_at(index) != body.serial) body = {};
    // Orders do not name a withdrawn object, so the haptic thread may use its couplings whatever orders it has seen.
    if (objects_.find(index) == nullptr) continue;
    while (!body.couplings.empty() && body.couplings.front().first_orders_without != 0 &&
           body.couplings.front().first_orders_without <= seen)
      body.couplings.pop_front();
  }
}

std::size_t BodyIntake::couplings() const noexcept {
  std::size_t count = 0;
  for (const Body& body : bodies_) count += body.couplings.size();
  return count;
}

void BodyIntake::tick() {
  free_unused();
  if (!granted_in_.take(granted_) || !is_valid(granted_.clock)) return;
  std::bitset<kMaxObjects> applied;
  for (std::uint32_t i = 0; i < std::min(granted_.count, kMaxBodies); ++i) {
    const GrantedBody& granted = granted_.bodies[i];
    if (granted.object >= kMaxObjects || applied.test(granted.object)) continue;
    applied.set(granted.object);
    apply(granted);
  }
  post();
}

}  // namespace tactus::hrtc_service
