#include "bench/safety_run.hpp"

#include <cmath>
#include <cstring>
#include <limits>
#include <memory>
#include <random>

#include "haptics/remote_device.hpp"
#include "haptics/rigid_body.hpp"
#include "session/sequence_window.hpp"
#include "tests/haptics/triangle_surface.hpp"
#include "wire/check.hpp"
#include "wire/convert.hpp"

namespace tactus::bench {
namespace {

using haptics::Vec3d;
using Bytes = std::vector<std::uint8_t>;

constexpr double kCycle = 1e-3;
constexpr std::int64_t kCycleNs = 1'000'000;
constexpr std::size_t kLatest = 512;  // cycles by which a sample is late at most
constexpr std::size_t kProblems = 10;

/// What happens to samples, as shares of all.
constexpr double kFlipped = 0.1, kCut = 0.02, kExtreme = 0.05, kDoubled = 0.02, kVeryLate = 0.01, kLost = 0.03;
constexpr double kSilence = 1e-4, kStop = 2e-6, kFailure = 2e-6, kRunaway = 1e-5;  // begins, a cycle

class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_{seed} {}
  [[nodiscard]] bool chance(double share) { return unit() < share; }
  [[nodiscard]] double unit() { return static_cast<double>(engine_() >> 11) * 0x1p-53; }
  [[nodiscard]] std::size_t below(std::size_t bound) { return static_cast<std::size_t>(engine_() % bound); }

 private:
  std::mt19937_64 engine_;
};

/// A hand that rubs and presses a box, at 0.2 m/s or so, and now and then runs away against the force.
class Hand {
 public:
  [[nodiscard]] session::DevicePose next(std::int64_t now_ns, Random& random) {
    const double t = static_cast<double>(now_ns) * 1e-9;
    if (random.chance(kRunaway)) runaway_ = 20;
    session::DevicePose pose;
    pose.sequence = ++sequence_;
    pose.session_time_ns = now_ns;
    Vec3d place{0.05 * std::sin(1.3 * t), 0.05 * std::sin(1.7 * t + 1), 0.001 * std::sin(9 * t) - 0.001};
    if (runaway_ > 0) place.z() -= 0.003 * (20 - --runaway_);
    pose.pose.position = {place.x(), place.y(), place.z()};
    const Vec3d velocity = (place - before_) / kCycle;
    pose.velocity = {velocity.x(), velocity.y(), velocity.z()};
    pose.radius = 0.003;
    const Eigen::Quaterniond turn = haptics::exp_map({0.9 * std::sin(2.3 * t), 0.7 * std::sin(3.1 * t), 0});
    pose.pose.orientation = {turn.x(), turn.y(), turn.z(), turn.w()};
    before_ = place;
    return pose;
  }

 private:
  Vec3d before_ = Vec3d::Zero();
  std::uint32_t sequence_ = 0;
  int runaway_ = 0;
};

/// The encoding that Fast DDS would carry, both ways.
class Encoding {
 public:
  [[nodiscard]] Bytes bytes(const session::DevicePose& pose) {
    wire::to_idl(pose, sample_);
    payload_.length = 0;
    type_.serialize(&sample_, &payload_);
    return {payload_.data, payload_.data + payload_.length};
  }
  [[nodiscard]] bool pose(const Bytes& bytes, session::DevicePose& pose) {
    std::memcpy(payload_.data, bytes.data(), bytes.size());
    payload_.length = static_cast<std::uint32_t>(bytes.size());
    try {
      if (!type_.deserialize(&payload_, &sample_)) return false;
    } catch (const std::exception&) {  // as the type of a Reader has it
      return false;
    }
    wire::from_idl(sample_, pose);
    return true;
  }

 private:
  wire::IdlOf<session::DevicePose>::Support type_;
  wire::IdlOf<session::DevicePose>::Type sample_;
  eprosima::fastrtps::rtps::SerializedPayload_t payload_{1024};
};

/// Loses, delays, doubles and spoils.
class Channel {
 public:
  Channel(Random& random, SafetyResult& result) : random_{random}, result_{result}, due_(kLatest) {}

  void send(const Bytes& bytes, std::uint64_t cycle) {
    if (silent_ > 0) --silent_;
    if (random_.chance(kSilence)) silent_ = 1 + static_cast<int>(random_.below(300));
    if (silent_ > 0 || random_.chance(kLost)) {
      ++result_.lost;
      return;
    }
    std::size_t delay = random_.below(3);
    if (random_.chance(kVeryLate)) {
      delay = random_.below(kLatest);
      ++result_.late;
    }
    Bytes spoilt = bytes;
    spoil(spoilt);
    if (random_.chance(kDoubled)) {
      due_[(cycle + random_.below(kLatest)) % kLatest].push_back(spoilt);
      ++result_.doubled;
    }
    due_[(cycle + delay) % kLatest].push_back(std::move(spoilt));
  }

  /// What arrives in this cycle; to be cleared by the caller.
  [[nodiscard]] std::vector<Bytes>& arrivals(std::uint64_t cycle) { return due_[cycle % kLatest]; }

 private:
  void spoil(Bytes& bytes) {
    const Bytes before = bytes;
    if (random_.chance(kFlipped))
      for (std::size_t flips = 1 + random_.below(16); flips > 0; --flips)
        bytes[random_.below(bytes.size())] ^= static_cast<std::uint8_t>(1u << random_.below(8));
    if (random_.chance(kExtreme)) {
      constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
      constexpr double kInfinite = std::numeric_limits<double>::infinity();
      constexpr std::array kNumbers{kNan, kInfinite, -kInfinite, 1e308, -1e308, 1e9, -1e3, 0.2, 5e-324, -0.0};
      const double number = kNumbers[random_.below(kNumbers.size())];
      // After the encapsulation of 4 bytes, doubles lie 8 apart.
      std::memcpy(bytes.data() + 4 + 8 * random_.below((bytes.size() - 4) / 8), &number, sizeof number);
    }
    if (random_.chance(kCut)) bytes.resize(random_.below(bytes.size()));
    if (bytes != before) ++result_.corrupted;
  }

  Random& random_;
  SafetyResult& result_;
  std::vector<std::vector<Bytes>> due_;
  int silent_ = 0;
};

/// Judges each force, or each torque, by the limits alone.
class Watcher {
 public:
  struct Limits {
    const char* what;
    double max, slew;  // N, N/s or the same of torques
  };
  Watcher(const SafetySettings& settings, const Limits& limits, SafetyResult& result, double& largest,
          double& largest_step)
      : settings_{settings}, limits_{limits}, result_{result}, largest_{largest}, largest_step_{largest_step} {}

  void on_reset(std::uint64_t cycle) {
    reset_cycle_ = cycle;
    latched_ = false;
  }

  /// `silence`: s since the newest sample that was taken; `reason`: of the fault, none when empty.
  void judge(std::uint64_t cycle, const Vec3d& force, double silence, bool fault, const std::string& reason) {
    constexpr double kTolerance = 1e-9;
    const double size = force.norm();
    const double step = (force - before_).norm();
    if (!force.allFinite()) note(result_.not_finite, cycle, "is not finite");
    if (size > limits_.max + kTolerance) note(result_.over_limit, cycle, "is over its limit");
    const bool ends_in_time = silence >= settings_.force.zero_by && size == 0;
    if (!fault && !ends_in_time) {
      largest_step_ = std::max(largest_step_, step);
      if (step > limits_.slew * kCycle + kTolerance) note(result_.over_slew, cycle, "jumped");
    }
    if (size > 0) result_.oldest_force = std::max(result_.oldest_force, silence);
    if (size > 0 && silence >= settings_.force.zero_by) note(result_.too_old, cycle, "is of an old pose");
    const double since_reset = static_cast<double>(cycle - reset_cycle_ + 1) * kCycle;
    if (size > limits_.max * since_reset / settings_.force.soft_start + kTolerance)
      note(result_.too_soon, cycle, "is stronger than the soft start allows");
    if (fault && size > 0) note(result_.despite_fault, cycle, "acts despite a fault");
    if (fault && (reason.empty() || reason == "unknown")) note(result_.without_reason, cycle, "is off without reason");
    if (latched_ && !fault) note(result_.ended_by_itself, cycle, "is on again without a reset");
    latched_ = fault;
    largest_ = std::max(largest_, size);
    before_ = force;
  }

 private:
  void note(std::uint64_t& count, std::uint64_t cycle, const char* how) {
    ++count;
    if (result_.problems.size() < kProblems)
      result_.problems.push_back("seed " + std::to_string(settings_.seed) + ", cycle " + std::to_string(cycle) +
                                 ": the " + limits_.what + " " + how);
  }

  const SafetySettings& settings_;
  Limits limits_;
  SafetyResult& result_;
  double& largest_;
  double& largest_step_;
  Vec3d before_ = Vec3d::Zero();
  std::uint64_t reset_cycle_ = 0;
  bool latched_ = false;
};

/// Where a tool would be that a plane holds up and level: below it a force and a torque act.
haptics::ToolResult held_level(const haptics::DeviceState& device) {
  haptics::ToolResult tool;
  tool.pose = {device.position, device.orientation};
  tool.in_contact = !(device.position.z() >= 0);
  if (!tool.in_contact) return tool;
  tool.displacement.z() = -device.position.z();
  tool.rotation = haptics::log_map(device.orientation.conjugate());
  return tool;
}

/// A renderer with what it is judged by, whose faults are reset after a while.
class Judged {
 public:
  haptics::ForceRenderer renderer;

  Judged(const SafetySettings& settings, const haptics::DeviceSpec& spec, SafetyResult& result)
      : renderer{settings.force, spec},
        result_{result},
        force_{settings,
               {"force", std::min(settings.force.max_force, spec.max_force), settings.force.max_slew},
               result,
               result.largest_force,
               result.largest_step},
        torque_{settings,
                {"torque", std::min(settings.force.max_torque, spec.max_torque), settings.force.max_torque_slew},
                result,
                result.largest_torque,
                result.largest_torque_step} {}

  /// True when the fault has been reset.
  bool judge(std::uint64_t cycle, const haptics::ForceResult& force, double silence, Random& random) {
    result_.force_cycles += force.force.isZero(0) ? 0 : 1;
    result_.torque_cycles += force.torque.isZero(0) ? 0 : 1;
    for (std::uint32_t bit = 0; bit < haptics::kForceBits; ++bit) result_.interventions[bit] += force.began >> bit & 1u;
    const bool fault = force.fault != haptics::Fault::kNone;
    const std::uint32_t status =
        fault ? session::kFault | static_cast<std::uint32_t>(force.fault) << session::kFaultReasonShift : 0;
    force_.judge(cycle, force.force, silence, fault, session::fault_reason(status));
    torque_.judge(cycle, force.torque, silence, fault, session::fault_reason(status));
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
  Watcher force_, torque_;
  std::uint64_t reset_at_ = 0;  // cycle; 0: no fault
};

}  // namespace

SafetyResult run_safety(const SafetySettings& settings) {
  SafetyResult result;
  Random random{settings.seed};
  Hand hand;
  Encoding encoding;
  Channel channel{random, result};
  // A box, 0.3 m wide, below z = 0: corners and edges are within reach of wrong positions.
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
  const haptics::Feel feel{1000, 1};
  // The same hand, with a ball and with a tool.
  Judged tip{settings, device->spec(), result}, tool{settings, device->spec(), result};
  std::int64_t received_ns = -1;
  session::SequenceWindow numbers{session::kCycleNumbers};
  std::uint32_t felt = 0;

  for (std::uint64_t cycle = 1; result.arrived < settings.samples; ++cycle) {
    const std::int64_t now_ns = static_cast<std::int64_t>(cycle) * kCycleNs;
    session::DevicePose pose = hand.next(now_ns, random);
    pose.command_felt = felt > 3 ? felt - 3 : 0;
    channel.send(encoding.bytes(pose), cycle);
    for (const Bytes& bytes : channel.arrivals(cycle)) {
      ++result.arrived;
      session::DevicePose arrived;
      if (!encoding.pose(bytes, arrived)) {
        ++result.undecodable;
        continue;
      }
      if (wire::fault(arrived) != nullptr) {
        ++result.refused;
        if (!random.chance(settings.unchecked)) continue;
        ++result.unchecked;
      }
      haptics::RemotePose taken;
      taken.position = arrived.pose.position;
      taken.orientation = arrived.pose.orientation;
      taken.velocity = arrived.velocity;
      taken.sequence = arrived.sequence;
      taken.buttons = arrived.buttons;
      taken.command_felt = arrived.command_felt;
      taken.taken_ns = arrived.session_time_ns;
      taken.arrived_ns = now_ns;
      const bool newest = session::accepted(numbers.admit(taken.sequence, now_ns));
      if (newest) device->on_pose(taken);
      ++(newest ? result.taken : result.overtaken);
      if (newest) received_ns = now_ns;
    }
    channel.arrivals(cycle).clear();
    if (received_ns < 0) continue;  // as in an HRTC, where a device without a pose is not served

    const haptics::DeviceState state = device->read(now_ns);
    const double age = static_cast<double>(now_ns - state.time_ns) * 1e-9;
    for (Judged* one : {&tip, &tool}) {
      if (random.chance(kStop)) one->renderer.latch(haptics::Fault::kEmergencyStop);
      if (random.chance(kFailure)) one->renderer.latch(haptics::Fault::kDeviceFailed);
    }
    proxy.set_grip({0.5, 0.4});
    const haptics::ProxyResult& touch = proxy.step(state.position, kCycle, surface, false);
    ++result.cycles;
    result.contact_cycles += touch.in_contact ? 1 : 0;
    const double silence = static_cast<double>(now_ns - received_ns) * 1e-9, silent = age - state.transit;
    const haptics::ForceResult& by_tip = tip.renderer.step(touch, state, feel, silent, kCycle);
    if (tip.judge(cycle, by_tip, silence, random)) proxy.reset();
    const haptics::ToolGrip grip = tool.renderer.grip(feel, kCycle, state.loop_delay);
    const haptics::ForceResult& by_tool = tool.renderer.step(held_level(state), grip, state, feel, silent, kCycle);
    static_cast<void>(tool.judge(cycle, by_tool, silence, random));
    felt = device->on_command(now_ns);
  }
  return result;
}

}  // namespace tactus::bench
