#include "hrtc_service/servo/flight_store.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <type_traits>
#include <utility>

#include "hrtc_service/servo/build_id.hpp"
#include "realtime/periodic_clock.hpp"

namespace tactus::hrtc_service {
namespace {

using Event = trace::FlightEvent;

FlightEntry entry_kind(const std::uint64_t* entry) noexcept { return static_cast<FlightEntry>(entry[0] >> 32); }
/// Returns the length of an entry with its head, in words.
std::size_t entry_words(const std::uint64_t* entry) noexcept { return 1 + (entry[0] & 0xffffffffu); }

template <class Value>
Value entry_value(const std::uint64_t* entry) noexcept {
  static_assert(std::is_trivially_copyable_v<Value>);
  Value value;
  std::memcpy(static_cast<void*>(&value), entry + 1, sizeof value);
  return value;
}

/// Returns the object of a kObject entry.
trace::FlightObject entry_object(const std::uint64_t* entry) {
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
  for (; from < end; from += entry_words(from)) visit(from);
}

/// Returns the offset from monotonic times, as in records, to Unix times, as in files, ns.
std::int64_t unix_minus_monotonic_ns() {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  return std::chrono::duration_cast<std::chrono::nanoseconds>(now).count() - realtime::monotonic_ns();
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
  start.retain_margin = settings.retain_margin;
  start.refine_ahead = settings.refine_ahead;
  start.targets = settings.targets;
  const haptics::ForceSettings& force = settings.force;
  start.max_force = force.max_force;
  start.max_slew = force.max_slew;
  start.soft_start = force.soft_start;
  start.recovery = force.recovery;
  start.max_fresh_age = force.max_fresh_age;
  start.zero_force_age = force.zero_force_age;
  start.max_speed = force.max_speed;
  start.max_torque = force.max_torque;
  start.max_torque_slew = force.max_torque_slew;
  start.max_angular_velocity = force.max_angular_velocity;
  for (const haptics::DeviceSpec& spec : specs)
    start.devices.push_back({spec.max_force, spec.max_stiffness, spec.damping, spec.workspace_radius, spec.max_torque,
                             spec.max_rotational_stiffness});
  if (settings.tool != nullptr) {
    for (const std::array<float, 3>& vertex : settings.tool->original_vertices())
      start.tool_vertices.insert(start.tool_vertices.end(), vertex.begin(), vertex.end());
    for (const std::array<std::uint32_t, 3>& triangle : settings.tool->original_triangles())
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
      duration_ns_{std::llround(seconds * 1e9)},
      max_words_{max_bytes / sizeof(std::uint64_t)} {
  segments_.emplace_back();
}

std::uint64_t FlightStore::bytes_for(double seconds, double period, std::uint32_t probes) noexcept {
  constexpr double kCycleBytes = 160, kProbeBytes = 8 + sizeof(trace::FlightProbe), kStateBytes = 1 << 17;
  const double all = seconds + 2;  // s; a second more for the oldest segment, and one for the current segment
  return static_cast<std::uint64_t>(all * ((kCycleBytes + probes * kProbeBytes) / period + kStateBytes));
}

void FlightStore::Contents::apply(const std::uint64_t* entry) {
  const FlightEntry kind = entry_kind(entry);
  if (kind != FlightEntry::kEvent && kind != FlightEntry::kObject) return;
  const auto event = entry_value<Event>(entry);
  switch (event.kind) {
    case Event::Kind::kObjectArrived:
      objects.resize(std::max<std::size_t>(objects.size(), event.object + 1));
      pages.resize(objects.size());
      regions.resize(objects.size());
      objects[event.object] = entry_object(entry);
      break;
    case Event::Kind::kPageArrived:
      pages[event.object].push_back(event.region);
      break;
    case Event::Kind::kPageDropped:
      std::erase(pages[event.object], event.region);
      break;
    case Event::Kind::kRegionArrived:
      regions[event.object].insert(event.region);
      break;
    case Event::Kind::kRegionDeparted:
      regions[event.object].erase(event.region);
      break;
    case Event::Kind::kObjectDeparted:
      objects[event.object].reset();
      pages[event.object].clear();
      regions[event.object].clear();
      break;
    case Event::Kind::kStopped:
    case Event::Kind::kReset:
    case Event::Kind::kRegionRetired:
    case Event::Kind::kPageDeparted:
    case Event::Kind::kObjectWithdrawn:
      break;
  }
}

void FlightStore::Contents::apply_entries(const Words& entries) {
  for_each_entry(entries.data(), entries.data() + entries.size(), [this](const std::uint64_t* entry) { apply(entry); });
}

void FlightStore::Contents::apply_records(const Words& records) {
  for (std::size_t at = 0; at < records.size(); at += records[at])
    for_each_entry(&records[at] + 1, &records[at] + records[at], [this](const std::uint64_t* entry) { apply(entry); });
}

void FlightStore::add(const FlightRecord& record) {
  const std::uint64_t* const begin = record.data() + 1;
  const std::uint64_t* const end = record.data() + record.size();
  const std::uint64_t* state = nullptr;
  std::uint64_t lost = 0, cycle = 0;
  std::int64_t time_ns = 0;
  for_each_entry(begin, end, [&](const std::uint64_t* entry) {
    if (entry_kind(entry) == FlightEntry::kState) state = entry;
    if (entry_kind(entry) == FlightEntry::kLost) lost = entry[1];
    if (entry_kind(entry) == FlightEntry::kTouch) time_ns = entry_value<trace::FlightTouch>(entry).time_ns;
    if (entry_kind(entry) == FlightEntry::kRefine) cycle = entry_value<trace::FlightRefine>(entry).cycle;
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
  // The next segment will probably be as long as the last one.
  const std::size_t last_size = segments_.back().records.size();
  Segment& next = segments_.emplace_back();
  next.records.reserve(last_size + last_size / 16);
  next.lost = lost;
  next.state.assign(state, end);
  const Segment& before = segments_[segments_.size() - 2];
  next.first_cycle = before.first_cycle + before.cycles + lost;
  next.first_ns = next.last_ns = before.last_ns;
  if (lost > 0) {
    lost_ += lost;
    const std::uint64_t* const events = begin + entry_words(begin);  // after kLost
    next.lost_events.assign(events, state);
  }
  words_ += next.words();
}

void FlightStore::add_new_records() {
  while (recorder_.next(record_)) add(record_);
}

void FlightStore::drop_old_segments() {
  while (segments_.size() > 2 &&
         (segments_.back().last_ns - segments_[1].first_ns >= duration_ns_ || words_ > max_words_)) {
    Segment& oldest = segments_.front();
    contents_.apply_records(oldest.records);
    contents_.apply_entries(segments_[1].lost_events);
    words_ -= oldest.words();
    segments_.pop_front();
  }
}

void FlightStore::drain() {
  add_new_records();
  drop_old_segments();
}

/// See FlightRecorder::put_state.
trace::FlightState FlightStore::state_of(const Segment& segment, const Contents& contents) const {
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
    const std::set<std::uint32_t>& held = contents.regions[object.object];
    object.loaded_pages = contents.pages[object.object];
    object.loaded_regions.assign(held.begin(), held.end());
    for (std::uint64_t regions = *at++; regions > 0; --regions, ++at)
      object.in_use.push_back({static_cast<std::uint32_t>(*at), static_cast<std::uint32_t>(*at >> 32) & 0x3fffffffu,
                               (*at >> 63) != 0, (*at >> 62 & 1u) != 0});
  }
  return state;
}

std::uint64_t FlightStore::write(const std::filesystem::path& file, const std::string& reason) {
  trace::FlightFileWriter out{file};
  const std::int64_t offset_ns = unix_minus_monotonic_ns();
  const auto set_time = [&](std::int64_t monotonic_time_ns) {
    out.set_time(static_cast<std::uint64_t>(monotonic_time_ns + offset_ns));
  };
  add_new_records();
  trace::FlightStart start = start_;
  start.reason = reason;
  start.first_cycle = segments_.front().first_cycle;
  set_time(segments_.front().first_ns);
  out.write(start);
  Contents contents = contents_;
  const auto write_objects = [&] {
    for (const std::optional<trace::FlightObject>& object : contents.objects)
      if (object) out.write(*object);
  };
  write_objects();

  // Records that arrive during writing are not written. No segment is dropped until the file is complete.
  std::uint64_t cycles = 0;
  const std::size_t segments = segments_.size();
  const std::size_t last_segment_size = segments_.back().records.size();
  for (std::size_t number = 0; number < segments; ++number) {
    if (number > 0 && segments_[number].lost > 0) {
      contents.apply_entries(segments_[number].lost_events);
      write_objects();
    }
    if (!segments_[number].state.empty() && (number == 0 || segments_[number].lost > 0)) {
      trace::FlightState state = state_of(segments_[number], contents);
      if (number == 0) state.lost = 0;
      out.write(state);
    }
    const std::size_t end = number + 1 < segments ? segments_[number].records.size() : last_segment_size;
    for (std::size_t at = 0; at < end; at += segments_[number].records[at]) {
      const std::uint64_t* const record = &segments_[number].records[at];
      for_each_entry(record + 1, record + record[0], [&](const std::uint64_t* entry) {
        if (entry_kind(entry) == FlightEntry::kTouch) set_time(entry_value<trace::FlightTouch>(entry).time_ns);
      });
      for_each_entry(record + 1, record + record[0], [&](const std::uint64_t* entry) {
        contents.apply(entry);
        switch (entry_kind(entry)) {
          case FlightEntry::kObject:
            out.write(entry_object(entry));
            out.write(entry_value<trace::FlightEvent>(entry));
            break;
          case FlightEntry::kEvent:
            out.write(entry_value<trace::FlightEvent>(entry));
            break;
          case FlightEntry::kMove:
            out.write(entry_value<trace::FlightMove>(entry));
            break;
          case FlightEntry::kProbe:
            out.write(entry_value<trace::FlightProbe>(entry));
            break;
          case FlightEntry::kTouch:
            out.write(entry_value<trace::FlightTouch>(entry));
            break;
          case FlightEntry::kRefine:
            out.write(entry_value<trace::FlightRefine>(entry));
            break;
          case FlightEntry::kLost:
          case FlightEntry::kState:
            break;
        }
      });
      ++cycles;
      constexpr std::uint64_t kDrainEvery = 64;  // cycles, which take less than 1 ms to write
      if (cycles % kDrainEvery == 0) add_new_records();
    }
  }
  out.close();
  drain();
  return cycles;
}

}  // namespace tactus::hrtc_service
