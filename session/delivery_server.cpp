#include "session/delivery_server.hpp"

#include <algorithm>
#include <limits>
#include <set>
#include <utility>

#include "spm/codec/page_codec.hpp"
#include "spm/codec/region_codec.hpp"

namespace tactus::session {
namespace {

/// Time to contact assigned to base meshes. Regions that are touched sooner come first; prefetched regions come later.
constexpr std::uint32_t kBaseContactUs = 100'000;
/// Free bytes of a chunk below which no piece is added.
constexpr std::size_t kMinFreeBytes = 64;
/// Delay of the first tail loss probe after the last chunk. Each further probe doubles the delay, up to the max.
constexpr std::int64_t kMinTailProbeNs = 4'000'000, kMaxTailProbeNs = 128'000'000;
/// Time without a demand after which the host drops an HRTC. An HRTC repeats its demands every half second
/// (DeliverySettings::keep_alive_ns).
constexpr std::int64_t kDropNs = 5'000'000'000;

std::uint32_t end_of(const spm::Interval& interval) { return interval.first + interval.count; }

/// Whether the intervals ascend, do not touch and lie below `limit`.
bool well_formed_intervals(const std::vector<spm::Interval>& intervals, std::uint32_t limit) {
  std::uint64_t end = 0;
  for (const spm::Interval& interval : intervals) {
    if (interval.count == 0 || interval.first < end || (end != 0 && interval.first == end)) return false;
    end = std::uint64_t{interval.first} + interval.count;
    if (end > limit) return false;
  }
  return true;
}

bool contains(const std::vector<spm::Interval>& intervals, std::uint32_t value) {
  const auto after =
      std::upper_bound(intervals.begin(), intervals.end(), value,
                       [](std::uint32_t v, const spm::Interval& interval) { return v < interval.first; });
  return after != intervals.begin() && value < end_of(*(after - 1));
}

bool contains_all(const std::vector<spm::Interval>& outer, const std::vector<spm::Interval>& inner) {
  std::size_t i = 0;
  for (const spm::Interval& interval : inner) {
    while (i < outer.size() && end_of(outer[i]) <= interval.first) ++i;
    if (i == outer.size() || interval.first < outer[i].first || end_of(interval) > end_of(outer[i])) return false;
  }
  return true;
}

std::vector<spm::Interval> list_of(const spm::codec::CompressedModel& model, std::uint32_t region) {
  return model.intervals_of(spm::RegionId{region});
}

/// Encodes a region with these records, or a part of the directory.
spm::codec::Result<spm::codec::Bytes> encode(const spm::codec::CompressedModel& model, std::uint32_t number,
                                             const std::vector<spm::Interval>& records) {
  if (number == kAllPages) return spm::codec::encode_pages(model.regions());
  if (is_of_directory(number))
    return spm::codec::encode_page(spm::page_with_id(model.regions(), spm::PageId{number - kFirstPage}));
  return spm::codec::encode_region(model, spm::RegionId{number}, records);
}

std::uint64_t count_records(const std::vector<spm::Interval>& intervals) {
  std::uint64_t count = 0;
  for (const spm::Interval& interval : intervals) count += interval.count;
  return count;
}

}  // namespace

DeliveryServer::DeliveryServer(const Origin& self, std::size_t chunk_bytes) : self_{self}, chunk_bytes_{chunk_bytes} {}

void DeliveryServer::add(std::uint64_t object_id, const spm::codec::CompressedModel& model) {
  const std::span<const std::uint8_t> base = model.spans().base;
  objects_.insert_or_assign(object_id, Object{model, checksum_of(base), {}, {}});
}

std::uint32_t DeliveryServer::base_bytes(std::uint64_t object_id) const {
  return static_cast<std::uint32_t>(objects_.at(object_id).model.spans().base.size());
}

bool DeliveryServer::well_formed(const Demand& demand, const spm::ModelSummary& summary) const {
  return well_formed_intervals(demand.have, summary.regions) &&
         std::all_of(demand.wanted.begin(), demand.wanted.end(), [&](const Wanted& wanted) {
           return wanted.region < summary.regions || is_of_directory(wanted.region);
         });
}

DeliveryServer::DemandResult DeliveryServer::on_demand(const Demand& demand, std::int64_t now_ns) {
  const auto object = objects_.find(demand.object_id);
  if (demand.origin.session != self_.session || object == objects_.end() ||
      demand.digest != object->second.model.summary().digest) {
    return DemandResult::kNotServed;
  }
  if (!well_formed(demand, object->second.model.summary())) return DemandResult::kMalformed;

  HrtcState& state = hrtcs_.try_emplace(demand.origin.participant).first->second;
  const Admission source = state.source.admit(demand.origin);
  if (source == Admission::kImplausible) return DemandResult::kImplausible;
  if (source == Admission::kNewStart) {
    record_sequences(state);  // an earlier incarnation may return and use its stream again
    HrtcState restarted;
    restarted.source = state.source;
    restarted.counters = state.counters;
    state = std::move(restarted);
  }
  state.received_ns = now_ns;
  const Admission time = state.times.admit(demand.origin.time_ns, now_ns);
  if (time == Admission::kImplausible) return DemandResult::kImplausible;
  if (time == Admission::kNewStart) {
    state.credit_time_ns = INT64_MIN;
    for (auto& [id, service] : state.services) service.demand.origin.time_ns = INT64_MIN;
  }
  const auto [found, first] = state.services.try_emplace(demand.object_id);
  Service& service = found->second;
  if (first) {
    service.stream = stream_id(self_, demand.origin, demand.object_id);
    const auto dropped = dropped_sequences_.find(service.stream);
    if (dropped != dropped_sequences_.end()) service.sequence = dropped->second;
  }
  const Admission epoch = service.epochs.admit(demand.epoch, now_ns);
  if (epoch == Admission::kImplausible) return DemandResult::kImplausible;
  const bool repeated =
      !first && demand.epoch == service.demand.epoch && demand.origin.time_ns <= service.demand.origin.time_ns;
  if (epoch == Admission::kOld || repeated) return DemandResult::kNotNewer;

  if (demand.origin.time_ns >= state.credit_time_ns) {
    state.credit_time_ns = demand.origin.time_ns;
    state.credit = demand.credit;
  }
  if (demand.serving_host != self_.participant) {
    if (service.partly_sent() != nullptr) count(state, [](DeliveryCounters& c) { ++c.messages_dropped; });
    for (const SentPiece& sent : service.in_flight) state.pacer.remove_in_flight(sent.bytes);
    Service stopped;
    stopped.stream = service.stream;
    stopped.sequence = service.sequence;
    stopped.planned = service.planned;
    stopped.epochs = service.epochs;
    stopped.demand = demand;
    service = std::move(stopped);
    return DemandResult::kApplied;
  }
  service.echo_pending = service.echo_pending || !service.serving || demand.epoch != service.demand.epoch;
  const bool was_serving = service.serving;
  service.serving = true;
  Demand before = std::exchange(service.demand, demand);
  if (demand.stream != service.stream) service.demand.received = service.demand.newest = 0;
  // The record of a stream that the HRTC still uses may have been deleted.
  if (service.sequence == 0) service.sequence = service.demand.newest;
  apply_receipt(state, service, now_ns);
  if (was_serving && !service.compare_due) service.compared_have = std::move(before.have);
  service.compare_due = true;
  return DemandResult::kApplied;
}

/// Removes from the pieces in flight those that the demand reports as received or as lost, and informs the pacer.
void DeliveryServer::apply_receipt(HrtcState& state, Service& service, std::int64_t now_ns) {
  constexpr std::int64_t kNsPerUs = 1000;
  const Demand& demand = service.demand;
  const auto now_us = static_cast<std::uint32_t>(now_ns / kNsPerUs);
  const auto passed = [&](const SentPiece& sent) { return sent.sequence <= std::max(demand.newest, demand.received); };
  Pacer::Feedback feedback;
  std::uint32_t waited_us = 0;
  for (; !service.in_flight.empty() && passed(service.in_flight.front()); service.in_flight.pop_front()) {
    const SentPiece& sent = service.in_flight.front();
    const auto message = std::lower_bound(service.messages.begin(), service.messages.end(), sent.message,
                                          [](const Message& m, std::uint32_t number) { return m.number < number; });
    const bool is_stored = message != service.messages.end() && message->number == sent.message;
    if (is_stored) --message->in_flight;
    if (sent.sequence > demand.received && contains(demand.gaps, sent.sequence)) {
      feedback.lost_bytes += sent.bytes;
      if (is_stored) message->lost.push_back(sent.index);
    } else {
      feedback.arrived_bytes += sent.bytes;
      waited_us = std::max(waited_us, now_us - sent.at_us);
    }
  }
  feedback.round_trip_ns = std::int64_t{waited_us} * kNsPerUs;
  const bool timed = demand.arrivals != 0 && demand.stream == service.stream;
  if (timed && accepted(state.one_ways.admit(demand.one_way_us, now_ns))) feedback.one_way_us = demand.one_way_us;
  state.pacer.on_feedback(feedback, now_ns);
}

/// Adds the records of a region to the covered records. The interval limit of a service shrinks with the number of
/// services, which bounds the memory of all. With few services the set is exact, and no record is sent twice.
void DeliveryServer::add_covered_records(Service& service, const Object& object, std::uint32_t region) const {
  constexpr std::size_t kMaxTotal = 40'960, kMin = 1'280, kMax = 5'120;  // intervals: 320, 10 and 40 KiB
  std::size_t services = 0;
  for (const auto& [hrtc, state] : hrtcs_) services += state.services.size();
  service.covered.add(list_of(object.model, region),
                      std::clamp(kMaxTotal / std::max<std::size_t>(services, 1), kMin, kMax));
}

/// Updates the messages, the covered records and the regions to send from the newest demand. If this demand still has
/// all regions of the demand that was compared before, and no message was refused or has a lost piece, the covered
/// records are extended; otherwise they are computed anew.
void DeliveryServer::compare(HrtcState& state, Service& service, const Object& object) {
  service.compare_due = false;
  const std::optional<std::vector<spm::Interval>> previous = std::exchange(service.compared_have, std::nullopt);
  count(state, [](DeliveryCounters& c) { ++c.comparisons; });
  const Demand& demand = service.demand;
  bool refused = false;
  const auto wanted = [&](const Message& message) {
    return std::any_of(demand.wanted.begin(), demand.wanted.end(),
                       [&](const Wanted& w) { return w.region == message.region; });
  };
  const auto has_ended = [&](const Message& message) {
    if (is_of_directory(message.region)) {  // no other message relies on it
      if (message.has_arrived()) return message.last_sequence <= demand.received;
      const bool cancelled = (!message.is_sent() || !message.lost.empty()) && !wanted(message);
      if (cancelled) count(state, [](DeliveryCounters& c) { ++c.messages_dropped; });
      return cancelled;
    }
    const bool base = message.region == spm::kNone;
    if (base ? !demand.need_base : contains(demand.have, message.region)) return true;  // accepted
    if (message.has_arrived() && message.last_sequence <= demand.received) return refused = true;
    const bool has_pieces_to_send = !message.is_sent() || !message.lost.empty();
    const bool cancelled = has_pieces_to_send && (base != demand.need_base || (!base && !wanted(message)));
    if (!cancelled) return false;
    count(state, [](DeliveryCounters& c) { ++c.messages_dropped; });
    refused = refused || message.is_sent();  // the HRTC does not have its records
    return true;
  };
  const auto erase_if = [&](const auto& condition) {
    service.messages.erase(std::remove_if(service.messages.begin(), service.messages.end(), condition),
                           service.messages.end());
  };
  erase_if(has_ended);

  const bool only_added =
      previous && contains_all(demand.have, *previous) && !refused && first_lost(service) == nullptr;
  if (!only_added) service.covered.clear();
  for (const spm::Interval& interval : demand.have) {
    for (std::uint32_t region = interval.first; region != end_of(interval); ++region) {
      if (!only_added || !contains(*previous, region)) add_covered_records(service, object, region);
    }
  }
  // The HRTC frees a retired region only after it has processed all chunks that were sent before the echo. So a message
  // that was sent completely is doubtful only if an earlier message was refused. A piece that is sent from now on must
  // not rely on regions that have left `have`.
  erase_if([&](Message& message) {
    if (only_added || message.region == spm::kNone || is_of_directory(message.region)) return false;
    const bool has_pieces_to_send = !message.is_sent() || !message.lost.empty();
    if (has_pieces_to_send || refused) {
      message.relies_on_removed =
          !contains_all(message.records, service.covered.missing(list_of(object.model, message.region)));
      if (message.relies_on_removed && has_pieces_to_send) {
        refused = refused || message.is_sent();
        count(state, [](DeliveryCounters& c) { ++c.messages_dropped; });
        return true;
      }
    }
    if (message.is_sent() && !message.relies_on_removed) add_covered_records(service, object, message.region);
    return false;
  });

  service.to_send.clear();
  std::set<std::uint32_t> seen;
  for (const Message& message : service.messages) seen.insert(message.region);
  for (const Wanted& w : demand.wanted) {
    if (Message* current = service.partly_sent(); current != nullptr && current->region == w.region)
      current->contact_in_us = w.contact_in_us;
    // Without the base mesh, an HRTC cannot store a region, but a page of the directory.
    if (demand.need_base && !is_of_directory(w.region)) continue;
    if (contains(demand.have, w.region) || object.damaged_regions.count(w.region) != 0) continue;
    if (!seen.insert(w.region).second) continue;
    service.to_send.push_back(w);
  }
  std::stable_sort(service.to_send.begin(), service.to_send.end(),
                   [](const Wanted& a, const Wanted& b) { return a.contact_in_us > b.contact_in_us; });
}

bool DeliveryServer::Message::fits(std::uint32_t piece, std::size_t free_bytes) const noexcept {
  const auto [from, to] = pieces.range(piece);
  return header_bytes(region, pieces.count) + to - from <= free_bytes;
}

DeliveryServer::Message* DeliveryServer::first_lost(Service& service, std::size_t free_bytes) {
  const auto at = std::find_if(service.messages.begin(), service.messages.end(), [&](const Message& message) {
    return !message.lost.empty() && message.fits(message.lost.back(), free_bytes);
  });
  return at == service.messages.end() ? nullptr : &*at;
}

/// Whether the base mesh is wanted and not planned yet. It precedes all other messages.
bool DeliveryServer::is_base_due(const Service& service) noexcept {
  return service.demand.need_base && std::none_of(service.messages.begin(), service.messages.end(),
                                                  [](const Message& message) { return message.region == spm::kNone; });
}

/// Time to contact of the message that this service would send next, us.
std::optional<std::uint32_t> DeliveryServer::urgency(Service& service) {
  if (!service.serving) return std::nullopt;
  if (const Message* lost = first_lost(service)) return lost->contact_in_us;
  if (const Message* current = service.partly_sent()) return current->contact_in_us;
  if (is_base_due(service)) return kBaseContactUs;
  if (service.to_send.empty()) return std::nullopt;
  return service.to_send.back().contact_in_us;
}

/// Plans the next message, whose first piece fits into `free_bytes` bytes. Returns false if all wanted regions are
/// damaged.
bool DeliveryServer::plan(Service& service, std::uint64_t object_id, std::size_t free_bytes) {
  const Object& object = objects_.at(object_id);
  const auto cut = [&](std::size_t bytes, std::uint32_t region) {
    return MessagePieces::cut(static_cast<std::uint32_t>(bytes), region, free_bytes, chunk_bytes_);
  };
  Message message;
  if (is_base_due(service)) {
    message.number = ++service.planned;
    message.contact_in_us = kBaseContactUs;
    message.pieces = cut(object.model.spans().base.size(), spm::kNone);
    message.checksum = object.base_checksum;
    service.messages.push_back(std::move(message));
    return true;
  }
  while (!service.to_send.empty()) {
    const Wanted wanted = service.to_send.back();
    service.to_send.pop_back();
    if (!is_of_directory(wanted.region))
      message.records = service.covered.missing(list_of(object.model, wanted.region));
    auto encoded = encode(object.model, wanted.region, message.records);
    if (!encoded) {
      add_damage(object_id, wanted.region, encoded.error().text);
      continue;
    }
    service.encoded = std::move(*encoded);
    message.number = ++service.planned;
    message.region = wanted.region;
    message.contact_in_us = wanted.contact_in_us;
    message.pieces = cut(service.encoded.size(), wanted.region);
    message.checksum = checksum_of(service.encoded);
    service.messages.push_back(std::move(message));
    return true;
  }
  return false;
}

/// Drops a message whose bytes in the model are no longer those that `plan` has checked, as in an overwritten file.
void DeliveryServer::drop_changed(HrtcState& state, Service& service, std::uint64_t object_id, const Message& message) {
  add_damage(object_id, message.region, "its bytes have changed since they were loaded");
  service.messages.erase(service.messages.begin() + (&message - service.messages.data()));
  service.compared_have.reset();  // the HRTC does not have the records of the message
  service.compare_due = true;
  count(state, [](DeliveryCounters& c) { ++c.messages_dropped; });
}

void DeliveryServer::add_damage(std::uint64_t object_id, std::uint32_t region, const std::string& damage) {
  Object& object = objects_.at(object_id);
  object.damaged_regions.insert(region);
  if (object.damage == damage) return;  // of most regions that need the same bytes
  object.damage = damage;
  damage_.push_back({object_id, damage});
}

/// Bytes of the chunks in flight and of the messages that arrived completely but are not in `have` yet.
std::uint64_t DeliveryServer::unanswered(const HrtcState& state) {
  std::uint64_t bytes = state.pacer.in_flight();
  for (const auto& [object_id, service] : state.services) {
    for (const Message& message : service.messages) bytes += message.has_arrived() ? message.pieces.bytes : 0;
  }
  return bytes;
}

std::optional<Outgoing> DeliveryServer::next(std::int64_t now_ns, const CanSend& can_send) {
  due_ns_ = std::numeric_limits<std::int64_t>::max();
  for (auto hrtc = hrtcs_.begin(); hrtc != hrtcs_.end();)
    hrtc = now_ns - hrtc->second.received_ns >= kDropNs ? drop(hrtc) : std::next(hrtc);
  auto at = hrtcs_.upper_bound(last_served_);
  for (std::size_t tried = 0; tried < hrtcs_.size(); ++tried, ++at) {
    if (at == hrtcs_.end()) at = hrtcs_.begin();
    if (can_send && !can_send(at->first)) continue;
    if (auto out = next(at->first, at->second, now_ns)) {
      last_served_ = at->first;
      return out;
    }
  }
  return std::nullopt;
}

std::optional<Outgoing> DeliveryServer::next(std::uint64_t hrtc, HrtcState& state, std::int64_t now_ns) {
  for (auto& [object_id, service] : state.services)
    if (service.compare_due) compare(state, service, objects_.at(object_id));
  std::optional<std::uint64_t> soonest;
  std::uint32_t contact_in_us = 0;
  for (auto& [object_id, service] : state.services) {
    const std::optional<std::uint32_t> own = urgency(service);
    if (!own || (soonest && *own >= contact_in_us)) continue;
    soonest = object_id;
    contact_in_us = *own;
  }
  if (soonest && unanswered(state) + chunk_bytes_ > state.credit) soonest.reset();
  if (!soonest) state.pacer.set_idle();
  // The next chunk of this object echoes the epoch too. It is sent now or as soon as the pacer allows.
  const std::optional<std::uint64_t> next_object = soonest;
  if (soonest && !state.pacer.may_send(static_cast<std::uint32_t>(chunk_bytes_), now_ns)) {
    soonest.reset();
    if (state.pacer.next_ns() > now_ns) due_ns_ = std::min(due_ns_, state.pacer.next_ns());
  }
  // An echo that would wait for another object's data, or for the pacer's window, is sent alone, because the HRTC frees
  // memory only after the echo.
  for (auto& [object_id, service] : state.services) {
    const bool soon = object_id == next_object && (soonest || state.pacer.next_ns() > now_ns);
    const bool probes_tail = service.serving && !service.in_flight.empty() && now_ns >= service.tail_probe_ns;
    if ((service.echo_pending || probes_tail) && !soon) return send_echo(hrtc, state, service, now_ns);
    if (!service.in_flight.empty()) due_ns_ = std::min(due_ns_, service.tail_probe_ns);
  }
  if (!soonest) return std::nullopt;
  return send_pieces(hrtc, state, *soonest, now_ns);
}

BulkChunk DeliveryServer::make_chunk(HrtcState& state, Service& service, std::int64_t now_ns) {
  BulkChunk chunk;
  chunk.stream = service.stream;
  chunk.sequence = ++service.sequence;
  chunk.epoch = service.demand.epoch;
  chunk.sent_us = static_cast<std::uint32_t>(now_ns / 1000);
  service.echo_pending = false;
  count(state, [](DeliveryCounters& c) { ++c.chunks; });
  return chunk;
}

Outgoing DeliveryServer::send_echo(std::uint64_t hrtc, HrtcState& state, Service& service, std::int64_t now_ns) {
  if (now_ns >= service.tail_probe_ns)
    service.tail_probe_interval_ns = std::min(2 * service.tail_probe_interval_ns, kMaxTailProbeNs);
  service.tail_probe_ns = now_ns + service.tail_probe_interval_ns;
  count(state, [](DeliveryCounters& c) { ++c.echoes; });
  return {hrtc, make_chunk(state, service, now_ns)};
}

Outgoing DeliveryServer::send_pieces(std::uint64_t hrtc, HrtcState& state, std::uint64_t object_id,
                                     std::int64_t now_ns) {
  Service& service = state.services.at(object_id);
  BulkChunk chunk = make_chunk(state, service, now_ns);
  std::size_t free_bytes = chunk_bytes_;
  while (auto piece = next_piece(state, service, object_id, chunk, free_bytes)) {
    free_bytes -= header_bytes(piece->region, piece->count) + piece->payload.size();
    chunk.pieces.push_back(std::move(*piece));
    if (chunk.kind() == BulkKind::kBase) break;  // a chunk carries a base mesh or regions, not both
  }
  state.pacer.on_sent(static_cast<std::uint32_t>(chunk.payload_bytes()), now_ns);
  service.tail_probe_interval_ns = kMinTailProbeNs;
  service.tail_probe_ns = now_ns + kMinTailProbeNs;
  count(state, [&](DeliveryCounters& c) { c.payload_bytes += chunk.payload_bytes(); });
  return {hrtc, std::move(chunk)};
}

/// Returns the next piece that fits into `free_bytes` bytes of the chunk, or none, and registers it as in flight.
std::optional<BulkPiece> DeliveryServer::next_piece(HrtcState& state, Service& service, std::uint64_t object_id,
                                                    const BulkChunk& chunk, std::size_t free_bytes) {
  if (free_bytes < kMinFreeBytes) return std::nullopt;
  Message* message = first_lost(service, free_bytes);
  const bool is_repeated = message != nullptr;
  if (!is_repeated && service.partly_sent() == nullptr) {
    if (!chunk.pieces.empty() && is_base_due(service)) return std::nullopt;
    if (!plan(service, object_id, free_bytes)) return std::nullopt;
  }
  const Object& object = objects_.at(object_id);
  if (!is_repeated) message = service.partly_sent();
  if (!chunk.pieces.empty() && message->region == spm::kNone) return std::nullopt;
  if (!is_repeated && !message->fits(message->sent_pieces, free_bytes)) return std::nullopt;

  BulkPiece piece;
  piece.region = message->region;
  piece.count = message->pieces.count;
  piece.checksum = message->checksum;
  std::vector<std::uint8_t> encoded;
  std::span<const std::uint8_t> bytes{service.encoded};
  if (message->region == spm::kNone) {
    bytes = object.model.spans().base;
  } else if (is_repeated && message != service.partly_sent()) {
    auto again = encode(object.model, message->region, message->records);
    if (!again || again->size() != message->pieces.bytes || checksum_of(*again) != message->checksum) {
      drop_changed(state, service, object_id, *message);
      return std::nullopt;
    }
    encoded = std::move(*again);
    bytes = std::span<const std::uint8_t>{encoded};
  }
  if (is_repeated) {
    piece.index = message->lost.back();
    message->lost.pop_back();
    count(state, [](DeliveryCounters& c) { ++c.repeated; });
  } else {
    piece.index = message->sent_pieces++;
  }
  const auto [from, to] = message->pieces.range(piece.index);
  piece.payload.assign(bytes.begin() + from, bytes.begin() + to);
  message->last_sequence = chunk.sequence;
  ++message->in_flight;
  const auto size = static_cast<std::uint16_t>(piece.payload.size());
  service.in_flight.push_back({chunk.sequence, message->number, chunk.sent_us, piece.index, size});

  if (!is_repeated && message->is_sent()) {
    service.encoded.clear();
    if (message->region == spm::kNone) {
      count(state, [](DeliveryCounters& c) { ++c.bases; });
    } else if (is_of_directory(message->region)) {
      count(state, [](DeliveryCounters& c) { ++c.pages; });
    } else {
      add_covered_records(service, object, message->region);
      const std::uint64_t records = count_records(message->records);
      count(state, [&](DeliveryCounters& c) {
        ++c.regions;
        c.records += records;
      });
    }
  }
  return piece;
}

void DeliveryServer::record_sequences(const HrtcState& state) {
  constexpr std::size_t kMaxRecorded = 4096;
  if (dropped_sequences_.size() >= kMaxRecorded) dropped_sequences_.clear();
  for (const auto& [object_id, service] : state.services)
    if (service.sequence != 0) dropped_sequences_[service.stream] = service.sequence;
}

void DeliveryServer::on_hrtc_gone(std::uint64_t hrtc) {
  const auto state = hrtcs_.find(hrtc);
  if (state != hrtcs_.end()) drop(state);
}

std::map<std::uint64_t, DeliveryServer::HrtcState>::iterator DeliveryServer::drop(
    std::map<std::uint64_t, HrtcState>::iterator state) {
  record_sequences(state->second);
  return hrtcs_.erase(state);
}

std::uint64_t DeliveryServer::bytes_in_flight(std::uint64_t hrtc) const {
  const auto state = hrtcs_.find(hrtc);
  return state == hrtcs_.end() ? 0 : unanswered(state->second);
}

const Pacer* DeliveryServer::pacer(std::uint64_t hrtc) const {
  const auto state = hrtcs_.find(hrtc);
  return state == hrtcs_.end() ? nullptr : &state->second.pacer;
}

std::map<std::uint64_t, DeliveryCounters> DeliveryServer::counters_by_hrtc() const {
  std::map<std::uint64_t, DeliveryCounters> all;
  for (const auto& [hrtc, state] : hrtcs_) all.emplace(hrtc, state.counters);
  return all;
}

}  // namespace tactus::session
