#include "hrtc_service/flight_recorder.hpp"

#include <xmmintrin.h>

#include <algorithm>
#include <cstring>
#include <type_traits>

namespace tactus::hrtc_service {
namespace {

using Kind = trace::FlightEvent::Kind;

std::array<double, 3> numbers(const Vec3d& v) noexcept { return plain(v); }

// A new member of the input of a cycle must be added to the record, too (idl/flight.idl).
static_assert(sizeof(ProbeInput) == 208 && sizeof(haptics::DeviceState) == 128, "record the new member");

constexpr std::uint64_t head_of(FlightEntry kind, std::uint32_t words) noexcept {
  return std::uint64_t{static_cast<std::uint32_t>(kind)} << 32 | words;
}

}  // namespace

FlightRecorder::FlightRecorder(std::uint32_t state_every)
    : ring_{kRingWords},
      words_(kMaxWords, 0),
      events_(kMaxEventWords, 0),
      in_use_(kMaxInUse),
      state_every_{state_every} {
  while (ring_.push(0)) {
  }
  ring_.consume_all([](std::uint64_t) {});
}

bool FlightRecorder::has_room(std::uint32_t words) noexcept {
  broken_ = broken_ || count_ + words > kMaxWords;
  return !broken_;
}

template <class Value>
void FlightRecorder::put(FlightEntry kind, const Value& value) noexcept {
  static_assert(std::is_trivially_copyable_v<Value>);
  constexpr std::uint32_t kWords = (sizeof value + 7) / 8;
  if (!has_room(1 + kWords)) return;
  words_[count_] = head_of(kind, kWords);
  words_[count_ + kWords] = 0;  // the padding after the value
  std::memcpy(&words_[count_ + 1], &value, sizeof value);
  count_ += 1 + kWords;
}

/// Adds an event to the record and to the events retained in case the record is lost. `came`: the object, when it is
/// new.
void FlightRecorder::put_event(Kind kind, std::uint32_t object, spm::RegionId region,
                               const TouchObject* came) noexcept {
  constexpr std::uint32_t kWords = 1 + sizeof(trace::FlightEvent) / 8;
  constexpr std::uint32_t kWithObject = kWords + sizeof(FlightNewObject) / 8;
  static_assert(sizeof(trace::FlightEvent) % 8 == 0);
  if (event_count_ + kWithObject > kMaxEventWords) {
    if (ended() == 0) ended_.store(lost_ + 1, std::memory_order_relaxed);
    return;
  }
  const std::uint32_t words = came != nullptr ? kWithObject : kWords;
  const trace::FlightEvent event{cycle_, kind, object, spm::index(region), 0};
  std::uint64_t* const entry = &events_[event_count_];
  entry[0] = head_of(came != nullptr ? FlightEntry::kObject : FlightEntry::kEvent, words - 1);
  std::memcpy(entry + 1, &event, sizeof event);
  if (came != nullptr) {
    FlightNewObject described{
        came->id, came->digest, came->placement.numbers(), came->material, came->index, came->body ? 1u : 0u, {}};
    std::copy_n(came->name.data(), std::min(came->name.size(), std::size_t{session::kMaxName}), described.name.data());
    std::memcpy(entry + kWords, &described, sizeof described);
  }
  event_count_ += words;
  if (!has_room(words)) return;
  std::copy_n(entry, words, &words_[count_]);
  count_ += words;
}

void FlightRecorder::stopped(haptics::Fault fault) noexcept {
  put(FlightEntry::kEvent, trace::FlightEvent{cycle_, Kind::kStopped, 0, 0, static_cast<std::uint32_t>(fault)});
}

void FlightRecorder::reset() noexcept { put(FlightEntry::kEvent, trace::FlightEvent{cycle_, Kind::kReset, 0, 0, 0}); }

void FlightRecorder::moved(const TouchObject& object, const Placement& placement) noexcept {
  put(FlightEntry::kMove, trace::FlightMove{cycle_, object.index, placement.numbers()});
}

void FlightRecorder::touched(const std::array<ProbeInput, kMaxProbes>& probes, std::int64_t now_ns,
                             const Arrival* arrivals, std::uint32_t arrival_count, const CycleResult& result) noexcept {
  for (std::uint32_t i = 0; i < arrival_count; ++i) {
    constexpr Kind kKinds[] = {Kind::kObjectCame, Kind::kRegionCame, Kind::kRegionRetired, Kind::kObjectWithdrawn};
    const Kind kind = kKinds[static_cast<std::size_t>(arrivals[i].kind)];
    const TouchObject* const object = arrivals[i].object;
    put_event(kind, object->index, arrivals[i].region, kind == Kind::kObjectCame ? object : nullptr);
  }
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
    const ProbeInput& input = probes[i];
    if (!input.active) continue;
    const ProbeOutput& output = result.probes[i];
    trace::FlightProbe probe;
    probe.cycle = cycle_;
    probe.pose_time_ns = input.device.time_ns;
    probe.position = numbers(input.device.position);
    probe.velocity = numbers(input.device.velocity);
    const Eigen::Quaterniond& turn = input.device.orientation;
    probe.orientation = {turn.x(), turn.y(), turn.z(), turn.w()};
    probe.transit = input.device.transit;
    probe.loop_delay = input.device.loop_delay;
    probe.pose_age = input.pose_age;
    probe.near_found = input.near.found;
    probe.near_sought = input.near.sought;
    probe.near_centre = input.near.centre;
    probe.near_moved = input.near.moved;
    probe.force = output.force;
    probe.torque = output.torque;
    probe.proxy = output.proxy;
    probe.proxy_orientation = output.orientation;
    probe.probe = i;
    probe.buttons = input.device.buttons;
    probe.pose_sequence = input.device.sequence;
    probe.failed = input.failed ? 1 : 0;
    probe.touched_object = output.object;
    probe.status = output.status;
    probe.contacts = output.contacts;
    put(FlightEntry::kProbe, probe);
  }
  put(FlightEntry::kTouch, trace::FlightTouch{cycle_, now_ns, _mm_getcsr() & 0xffc0u});
}

/// The carried state as a 64-bit size and bytes; then the count of objects, and for each its number and base faces,
/// mesh hash, count of active regions, and for each region its number and applied records, with retiring and resting in
/// the top bits. A state that does not fit is omitted.
bool FlightRecorder::put_state(Cycle& cycle) noexcept {
  // A state does not contain the previous version of the meshes, which the next touch may query. So it waits for a
  // cycle that changed no mesh. It does not contain the remains of withdrawn objects either, so it waits until these
  // have departed.
  if (!cycle.leaving().empty()) return false;
  for (const TouchObject* object : cycle.objects())
    if (object->forest->kept_differs()) return false;
  const std::uint32_t from = count_;
  const auto put_word = [&](std::uint64_t word) {
    if (has_room(1)) words_[count_++] = word;
  };
  put_word(0);  // placeholder for the entry's head
  haptics::CarriedSize size;
  cycle.for_each_carried(size);
  put_word(size.bytes());
  if (const auto words = static_cast<std::uint32_t>((size.bytes() + 7) / 8); has_room(words)) {
    words_[count_ + words - 1] = 0;
    haptics::CarriedWriter writer{&words_[count_]};
    cycle.for_each_carried(writer);
    count_ += words;
  }
  put_word(cycle.objects().size());
  for (const TouchObject* object : cycle.objects()) {
    const spm::Forest& forest = *object->forest;
    const std::uint32_t in_use = forest.in_use(in_use_.data(), kMaxInUse);
    put_word(std::uint64_t{object->index} << 32 | forest.base_faces_shown());
    put_word(forest.mesh_hash());
    put_word(in_use);
    if (in_use > kMaxInUse || !has_room(in_use)) {
      broken_ = true;
      break;
    }
    for (std::uint32_t i = 0; i < in_use; ++i) {
      const spm::Forest::InUse& region = in_use_[i];
      words_[count_++] = std::uint64_t{region.retiring} << 63 | std::uint64_t{region.resting} << 62 |
                         std::uint64_t{region.applied} << 32 | spm::index(region.region);
    }
  }
  if (broken_) {
    broken_ = false;
    count_ = from;
    return false;
  }
  words_[from] = head_of(FlightEntry::kState, count_ - from - 1);
  since_state_ = 0;
  return true;
}

bool FlightRecorder::push() noexcept {
  words_[0] = count_;
  if (ring_.write_available() < count_) return false;
  ring_.push(words_.data(), count_);
  event_count_ = 0;
  return true;
}

void FlightRecorder::refined(Cycle& cycle, std::span<const Departure> left, bool departures_fit) noexcept {
  for (const Departure& departure : left)
    put_event(departure.is_object() ? Kind::kObjectLeft : Kind::kRegionLeft, departure.object, departure.region);
  if (ended() == 0) {
    const CycleResult& result = cycle.result();
    std::uint64_t hash = 0;
    for (const TouchObject* object : cycle.objects()) hash = flight_hash(hash, object->forest->mesh_hash());
    const bool state_due = departures_fit && lost_ == 0 && ++since_state_ >= state_every_;
    put(FlightEntry::kRefine, trace::FlightRefine{cycle_, hash, result.costs.granted, result.budget_spent ? 1u : 0u,
                                                  result.nodes_full ? 1u : 0u, state_due ? 1u : 0u});
    // A replay from this state starts without surroundings, so this cycle must continue without them, too.
    if (state_due) cycle.forget_surroundings();
    const bool whole = !broken_ && departures_fit && lost_ == 0;
    if (whole && state_due) static_cast<void>(put_state(cycle));
    if (!whole || !push()) {
      ++lost_;
      // Recording continues when there is room for some cycles.
      count_ = 1;
      broken_ = false;
      put(FlightEntry::kLost, lost_);
      if (ring_.write_available() >= kRingWords / 2 && has_room(event_count_)) {
        std::copy_n(events_.begin(), event_count_, words_.begin() + count_);
        count_ += event_count_;
        if (put_state(cycle) && push()) lost_ = 0;
      }
    }
  }
  ++cycle_;
  count_ = 1;
  broken_ = false;
}

bool FlightRecorder::next(FlightRecord& record) {
  std::uint64_t words = 0;
  if (!ring_.pop(words)) return false;
  record.resize(words);
  record[0] = words;
  ring_.pop(record.data() + 1, words - 1);
  return true;
}

}  // namespace tactus::hrtc_service
