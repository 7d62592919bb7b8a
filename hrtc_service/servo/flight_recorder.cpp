#include "hrtc_service/servo/flight_recorder.hpp"

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

constexpr std::uint64_t entry_head(FlightEntry kind, std::uint32_t words) noexcept {
  return std::uint64_t{static_cast<std::uint32_t>(kind)} << 32 | words;
}

}  // namespace

FlightRecorder::FlightRecorder(std::uint32_t state_period)
    : ring_{kRingWords},
      words_(kMaxWords, 0),
      events_(kMaxEventWords, 0),
      in_use_(kMaxInUse),
      state_period_{state_period} {
  while (ring_.push(0)) {
  }
  ring_.consume_all([](std::uint64_t) {});
}

bool FlightRecorder::has_room(std::uint32_t words) noexcept {
  is_too_long_ = is_too_long_ || count_ + words > kMaxWords;
  return !is_too_long_;
}

template <class Value>
void FlightRecorder::put(FlightEntry kind, const Value& value) noexcept {
  static_assert(std::is_trivially_copyable_v<Value>);
  constexpr std::uint32_t kWords = (sizeof value + 7) / 8;
  if (!has_room(1 + kWords)) return;
  words_[count_] = entry_head(kind, kWords);
  words_[count_ + kWords] = 0;  // the padding after the value
  std::memcpy(&words_[count_ + 1], &value, sizeof value);
  count_ += 1 + kWords;
}

/// Adds an event to the record, and to the events that are stored in case the record is lost. `new_object`: the object
/// of a kObjectArrived event, else null.
void FlightRecorder::put_event(Kind kind, std::uint32_t object, spm::RegionId region,
                               const TouchObject* new_object) noexcept {
  constexpr std::uint32_t kWords = 1 + sizeof(trace::FlightEvent) / 8;
  constexpr std::uint32_t kWithObject = kWords + sizeof(FlightNewObject) / 8;
  static_assert(sizeof(trace::FlightEvent) % 8 == 0);
  if (event_count_ + kWithObject > kMaxEventWords) {
    if (lost_at_end() == 0) lost_at_end_.store(lost_ + 1, std::memory_order_relaxed);
    return;
  }
  const std::uint32_t words = new_object != nullptr ? kWithObject : kWords;
  const trace::FlightEvent event{cycle_, kind, object, spm::index(region), 0};
  std::uint64_t* const entry = &events_[event_count_];
  entry[0] = entry_head(new_object != nullptr ? FlightEntry::kObject : FlightEntry::kEvent, words - 1);
  std::memcpy(entry + 1, &event, sizeof event);
  if (new_object != nullptr) {
    FlightNewObject described{new_object->id,
                              new_object->digest,
                              new_object->placement.numbers(),
                              new_object->material,
                              new_object->index,
                              new_object->body ? 1u : 0u,
                              {}};
    std::copy_n(new_object->name.data(), std::min(new_object->name.size(), std::size_t{session::kMaxName}),
                described.name.data());
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
    constexpr Kind kKinds[] = {Kind::kObjectArrived,   Kind::kRegionArrived, Kind::kRegionRetired,
                               Kind::kObjectWithdrawn, Kind::kPageArrived,   Kind::kPageDropped};
    const Kind kind = kKinds[static_cast<std::size_t>(arrivals[i].kind)];
    const TouchObject* const object = arrivals[i].object;
    const spm::RegionId region =
        arrivals[i].page != nullptr ? spm::RegionId{spm::index(arrivals[i].page->id())} : arrivals[i].region;
    put_event(kind, object->index, region, kind == Kind::kObjectArrived ? object : nullptr);
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
    probe.round_trip = input.device.round_trip;
    probe.pose_age = input.pose_age;
    probe.near_found = input.near.found;
    probe.near_searched = input.near.searched;
    probe.near_centre = input.near.centre;
    probe.near_valid_radius = input.near.moved;
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

/// Adds the state of the cycle to the record: size and bytes of Cycle::for_each_carried, and the number of objects.
/// Then, for each object: index and base faces, mesh hash, number of regions in use. Then, for each of these regions:
/// number and applied records, with the flags `retiring` and `retained` in the top bits. Returns false and adds nothing
/// if the state does not fit or cannot be recorded after this cycle.
bool FlightRecorder::put_state(Cycle& cycle) noexcept {
  // A state contains neither the previous versions of the meshes, which the next touch may query, nor withdrawn
  // objects. So it is only recorded after a cycle that changed no mesh, and when no withdrawn object remains.
  if (!cycle.withdrawn_objects().empty()) return false;
  for (const TouchObject* object : cycle.objects())
    if (object->forest->previous_differs()) return false;
  const std::uint32_t from = count_;
  const auto put_word = [&](std::uint64_t word) {
    if (has_room(1)) words_[count_++] = word;
  };
  put_word(0);  // for the head of the entry
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
    const std::uint32_t in_use = forest.copy_in_use(in_use_.data(), kMaxInUse);
    put_word(std::uint64_t{object->index} << 32 | forest.base_faces_shown());
    put_word(forest.mesh_hash());
    put_word(in_use);
    if (in_use > kMaxInUse || !has_room(in_use)) {
      is_too_long_ = true;
      break;
    }
    for (std::uint32_t i = 0; i < in_use; ++i) {
      const spm::Forest::InUse& region = in_use_[i];
      words_[count_++] = std::uint64_t{region.retiring} << 63 | std::uint64_t{region.retained} << 62 |
                         std::uint64_t{region.applied} << 32 | spm::index(region.region);
    }
  }
  if (is_too_long_) {
    is_too_long_ = false;
    count_ = from;
    return false;
  }
  words_[from] = entry_head(FlightEntry::kState, count_ - from - 1);
  cycles_since_state_ = 0;
  return true;
}

bool FlightRecorder::push() noexcept {
  words_[0] = count_;
  if (ring_.write_available() < count_) return false;
  ring_.push(words_.data(), count_);
  event_count_ = 0;
  return true;
}

void FlightRecorder::refined(Cycle& cycle, std::span<const Departure> departed, bool departures_fit) noexcept {
  for (const Departure& departure : departed)
    put_event(departure.page != nullptr ? Kind::kPageDeparted
              : departure.is_object()   ? Kind::kObjectDeparted
                                        : Kind::kRegionDeparted,
              departure.object,
              departure.page != nullptr ? spm::RegionId{spm::index(departure.page->id())} : departure.region);
  if (lost_at_end() == 0) {
    const CycleResult& result = cycle.result();
    std::uint64_t hash = 0;
    for (const TouchObject* object : cycle.objects()) hash = flight_hash(hash, object->forest->mesh_hash());
    const bool state_due = departures_fit && lost_ == 0 && ++cycles_since_state_ >= state_period_;
    put(FlightEntry::kRefine, trace::FlightRefine{cycle_, hash, result.costs.granted, result.budget_spent ? 1u : 0u,
                                                  result.nodes_full ? 1u : 0u, state_due ? 1u : 0u});
    // The state does not contain the pairs of triangles that tools have gathered. A replay that begins with the state
    // gathers them again, so this cycle must gather them again, too.
    if (state_due) cycle.clear_gathered_pairs();
    const bool is_complete = !is_too_long_ && departures_fit && lost_ == 0;
    if (is_complete && state_due) static_cast<void>(put_state(cycle));
    if (!is_complete || !push()) {
      ++lost_;
      // Recording continues when half of the ring is free.
      count_ = 1;
      is_too_long_ = false;
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
  is_too_long_ = false;
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
