#include "hrtc_service/haptic_thread.hpp"

#include <unistd.h>

#include <algorithm>
#include <future>
#include <memory>

#include "hrtc_service/realtime.hpp"

namespace tactus::hrtc_service {
namespace {

constexpr std::size_t kRingEntries = 4096;

/// Touches all of a ring's memory, so that the haptic thread is never the first to.
template <class Entry>
void touch(boost::lockfree::spsc_queue<Entry>& ring) {
  const auto blank = std::make_unique<Entry>();
  while (ring.push(*blank)) {
  }
  ring.consume_all([](const Entry&) {});
}

}  // namespace

HapticThread::HapticThread(const HapticSettings& settings, const std::array<haptics::DeviceSpec, kMaxProbes>& specs)
    : settings_{settings},
      arrivals_{kRingEntries},
      departures_{kRingEntries},
      traces_{2 * kRingEntries},
      log_{settings.log ? kRingEntries : 1},
      cycle_{settings.cycle, specs, departures_, settings.log ? &log_ : nullptr},
      bodies_{settings.cycle},
      governor_{settings.deadline_ns} {
  cycle_.set_observer(settings.recorder);
  touch(arrivals_);
  touch(departures_);
  touch(traces_);
  touch(log_);
  frames_.fill(settings.frame);
  snapshot_.nodes.resize(settings.snapshot_nodes);
}

HapticThread::~HapticThread() { stop(); }

std::string HapticThread::start() {
  std::promise<std::string> granted;
  std::future<std::string> future = granted.get_future();
  pid_t thread_id = 0;
  running_ = true;
  thread_ = std::thread{[this, &granted, &thread_id] {
    pthread_setname_np(pthread_self(), "haptic");
    thread_id = gettid();
    granted.set_value(settings_.priority > 0 ? wire::enter_realtime("haptic thread", settings_.priority)
                                             : "haptic thread: no real-time priority asked for");
    run();
  }};
  std::string line = future.get();
  usage_ = std::make_unique<UsageSampler>(thread_.native_handle(), thread_id);
  if (!usage_->available()) line += "; the system does not report its run-queue wait, so late cycles stay unclassified";
  return line;
}

void HapticThread::stop() {
  running_ = false;
  if (thread_.joinable()) thread_.join();
}

void HapticThread::obey(const HapticCommands& commands) noexcept {
  if (commands.snapshots != current_.snapshots && settings_.snapshot_nodes > 0 && !snapshot_.under_way) {
    snapshot_.count = snapshot_.objects = snapshot_.next_node = 0;
    snapshot_.under_way = true;
  }
  for (std::uint32_t i = 0; i < kMaxProbes; ++i)
    if (current_.devices[i] != nullptr && commands.devices[i] != current_.devices[i])
      current_.devices[i]->write_wrench(Vec3d::Zero(), Vec3d::Zero());
  current_ = commands;
  obeyed_.store(commands.number, std::memory_order_release);
}

/// A stop comes last: it stands, whatever a reset has ended.
void HapticThread::obey(StopWord word) noexcept {
  if (word.bits() == stop_.bits()) return;
  if (word.resets != stop_.resets) cycle_.reset_faults();
  if (word.stopped) cycle_.stop(haptics::Fault::kEmergencyStop);
  stop_ = word;
}

void HapticThread::read_devices(std::int64_t now_ns) noexcept {
  const std::array<NearObjects, kMaxProbes>& near = near_.latest();
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
    ProbeInput& input = inputs_[i];
    input.active = current_.devices[i] != nullptr;
    if (!input.active) continue;
    input.device = current_.devices[i]->read(now_ns);
    input.failed = current_.devices[i]->health() == haptics::DeviceHealth::kFailed;
    input.pose_age = static_cast<double>(now_ns - input.device.time_ns) * 1e-9;
    if (current_.framed[i])
      input.device = frames_[i].to_world(input.device, (input.device.buttons & haptics::kClutchButton) != 0);
    input.near = near[i];
  }
}

void HapticThread::write_forces() noexcept {
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
    if (current_.devices[i] == nullptr) continue;
    const Vec3d force = vec(outputs_[i].force), torque = vec(outputs_[i].torque);
    if (current_.framed[i])
      current_.devices[i]->write_wrench(frames_[i].force_to_device(force), frames_[i].torque_to_device(torque));
    else
      current_.devices[i]->write_wrench(force, torque);
  }
}

void HapticThread::continue_snapshot() noexcept {
  std::uint32_t room = 500;  // nodes: some 20 us
  const std::vector<TouchObject*>& objects = cycle_.objects();
  while (room > 0 && snapshot_.objects < objects.size()) {
    const TouchObject& object = *objects[snapshot_.objects];
    const auto left = static_cast<std::uint32_t>(snapshot_.nodes.size()) - snapshot_.count;
    const std::uint32_t wanted = std::min(room, left);
    spm::TreeNode* out = snapshot_.nodes.data() + snapshot_.count;
    const std::uint32_t copied = object.forest->tree().copy_leaves(snapshot_.next_node, out, wanted);
    snapshot_.count += copied;
    room -= copied;
    if (copied > 0) snapshot_.next_node = out[copied - 1].id + 1;
    if (copied == wanted && left > copied) break;
    snapshot_.indices[snapshot_.objects] = object.index;
    snapshot_.endpoints[snapshot_.objects++] = snapshot_.count;
    snapshot_.next_node = 0;
  }
  if (snapshot_.objects < objects.size()) return;
  snapshot_.under_way = false;
  snapshots_done_.fetch_add(1, std::memory_order_release);
}

std::vector<SnapshotFace> HapticThread::snapshot(std::uint32_t object_index) const {
  std::vector<SnapshotFace> faces;
  for (std::uint32_t i = 0, first = 0; i < snapshot_.objects; first = snapshot_.endpoints[i++]) {
    if (snapshot_.indices[i] != object_index) continue;
    for (std::uint32_t number = first; number < snapshot_.endpoints[i]; ++number) {
      const spm::TreeNode& node = snapshot_.nodes[number];
      for (unsigned lane = 0; lane < spm::TreeNode::kWidth; ++lane) {
        if ((node.mask >> lane & 1u) == 0) continue;
        SnapshotFace& face = faces.emplace_back();
        for (std::uint32_t row = 0; row < face.corners.size(); ++row) face.corners[row] = node.lanes[row][lane];
        face.last = (node.last >> lane & 1u) != 0;
      }
    }
  }
  return faces;
}

void HapticThread::run() {
  const std::int64_t period_ns = settings_.period_ns();
  PeriodicClock clock{period_ns};
  std::uint64_t cycles = 0;
  std::uint64_t skipped = 0;
  while (running_.load(std::memory_order_relaxed)) {
    const std::int64_t wake_late = clock.wait_next();
    const std::int64_t now_ns = monotonic_ns();
    if (HapticCommands commands; commands_.take(commands)) obey(commands);
    obey(StopWord::of(stop_word_.load(std::memory_order_acquire)));
    const auto arrived = static_cast<std::uint32_t>(arrivals_.pop(arrived_.data(), arrived_.size()));
    read_devices(now_ns);

    bodies_.place(cycle_, now_ns);
    const CycleResult& result = cycle_.touch(inputs_, now_ns, arrived_.data(), arrived);
    outputs_ = result.probes;
    bodies_.limit(cycle_, inputs_, outputs_);
    write_forces();
    stop_obeyed_.store(stop_.bits(), std::memory_order_release);
    bodies_.step(cycle_, now_ns);

    const ProbeReports reports{now_ns, clock.due_ns(), ++cycles, outputs_, result.interventions};
    sender_reports_.post(reports);
    service_reports_.post(reports);

    // The forces are out.
    constexpr spm::Budget kAll{1u << 20};
    cycle_.refine(snapshot_.under_way ? spm::Budget{0} : kAll, governor_.limit());
    for (const TouchObject* object : cycle_.objects()) hashes_[object->index] = object->forest->mesh_hash();
    mesh_hashes_.post(hashes_);
    if (snapshot_.under_way) continue_snapshot();
    CycleTrace trace;
    trace.costs = result.costs;
    trace.times = {clock.due_ns() - period_ns, now_ns, monotonic_ns(), clock.due_ns()};
    trace.wake_late = static_cast<std::uint32_t>(wake_late);
    trace.skipped = static_cast<std::uint32_t>(clock.skipped() - skipped);
    for (const ProbeOutput& probe : result.probes) {
      trace.active = static_cast<std::uint8_t>(trace.active + (probe.active ? 1 : 0));
      trace.stale = static_cast<std::uint8_t>(trace.stale + ((probe.status & session::kStalePose) != 0 ? 1 : 0));
      if ((probe.status & session::kInContact) == 0) continue;
      ++trace.in_contact;
      trace.exact = static_cast<std::uint8_t>(trace.exact + ((probe.status & session::kExact) != 0 ? 1 : 0));
    }
    trace.targets_dropped = result.targets_dropped;
    skipped = clock.skipped();
    if (!traces_.push(trace)) traces_dropped_.fetch_add(1, std::memory_order_relaxed);
    const CycleCosts& costs = result.costs;
    if (costs.foreseen > 0)
      governor_.observe(costs.visits * spm::Budget::kVisit + costs.changes * spm::Budget::kChange, costs.refit,
                        costs.total(), costs.foreseen);
  }
  for (haptics::Device* device : current_.devices)
    if (device != nullptr) device->write(Vec3d::Zero());
}

}  // namespace tactus::hrtc_service
