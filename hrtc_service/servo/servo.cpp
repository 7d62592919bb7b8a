#include "hrtc_service/servo/servo.hpp"

#include <algorithm>
#include <utility>

namespace tactus::hrtc_service {
namespace {

// Longest silence of a gateway on a busy machine, s.
constexpr double kSilence = 0.04;
// Times in which the forces of movable and of fixed objects then decrease to zero, s.
constexpr double kMovableFade = 0.02, kFixedFade = 0.5;
// Max part of the time between two cycles that counts as silence, s: the gateway does not run either while the machine
// is suspended. Half of kSilence, so that forces do not end in the first cycle afterwards.
constexpr double kMaxGap = 0.02;

}  // namespace

Servo::Servo(const ServoSettings& settings, ServoLink& link, Intake& intake, BodyOrderLink& orders,
             ContactQuery::LogRing* log)
    : link_{link},
      near_objects_{link.near_objects},
      reports_{link.reports},
      mesh_hashes_{link.mesh_hashes},
      shown_reports_{link.shown_reports},
      arrivals_{intake.arrivals()},
      cycle_{settings.cycle, settings.specs, intake.departures(), log},
      bodies_{settings.cycle, link.bodies, orders},
      stop_signals_{settings.emergency_stop_signals},
      force_{settings.cycle.force},
      gateway_patience_{settings.gateway_patience},
      watches_gateway_{settings.watches_gateway} {
  cycle_.set_observer(settings.recorder);
  snapshot_.nodes.resize(settings.snapshot_nodes);
}

/// Returns the stop word to obey. It is stopped in the cycle of a local stop, while a stop button is pressed, and while
/// the gateway has not issued a stop for a local stop. A pressed button counts as a local stop, and as another one when
/// a reset has ended its stop while it is pressed. The buttons of a failed device do not count, because nobody can
/// release them.
StopWord Servo::read_stop() noexcept {
  const std::uint32_t issued = link_.local_stops_issued();
  StopWord word = link_.stop();  // after `issued`, because the gateway sets the word first
  const bool was_pressed =
      std::exchange(stop_pressed_, std::any_of(inputs_.begin(), inputs_.end(), [](const auto& input) {
                      return input.active && !input.failed && (input.device.buttons & haptics::kStopButton) != 0;
                    }));
  const std::uint32_t before = local_stops_;
  if (stop_pressed_ && (!was_pressed || word.resets != stop_.resets)) ++local_stops_;
  if (stop_signals_ != nullptr) {
    const std::uint32_t signals = stop_signals_->load(std::memory_order_relaxed);
    local_stops_ += signals - std::exchange(stop_signals_seen_, signals);
  }
  link_.set_local_stops(local_stops_);
  word.stopped = word.stopped || stop_pressed_ || local_stops_ != before || issued != local_stops_;
  return word;
}

/// Applies the stop after the reset, so that an earlier reset cannot end the stop.
void Servo::obey(StopWord word) noexcept {
  if (word.bits() == stop_.bits()) return;
  if (word.resets > stop_.resets) cycle_.reset_faults();
  if (word.stopped) cycle_.stop(haptics::Fault::kEmergencyStop);
  stop_ = word;
}

/// While the gateway is silent, raises the pose ages of probes, so that their forces decrease and return as those of a
/// silent device. Probes that may touch a movable object have kSilence before that, all others `gateway_patience`. The
/// silence ends with a heartbeat in the session. At a movable object it also continues until its pose is known.
void Servo::age_without_gateway(std::int64_t now_ns) noexcept {
  const double since_last = static_cast<double>(now_ns - std::exchange(silence_updated_ns_, now_ns)) * 1e-9;
  const double passed = std::clamp(since_last, 0.0, kMaxGap);
  const std::uint64_t heartbeats = link_.session_heartbeats();
  const bool has_new_heartbeat = std::exchange(heartbeats_, heartbeats) != heartbeats;
  silence_ = has_new_heartbeat || heartbeats == 0 ? 0 : silence_ + passed;
  if (!watches_gateway_) return;
  const std::uint32_t attach_requests = link_.intake.attach_requests.load(std::memory_order_acquire);
  if (std::exchange(attach_requests_, attach_requests) != attach_requests) bodies_.forget_poses();
  const std::uint64_t unknown = bodies_.unknown_poses();
  unknown_silence_ = unknown != 0 ? unknown_silence_ + passed : silence_;
  const auto ends_force = [](double silence) { return silence >= kSilence + kMovableFade; };
  released_ = ends_force(silence_) ? ~std::uint64_t{0} : ends_force(unknown_silence_) ? unknown : 0;
  if (unknown_silence_ <= kSilence) return;
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
    const std::uint32_t object = outputs_[i].object;
    std::uint64_t movable = cycle_.movable_objects_at(i, vec(outputs_[i].proxy));
    if (cycle_.can_move(object)) movable |= std::uint64_t{1} << object;
    const double silence = (movable & unknown) != 0 ? unknown_silence_ : silence_;
    const double late = silence - (movable != 0 ? kSilence : gateway_patience_);
    if (late <= 0) continue;
    const double share = late / (movable != 0 ? kMovableFade : kFixedFade);
    const double age = force_.max_fresh_age + share * (force_.zero_force_age - force_.max_fresh_age);
    inputs_[i].pose_age = std::max(inputs_[i].pose_age, age + inputs_[i].device.transit);
  }
}

const Servo::Outputs& Servo::touch(const Inputs& inputs, std::int64_t now_ns) noexcept {
  inputs_ = inputs;
  age_without_gateway(now_ns);  // before `read_stop`, see ServoLink::session_heartbeats
  obey(read_stop());
  const auto arrived = static_cast<std::uint32_t>(arrivals_.pop(arrived_.data(), arrived_.size()));
  const std::array<NearObjects, kMaxProbes>& near = near_objects_.latest();
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) inputs_[i].near = near[i];
  bodies_.apply_received_poses(cycle_, now_ns);
  outputs_ = cycle_.touch(inputs_, now_ns, arrived_.data(), arrived).probes;
  bodies_.forget_withdrawn(cycle_);
  bodies_.limit_forces(cycle_, inputs_, outputs_);
  return outputs_;
}

void Servo::publish(std::int64_t now_ns, std::int64_t next_due_ns) noexcept {
  link_.acknowledge_stop(stop_);
  bodies_.simulate(cycle_, now_ns, released_);
  reports_.post({now_ns, next_due_ns, ++cycles_, outputs_, cycle_.result().interventions});
}

const CycleResult& Servo::refine(spm::Budget budget, const RefineLimit& limit) noexcept {
  const CycleResult& result = cycle_.refine(snapshot_.is_copying ? spm::Budget{0} : budget, limit);
  for (const TouchObject* object : cycle_.objects()) hashes_[object->index] = object->forest->mesh_hash();
  mesh_hashes_.post(hashes_);
  link_.set_log_dropped(cycle_.log_dropped());
  if (const std::uint32_t requested = link_.take_shown_request(); requested != spm::kNone) report_shown(requested);
  if (snapshot_.is_copying) continue_snapshot();
  return result;
}

/// Reports the regions of an object's mesh. Takes about 2 us for 100 regions.
void Servo::report_shown(std::uint32_t object_index) noexcept {
  for (const TouchObject* object : cycle_.objects()) {
    if (object->index != object_index) continue;
    shown_.object = object_index;
    shown_.mesh_hash = object->forest->mesh_hash();
    shown_.count =
        object->forest->copy_in_use(shown_.regions.data(), static_cast<std::uint32_t>(shown_.regions.size()));
    shown_reports_.post(shown_);
  }
}

bool Servo::begin_snapshot() noexcept {
  if (snapshot_.nodes.empty() || snapshot_.is_copying ||
      snapshots_released_.load(std::memory_order_acquire) != snapshots_done())
    return false;
  snapshot_.count = snapshot_.objects = snapshot_.next_node = 0;
  snapshot_.objects_changed = cycle_.objects_changed();
  snapshot_.is_copying = true;
  return true;
}

void Servo::continue_snapshot() noexcept {
  if (snapshot_.objects_changed != cycle_.objects_changed()) {  // objects may have other positions in the list
    snapshot_.is_copying = false;
    (void)begin_snapshot();
  }
  std::uint32_t nodes_left = 500;  // max leaves copied in a cycle, which take some 20 us
  const std::vector<TouchObject*>& objects = cycle_.objects();
  while (nodes_left > 0 && snapshot_.objects < objects.size()) {
    const TouchObject& object = *objects[snapshot_.objects];
    const auto free_nodes = static_cast<std::uint32_t>(snapshot_.nodes.size()) - snapshot_.count;
    const std::uint32_t max_copied = std::min(nodes_left, free_nodes);
    spm::TreeNode* out = snapshot_.nodes.data() + snapshot_.count;
    const std::uint32_t copied = object.forest->tree().copy_leaves(snapshot_.next_node, out, max_copied);
    snapshot_.count += copied;
    nodes_left -= copied;
    if (copied > 0) snapshot_.next_node = out[copied - 1].id + 1;
    if (copied == max_copied && free_nodes > copied) break;
    snapshot_.indices[snapshot_.objects] = object.index;
    snapshot_.ends[snapshot_.objects++] = snapshot_.count;
    snapshot_.next_node = 0;
  }
  if (snapshot_.objects < objects.size()) return;
  snapshot_.is_copying = false;
  snapshots_done_.fetch_add(1, std::memory_order_release);
}

std::vector<SnapshotFace> Servo::snapshot(std::uint32_t object_index) const {
  std::vector<SnapshotFace> faces;
  for (std::uint32_t i = 0, first = 0; i < snapshot_.objects; first = snapshot_.ends[i++]) {
    if (snapshot_.indices[i] != object_index) continue;
    for (std::uint32_t number = first; number < snapshot_.ends[i]; ++number) {
      const spm::TreeNode& node = snapshot_.nodes[number];
      for (unsigned lane = 0; lane < spm::TreeNode::kWidth; ++lane) {
        if ((node.mask >> lane & 1u) == 0) continue;
        SnapshotFace& face = faces.emplace_back();
        for (std::uint32_t row = 0; row < face.corners.size(); ++row) face.corners[row] = node.lanes[row][lane];
        face.finest = (node.finest >> lane & 1u) != 0;
      }
    }
  }
  return faces;
}

}  // namespace tactus::hrtc_service
