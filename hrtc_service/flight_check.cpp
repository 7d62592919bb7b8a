#include "hrtc_service/flight_check.hpp"

#include <cmath>
#include <string>

#include "haptics/force.hpp"
#include "hrtc_service/servo/touch_object.hpp"
#include "spm/pool.hpp"

namespace tactus::hrtc_service {
namespace {

using trace::FlightError;

template <class Number>
void expect(bool valid, const char* name, Number found, const std::string& expected) {
  if (!valid) throw FlightError(std::string{"found "} + name + " " + std::to_string(found) + ", expected " + expected);
}

void expect_above_zero(const char* name, double found) {
  expect(std::isfinite(found) && found > 0, name, found, "a finite number above 0");
}

void expect_not_negative(const char* name, double found) {
  expect(std::isfinite(found) && found >= 0, name, found, "a finite number, at least 0");
}

void expect_object(std::uint32_t found) {
  expect(found < kMaxObjects, "object", found, "below " + std::to_string(kMaxObjects));
}

void expect_placement(const trace::PlacementNumbers& found) {
  if (!Placement{found}.valid())
    throw FlightError("found an invalid placement of scale " + std::to_string(found[0]) +
                      ", expected finite numbers, a scale above 0 and a rotation");
}

void expect_pool(const trace::FlightStart& start, std::uint64_t max_bytes) {
  expect(start.slots > 0 && start.slots <= spm::kMaxSlots, "slots", start.slots,
         "1 to " + std::to_string(spm::kMaxSlots));
  expect(start.tree_nodes < spm::kMaxTreeNodes, "tree nodes", start.tree_nodes,
         "below " + std::to_string(spm::kMaxTreeNodes));
  spm::PoolSettings pool;
  pool.slots = start.slots;
  pool.tree_nodes = start.tree_nodes;
  pool.list_blocks = start.list_blocks;
  pool.compressed_blocks = 0;
  expect(pool.bytes() <= max_bytes, "a pool of bytes", pool.bytes(), "at most " + std::to_string(max_bytes));
}

class Check {
 public:
  explicit Check(std::uint64_t max_pool_bytes) : max_pool_bytes_{max_pool_bytes} {}

  void operator()(const trace::FlightStart& start) const {
    expect_above_zero("period", start.period);
    expect_above_zero("tip radius", start.tip_radius);
    expect_not_negative("refine margin", start.refine_margin);
    expect_not_negative("retain margin", start.retain_margin);
    expect_not_negative("refine ahead", start.refine_ahead);
    for (const double setting :
         {start.max_force, start.max_slew, start.soft_start, start.recovery, start.max_fresh_age, start.zero_force_age,
          start.max_speed, start.max_torque, start.max_torque_slew, start.max_angular_velocity})
      expect_not_negative("force setting", setting);
    expect(start.devices.size() == kMaxProbes, "devices", start.devices.size(), std::to_string(kMaxProbes));
    for (const trace::FlightLimits& limits : start.devices)
      for (const double limit : {limits.max_force, limits.max_stiffness, limits.damping, limits.workspace_radius,
                                 limits.max_torque, limits.max_rotational_stiffness})
        expect(limit >= 0, "device limit", limit, "at least 0");
    expect(start.tool_vertices.size() % 3 == 0, "coordinates of a tool", start.tool_vertices.size(), "three a vertex");
    expect(start.tool_triangles.size() % 3 == 0, "corners of a tool", start.tool_triangles.size(), "three a triangle");
    expect_pool(start, max_pool_bytes_);
  }
  void operator()(const trace::FlightObject& object) const {
    expect_object(object.object);
    expect_placement(object.placement);
    expect_not_negative("stiffness", object.stiffness);
    expect_not_negative("damping", object.damping);
    expect_not_negative("static friction", object.static_friction);
    expect_not_negative("dynamic friction", object.dynamic_friction);
  }
  void operator()(const trace::FlightState& state) const {
    for (const trace::FlightObjectState& object : state.objects) expect_object(object.object);
  }
  void operator()(const trace::FlightEvent& event) const {
    using Kind = trace::FlightEvent::Kind;
    const auto kind = static_cast<std::uint32_t>(event.kind), last = static_cast<std::uint32_t>(Kind::kPageDeparted);
    expect(kind <= last, "event", kind, "at most " + std::to_string(last));
    constexpr auto kLastFault = static_cast<std::uint32_t>(haptics::kLastFault);
    if (event.kind == Kind::kStopped)
      expect(event.fault > 0 && event.fault <= kLastFault, "fault", event.fault, "1 to " + std::to_string(kLastFault));
    expect_object(event.object);
  }
  void operator()(const trace::FlightMove& move) const {
    expect_object(move.object);
    expect_placement(move.placement);
  }
  void operator()(const trace::FlightProbe& probe) const {
    expect(probe.probe < kMaxProbes, "probe", probe.probe, "below " + std::to_string(kMaxProbes));
  }
  void operator()(const trace::FlightTouch& touch) const {
    // An unmasked floating-point exception would end the program.
    constexpr std::uint32_t kMasks = 0x1f80, kAll = 0xffc0;
    expect((touch.float_control & kMasks) == kMasks && (touch.float_control & ~kAll) == 0, "float control",
           touch.float_control, "all exceptions masked and no flags");
  }
  void operator()(const trace::FlightRefine& /*refine*/) const {}

 private:
  std::uint64_t max_pool_bytes_;
};

}  // namespace

void expect_valid(const trace::FlightMessage& message, std::uint64_t max_pool_bytes) {
  std::visit(Check{max_pool_bytes}, message);
}

}  // namespace tactus::hrtc_service
