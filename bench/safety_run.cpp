#include "bench/safety_run.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <memory>
#include <random>

#include "haptics/remote_device.hpp"
#include "haptics/rigid_body.hpp"
#include "session/check.hpp"
#include "session/sequence_window.hpp"
#include "tests/haptics/triangle_surface.hpp"
#include "wire/convert.hpp"
#include "wire/dds.hpp"

namespace tactus::bench {
namespace {

using haptics::Vec3d;
using Bytes = std::vector<std::uint8_t>;

constexpr double kCycle = 1e-3;
constexpr std::int64_t kCycleNs = 1'000'000;
constexpr std::size_t kMaxDelay = 512;  // cycles
constexpr std::size_t kMaxProblems = 10;

// Probabilities of each fault of the channel, for a sample.
constexpr double kFlipped = 0.1, kTruncated = 0.02, kExtreme = 0.05, kRepeated = 0.02, kVeryLate = 0.01, kLost = 0.03;
// Probabilities that an event begins, for a cycle.
constexpr double kSilence = 1e-4, kStop = 2e-6, kFailure = 2e-6, kRunaway = 1e-5;

class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_{seed} {}
  [[nodiscard]] bool chance(double share) { return unit() < share; }
  [[nodiscard]] double unit() { return static_cast<double>(engine_() >> 11) * 0x1p-53; }
  [[nodiscard]] std::size_t below(std::size_t bound) { return static_cast<std::size_t>(engine_() % bound); }

 private:
  std::mt19937_64 engine_;
};

/// Simulates a hand that strokes and presses a box at about 0.2 m/s. At random times it moves into the box for 20
/// cycles, ever faster.
class Hand {
 public:
  [[nodiscard]] session::DevicePose next(std::int64_t now_ns, Random& random) {
    const double t = static_cast<double>(now_ns) * 1e-9;
    if (random.chance(kRunaway)) runaway_ = 20;
    session::DevicePose pose;
    pose.sequence = ++sequence_;
    pose.session_time_ns = now_ns;
    Vec3d position{0.05 * std::sin(1.3 * t), 0.05 * std::sin(1.7 * t + 1), 0.001 * std::sin(9 * t) - 0.001};
    if (runaway_ > 0) position.z() -= 0.003 * (20 - --runaway_);
    pose.pose.position = {position.x(), position.y(), position.z()};
    const Vec3d velocity = (position - previous_) / kCycle;
    pose.velocity = {velocity.x(), velocity.y(), velocity.z()};
    pose.radius = 0.003;
    const Eigen::Quaterniond turn = haptics::exp_map({0.9 * std::sin(2.3 * t), 0.7 * std::sin(3.1 * t), 0});
    pose.pose.orientation = {turn.x(), turn.y(), turn.z(), turn.w()};
    previous_ = position;
    return pose;
  }

 private:
  Vec3d previous_ = Vec3d::Zero();
  std::uint32_t sequence_ = 0;
  int runaway_ = 0;
};

/// Encodes and decodes poses as Fast DDS does.
class Encoding {
 public:
  [[nodiscard]] Bytes bytes(const session::DevicePose& pose) {
    wire::to_idl(pose, sample_);
    payload_.length = 0;
    (void)wire::encode(type_, sample_, payload_);
    return {payload_.data, payload_.data + payload_.length};
  }
  [[nodiscard]] bool pose(const Bytes& bytes, session::DevicePose& pose) {
    std::copy(bytes.begin(), bytes.end(), payload_.data);
    payload_.length = static_cast<std::uint32_t>(bytes.size());
    if (!type_.decode(payload_, &sample_)) return false;
    wire::from_idl(sample_, pose);
    return true;
  }

 private:
  wire::Guarded<wire::IdlOf<session::DevicePose>::Support> type_{true};
  wire::IdlOf<session::DevicePose>::Type sample_;
  wire::rtps::SerializedPayload_t payload_{1024};
};

/// Loses, delays, repeats and corrupts samples.
class Channel {
 public:
  Channel(Random& random, SafetyResult& result) : random_{random}, result_{result}, due_(kMaxDelay) {}

  void send(const Bytes& bytes, std::uint64_t cycle) {
    ++result_.sent;
    if (silent_ > 0) --silent_;
    if (random_.chance(kSilence)) silent_ = 1 + static_cast<int>(random_.below(300));
    if (silent_ > 0 || random_.chance(kLost)) {
      ++result_.lost;
      return;
    }
    std::size_t delay = random_.below(3);
    if (random_.chance(kVeryLate)) {
      delay = random_.below(kMaxDelay);
      ++result_.late;
    }
    Bytes corrupted = bytes;
    corrupt(corrupted);
    if (random_.chance(kRepeated)) {
      due_[(cycle + random_.below(kMaxDelay)) % kMaxDelay].push_back(corrupted);
      ++result_.repeated;
    }
    due_[(cycle + delay) % kMaxDelay].push_back(std::move(corrupted));
  }

  /// Returns the samples that arrive in this cycle. The caller clears them.
  [[nodiscard]] std::vector<Bytes>& arrivals(std::uint64_t cycle) { return due_[cycle % kMaxDelay]; }

 private:
  void corrupt(Bytes& bytes) {
    const Bytes before = bytes;
    if (random_.chance(kFlipped))
      for (std::size_t flips = 1 + random_.below(16); flips > 0; --flips)
        bytes[random_.below(bytes.size())] ^= static_cast<std::uint8_t>(1u << random_.below(8));
    if (random_.chance(kExtreme)) {
      constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
      constexpr double kInfinite = std::numeric_limits<double>::infinity();
      constexpr std::array kNumbers{kNan, kInfinite, -kInfinite, 1e308, -1e308, 1e9, -1e3, 0.2, 5e-324, -0.0};
      const double number = kNumbers[random_.below(kNumbers.size())];
      // The doubles follow the encapsulation of 4 bytes, each 8 bytes long.
      std::memcpy(bytes.data() + 4 + 8 * random_.below((bytes.size() - 4) / 8), &number, sizeof number);
    }
    if (random_.chance(kTruncated)) bytes.resize(random_.below(bytes.size()));
    if (bytes != before) ++result_.corrupted;
  }

  Random& random_;
  SafetyResult& result_;
  std::vector<std::vector<Bytes>> due_;
  int silent_ = 0;
};

/// Checks each force, or each torque, against its limits.
class LimitChecker {
 public:
  struct Limits {
    const char* name;
    double max, slew;  // N and N/s, or N m and N m/s
  };
  LimitChecker(const SafetySettings& settings, const Limits& limits, SafetyResult& result, double& max,
               double& max_step)
      : settings_{settings}, limits_{limits}, result_{result}, max_{max}, max_step_{max_step} {}

  void on_reset(std::uint64_t cycle) {
    reset_cycle_ = cycle;
    latched_ = false;
  }

  /// `silence`: time since the newest accepted sample, s. `reason`: of the fault; empty if the fault has none.
  void check(std::uint64_t cycle, const Vec3d& force, double silence, bool fault, const std::string& reason) {
    constexpr double kTolerance = 1e-9;
    const double size = force.norm();
    const double step = (force - previous_).norm();
    if (!force.allFinite()) note(result_.not_finite, cycle, "is not finite");
    if (size > limits_.max + kTolerance) note(result_.over_limit, cycle, "is over its limit");
    const bool ends_in_time = silence >= settings_.force.zero_force_age && size == 0;
    if (!fault && !ends_in_time) {
      max_step_ = std::max(max_step_, step);
      if (step > limits_.slew * kCycle + kTolerance)
        note(result_.over_slew, cycle, "changes faster than its slew limit");
    }
    if (size > 0) result_.max_silence = std::max(result_.max_silence, silence);
    if (size > 0 && silence >= settings_.force.zero_force_age)
      note(result_.too_old, cycle, "acts on a pose that is too old");
    const double since_reset = static_cast<double>(cycle - reset_cycle_ + 1) * kCycle;
    if (size > limits_.max * since_reset / settings_.force.soft_start + kTolerance)
      note(result_.too_soon, cycle, "is stronger than the soft start allows");
    if (fault && size > 0) note(result_.despite_fault, cycle, "acts despite a fault");
    if (fault && (reason.empty() || reason == "unknown"))
      note(result_.without_reason, cycle, "is zero by a fault without a reason");
    if (latched_ && !fault) note(result_.ended_by_itself, cycle, "has ended its fault without a reset");
    latched_ = fault;
    max_ = std::max(max_, size);
    previous_ = force;
  }

 private:
  void note(std::uint64_t& count, std::uint64_t cycle, const char* how) {
    ++count;
    if (result_.problems.size() < kMaxProblems)
      result_.problems.push_back("seed " + std::to_string(settings_.seed) + ", cycle " + std::to_string(cycle) +
                                 ": the " + limits_.name + " " + how);
  }

  const SafetySettings& settings_;
  Limits limits_;
  SafetyResult& result_;
  double& max_;
  double& max_step_;
  Vec3d previous_ = Vec3d::Zero();
  std::uint64_t reset_cycle_ = 0;
  bool latched_ = false;
};

/// Returns the result of a tool that the plane z = 0 supports without rotation. Below the plane, a force and a torque
/// act.
haptics::ToolResult supported_tool(const haptics::DeviceState& device) {
  haptics::ToolResult tool;
  tool.pose = {device.position, device.orientation};
  tool.in_contact = !(device.position.z() >= 0);
  if (!tool.in_contact) return tool;
  tool.displacement.z() = -device.position.z();
  tool.rotation = haptics::log_map(device.orientation.conjugate());
  return tool;
}

/// A renderer with the checkers of its force and its torque. Resets each fault 20 to 219 cycles after it began.
class CheckedRenderer {
 public:
  haptics::ForceRenderer renderer;

  CheckedRenderer(const SafetySettings& settings, const haptics::DeviceSpec& spec, SafetyResult& result)
      : renderer{settings.force, spec},
        result_{result},
        force_{settings,
               {"force", std::min(settings.force.max_force, spec.max_force), settings.force.max_slew},
               result,
               result.max_force,
               result.max_force_step},
        torque_{settings,
                {"torque", std::min(settings.force.max_torque, spec.max_torque), settings.force.max_torque_slew},
                result,
                result.max_torque,
                result.max_torque_step} {}

  /// Checks force and torque of a cycle. Returns true if it has reset a fault.
  bool check(std::uint64_t cycle, const haptics::ForceResult& force, double silence, Random& random) {
    result_.force_cycles += force.force.isZero(0) ? 0 : 1;
    result_.torque_cycles += force.torque.isZero(0) ? 0 : 1;
    for (std::uint32_t bit = 0; bit < haptics::kForceBits; ++bit) result_.interventions[bit] += force.began >> bit & 1u;
    const bool fault = force.fault != haptics::Fault::kNone;
    const std::uint32_t status =
        fault ? session::kFault | static_cast<std::uint32_t>(force.fault) << session::kFaultReasonShift : 0;
    force_.check(cycle, force.force, silence, fault, session::fault_reason(status));
    torque_.check(cycle, force.torque, silence, fault, session::fault_reason(status));
    if (fault && reset_at_ == 0) {
      ++result_.faults[static_cast<std::size_t>(force.fault)];
      reset_at_ = cycle + 20 + random.below(200);
    }
    if (cycle != reset_at_) return false;
    renderer.reset();
    force_.on_reset(cycle + 1);
    torque_.on_reset(cycle + 1);
    reset_at_ = 0;
    return true;
  }

 private:
  SafetyResult& result_;
  LimitChecker force_, torque_;
  std::uint64_t reset_at_ = 0;  // cycle; 0: no fault
};

}  // namespace

SafetyResult run_safety(const SafetySettings& settings) {
  SafetyResult result;
  Random random{settings.seed};
  Hand hand;
  Encoding encoding;
  Channel channel{random, result};
  // A box of 0.3 m below z = 0. Wrong positions also touch its corners and edges.
  std::vector<haptics::testing::Triangle> box;
  const auto add = [&](const Vec3d& corner, const Vec3d& u, const Vec3d& v) {
    for (const auto& triangle : haptics::testing::sheet(corner, u, v)) box.push_back(triangle);
  };
  const Vec3d low{-0.15, -0.15, -0.3};
  const Vec3d x{0.3, 0, 0}, y{0, 0.3, 0}, z{0, 0, 0.3};
  add(low + z, x, y);
  add(low, y, x);
  add(low, x, z);
  add(low + y, z, x);
  add(low, z, y);
  add(low + x, y, z);
  haptics::testing::TriangleSurface surface{box};

  haptics::DeviceSpec spec;
  spec.max_torque = 2 * settings.force.max_torque;
  auto device = std::make_unique<haptics::RemoteDevice>(spec);
  haptics::Proxy proxy;
  const haptics::ContactImpedance impedance{1000, 1};
  // The same hand moves a sphere and a tool.
  CheckedRenderer sphere{settings, device->spec(), result}, tool{settings, device->spec(), result};
  std::int64_t received_ns = -1;
  session::SequenceWindow numbers{session::kCycleNumbers};
  std::uint32_t felt = 0;

  for (std::uint64_t cycle = 1; result.arrived < settings.samples; ++cycle) {
    const std::int64_t now_ns = static_cast<std::int64_t>(cycle) * kCycleNs;
    session::DevicePose pose = hand.next(now_ns, random);
    pose.command_applied = felt > 3 ? felt - 3 : 0;
    channel.send(encoding.bytes(pose), cycle);
    for (const Bytes& bytes : channel.arrivals(cycle)) {
      ++result.arrived;
      session::DevicePose arrived;
      if (!encoding.pose(bytes, arrived)) {
        ++result.undecodable;
        continue;
      }
      if (session::invalid_field(arrived) != nullptr) {
        ++result.refused;
        if (!random.chance(settings.unchecked)) continue;
        ++result.unchecked;
      }
      haptics::RemotePose remote_pose;
      remote_pose.position = arrived.pose.position;
      remote_pose.orientation = arrived.pose.orientation;
      remote_pose.velocity = arrived.velocity;
      remote_pose.sequence = arrived.sequence;
      remote_pose.buttons = arrived.buttons;
      remote_pose.command_applied = arrived.command_applied;
      remote_pose.measured_ns = arrived.session_time_ns;
      remote_pose.arrived_ns = now_ns;
      const bool newest = session::accepted(numbers.admit(remote_pose.sequence, now_ns));
      if (newest) device->on_pose(remote_pose);
      ++(newest ? result.accepted : result.overtaken);
      if (newest) received_ns = now_ns;
    }
    channel.arrivals(cycle).clear();
    if (received_ns < 0) continue;  // as an HRTC does while a device has no pose

    const haptics::DeviceState state = device->read(now_ns);
    const double age = static_cast<double>(now_ns - state.time_ns) * 1e-9;
    for (CheckedRenderer* renderer : {&sphere, &tool}) {
      if (random.chance(kStop)) renderer->renderer.latch(haptics::Fault::kEmergencyStop);
      if (random.chance(kFailure)) renderer->renderer.latch(haptics::Fault::kDeviceFailed);
    }
    proxy.set_grip({0.5, 0.4});
    const haptics::ProxyResult& touch = proxy.step(state.position, kCycle, surface, false);
    ++result.cycles;
    result.contact_cycles += touch.in_contact ? 1 : 0;
    const double silence = static_cast<double>(now_ns - received_ns) * 1e-9, silent = age - state.transit;
    const haptics::ForceResult& sphere_force = sphere.renderer.step(touch, state, impedance, silent, kCycle);
    if (sphere.check(cycle, sphere_force, silence, random)) proxy.reset();
    const haptics::ToolGrip grip = tool.renderer.tool_grip(impedance, kCycle, state.round_trip);
    const haptics::ForceResult& tool_force =
        tool.renderer.step(supported_tool(state), grip, state, impedance, silent, kCycle);
    static_cast<void>(tool.check(cycle, tool_force, silence, random));
    felt = device->on_command(now_ns);
  }
  return result;
}

}  // namespace tactus::bench
