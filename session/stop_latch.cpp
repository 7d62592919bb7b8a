#include "session/stop_latch.hpp"

#include <algorithm>

namespace tactus::session {
namespace {

bool stands(const StopRecord& record) noexcept { return record.stop > record.ended; }

bool has_stop(const StopRecord& record) noexcept { return record.stop != 0; }
bool has_reset(const StopRecord& record) noexcept { return record.reset != 0; }

/// Finds the record or the name of an issuer.
template <class Items>
auto find_in(Items& items, std::uint64_t participant, std::uint64_t incarnation) {
  return std::find_if(items.begin(), items.end(), [&](const auto& item) {
    return item.participant == participant && item.incarnation == incarnation;
  });
}

}  // namespace

StopLatch::StopLatch(const Origin& self) : self_{self} {
  records_.reserve(kMaxStops);
  direct_.reserve(kMaxStops);
}

bool StopLatch::is_own(std::uint64_t participant, std::uint64_t incarnation) const noexcept {
  return participant == self_.participant && incarnation == self_.incarnation;
}

/// Returns the record of an issuer, or null. Moves it to the end, which invalidates references.
StopRecord* StopLatch::find(std::uint64_t participant, std::uint64_t incarnation) noexcept {
  const auto known = find_in(records_, participant, incarnation);
  if (known == records_.end()) return nullptr;
  std::rotate(known, known + 1, records_.end());
  return &records_.back();
}

StopRecord& StopLatch::find_or_add(std::uint64_t participant, std::uint64_t incarnation) {
  StopRecord* const known = find(participant, incarnation);
  return known != nullptr ? *known : records_.emplace_back(StopRecord{participant, incarnation, 0, 0, 0});
}

/// Returns the record for the stops of another issuer. If it is new and none is free, drops a stop that does not stand.
/// Returns null if no record becomes free.
StopRecord* StopLatch::find_or_add_stop(const StopName& stop) {
  StopRecord* const known = find(stop.participant, stop.incarnation);
  if (known != nullptr && has_stop(*known)) return known;
  const auto used = std::count_if(records_.begin(), records_.end(), [this](const StopRecord& record) {
    return has_stop(record) && !is_own(record.participant, record.incarnation);
  });
  if (used >= static_cast<std::ptrdiff_t>(kMaxStopIssuers) && !drop_a_stop()) return nullptr;
  return &find_or_add(stop.participant, stop.incarnation);
}

StopRecord& StopLatch::find_or_add_reset(const Origin& issuer) {
  StopRecord* const known = find(issuer.participant, issuer.incarnation);
  if (known != nullptr && has_reset(*known)) return *known;
  if (std::count_if(records_.begin(), records_.end(), has_reset) >= static_cast<std::ptrdiff_t>(kMaxResetIssuers))
    drop_a_reset();
  return find_or_add(issuer.participant, issuer.incarnation);
}

bool StopLatch::drop_a_stop() {
  const auto oldest = std::find_if(records_.begin(), records_.end(), [this](const StopRecord& record) {
    return has_stop(record) && !stands(record) && !is_own(record.participant, record.incarnation);
  });
  if (oldest == records_.end()) return false;
  oldest->stop = oldest->ended = 0;
  if (!has_reset(*oldest)) records_.erase(oldest);
  return true;
}

void StopLatch::drop_a_reset() {
  const auto oldest = std::find_if(records_.begin(), records_.end(), has_reset);
  oldest->reset = 0;
  if (!has_stop(*oldest)) records_.erase(oldest);
}

/// Sets a number of a record if `value` is larger.
void StopLatch::raise(std::uint32_t& number, std::uint32_t value) noexcept {
  if (value <= number) return;
  number = value;
  ++changes_;
}

bool StopLatch::raise_own_stop() {
  StopRecord& own = find_or_add(self_.participant, self_.incarnation);
  if (stands(own)) return false;
  raise(own.stop, own.ended + 1);
  return true;
}

void StopLatch::issue_stop() {
  StopRecord& own = find_or_add(self_.participant, self_.incarnation);
  raise(own.stop, std::max(own.stop, own.ended) + 1);
}

/// Returns whether the issuer itself has sent no stop with this number or a larger one before.
bool StopLatch::is_first_from_issuer(const StopName& stop) {
  const auto known = find_in(direct_, stop.participant, stop.incarnation);
  if (known != direct_.end()) {
    const bool is_first = stop.number > known->number;
    known->number = std::max(known->number, stop.number);
    std::rotate(known, known + 1, direct_.end());
    return is_first;
  }
  if (direct_.size() == kMaxStops) direct_.erase(direct_.begin());
  direct_.push_back(stop);
  return true;
}

bool StopLatch::on_stop(const StopName& stop) {
  if (stop.number == 0 || is_own(stop.participant, stop.incarnation))
    return false;  // only this program issues its stops
  const bool is_first = is_first_from_issuer(stop);
  if (record_stop(stop)) return true;
  const auto recorded = find_in(records_, stop.participant, stop.incarnation);
  if (!is_first || recorded == records_.end()) return false;
  // Another program has forwarded this stop or a later one. A reset of that one must not end the stop of its issuer.
  return (recorded->stop > stop.number || !stands(*recorded)) && raise_own_stop();
}

/// Records a stop. Returns true when it is new and a stop stands.
bool StopLatch::record_stop(const StopName& stop) {
  StopRecord* const record = find_or_add_stop(stop);
  if (record == nullptr) return raise_own_stop();
  const bool is_new = stop.number > record->stop;
  raise(record->stop, stop.number);
  return is_new;
}

bool StopLatch::on_reset(const ForceReset& reset) {
  if (reset.number == 0) return false;
  const StopRecord* const before = find(reset.origin.participant, reset.origin.incarnation);
  const bool is_new = before == nullptr || reset.number > before->reset;
  for (const StopName& stop : reset.stops) {
    StopRecord* const record = find(stop.participant, stop.incarnation);
    if (record == nullptr) continue;  // if the stop arrives later, it will be in force
    const bool own = is_own(stop.participant, stop.incarnation);
    if (own && stop.number > record->stop) continue;  // the reset names a stop that this program has not issued
    // A larger number would end stops that their issuer has not issued yet.
    raise(record->ended, std::min(stop.number, record->stop));
  }
  StopRecord& from = find_or_add_reset(reset.origin);
  raise(from.reset, reset.number);
  if (is_new) ++resets_;
  return is_new;
}

bool StopLatch::on_roster(const RosterEntry& entry) {
  if (entry.origin.session != self_.session || entry.protocol != kProtocolVersion) return false;
  if (!lists_stops(entry)) return false;
  bool is_new = false;
  for (const StopRecord& stated : entry.stops) {
    const StopName stop{stated.participant, stated.incarnation, stated.stop};
    if (!stands(stated) || is_own(stop.participant, stop.incarnation)) continue;
    const bool is_of_sender =
        stop.participant == entry.origin.participant && stop.incarnation == entry.origin.incarnation;
    is_new = (is_of_sender ? on_stop(stop) : record_stop(stop)) || is_new;
  }
  return is_new;
}

bool StopLatch::stopped() const noexcept { return std::any_of(records_.begin(), records_.end(), stands); }

bool lists_stops(const RosterEntry& entry) noexcept { return entry.role == Role::kHost || entry.role == Role::kHrtc; }

std::vector<StopName> standing_stops(const std::vector<StopRecord>& records) {
  std::vector<StopName> names;
  for (const StopRecord& record : records)
    if (stands(record)) names.push_back({record.participant, record.incarnation, record.stop});
  return names;
}

std::vector<StopName> standing_stops(const Roster& roster) {
  std::vector<StopName> all;
  roster.for_each([&](const RosterEntry& entry) {
    if (!lists_stops(entry)) return;
    for (const StopName& stop : standing_stops(entry.stops)) {
      const auto known = find_in(all, stop.participant, stop.incarnation);
      if (known == all.end())
        all.push_back(stop);
      else
        known->number = std::max(known->number, stop.number);
    }
  });
  return all;
}

bool acknowledges(const RosterEntry& entry, const EmergencyStop& stop) {
  const auto record = find_in(entry.stops, stop.origin.participant, stop.origin.incarnation);
  // A program ends only stops that it has received. One with a larger `ended` would ignore later stops.
  // A larger `stop` is not of this issuer, which repeats only its newest one.
  if (record != entry.stops.end() && record->stop == stop.number && record->ended <= record->stop) return true;
  // If the program had no free record for the stop, it has issued a stop of its own instead.
  const auto own = find_in(entry.stops, entry.origin.participant, entry.origin.incarnation);
  return own != entry.stops.end() && stands(*own);
}

bool acknowledges(const RosterEntry& entry, const ForceReset& reset) {
  const auto from = find_in(entry.stops, reset.origin.participant, reset.origin.incarnation);
  if (from == entry.stops.end() || from->reset < reset.number) return false;
  // A program that has applied the reset may have no record of a stop that it names, because no record was free.
  return std::none_of(reset.stops.begin(), reset.stops.end(), [&](const StopName& stop) {
    const auto record = find_in(entry.stops, stop.participant, stop.incarnation);
    return record != entry.stops.end() && stands(*record) && record->ended < stop.number;
  });
}

void Recipients::update(const Roster& roster) {
  std::erase_if(entries_, [&](const auto& known) { return roster.has_left(known.first); });
  roster.for_each([&](const RosterEntry& entry) {
    const std::uint64_t participant = entry.origin.participant;
    if (lists_stops(entry) && (entries_.size() < kMaxEntries || entries_.count(participant) != 0))
      entries_.insert_or_assign(participant, entry);
  });
}

}  // namespace tactus::session
