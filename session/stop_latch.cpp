#include "session/stop_latch.hpp"

#include <algorithm>

namespace tactus::session {
namespace {

bool stands(const StopRecord& record) noexcept { return record.stop > record.ended; }

template <class Records>
auto find_in(Records& records, std::uint64_t participant, std::uint64_t incarnation) {
  return std::find_if(records.begin(), records.end(), [&](const StopRecord& record) {
    return record.participant == participant && record.incarnation == incarnation;
  });
}

}  // namespace

StopLatch::StopLatch(const Origin& self) : self_{self} { records_.reserve(kMaxStops); }

bool StopLatch::is_own(const StopRecord& record) const noexcept {
  return record.participant == self_.participant && record.incarnation == self_.incarnation;
}

/// Returns the record of a program that issues stops or resets, a new one if necessary. Null if the stops of all
/// records are in force. One record is reserved for the stops of this program.
StopRecord* StopLatch::find_or_add(std::uint64_t participant, std::uint64_t incarnation) {
  const auto known = find_in(records_, participant, incarnation);
  if (known != records_.end()) return &*known;
  const StopRecord added{participant, incarnation, 0, 0, 0};
  const auto others = static_cast<std::size_t>(
      std::count_if(records_.begin(), records_.end(), [this](const StopRecord& record) { return !is_own(record); }));
  if (!is_own(added) && others >= kMaxStops - 1) {
    const auto oldest = std::find_if(records_.begin(), records_.end(),
                                     [this](const StopRecord& record) { return !stands(record) && !is_own(record); });
    if (oldest == records_.end()) return nullptr;
    records_.erase(oldest);
  }
  return &records_.emplace_back(added);
}

/// Sets a number of a record if `value` is larger. Then moves the record to the end, which invalidates references.
void StopLatch::set(StopRecord& record, std::uint32_t StopRecord::*number, std::uint32_t value) {
  if (value <= record.*number) return;
  record.*number = value;
  ++changes_;
  const auto at = records_.begin() + (&record - records_.data());
  std::rotate(at, at + 1, records_.end());
}

bool StopLatch::raise_own_stop() {
  StopRecord& own = *find_or_add(self_.participant, self_.incarnation);
  if (stands(own)) return false;
  set(own, &StopRecord::stop, own.ended + 1);
  return true;
}

bool StopLatch::on_stop(const StopName& stop) {
  StopRecord* const record = find_or_add(stop.participant, stop.incarnation);
  if (record == nullptr) return raise_own_stop();
  if (is_own(*record) || stop.number <= record->stop) return false;  // only this program issues its stops
  const bool ended = stop.number <= record->ended;
  set(*record, &StopRecord::stop, stop.number);
  return !ended;
}

bool StopLatch::on_reset(const ForceReset& reset) {
  for (const StopName& stop : reset.stops) {
    StopRecord* const record = find_or_add(stop.participant, stop.incarnation);
    if (record == nullptr) continue;  // if the stop arrives later, it will be in force
    if (is_own(*record) && stop.number > record->stop)
      continue;  // the reset names a stop that this program has not issued
    set(*record, &StopRecord::ended, stop.number);
  }
  StopRecord* const from = find_or_add(reset.origin.participant, reset.origin.incarnation);
  if (from == nullptr || reset.number <= from->reset) return false;
  set(*from, &StopRecord::reset, reset.number);
  ++resets_;
  return true;
}

bool StopLatch::on_roster(const RosterEntry& entry) {
  if (entry.origin.session != self_.session || entry.protocol != kProtocolVersion) return false;
  bool is_new = false;
  for (const StopRecord& record : entry.stops)
    if (stands(record)) is_new = on_stop({record.participant, record.incarnation, record.stop}) || is_new;
  return is_new;
}

bool StopLatch::stopped() const noexcept { return std::any_of(records_.begin(), records_.end(), stands); }

std::vector<StopName> standing_stops(const std::vector<StopRecord>& records) {
  std::vector<StopName> names;
  for (const StopRecord& record : records)
    if (stands(record)) names.push_back({record.participant, record.incarnation, record.stop});
  return names;
}

bool acknowledges(const RosterEntry& entry, const EmergencyStop& stop) {
  const auto record = find_in(entry.stops, stop.origin.participant, stop.origin.incarnation);
  if (record != entry.stops.end() && record->stop >= stop.number) return true;
  // If the program had no free record for the stop, it has issued a stop of its own instead.
  const auto own = find_in(entry.stops, entry.origin.participant, entry.origin.incarnation);
  return own != entry.stops.end() && stands(*own);
}

bool acknowledges(const RosterEntry& entry, const ForceReset& reset) {
  const auto from = find_in(entry.stops, reset.origin.participant, reset.origin.incarnation);
  if (from == entry.stops.end() || from->reset < reset.number) return false;
  return std::all_of(reset.stops.begin(), reset.stops.end(), [&](const StopName& stop) {
    const auto record = find_in(entry.stops, stop.participant, stop.incarnation);
    return record != entry.stops.end() && record->ended >= stop.number;
  });
}

}  // namespace tactus::session
