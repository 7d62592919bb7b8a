#include "session/delivery_client.hpp"

#include <xxhash.h>

#include <algorithm>

namespace tactus::session {
namespace {

constexpr std::size_t kMaxRunsAhead = 1024;
/// What a payload costs beside its bytes.
constexpr std::size_t kPayloadOverhead = 96;

bool well_formed(const BulkChunk& chunk) {
  return chunk.sequence != 0 && chunk.part < chunk.parts && chunk.payload.size() <= kMaxPayload &&
         (chunk.kind == BulkKind::kEcho || (chunk.kind == BulkKind::kRegion) == (chunk.region != spm::kNone));
}

}  // namespace

std::uint32_t first_epoch(std::uint64_t incarnation) noexcept {
  return static_cast<std::uint32_t>(XXH3_64bits(&incarnation, sizeof incarnation) & 0x7fffffffu);
}

DeliveryClient::DeliveryClient(const Origin& self, const DeliverySettings& settings)
    : self_{self}, settings_{settings} {}

void DeliveryClient::offer(const CatalogueEntry& entry) {
  Host& host = hosts_[entry.origin.participant];
  if (entry.withdrawn) {
    host.offers.erase(entry.object_id);
  } else {
    host.offers[entry.object_id] = entry.summary.digest;
  }
}

void DeliveryClient::host_seen(std::uint64_t host, std::uint64_t incarnation, std::int64_t now_ns) {
  Host& state = hosts_[host];
  if (incarnation < state.stream.incarnation && state.live) return;  // else a twin has yielded its name to it
  if (incarnation != state.stream.incarnation) begin_stream(host, state, incarnation);
  state.live = true;
  state.seen_ns = now_ns;
}

void DeliveryClient::host_gone(std::uint64_t host) {
  const auto at = hosts_.find(host);
  if (at != hosts_.end()) at->second.live = false;
}

void DeliveryClient::host_silent(std::uint64_t host) {
  const auto at = hosts_.find(host);
  if (at != hosts_.end()) at->second.seen_ns -= settings_.host_late_ns;
}

void DeliveryClient::begin_stream(std::uint64_t host, Host& state, std::uint64_t incarnation) {
  state.stream = Stream{};
  state.stream.incarnation = incarnation;
  for (auto& [object_id, object] : objects_) {
    for (auto& [region, handed] : object.handed) {
      if (handed.host == host) handed.last_sequence = 0;
    }
    if (object.host != host) continue;
    for (auto& [region, retiring] : object.retiring) retiring.echo_sequence = 0;
    change(object);
  }
}

void DeliveryClient::open(std::uint64_t object_id, std::uint64_t digest) {
  const auto [at, is_new] = objects_.try_emplace(object_id);
  if (!is_new) return;
  at->second.digest = digest;
  at->second.epoch = first_epoch(self_.incarnation);
  change(at->second);
}

/// Several changes between two demands share the epoch of the second.
void DeliveryClient::change(Object& object) {
  if (object.changed) return;
  object.changed = true;
  ++object.epoch;
}

void DeliveryClient::want(std::uint64_t object_id, std::vector<Wanted> wanted) {
  Object& object = objects_.at(object_id);
  std::stable_sort(wanted.begin(), wanted.end(),
                   [](const Wanted& a, const Wanted& b) { return a.contact_in_us < b.contact_in_us; });
  // Times alone go along with the next demand.
  const bool same = std::equal(wanted.begin(), wanted.end(), object.wanted.begin(), object.wanted.end(),
                               [](const Wanted& a, const Wanted& b) { return a.region == b.region; });
  if (!same) {
    for (const Wanted& w : wanted) {
      if (w.contact_in_us >= settings_.urgent_us || object.urgent) break;
      object.urgent = std::none_of(object.wanted.begin(), object.wanted.end(),
                                   [&](const Wanted& before) { return before.region == w.region; });
    }
    change(object);
  }
  object.wanted = std::move(wanted);
}

std::optional<DeliveryClient::Message> DeliveryClient::on_chunk(const BulkChunk& chunk, std::int64_t now_ns) {
  ++counters_.chunks;
  counters_.payload_bytes += chunk.payload.size();
  const auto object_at = objects_.find(chunk.object_id);
  const auto host_at = hosts_.find(chunk.origin.participant);
  if (chunk.origin.session != self_.session || chunk.hrtc != self_.participant || host_at == hosts_.end() ||
      chunk.origin.incarnation < host_at->second.stream.incarnation || !well_formed(chunk)) {
    ++counters_.foreign;
    return std::nullopt;
  }
  Host& host = host_at->second;
  if (chunk.origin.incarnation > host.stream.incarnation) {
    begin_stream(chunk.origin.participant, host, chunk.origin.incarnation);
  }
  note_sequence(host.stream, chunk.sequence, now_ns);
  if (object_at == objects_.end() || chunk.digest != object_at->second.digest ||
      chunk.epoch < first_epoch(self_.incarnation) || chunk.epoch > object_at->second.epoch) {
    ++counters_.foreign;
    return std::nullopt;
  }
  Object& object = object_at->second;
  object.progress_ns = now_ns;
  note_rate(chunk.payload.size(), now_ns);
  note_echo(object, chunk, now_ns);
  if (chunk.kind == BulkKind::kEcho) return std::nullopt;
  object.acknowledge = true;
  return assemble(object, chunk, now_ns);
}

void DeliveryClient::note_sequence(Stream& stream, std::uint32_t sequence, std::int64_t now_ns) {
  if (!stream.begun) {
    // What came before was for an earlier incarnation of this HRTC, or is nothing.
    stream.begun = true;
    stream.received = sequence - 1;
  }
  if (sequence <= stream.received) return;
  auto after = stream.ahead.upper_bound(sequence);
  std::uint32_t first = sequence;
  Stream::Run run{sequence, now_ns};
  if (after != stream.ahead.begin()) {
    const auto before = std::prev(after);
    if (sequence <= before->second.last) return;
    if (sequence == before->second.last + 1) {
      first = before->first;
      run.since_ns = before->second.since_ns;
      stream.ahead.erase(before);
    }
  }
  if (after != stream.ahead.end() && after->first == sequence + 1) {
    run.last = after->second.last;
    run.since_ns = std::min(run.since_ns, after->second.since_ns);
    stream.ahead.erase(after);
  }
  stream.ahead.emplace(first, run);
  while (!stream.ahead.empty() &&
         (stream.ahead.begin()->first == stream.received + 1 || stream.ahead.size() > kMaxRunsAhead)) {
    stream.received = stream.ahead.begin()->second.last;
    stream.ahead.erase(stream.ahead.begin());
  }
}

void DeliveryClient::give_up_holes(std::int64_t now_ns) {
  for (auto& [host_id, host] : hosts_) {
    Stream& stream = host.stream;
    const std::uint32_t before = stream.received;
    while (!stream.ahead.empty() && (stream.ahead.begin()->first == stream.received + 1 ||
                                     now_ns - stream.ahead.begin()->second.since_ns >= settings_.hole_timeout_ns)) {
      if (stream.ahead.begin()->first != stream.received + 1) ++counters_.holes;
      stream.received = stream.ahead.begin()->second.last;
      stream.ahead.erase(stream.ahead.begin());
    }
    if (stream.received == before) continue;
    for (auto& [object_id, object] : objects_) {
      if (object.host == host_id) object.acknowledge = true;
    }
  }
}

/// The last sequence before which nothing of this object is missing or waits for the caller's answer.
std::uint32_t DeliveryClient::dealt_with(const Object& object, std::uint64_t host, const Stream& stream,
                                         bool or_parked) {
  std::uint32_t received = stream.received;
  for (const auto& [region, handed] : object.handed) {
    if (or_parked && handed.parked) continue;
    if (handed.host == host && handed.last_sequence != 0) received = std::min(received, handed.last_sequence - 1);
  }
  return received;
}

void DeliveryClient::note_echo(Object& object, const BulkChunk& chunk, std::int64_t now_ns) {
  if (chunk.origin.participant != object.host) return;
  if (object.timed_ns != 0 && chunk.epoch >= object.timed_epoch) {
    constexpr std::int64_t kSmoothing = 8;
    const std::int64_t took = now_ns - object.timed_ns;
    round_trip_ns_ += round_trip_ns_ == 0 ? took : (took - round_trip_ns_) / kSmoothing;
    object.timed_ns = 0;
  }
  for (auto& [region, retiring] : object.retiring) {
    if (retiring.echo_sequence == 0 && chunk.epoch >= retiring.epoch) retiring.echo_sequence = chunk.sequence;
  }
}

std::optional<DeliveryClient::Message> DeliveryClient::assemble(Object& object, const BulkChunk& chunk,
                                                                std::int64_t now_ns) {
  const bool here = chunk.kind == BulkKind::kBase
                        ? object.has_base
                        : object.have.count(chunk.region) != 0 || object.retiring.count(chunk.region) != 0;
  if (here || object.handed.count(chunk.region) != 0) {
    ++counters_.stale;
    return std::nullopt;
  }
  auto at = object.partials.find(chunk.region);
  const auto other = [&] { return at->second.checksum != chunk.checksum || at->second.parts != chunk.parts; };
  if (at != object.partials.end() && other()) {
    const auto age = std::make_pair(at->second.epoch, at->second.last_sequence);
    if (std::make_pair(chunk.epoch, chunk.sequence) < age) {
      ++counters_.stale;
      return std::nullopt;
    }
    drop_partial(object, at);
    at = object.partials.end();
  }
  if (at == object.partials.end()) {
    at = object.partials.try_emplace(chunk.region).first;
    at->second.checksum = chunk.checksum;
    at->second.parts = chunk.parts;
  }
  Partial& partial = at->second;
  partial.epoch = std::max(partial.epoch, chunk.epoch);
  if (partial.host != chunk.origin.participant) partial.last_sequence = 0;
  partial.host = chunk.origin.participant;
  partial.last_sequence = std::max(partial.last_sequence, chunk.sequence);
  partial.touched_ns = now_ns;
  if (partial.payloads.emplace(chunk.part, chunk.payload).second) {
    partial.bytes += chunk.payload.size() + kPayloadOverhead;
    partial_bytes_ += chunk.payload.size() + kPayloadOverhead;
  }
  if (partial.payloads.size() < partial.parts) {
    if (partial_bytes_ > settings_.max_partial_bytes) bound_partials(now_ns);
    return std::nullopt;
  }

  if (partial.epoch < object.released_epoch) {
    drop_partial(object, at);
    ++counters_.stale;
    return std::nullopt;
  }
  Message message{chunk.object_id, chunk.kind, chunk.region, partial.epoch, {}};
  message.bytes.reserve(partial.bytes);
  for (const auto& [part, payload] : partial.payloads) {
    message.bytes.insert(message.bytes.end(), payload.begin(), payload.end());
  }
  const Handed handed{partial.host, partial.epoch, partial.last_sequence, false};
  drop_partial(object, at);
  if (XXH3_64bits(message.bytes.data(), message.bytes.size()) != chunk.checksum) {
    ++counters_.corrupt;
    return std::nullopt;
  }
  object.handed.emplace(chunk.region, handed);
  ++counters_.messages;
  return message;
}

void DeliveryClient::drop_partial(Object& object, std::map<std::uint32_t, Partial>::iterator at) {
  partial_bytes_ -= at->second.bytes;
  object.partials.erase(at);
}

/// Drops what has not been touched for long, and the longest untouched until the rest fits.
void DeliveryClient::bound_partials(std::int64_t now_ns) {
  for (;;) {
    Object* owner = nullptr;
    std::map<std::uint32_t, Partial>::iterator oldest;
    for (auto& [object_id, object] : objects_) {
      for (auto at = object.partials.begin(); at != object.partials.end(); ++at) {
        if (owner != nullptr && oldest->second.touched_ns <= at->second.touched_ns) continue;
        owner = &object;
        oldest = at;
      }
    }
    if (owner == nullptr) return;
    const bool expired = now_ns - oldest->second.touched_ns >= settings_.partial_timeout_ns;
    if (!expired && partial_bytes_ <= settings_.max_partial_bytes) return;
    drop_partial(*owner, oldest);
  }
}

void DeliveryClient::set_room(std::uint64_t bytes) {
  room_ = bytes;
  // Worth a demand of its own when a host may be waiting for it.
  constexpr std::uint64_t kWorthTelling = 8 * kMaxPayload;
  if (room_told_ >= settings_.credit || room_ < room_told_ + kWorthTelling) return;
  for (auto& [object_id, object] : objects_) object.acknowledge = object.acknowledge || owed(object);
}

std::uint64_t DeliveryClient::promised(std::int64_t now_ns) {
  const std::int64_t known_ns = now_ns - round_trip_ns_ - 2 * settings_.demand_interval_ns;
  while (told_.size() > 1 && told_[1].at_ns <= known_ns) told_.pop_front();
  return told_.empty() ? 0 : told_.front().credit;
}

/// What arrives in a window, as a rate; the best of late, for a host that has nothing to send says nothing of the link.
void DeliveryClient::note_rate(std::size_t bytes, std::int64_t now_ns) {
  constexpr std::int64_t kLeastWindow = 20'000'000;
  constexpr double kForgetting = 0.95;
  constexpr double kNsPerS = 1e9;
  window_.bytes += bytes;
  const std::int64_t lasted = now_ns - window_.begun_ns;
  if (lasted < std::max(kLeastWindow, round_trip_ns_)) return;
  const double rate = static_cast<double>(window_.bytes) * kNsPerS / static_cast<double>(lasted);
  rate_ = std::max(rate, kForgetting * rate_);
  window_ = {now_ns, 0};
}

/// A quarter more than rate times round trip: enough to find out that the link takes more, little enough not to queue.
std::uint32_t DeliveryClient::credit() const {
  constexpr double kMore = 1.25;
  constexpr double kNsPerS = 1e9;
  const double turnaround = static_cast<double>(round_trip_ns_ + settings_.demand_interval_ns) / kNsPerS;
  const double credit = std::clamp(kMore * rate_ * turnaround, static_cast<double>(settings_.credit),
                                   static_cast<double>(std::max(settings_.credit, settings_.most_credit)));
  return static_cast<std::uint32_t>(std::min(credit, static_cast<double>(room_)));
}

void DeliveryClient::base_held(std::uint64_t object_id) {
  Object& object = objects_.at(object_id);
  object.handed.erase(spm::kNone);
  object.has_base = true;
  change(object);
}

void DeliveryClient::base_refused(std::uint64_t object_id) { refused(object_id, spm::kNone); }

void DeliveryClient::held(std::uint64_t object_id, std::uint32_t region) {
  Object& object = objects_.at(object_id);
  object.handed.erase(region);
  object.retiring.erase(region);
  if (!object.have.insert(region).second) return;
  object.unannounced.insert(region);
  change(object);
}

void DeliveryClient::refused(std::uint64_t object_id, std::uint32_t region) {
  Object& object = objects_.at(object_id);
  if (object.handed.erase(region) == 0) return;
  ++counters_.refused;
  object.acknowledge = true;
}

void DeliveryClient::park(std::uint64_t object_id, std::uint32_t region) {
  objects_.at(object_id).handed.at(region).parked = true;
}

bool DeliveryClient::retire(std::uint64_t object_id, std::uint32_t region) {
  Object& object = objects_.at(object_id);
  if (object.host != 0 && object.unannounced.count(region) != 0) return false;
  if (object.have.erase(region) == 0) return false;
  change(object);
  object.retiring[region] = {object.epoch, 0};
  return true;
}

std::vector<std::uint32_t> DeliveryClient::take_released(std::uint64_t object_id) {
  Object& object = objects_.at(object_id);
  std::vector<std::uint32_t> released;
  if (object.retiring.empty()) return released;
  const auto host = hosts_.find(object.host);
  const bool served = object.host != 0 && host != hosts_.end();
  const std::uint32_t received = served ? dealt_with(object, object.host, host->second.stream, true) : 0;
  for (auto at = object.retiring.begin(); at != object.retiring.end();) {
    const Retiring& retiring = at->second;
    const bool passed = retiring.echo_sequence != 0 && retiring.echo_sequence <= received;
    const bool counted_on = std::any_of(object.handed.begin(), object.handed.end(), [&](const auto& entry) {
      return !entry.second.parked && entry.second.epoch < retiring.epoch;
    });
    if ((served && !passed) || counted_on) {
      ++at;
      continue;
    }
    released.push_back(at->first);
    object.released_epoch = std::max(object.released_epoch, retiring.epoch);
    at = object.retiring.erase(at);
  }
  return released;
}

void DeliveryClient::choose_host(std::uint64_t object_id, Object& object, std::int64_t now_ns) {
  const auto offers = [&](const Host& host) {
    const auto offer = host.offers.find(object_id);
    return host.live && offer != host.offers.end() && offer->second == object.digest;
  };
  const auto current = hosts_.find(object.host);
  const bool serving = object.host != 0 && current != hosts_.end() && offers(current->second);
  if (serving && now_ns - current->second.seen_ns < settings_.host_late_ns) return;
  for (const auto& [id, host] : hosts_) {
    if (!offers(host) || now_ns - host.seen_ns >= settings_.host_late_ns) continue;
    serve_from(object, id, now_ns);
    return;
  }
  if (!serving && object.host != 0) serve_from(object, 0, now_ns);
}

void DeliveryClient::serve_from(Object& object, std::uint64_t host, std::int64_t now_ns) {
  if (object.host != 0) ++counters_.host_changes;
  object.host = host;
  object.progress_ns = now_ns;
  object.timed_ns = 0;
  for (auto& [region, retiring] : object.retiring) retiring.echo_sequence = 0;
  change(object);
}

/// Whether the serving host has something to answer.
bool DeliveryClient::owed(const Object& object) const {
  if (object.host == 0) return false;
  if (!object.has_base) return object.handed.empty();
  if (!object.retiring.empty()) return true;
  return std::any_of(object.wanted.begin(), object.wanted.end(), [&](const Wanted& wanted) {
    return object.have.count(wanted.region) == 0 && object.handed.count(wanted.region) == 0;
  });
}

std::optional<Demand> DeliveryClient::demand(std::int64_t now_ns) {
  give_up_holes(now_ns);
  bound_partials(now_ns);
  for (auto& [object_id, object] : objects_) {
    choose_host(object_id, object, now_ns);
    if (object.host == 0) continue;
    if (!owed(object)) object.progress_ns = now_ns;
    if (now_ns - object.progress_ns >= settings_.silence_ns) {
      object.progress_ns = now_ns;
      change(object);
    }
    const std::int64_t since = now_ns - object.sent_ns;
    const std::int64_t interval = object.urgent ? settings_.urgent_interval_ns : settings_.demand_interval_ns;
    const bool news = (object.changed || object.acknowledge) && since >= interval;
    if (object.sent_once && !news && since < settings_.keep_alive_ns) continue;
    return make_demand(object_id, object, now_ns);
  }
  return std::nullopt;
}

Demand DeliveryClient::make_demand(std::uint64_t object_id, Object& object, std::int64_t now_ns) {
  room_told_ = room_;
  if (object.changed && object.timed_ns == 0) {
    object.timed_epoch = object.epoch;
    object.timed_ns = now_ns;
  }
  object.changed = object.acknowledge = object.urgent = false;
  object.unannounced.clear();
  object.sent_once = true;
  object.sent_ns = now_ns;
  Demand demand;
  demand.origin = self_;
  demand.origin.time_ns = now_ns;
  demand.object_id = object_id;
  demand.digest = object.digest;
  demand.serving_host = object.host;
  demand.epoch = object.epoch;
  demand.need_base = !object.has_base;
  for (const std::uint32_t region : object.have) {
    if (!demand.have.empty() && demand.have.back().first + demand.have.back().count == region) {
      ++demand.have.back().count;
    } else if (demand.have.size() < kMaxHaveRuns) {
      demand.have.push_back({region, 1});
    } else {
      break;  // what is left out is not counted on, no more
    }
  }
  for (const Wanted& wanted : object.wanted) {
    if (demand.wanted.size() == kMaxWanted) break;
    if (object.have.count(wanted.region) != 0 || object.retiring.count(wanted.region) != 0) continue;
    demand.wanted.push_back(wanted);
  }
  const Stream& stream = hosts_.at(object.host).stream;
  demand.stream_incarnation = stream.incarnation;
  demand.received = dealt_with(object, object.host, stream, false);
  demand.credit = credit();
  while (!told_.empty() && told_.back().credit <= demand.credit) told_.pop_back();
  told_.push_back({now_ns, demand.credit});
  return demand;
}

std::uint64_t DeliveryClient::serving_host(std::uint64_t object_id) const {
  const auto object = objects_.find(object_id);
  return object == objects_.end() ? 0 : object->second.host;
}

}  // namespace tactus::session
