#include "hrtc_service/haptic_thread.hpp"

#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <future>
#include <memory>

#include "hrtc_service/realtime.hpp"

namespace tactus::hrtc_service {
namespace {

constexpr std::size_t kRingEntries = 4096;
constexpr std::uint32_t kClutchButton = 1;

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
      governor_{settings.deadline_ns},
      event_{eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)} {
  touch(arrivals_);
  touch(departures_);
  touch(traces_);
  touch(log_);
  frames_.fill(settings.frame);
  if (settings.snapshot_faces == 0) return;
  snapshot_.resize(kMaxObjects);
  snapshot_rows_.resize(settings.snapshot_faces);
  for (std::vector<SnapshotFace>& faces : snapshot_) faces.reserve(settings.snapshot_faces / 4);
}

HapticThread::~HapticThread() {
  stop();
  close(event_);
}

std::string HapticThread::start() {
  std::promise<std::string> granted;
  std::future<std::string> line = granted.get_future();
  running_ = true;
  thread_ = std::thread{[this, &granted] {
    pthread_setname_np(pthread_self(), "haptic");
    granted.set_value(settings_.priority > 0 ? enter_realtime(settings_.priority)
                                             : "haptic thread: no real-time priority asked for");
    run();
  }};
  return line.get();
}

void HapticThread::stop() {
  running_ = false;
  if (thread_.joinable()) thread_.join();
}

void HapticThread::obey(const HapticCommands& commands) noexcept {
  if (commands.stops != current_.stops) cycle_.stop(haptics::Fault::kEmergencyStop);
  if (commands.resets != current_.resets) cycle_.reset_faults();
  if (commands.snapshots != current_.snapshots && settings_.snapshot_faces > 0) take_snapshot();
  for (std::uint32_t i = 0; i < kMaxProbes; ++i)
    if (current_.devices[i] != nullptr && commands.devices[i] != current_.devices[i])
      current_.devices[i]->write(Vec3d::Zero());
  current_ = commands;
}

void HapticThread::read_devices(std::int64_t now_ns) noexcept {
  const std::array<std::uint64_t, kMaxProbes>& near = near_.latest();
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
    ProbeInput& input = inputs_[i];
    input.active = current_.devices[i] != nullptr;
    if (!input.active) continue;
    input.device = current_.devices[i]->read(now_ns);
    input.pose_age = static_cast<double>(now_ns - input.device.time_ns) * 1e-9;
    if (current_.framed[i])
      input.device = frames_[i].to_world(input.device, (input.device.buttons & kClutchButton) != 0);
    input.near = near[i];
  }
}

void HapticThread::write_forces(const CycleResult& result) noexcept {
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
    if (current_.devices[i] == nullptr) continue;
    const Vec3d force = vec(result.probes[i].force);
    current_.devices[i]->write(current_.framed[i] ? frames_[i].force_to_device(force) : force);
  }
}

void HapticThread::take_snapshot() noexcept {
  for (const TouchObject* object : cycle_.objects()) {
    std::vector<SnapshotFace>& faces = snapshot_[object->index];
    faces.clear();
    const spm::AbTree& tree = object->forest->tree();
    const auto rows = static_cast<std::uint32_t>(std::min(snapshot_rows_.size(), faces.capacity()));
    const std::uint32_t found = std::min(rows, tree.near(Vec3d::Zero(), 1e15, snapshot_rows_.data(), rows));
    for (std::uint32_t i = 0; i < found; ++i) {
      const spm::FaceRow& row = tree.row(snapshot_rows_[i]);
      faces.push_back({tree.corners(snapshot_rows_[i]), row.face, row.last});
    }
  }
  snapshots_done_.fetch_add(1, std::memory_order_release);
}

void HapticThread::run() {
  const std::int64_t period_ns = settings_.period_ns();
  PeriodicClock clock{period_ns};
  std::uint64_t cycles = 0;
  std::uint64_t skipped = 0;
  std::int64_t cpu = thread_cpu_ns();
  while (running_.load(std::memory_order_relaxed)) {
    const std::int64_t wake_late = clock.wait_next();
    const std::int64_t now_ns = monotonic_ns();
    if (HapticCommands commands; commands_.take(commands)) obey(commands);
    const auto arrived = static_cast<std::uint32_t>(arrivals_.pop(arrived_.data(), arrived_.size()));
    read_devices(now_ns);

    const CycleResult& result = cycle_.step(inputs_, now_ns, arrived_.data(), arrived, governor_.budget());
    write_forces(result);

    const ProbeReports reports{now_ns, ++cycles, result.probes};
    sender_reports_.post(reports);
    service_reports_.post(reports);
    for (const TouchObject* object : cycle_.objects()) hashes_[object->index] = object->forest->mesh_hash();
    mesh_hashes_.post(hashes_);
    const std::uint64_t one = 1;
    (void)!write(event_, &one, sizeof one);

    // The forces are out; what follows is book-keeping.
    const std::int64_t end = monotonic_ns();
    const std::int64_t cpu_now = thread_cpu_ns();
    CycleTrace trace;
    trace.costs = result.costs;
    trace.wake_late = static_cast<std::uint32_t>(wake_late);
    trace.cpu = static_cast<std::uint32_t>(cpu_now - cpu);
    trace.skipped = static_cast<std::uint32_t>(clock.skipped() - skipped);
    trace.late = end > clock.due_ns() || trace.skipped > 0;
    trace.late_is_ours = trace.late && own_work(cpu_now - cpu, end - now_ns, period_ns);
    for (const ProbeOutput& probe : result.probes) {
      trace.active = static_cast<std::uint8_t>(trace.active + (probe.active ? 1 : 0));
      if ((probe.status & session::kInContact) == 0) continue;
      ++trace.in_contact;
      trace.exact = static_cast<std::uint8_t>(trace.exact + ((probe.status & session::kExact) != 0 ? 1 : 0));
    }
    // A cycle that was interrupted took longer than it worked.
    const double own = std::min<double>(static_cast<double>(cpu_now - cpu), result.costs.total());
    cpu = cpu_now;
    skipped = clock.skipped();
    if (!traces_.push(trace)) traces_dropped_.fetch_add(1, std::memory_order_relaxed);
    const CycleCosts& costs = result.costs;
    governor_.observe(costs.visits * spm::Budget::kVisit + costs.changes * spm::Budget::kChange,
                      std::min<double>(costs.refine + costs.refit, own), own);
  }
  for (haptics::Device* device : current_.devices)
    if (device != nullptr) device->write(Vec3d::Zero());
}

}  // namespace tactus::hrtc_service
