#include "hrtc_service/flight_store.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <type_traits>
#include <utility>

#include "hrtc_service/build_id.hpp"
#include "hrtc_service/realtime.hpp"

namespace tactus::hrtc_service {
namespace {

using Event = trace::FlightEvent;

FlightEntry kind_of(const std::uint64_t* entry) noexcept { return static_cast<FlightEntry>(entry[0] >> 32); }
/// With its head.
std::size_t size_of(const std::uint64_t* entry) noexcept { return 1 + (entry[0] & 0xffffffffu); }

template <class Value>
Value value_of(const std::uint64_t* entry) noexcept {
  static_assert(std::is_trivially_copyable_v<Value>);
  Value value;
  std::memcpy(static_cast<void*>(&value), entry + 1, sizeof value);
  return value;
}

/// Of a kObject.
trace::FlightObject object_of(const std::uint64_t* entry) {
  FlightNewObject object;
  std::memcpy(static_cast<void*>(&object), entry + 1 + sizeof(Event) / 8, sizeof object);
  return {object.object,
          object.id,
          object.digest,
          object.name.data(),
          object.placement,
          object.material.stiffness,
          object.material.damping,
          object.material.static_friction,
          object.material.dynamic_friction,
          object.movable != 0};
}

template <class Visit>
void for_each_entry(const std::uint64_t* from, const std::uint64_t* end, Visit&& visit) {
  for (; from < end; from += size_of(from)) visit(from);
}

/// Times in a file are ns since 1970; times in a record are of our clock.
std::int64_t since_1970_less_ours() {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  return std::chrono::duration_cast<std::chrono::nanoseconds>(now).count() - monotonic_ns();
}

}  // namespace

static_assert(sizeof(CycleSettings) == 136, "record the new setting");

trace::FlightStart flight_start(const std::string& participant, const CycleSettings& settings,
                                const spm::PoolSettings& pool,
                                const std::array<haptics::DeviceSpec, kMaxProbes>& specs) {
  trace::FlightStart start;
  start.build = build_id();
  start.participant = participant;
  start.period = settings.period;
  start.tip_radius = settings.radius;
  start.refine_margin = settings.refine_margin;
  start.keep_margin = settings.keep_margin;
  start.refine_ahead = settings.refine_ahead;
  start.targets = settings.targets;
  const haptics::ForceSettings& force = settings.force;
  start.max_force = force.max_force;
  start.max_slew = force.max_slew;
  start.soft_start = force.soft_start;
  start.recovery = force.recovery;
  start.hold = force.hold;
  start.zero_by = force.zero_by;
  start.max_speed = force.max_speed;
  start.max_torque = force.max_torque;
  start.max_torque_slew = force.max_torque_slew;
  start.max_angular_velocity = force.max_angular_velocity;
  for (const haptics::DeviceSpec& spec : specs)
    start.devices.push_back({spec.max_force, spec.max_stiffness, spec.damping, spec.workspace_radius, spec.max_torque,
                             spec.max_rotational_stiffness});
  if (settings.tool != nullptr) {
    for (const std::array<float, 3>& vertex : settings.tool->given_vertices())
      start.tool_vertices.insert(start.tool_vertices.end(), vertex.begin(), vertex.end());
    for (const std::array<std::uint32_t, 3>& triangle : settings.tool->given_triangles())
      start.tool_triangles.insert(start.tool_triangles.end(), triangle.begin(), triangle.end());
  }
  start.slots = pool.slots;
  start.tree_nodes = pool.tree_nodes;
  start.list_blocks = pool.list_blocks;
  return start;
}

FlightStore::FlightStore(FlightRecorder& recorder, trace::FlightStart start, double seconds, std::uint64_t max_bytes)
    : recorder_{recorder},
      start_{std::move(start)},
      keep_ns_{std::llround(seconds * 1e9)},
      max_words_{max_bytes / sizeof(std::uint64_t)} {
  segments_.emplace_back();
}

std::uint64_t FlightStore::bytes_for(double seconds, double period, std::uint32_t probes) noexcept {
  constexpr double kOfCycle = 160, kOfProbe = 8 + sizeof(trace::FlightProbe), kOfSecond = 1 << 17;
  const double all = seconds + 2;  // the oldest segment, and the current one
  return static_cast<std::uint64_t>(all * ((kOfCycle + probes * kOfProbe) / period + kOfSecond));
}

void FlightStore::Known::take(const std::uint64_t* entry) {
  const FlightEntry kind = kind_of(entry);
  if (kind != FlightEntry::kEvent && kind != FlightEntry::kObject) return;
  const auto event = value_of<Event>(entry);
  switch (event.kind) {
    case Event::Kind::kObjectCame:
      objects.resize(std::max<std::size_t>(objects.size(), event.object + 1));
      here.resize(objects.size());
      objects[event.object] = object_of(entry);
      break;
    case Event::Kind::kRegionCame:
      here[event.object].insert(event.region);
      break;
    case Event::Kind::kRegionLeft:
      here[event.object].erase(event.region);
      break;
    case Event::Kind::kObjectLeft:
      objects[event.object].reset();
      here[event.object].clear();
      break;
    case Event::Kind::kStopped:
    case Event::Kind::kReset:
    case Event::Kind::kRegionRetired:
    case Event::Kind::kObjectWithdrawn:
      break;
  }
}

void FlightStore::Known::take_all(const Words& entries) {
  for_each_entry(entries.data(), entries.data() + entries.size(), [this](const std::uint64_t* entry) { take(entry); });
}

void FlightStore::Known::take_records(const Words& records) {
  for (std::size_t at = 0; at < records.size(); at += records[at])
    for_each_entry(&records[at] + 1, &records[at] + records[at], [this](const std::uint64_t* entry) { take(entry); });
}

void FlightStore::take(const FlightRecord& record) {
  const std::uint64_t* const begin = record.data() + 1;
  const std::uint64_t* const end = record.data() + record.size();
  const std::uint64_t* state = nullptr;
  std::uint64_t lost = 0, cycle = 0;
  std::int64_t time_ns = 0;
  for_each_entry(begin, end, [&](const std::uint64_t* entry) {
    if (kind_of(entry) == FlightEntry::kState) state = entry;
    if (kind_of(entry) == FlightEntry::kLost) lost = entry[1];
    if (kind_of(entry) == FlightEntry::kTouch) time_ns = value_of<trace::FlightTouch>(entry).time_ns;
    if (kind_of(entry) == FlightEntry::kRefine) cycle = value_of<trace::FlightRefine>(entry).cycle;
  });
  if (lost == 0) {
    Segment& last = segments_.back();
    if (last.cycles++ == 0) {
      last.first_cycle = cycle;
      last.first_ns = time_ns;
    }
    last.last_ns = time_ns;
    const std::uint64_t* const until = state != nullptr ? state : end;
    last.records.push_back(static_cast<std::uint64_t>(until - record.data()));
    last.records.insert(last.records.end(), begin, until);
    words_ += 1 + static_cast<std::uint64_t>(until - begin);
  }
  if (state == nullptr) return;
  // Expect the next second to be as long as the last one.
  const std::size_t room = segments_.back().records.size();
  Segment& next = segments_.emplace_back();
  next.records.reserve(room + room / 16);
  next.lost = lost;
  next.state.assign(state, end);
  const Segment& before = segments_[segments_.size() - 2];
  next.first_cycle = before.first_cycle + before.cycles + lost;
  next.first_ns = next.last_ns = before.last_ns;
  if (lost > 0) {
    lost_ += lost;
    const std::uint64_t* const events = begin + size_of(begin);  // behind kLost
    next.before.assign(events, state);
  }
  words_ += next.words();
}

void FlightStore::take_new() {
  while (recorder_.next(record_)) take(record_);
}

void FlightStore::evict() {
  while (segments_.size() > 2 &&
         (segments_.back().last_ns - segments_[1].first_ns >= keep_ns_ || words_ > max_words_)) {
    Segment& oldest = segments_.front();
    known_.take_records(oldest.records);
    known_.take_all(segments_[1].before);
    words_ -= oldest.words();
    segments_.pop_front();
  }
}

void FlightStore::drain() {
  take_new();
  evict();
}

/// See FlightRecorder::put_state.
trace::FlightState FlightStore::state_of(const Segment& segment, const Known& known) const {
  trace::FlightState state;
  state.cycle = segment.first_cycle;
  state.lost = segment.lost;
  const std::uint64_t* at = segment.state.data() + 1;
  const std::uint64_t bytes = *at++;
  const auto* const carried = reinterpret_cast<const std::uint8_t*>(at);
  state.carried.assign(carried, carried + bytes);
  at += (bytes + 7) / 8;
  for (std::uint64_t objects = *at++; objects > 0; --objects) {
    trace::FlightObjectState& object = state.objects.emplace_back();
    object.object = static_cast<std::uint32_t>(*at >> 32);
    object.base_faces = static_cast<std::uint32_t>(*at++);
    object.mesh_hash = *at++;
    const std::set<std::uint32_t>& here = known.here[object.object];
    object.here.assign(here.begin(), here.end());
    for (std::uint64_t regions = *at++; regions > 0; --regions, ++at)
      object.in_use.push_back({static_cast<std::uint32_t>(*at), static_cast<std::uint32_t>(*at >> 32) & 0x3fffffffu,
                               (*at >> 63) != 0, (*at >> 62 & 1u) != 0});
  }
  return state;
}

std::uint64_t FlightStore::write(const std::filesystem::path& file, const std::string& reason) {
  trace::FlightFileWriter out{file};
  const std::int64_t offset_ns = since_1970_less_ours();
  const auto set_time = [&](std::int64_t ours_ns) { out.set_time(static_cast<std::uint64_t>(ours_ns + offset_ns)); };
  take_new();
  trace::FlightStart start = start_;
  start.reason = reason;
  start.first_cycle = segments_.front().first_cycle;
  set_time(segments_.front().first_ns);
  out.write(start);
  Known known = known_;
  const auto write_objects = [&] {
    for (const std::optional<trace::FlightObject>& object : known.objects)
      if (object) out.write(*object);
  };
  write_objects();

  // Records that arrive meanwhile are for the next file; no segment is dropped until this one is written.
  std::uint64_t cycles = 0;
  const std::size_t segments = segments_.size();
  const std::size_t of_last = segments_.back().records.size();
  for (std::size_t number = 0; number < segments; ++number) {
    if (number > 0 && segments_[number].lost > 0) {
      known.take_all(segments_[number].before);
      write_objects();
    }
    if (!segments_[number].state.empty() && (number == 0 || segments_[number].lost > 0)) {
      trace::FlightState state = state_of(segments_[number], known);
      if (number == 0) state.lost = 0;
      out.write(state);
    }
    const std::size_t end = number + 1 < segments ? segments_[number].records.size() : of_last;
    for (std::size_t at = 0; at < end; at += segments_[number].records[at]) {
      const std::uint64_t* const record = &segments_[number].records[at];
      for_each_entry(record + 1, record + record[0], [&](const std::uint64_t* entry) {
        if (kind_of(entry) == FlightEntry::kTouch) set_time(value_of<trace::FlightTouch>(entry).time_ns);
      });
      for_each_entry(record + 1, record + record[0], [&](const std::uint64_t* entry) {
        known.take(entry);
        switch (kind_of(entry)) {
          case FlightEntry::kObject:
            out.write(object_of(entry));
            out.write(value_of<trace::FlightEvent>(entry));
            break;
          case FlightEntry::kEvent:
            out.write(value_of<trace::FlightEvent>(entry));
            break;
          case FlightEntry::kMove:
            out.write(value_of<trace::FlightMove>(entry));
            break;
          case FlightEntry::kProbe:
            out.write(value_of<trace::FlightProbe>(entry));
            break;
          case FlightEntry::kTouch:
            out.write(value_of<trace::FlightTouch>(entry));
            break;
          case FlightEntry::kRefine:
            out.write(value_of<trace::FlightRefine>(entry));
            break;
          case FlightEntry::kLost:
          case FlightEntry::kState:
            break;
        }
      });
      ++cycles;
      constexpr std::uint64_t kDrainEvery = 64;  // cycles: fractions of a millisecond of writing
      if (cycles % kDrainEvery == 0) take_new();
    }
  }
  out.close();
  drain();
  return cycles;
}

}  // namespace tactus::hrtc_service
