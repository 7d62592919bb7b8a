#include "session/delivery_server.hpp"

#include <xxhash.h>

#include <algorithm>
#include <set>
#include <utility>

#include "spm/codec/region_codec.hpp"

namespace tactus::session {
namespace {

/// A base mesh goes behind regions that are touched sooner than this, and ahead of all prefetching.
constexpr std::uint32_t kBaseContactUs = 100'000;

std::uint32_t end_of(const spm::Run& run) { return run.first + run.count; }

/// Ascending runs that do not touch, all below `limit`.
bool well_formed_runs(const std::vector<spm::Run>& runs, std::uint32_t limit) {
  std::uint64_t end = 0;
  for (const spm::Run& run : runs) {
    if (run.count == 0 || run.first < end || (end != 0 && run.first == end)) return false;
    end = std::uint64_t{run.first} + run.count;
    if (end > limit) return false;
  }
  return true;
}

bool contains(const std::vector<spm::Run>& runs, std::uint32_t value) {
  const auto after = std::upper_bound(runs.begin(), runs.end(), value,
                                      [](std::uint32_t v, const spm::Run& run) { return v < run.first; });
  return after != runs.begin() && value < end_of(*(after - 1));
}

bool contains_all(const std::vector<spm::Run>& outer, const std::vector<spm::Run>& inner) {
  std::size_t i = 0;
  for (const spm::Run& run : inner) {
    while (i < outer.size() && end_of(outer[i]) <= run.first) ++i;
    if (i == outer.size() || run.first < outer[i].first || end_of(run) > end_of(outer[i])) return false;
  }
  return true;
}

std::uint32_t parts_of(std::size_t bytes) {
  return static_cast<std::uint32_t>(std::max<std::size_t>(1, (bytes + kMaxPayload - 1) / kMaxPayload));
}

std::uint64_t count_records(const std::vector<spm::Run>& runs) {
  std::uint64_t count = 0;
  for (const spm::Run& run : runs) count += run.count;
  return count;
}

}  // namespace

DeliveryServer::DeliveryServer(const Origin& self) : self_{self} {}

void DeliveryServer::add(std::uint64_t object_id, const spm::codec::CodedModel& model) {
  const spm::Span<const std::uint8_t> base = model.spans().base;
  objects_.insert_or_assign(object_id, Object{model, XXH3_64bits(base.data(), base.size())});
}

std::uint32_t DeliveryServer::base_bytes(std::uint64_t object_id) const {
  return static_cast<std::uint32_t>(objects_.at(object_id).model.spans().base.size());
}

bool DeliveryServer::well_formed(const Demand& demand, const spm::ModelSummary& summary) const {
  return well_formed_runs(demand.have, summary.regions) &&
         std::all_of(demand.wanted.begin(), demand.wanted.end(),
                     [&](const Wanted& wanted) { return wanted.region < summary.regions; });
}

DeliveryServer::DemandResult DeliveryServer::on_demand(const Demand& demand) {
  const auto object = objects_.find(demand.object_id);
  if (demand.origin.session != self_.session || object == objects_.end() ||
      demand.digest != object->second.model.summary().digest) {
    return DemandResult::kNotServed;
  }
  if (!well_formed(demand, object->second.model.summary())) return DemandResult::kMalformed;

  const auto [at, is_new] = streams_.try_emplace(demand.origin.participant);
  Stream& stream = at->second;
  if (is_new) {
    stream.sequence = highest_forgotten_;
    stream.hrtc_incarnation = demand.origin.incarnation;
  }
  if (demand.origin.incarnation < stream.hrtc_incarnation) return DemandResult::kNotNewer;
  if (demand.origin.incarnation > stream.hrtc_incarnation) {
    Stream fresh;
    fresh.hrtc_incarnation = demand.origin.incarnation;
    fresh.sequence = stream.sequence;
    fresh.counters = stream.counters;
    stream = std::move(fresh);
  }

  const auto [found, first] = stream.services.try_emplace(demand.object_id);
  Service& service = found->second;
  const auto age = [](const Demand& d) { return std::make_pair(d.epoch, d.origin.time_ns); };
  if (!first && age(demand) <= age(service.demand)) return DemandResult::kNotNewer;

  if (demand.origin.time_ns >= stream.credit_time_ns) {
    stream.credit_time_ns = demand.origin.time_ns;
    stream.credit = demand.credit;
  }
  const bool mine = demand.serving_host == self_.participant;
  const bool of_my_stream = mine && demand.stream_incarnation == self_.incarnation;
  const std::uint32_t received = of_my_stream ? std::min(demand.received, stream.sequence) : 0;
  acknowledge(stream, received);

  if (!mine) {
    if (service.under_way) count(stream, [](DeliveryCounters& c) { ++c.messages_dropped; });
    service = Service{};
    service.demand = demand;
    return DemandResult::kTaken;
  }
  service.echo_owed = service.echo_owed || !service.serving || demand.epoch != service.demand.epoch;
  const bool can_build_on = service.serving;
  service.serving = true;
  const Demand before = std::exchange(service.demand, demand);
  compare(service, object->second, can_build_on ? &before.have : nullptr, received, stream);
  return DemandResult::kTaken;
}

void DeliveryServer::acknowledge(Stream& stream, std::uint32_t received) const {
  while (!stream.unacknowledged.empty() && stream.unacknowledged.front().first <= received) {
    stream.unacknowledged_bytes -= stream.unacknowledged.front().second;
    stream.unacknowledged.pop_front();
  }
}

/// Brings `sent`, the records covered, the message under way and the regions to send in line with the newest demand.
/// What is covered grows in place while nothing of `had`, the demand before, and nothing sent was lost.
void DeliveryServer::compare(Service& service, const Object& object, const std::vector<spm::Run>* had,
                             std::uint32_t received, Stream& stream) {
  const Demand& demand = service.demand;
  bool only_more = had != nullptr && contains_all(demand.have, *had);
  for (auto it = service.sent.begin(); it != service.sent.end();) {
    const bool taken = contains(demand.have, it->first);
    const bool lost = !taken && it->second <= received;
    only_more = only_more && !lost;
    // What is under way may have counted on it, and be refused in its turn.
    if (lost) service.count_on_after = stream.sequence;
    it = taken || lost ? service.sent.erase(it) : std::next(it);
  }
  if (!demand.need_base || (service.base_sent && *service.base_sent <= received)) service.base_sent.reset();

  if (!only_more) service.covered.assign((object.model.summary().records + 63) / 64, 0);
  for (const spm::Run& run : demand.have) {
    for (std::uint32_t region = run.first; region != end_of(run); ++region) {
      if (!only_more || !contains(*had, region)) cover(service, object.model, region);
    }
  }
  if (!only_more) {
    for (const auto& [region, last] : service.sent)
      if (last > service.count_on_after) cover(service, object.model, region);
  }

  if (service.under_way && !still_holds(service, object.model)) {
    service.under_way.reset();
    count(stream, [](DeliveryCounters& c) { ++c.messages_dropped; });
  }
  service.to_send.clear();
  if (demand.need_base) return;
  std::set<std::uint32_t> seen;
  for (const Wanted& wanted : demand.wanted) {
    if (!seen.insert(wanted.region).second) continue;
    const bool under_way = service.under_way && service.under_way->region == wanted.region;
    if (under_way) service.under_way->contact_in_us = wanted.contact_in_us;
    if (under_way || contains(demand.have, wanted.region) || service.sent.count(wanted.region) != 0) continue;
    service.to_send.push_back(wanted);
  }
  std::stable_sort(service.to_send.begin(), service.to_send.end(),
                   [](const Wanted& a, const Wanted& b) { return a.contact_in_us > b.contact_in_us; });
}

void DeliveryServer::cover(Service& service, const spm::codec::CodedModel& model, std::uint32_t region) const {
  for (const spm::Run& run : model.runs_of(spm::RegionId{region})) {
    for (std::uint32_t r = run.first; r != end_of(run);) {
      const std::uint32_t bit = r % 64;
      const std::uint32_t count = std::min(64 - bit, end_of(run) - r);
      const std::uint64_t mask = count == 64 ? ~std::uint64_t{0} : ((std::uint64_t{1} << count) - 1) << bit;
      service.covered[r / 64] |= mask;
      r += count;
    }
  }
}

std::vector<spm::Run> DeliveryServer::missing(const Service& service, const spm::codec::CodedModel& model,
                                              std::uint32_t region) const {
  std::vector<spm::Run> runs;
  for (const spm::Run& run : model.runs_of(spm::RegionId{region})) {
    for (std::uint32_t r = run.first; r != end_of(run); ++r) {
      if ((service.covered[r / 64] >> r % 64 & 1u) != 0) continue;
      if (!runs.empty() && end_of(runs.back()) == r) {
        ++runs.back().count;
      } else {
        runs.push_back({r, 1});
      }
    }
  }
  return runs;
}

/// Whether the message under way is still wanted, and enough together with what is covered now.
bool DeliveryServer::still_holds(const Service& service, const spm::codec::CodedModel& model) const {
  const UnderWay& message = *service.under_way;
  const Demand& demand = service.demand;
  if (message.kind == BulkKind::kBase) return demand.need_base;
  const bool wanted = std::any_of(demand.wanted.begin(), demand.wanted.end(),
                                  [&](const Wanted& w) { return w.region == message.region; });
  return wanted && !demand.need_base && !contains(demand.have, message.region) &&
         contains_all(message.records, missing(service, model, message.region));
}

/// Time to contact of what this service would send next.
std::optional<std::uint32_t> DeliveryServer::urgency(const Service& service) {
  if (!service.serving) return std::nullopt;
  if (service.under_way) return service.under_way->contact_in_us;
  if (service.demand.need_base) {
    return service.base_sent ? std::nullopt : std::optional<std::uint32_t>{kBaseContactUs};
  }
  if (service.to_send.empty()) return std::nullopt;
  return service.to_send.back().contact_in_us;
}

void DeliveryServer::begin(Service& service, const Object& object) const {
  UnderWay message;
  if (service.demand.need_base) {
    message.contact_in_us = kBaseContactUs;
    message.checksum = object.base_checksum;
    message.parts = parts_of(object.model.spans().base.size());
  } else {
    const Wanted wanted = service.to_send.back();
    service.to_send.pop_back();
    message.kind = BulkKind::kRegion;
    message.region = wanted.region;
    message.contact_in_us = wanted.contact_in_us;
    message.records = missing(service, object.model, wanted.region);
    message.bytes = spm::codec::encode_region(object.model, spm::RegionId{wanted.region}, message.records);
    message.checksum = XXH3_64bits(message.bytes.data(), message.bytes.size());
    message.parts = parts_of(message.bytes.size());
  }
  service.under_way = std::move(message);
}

std::optional<Outgoing> DeliveryServer::next(std::int64_t now_ns, const CanSend& can_send) {
  auto at = streams_.upper_bound(last_served_);
  for (std::size_t tried = 0; tried < streams_.size(); ++tried, ++at) {
    if (at == streams_.end()) at = streams_.begin();
    auto& [hrtc, stream] = *at;
    if (can_send && !can_send(hrtc)) continue;
    std::optional<std::uint64_t> soonest;
    if (stream.unacknowledged_bytes + kMaxPayload <= stream.credit) {
      std::uint32_t contact_in_us = 0;
      for (const auto& [object_id, service] : stream.services) {
        const std::optional<std::uint32_t> own = urgency(service);
        if (!own || (soonest && *own >= contact_in_us)) continue;
        soonest = object_id;
        contact_in_us = *own;
      }
    }
    // An epoch that would wait behind another object's data is told alone: memory is freed by it.
    for (auto& [object_id, service] : stream.services) {
      if (!service.echo_owed || object_id == soonest) continue;
      last_served_ = hrtc;
      count(stream, [](DeliveryCounters& c) { ++c.echoes; });
      BulkChunk echo = make_chunk(hrtc, stream, object_id, service, now_ns);
      echo.checksum = XXH3_64bits(nullptr, 0);
      return Outgoing{hrtc, std::move(echo)};
    }
    if (soonest) {
      last_served_ = hrtc;
      return send_part(hrtc, stream, *soonest, now_ns);
    }
  }
  return std::nullopt;
}

BulkChunk DeliveryServer::make_chunk(std::uint64_t hrtc, Stream& stream, std::uint64_t object_id, Service& service,
                                     std::int64_t now_ns) {
  BulkChunk chunk;
  chunk.origin = self_;
  chunk.origin.time_ns = now_ns;
  chunk.hrtc = hrtc;
  chunk.object_id = object_id;
  chunk.digest = service.demand.digest;
  chunk.sequence = ++stream.sequence;
  chunk.epoch = service.demand.epoch;
  chunk.region = spm::kNone;
  service.echo_owed = false;
  count(stream, [](DeliveryCounters& c) { ++c.chunks; });
  return chunk;
}

Outgoing DeliveryServer::send_part(std::uint64_t hrtc, Stream& stream, std::uint64_t object_id, std::int64_t now_ns) {
  Service& service = stream.services.at(object_id);
  const Object& object = objects_.at(object_id);
  if (!service.under_way) begin(service, object);
  UnderWay& message = *service.under_way;
  const spm::Span<const std::uint8_t> bytes =
      message.kind == BulkKind::kBase ? object.model.spans().base : spm::Span<const std::uint8_t>{message.bytes};

  BulkChunk chunk = make_chunk(hrtc, stream, object_id, service, now_ns);
  chunk.kind = message.kind;
  chunk.region = message.region;
  chunk.part = message.part++;
  chunk.parts = message.parts;
  chunk.checksum = message.checksum;
  const std::size_t from = std::size_t{chunk.part} * kMaxPayload;
  const std::size_t to = std::min(from + kMaxPayload, bytes.size());
  chunk.payload.assign(bytes.begin() + from, bytes.begin() + to);
  const auto size = static_cast<std::uint32_t>(chunk.payload.size());
  stream.unacknowledged.emplace_back(chunk.sequence, size);
  stream.unacknowledged_bytes += size;
  count(stream, [&](DeliveryCounters& c) { c.payload_bytes += size; });

  if (message.part == message.parts) {
    if (message.kind == BulkKind::kBase) {
      service.base_sent = chunk.sequence;
      count(stream, [](DeliveryCounters& c) { ++c.bases; });
    } else {
      service.sent[message.region] = chunk.sequence;
      cover(service, object.model, message.region);
      const std::uint64_t records = count_records(message.records);
      count(stream, [&](DeliveryCounters& c) {
        ++c.regions;
        c.records += records;
      });
    }
    service.under_way.reset();
  }
  return {hrtc, std::move(chunk)};
}

void DeliveryServer::on_hrtc_gone(std::uint64_t hrtc) {
  const auto stream = streams_.find(hrtc);
  if (stream == streams_.end()) return;
  highest_forgotten_ = std::max(highest_forgotten_, stream->second.sequence);
  streams_.erase(stream);
}

std::uint64_t DeliveryServer::bytes_under_way(std::uint64_t hrtc) const {
  const auto stream = streams_.find(hrtc);
  return stream == streams_.end() ? 0 : stream->second.unacknowledged_bytes;
}

std::map<std::uint64_t, DeliveryCounters> DeliveryServer::counters_by_hrtc() const {
  std::map<std::uint64_t, DeliveryCounters> all;
  for (const auto& [hrtc, stream] : streams_) all.emplace(hrtc, stream.counters);
  return all;
}

}  // namespace tactus::session
