#include "bench/movement.hpp"

#include <stdexcept>

#include "bench/session_run.hpp"
#include "client_sim/operator.hpp"
#include "client_sim/scenario.hpp"
#include "haptics/simulated_device.hpp"
#include "sharing/hand_path.hpp"

namespace tactus::bench {
namespace {

using spm::Vec3d;

constexpr char kUser[] = "ann";

client_sim::User user_of(const Movement& movement) {
  const std::string text =
      std::string{"name: movement\nusers:\n  - name: "} + kUser + "\n    repeat: true\n    script:\n" + movement.script;
  return client_sim::parse_scenario(text, movement.name).users.front();
}

client_sim::Objects objects_of(const spm::ModelSummary& summary, double scale) {
  client_sim::ObjectView view;
  view.id = 1;
  for (int axis = 0; axis < 3; ++axis) {
    view.centre[axis] = scale * (summary.bounds_min[axis] + summary.bounds_max[axis]) / 2;
    view.half_size[axis] = scale * (summary.bounds_max[axis] - summary.bounds_min[axis]) / 2;
  }
  return {{"object", view}};
}

/// A hand with a tremor of 0.1 mm, whose device measures positions in steps of 10 um.
haptics::HandSettings hand_settings(const Vec3d& start, std::uint32_t seed) {
  haptics::HandSettings hand;
  hand.tremor = 1e-4;
  hand.encoder_step = 1e-5;
  hand.seed = seed;
  hand.start = start;
  return hand;
}

session::ProbeState state_of(const hrtc_service::ProbeOutput& probe) {
  session::ProbeState state;
  state.user_id = session::id_of(kUser);
  state.device.position = probe.device;
  state.proxy = probe.proxy;
  state.velocity = probe.velocity;
  state.force = probe.force;
  state.radius = 0.003;
  state.object_id = probe.object == spm::kNone ? 0 : 1;
  state.status = probe.status;
  state.stiffness = probe.stiffness;
  return state;
}

}  // namespace

const std::vector<Movement>& movements() {
  static const std::vector<Movement> kMovements{
      {"tap", "      - tap: {object: object, direction: [0, 0, 1], count: 1000, speed: 0.15, force: 1}\n"},
      {"follow 5 cm/s",
       "      - approach: {object: object, direction: [0, 0, 1], speed: 0.1}\n"
       "      - follow: {speed: 0.05, force: 1.5, seconds: 1000, pattern: circle}\n"},
      {"follow 15 cm/s",
       "      - approach: {object: object, direction: [0, 0, 1], speed: 0.1}\n"
       "      - follow: {speed: 0.15, force: 1.5, seconds: 1000, pattern: zigzag}\n"},
      {"hold",
       "      - approach: {object: object, direction: [0, 0, 1], speed: 0.1}\n"
       "      - hold: {force: 1, seconds: 1000}\n"},
      {"air",
       "      - approach: {object: object, direction: [0, 0, 1], speed: 0.1, until_force: 0.1}\n"
       "      - retreat: {speed: 0.25}\n"
       "      - wait: {seconds: 0.5}\n"}};
  return kMovements;
}

std::vector<session::ProbeState> simulate(const spm::Model& model, double scale, const Movement& movement,
                                          double seconds, std::uint32_t seed) {
  SessionSettings settings;
  settings.pool = spm::PoolSettings::for_slots(model.summary.parts + 1000);
  SessionRun run{model, scale, settings};
  const client_sim::Objects objects = objects_of(model.summary, scale);
  const client_sim::ObjectView& view = objects.begin()->second;
  const Vec3d start = view.centre + Vec3d{0, 0, view.half_size.z() + 0.03};
  run.settle(start);

  client_sim::Operator user{user_of(movement), {}};
  haptics::SimulatedDevice hand{hand_settings(start, seed)};
  std::vector<session::ProbeState> states;
  constexpr std::int64_t kMs = 1'000'000, kStart = 1'000'000'000, kContactLimit = 20'000 * kMs;
  const auto count = static_cast<std::size_t>(seconds * 1e3);
  bool has_touched = false;
  for (std::int64_t now = kStart; states.size() < count; now += kMs) {
    if (now > kStart + kContactLimit && !has_touched)
      throw std::runtime_error(std::string{"movement '"} + movement.name + "' touches nothing within 20 s");
    const haptics::DeviceState device = hand.read(now);
    run.prepare(device.position, device.velocity);
    const hrtc_service::ProbeOutput& probe = run.cycle(spm::Budget{1u << 20}).probes[0];
    hand.write(hrtc_service::vec(probe.force));
    session::ProbeState state = state_of(probe);
    state.session_time_ns = now;
    user.on_probe_state(state);
    if (const auto intent = user.tick(now, objects)) hand.paths().post(sharing::hand_path(*intent, 0));
    has_touched = has_touched || (probe.status & session::kInContact) != 0;
    if (!has_touched) continue;
    state.session_time_ns = static_cast<std::int64_t>(states.size()) * kMs;
    state.sequence = static_cast<std::uint32_t>(states.size()) + 1;
    states.push_back(state);
  }
  return states;
}

}  // namespace tactus::bench
