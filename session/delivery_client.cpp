#include "session/delivery_client.hpp"

#include <algorithm>
#include <utility>

#include "session/units.hpp"

namespace tactus::session {
namespace {

constexpr std::size_t kMaxStreamGaps = 1024;
/// Memory that a stored piece takes in addition to its payload, bytes.
constexpr std::size_t kPayloadOverhead = 96;
constexpr std::int64_t kNsPerUs = 1000;

bool well_formed(const BulkChunk& chunk) {
  return chunk.sequence != 0 && chunk.payload_bytes() <= kMaxPayload &&
         std::all_of(chunk.pieces.begin(), chunk.pieces.end(), [&](const BulkPiece& piece) {
           return piece.index < piece.count && (piece.region == spm::kNone) == (chunk.kind() == BulkKind::kBase);
         });
}

}  // namespace

DeliveryClient::DeliveryClient(const Origin& self, const DeliverySettings& settings)
    : self_{self}, settings_{settings} {}

void DeliveryClient::on_catalogue(const CatalogueEntry& entry) {
  Host& host = hosts_[entry.origin.participant];
  const auto key = std::make_pair(entry.object_id, entry.origin.incarnation);
  if (host.offers.size() >= kMaxOffers)
    std::erase_if(host.offers, [&](const auto& offer) {
      return offer.first.second != entry.origin.incarnation && offer.first.second != host.incarnation;
    });
  if (entry.withdrawn) {
    host.offers.erase(key);
  } else if (host.offers.size() < kMaxOffers || host.offers.count(key) != 0) {
    host.offers[key] = {entry.summary.digest, entry.summary.regions};
  } else {
    ++counters_.foreign;
  }
}

/// Returns an offer of the object with this digest, or null.
const DeliveryClient::Offer* DeliveryClient::Host::find_offer(std::uint64_t object, std::uint64_t digest) const {
  for (auto at = offers.lower_bound({object, 0}); at != offers.end() && at->first.first == object; ++at)
    if (at->second.digest == digest) return &at->second;
  return nullptr;
}

void DeliveryClient::on_host_heartbeat(std::uint64_t host, std::uint64_t incarnation, std::int64_t now_ns) {
  Host& state = hosts_[host];
  if (incarnation < state.incarnation && state.present) return;  // name conflict: the newer program still lives
  if (incarnation != state.incarnation) {
    begin_streams(host, incarnation);
    state.incarnation_ns = now_ns;
  }
  state.present = true;
  state.heartbeat_ns = now_ns;
  state.absent_ns = 0;
}

void DeliveryClient::on_host_gone(std::uint64_t host) {
  const auto at = hosts_.find(host);
  if (at != hosts_.end()) at->second.present = false;
}

void DeliveryClient::on_host_left(std::uint64_t host, std::uint64_t incarnation) {
  const auto at = hosts_.find(host);
  if (at == hosts_.end()) return;
  auto& offers = at->second.offers;
  for (auto offer = offers.begin(); offer != offers.end();)
    offer = offer->first.second == incarnation ? offers.erase(offer) : std::next(offer);
}

void DeliveryClient::suspect_host(std::uint64_t host) {
  const auto at = hosts_.find(host);
  if (at != hosts_.end()) at->second.heartbeat_ns -= settings_.host_late_ns;
}

void DeliveryClient::end_streams(std::uint64_t host) {
  for (auto at = streams_.begin(); at != streams_.end();) {
    at = at->second.host == host ? streams_.erase(at) : std::next(at);
  }
}

/// Forgets hosts that have been absent for long and serve no object, and the offers of replaced incarnations.
void DeliveryClient::forget_hosts(std::int64_t now_ns) {
  for (auto at = hosts_.begin(); at != hosts_.end();) {
    Host& host = at->second;
    if (!host.present && host.absent_ns == 0) host.absent_ns = now_ns;
    if (now_ns - host.incarnation_ns >= settings_.forget_host_ns)
      for (auto offer = host.offers.begin(); offer != host.offers.end();)
        offer = offer->first.second < host.incarnation ? host.offers.erase(offer) : std::next(offer);
    const bool serves = std::any_of(objects_.begin(), objects_.end(),
                                    [&](const auto& object) { return object.second.host == at->first; });
    if (host.present || serves || now_ns - host.absent_ns < settings_.forget_host_ns) {
      ++at;
      continue;
    }
    end_streams(at->first);
    at = hosts_.erase(at);
  }
}

void DeliveryClient::begin_streams(std::uint64_t host, std::uint64_t incarnation) {
  end_streams(host);
  Host& state = hosts_[host];
  state.incarnation = incarnation;
  state.arrivals = 0;
  state.times = WrappedTimeWindow{};
  for (auto& [object_id, object] : objects_) {
    begin_stream(host, object_id);
    if (object.host != host) continue;
    for (auto& [region, retiring] : object.retiring) retiring.echo_sequence = 0;
    begin_epoch(object);
  }
}

/// Begins the stream of a host that has sent a heartbeat. If another stream has the same id, that stream remains.
void DeliveryClient::begin_stream(std::uint64_t host, std::uint64_t object_id) {
  const std::uint32_t id = stream_id({self_.session, host, *hosts_.at(host).incarnation, 0}, self_, object_id);
  const auto [at, is_new] = streams_.try_emplace(id);
  if (!is_new) return;
  at->second.id = id;
  at->second.host = host;
  at->second.object_id = object_id;
}

/// Returns the stream of the host about the object. Null before the first heartbeat of the host, and if another stream
/// has its id.
DeliveryClient::Stream* DeliveryClient::find_stream(std::uint64_t host, std::uint64_t object_id) {
  const auto state = hosts_.find(host);
  if (state == hosts_.end() || !state->second.incarnation) return nullptr;
  const auto at = streams_.find(stream_id({self_.session, host, *state->second.incarnation, 0}, self_, object_id));
  if (at == streams_.end() || at->second.host != host || at->second.object_id != object_id) return nullptr;
  return &at->second;
}

void DeliveryClient::open(std::uint64_t object_id, std::uint64_t digest) {
  const auto [at, is_new] = objects_.try_emplace(object_id);
  if (!is_new) return;
  at->second.digest = digest;
  at->second.epoch = last_epoch_;
  for (const auto& [host, state] : hosts_)
    if (state.incarnation) begin_stream(host, object_id);
  begin_epoch(at->second);
}

void DeliveryClient::close(std::uint64_t object_id) {
  const auto at = objects_.find(object_id);
  if (at == objects_.end()) return;
  last_epoch_ = std::max(last_epoch_, at->second.epoch);
  auto& partials = at->second.partials;
  while (!partials.empty()) drop_partial(at->second, object_id, partials.begin());
  for (auto stream = streams_.begin(); stream != streams_.end();)
    stream = stream->second.object_id == object_id ? streams_.erase(stream) : std::next(stream);
  objects_.erase(at);
}

bool DeliveryClient::is_offered(std::uint64_t object_id, std::uint64_t digest) const {
  return std::any_of(hosts_.begin(), hosts_.end(),
                     [&](const auto& host) { return host.second.find_offer(object_id, digest) != nullptr; });
}

/// Gives the next demand a new epoch; all changes since the last demand share it.
void DeliveryClient::begin_epoch(Object& object) {
  if (object.changed) return;
  object.changed = true;
  ++object.epoch;
}

void DeliveryClient::set_wanted(std::uint64_t object_id, std::vector<Wanted> wanted) {
  Object& object = objects_.at(object_id);
  std::stable_sort(wanted.begin(), wanted.end(),
                   [](const Wanted& a, const Wanted& b) { return a.contact_in_us < b.contact_in_us; });
  // If only contact times changed, no demand is due: the next demand publishes the new times.
  const bool same = std::equal(wanted.begin(), wanted.end(), object.wanted.begin(), object.wanted.end(),
                               [](const Wanted& a, const Wanted& b) { return a.region == b.region; });
  if (!same) {
    for (const Wanted& w : wanted) {
      if (w.contact_in_us >= settings_.urgent_us || object.urgent) break;
      object.urgent = std::none_of(object.wanted.begin(), object.wanted.end(),
                                   [&](const Wanted& before) { return before.region == w.region; });
    }
    begin_epoch(object);
  }
  object.wanted = std::move(wanted);
}

std::vector<DeliveryClient::Message> DeliveryClient::on_chunk(const BulkChunk& chunk, std::int64_t now_ns) {
  ++counters_.chunks;
  counters_.payload_bytes += chunk.payload_bytes();
  const auto at = streams_.find(chunk.stream);
  if (at == streams_.end() || !well_formed(chunk) || chunk.epoch > objects_.at(at->second.object_id).epoch) {
    ++counters_.foreign;
    return {};
  }
  Stream& stream = at->second;
  if (chunk.is_from_member &&
      std::find(chunk.senders.begin(), chunk.senders.end(), stream.host) == chunk.senders.end()) {
    ++counters_.foreign;
    return {};
  }
  Object& object = objects_.at(stream.object_id);
  Host& host = hosts_.at(stream.host);
  const Offer* const offer = host.find_offer(stream.object_id, object.digest);
  const auto is_in_model = [&](const BulkPiece& piece) {
    return piece.region == spm::kNone || piece.region < offer->regions || is_of_directory(piece.region);
  };
  if (offer == nullptr || !std::all_of(chunk.pieces.begin(), chunk.pieces.end(), is_in_model)) {
    ++counters_.foreign;
    return {};
  }
  const std::uint32_t one_way_us = static_cast<std::uint32_t>(now_ns / kNsPerUs) - chunk.sent_us;
  const Admission number = stream.numbers.admit(chunk.sequence, now_ns);
  const Admission time = number == Admission::kImplausible ? number : host.times.admit(one_way_us, now_ns);
  if (time == Admission::kImplausible) {
    ++counters_.implausible;
    return {};
  }
  if (number == Admission::kNewStart) {  // the host repeats the pieces of earlier chunks under new numbers
    stream.newest = 0;
    stream.gaps.clear();
  }
  if (time == Admission::kNewStart) host.arrivals = 0;
  const bool shorter = static_cast<std::int32_t>(one_way_us - host.one_way_us) < 0;
  if (host.arrivals++ == 0 || shorter) host.one_way_us = one_way_us;
  track_gaps(stream, chunk, now_ns);
  measure_rate(chunk.payload_bytes(), now_ns);
  on_echo(object, stream, chunk, now_ns);
  std::vector<Message> messages;
  for (const BulkPiece& piece : chunk.pieces) {
    object.received_changed = true;
    if (auto message = assemble(object, stream.object_id, chunk, piece, now_ns))
      messages.push_back(std::move(*message));
  }
  return messages;
}

/// Begins, fills and forgets gaps after the arrival of a chunk.
void DeliveryClient::track_gaps(Stream& stream, const BulkChunk& chunk, std::int64_t now_ns) const {
  const std::uint32_t sequence = chunk.sequence;
  if (sequence > stream.newest) {
    if (sequence != stream.newest + 1) stream.gaps[stream.newest + 1] = {sequence - 1, now_ns, 0};
    stream.newest = sequence;
  } else if (auto after = stream.gaps.upper_bound(sequence); after != stream.gaps.begin()) {
    const auto at = std::prev(after);
    const Stream::Gap gap = at->second;
    if (sequence <= gap.last) {
      if (sequence < gap.last) stream.gaps.emplace(sequence + 1, gap);
      if (at->first < sequence) {
        at->second.last = sequence - 1;
      } else {
        stream.gaps.erase(at);
      }
    }
  }
  for (auto at = stream.gaps.begin(); at != stream.gaps.end();) {
    const bool closed = at->second.reported_epoch != 0 && at->second.reported_epoch <= chunk.epoch;
    if (!closed && stream.gaps.size() <= kMaxStreamGaps) {
      ++at;
    } else {
      at = stream.gaps.erase(at);
    }
  }
}

/// Whether a gap is older than reordering explains, and no demand has reported it yet.
bool DeliveryClient::has_gap_to_report(const Stream& stream, std::int64_t now_ns) const {
  return std::any_of(stream.gaps.begin(), stream.gaps.end(), [&](const auto& gap) {
    return gap.second.reported_epoch == 0 && now_ns - gap.second.detected_ns >= settings_.overtaking_ns;
  });
}

/// Fills Demand::gaps and Demand::newest, up to the first gap that overtaken chunks may still fill.
void DeliveryClient::report_gaps(Object& object, Stream& stream, Demand& demand, std::int64_t now_ns) {
  demand.newest = stream.newest;
  for (auto& [first, gap] : stream.gaps) {
    const bool may_be_filled = gap.reported_epoch == 0 && now_ns - gap.detected_ns < settings_.overtaking_ns;
    if (may_be_filled || demand.gaps.size() == kMaxGaps) {
      demand.newest = first - 1;
      return;
    }
    if (gap.reported_epoch == 0) {
      gap.reported_epoch = object.epoch;
      counters_.lost += gap.last - first + 1;
    }
    demand.gaps.push_back({first, gap.last - first + 1});
  }
}

/// Returns the largest sequence number up to which no chunk of the stream is missing and the caller has answered all
/// messages. With `or_postponed`, messages with a postponed answer count as answered.
std::uint32_t DeliveryClient::processed_up_to(const Object& object, const Stream& stream, bool or_postponed) const {
  std::uint32_t received = stream.received();
  for (const auto& [region, pending] : object.pending) {
    if (or_postponed && pending.postponed) continue;
    if (pending.stream == stream.id) received = std::min(received, pending.last_sequence - 1);
  }
  return received;
}

/// Measures the round trip, and records for which retired regions the serving host has echoed the retirement.
void DeliveryClient::on_echo(Object& object, const Stream& stream, const BulkChunk& chunk, std::int64_t now_ns) {
  if (stream.host != object.host) return;
  object.answered_ns = now_ns;
  if (object.measured_from_ns != 0 && chunk.epoch >= object.measured_epoch) {
    constexpr std::int64_t kSmoothing = 8;
    const std::int64_t round_trip_ns = now_ns - object.measured_from_ns;
    round_trip_ns_ += round_trip_ns_ == 0 ? round_trip_ns : (round_trip_ns - round_trip_ns_) / kSmoothing;
    object.measured_from_ns = 0;
  }
  for (auto& [region, retiring] : object.retiring) {
    if (retiring.echo_sequence == 0 && chunk.epoch >= retiring.epoch) retiring.echo_sequence = chunk.sequence;
  }
}

/// Adds a piece to its message. Returns the message if the piece completes it.
std::optional<DeliveryClient::Message> DeliveryClient::assemble(Object& object, std::uint64_t object_id,
                                                                const BulkChunk& chunk, const BulkPiece& piece,
                                                                std::int64_t now_ns) {
  const bool is_held = chunk.kind() == BulkKind::kBase
                           ? object.has_base
                           : object.have.count(piece.region) != 0 || object.retiring.count(piece.region) != 0 ||
                                 object.pages.count(piece.region) != 0;
  if (is_held || object.pending.count(piece.region) != 0) {
    ++counters_.stale;
    return std::nullopt;
  }
  auto at = object.partials.find(piece.region);
  // A host that cancels a message and plans it again cuts it to fit another chunk, so its first piece has another size.
  const auto is_cut_again = [&] {
    const auto first = at->second.payloads.find(0);
    return piece.index == 0 && first != at->second.payloads.end() && first->second.size() != piece.payload.size();
  };
  const auto is_other_message = [&] {
    return at->second.checksum != piece.checksum || at->second.piece_count != piece.count || is_cut_again();
  };
  if (at != object.partials.end() && is_other_message()) {
    const auto age = std::make_pair(at->second.epoch, at->second.last_sequence);
    if (std::make_pair(chunk.epoch, chunk.sequence) < age) {
      ++counters_.stale;
      return std::nullopt;
    }
    drop_partial(object, object_id, at);
    at = object.partials.end();
  }
  if (at == object.partials.end()) {
    at = object.partials.try_emplace(piece.region).first;
    at->second.checksum = piece.checksum;
    at->second.piece_count = piece.count;
  }
  Partial& partial = at->second;
  partial.epoch = std::max(partial.epoch, chunk.epoch);
  if (partial.stream != chunk.stream) partial.last_sequence = 0;
  partial.stream = chunk.stream;
  partial.last_sequence = std::max(partial.last_sequence, chunk.sequence);
  partials_by_age_.erase({partial.received_ns, object_id, piece.region});
  partials_by_age_.insert({now_ns, object_id, piece.region});
  partial.received_ns = now_ns;
  if (partial.payloads.emplace(piece.index, piece.payload).second) {
    partial.bytes += piece.payload.size() + kPayloadOverhead;
    partial_bytes_ += piece.payload.size() + kPayloadOverhead;
  }
  if (partial.payloads.size() < partial.piece_count) {
    limit_partials(now_ns);
    return std::nullopt;
  }
  return complete(object, object_id, chunk.kind(), at);
}

/// Joins the pieces of a complete message and removes them. Returns none if the message is stale or corrupt.
std::optional<DeliveryClient::Message> DeliveryClient::complete(Object& object, std::uint64_t object_id, BulkKind kind,
                                                                std::map<std::uint32_t, Partial>::iterator at) {
  const Partial& partial = at->second;
  if (partial.epoch < object.released_epoch) {
    drop_partial(object, object_id, at);
    ++counters_.stale;
    return std::nullopt;
  }
  Message message{object_id, kind, at->first, partial.epoch, {}};
  message.bytes.reserve(partial.bytes);
  for (const auto& [index, payload] : partial.payloads) {
    message.bytes.insert(message.bytes.end(), payload.begin(), payload.end());
  }
  const Pending pending{partial.stream, partial.epoch, partial.last_sequence, false};
  const std::uint32_t checksum = partial.checksum;
  drop_partial(object, object_id, at);
  if (checksum_of(message.bytes) != checksum) {
    ++counters_.corrupt;
    return std::nullopt;
  }
  object.pending.emplace(message.region, pending);
  ++counters_.messages;
  return message;
}

void DeliveryClient::drop_partial(Object& object, std::uint64_t object_id,
                                  std::map<std::uint32_t, Partial>::iterator at) {
  partial_bytes_ -= at->second.bytes;
  partials_by_age_.erase({at->second.received_ns, object_id, at->first});
  object.partials.erase(at);
}

/// Drops incomplete messages without a new piece for `partial_timeout_ns`. Then drops those without a new piece for
/// longest, until the others fit into `max_partials` and `max_partial_bytes`.
void DeliveryClient::limit_partials(std::int64_t now_ns) {
  while (!partials_by_age_.empty()) {
    const auto [received_ns, object_id, region] = *partials_by_age_.begin();
    const bool expired = now_ns - received_ns >= settings_.partial_timeout_ns;
    const bool fit = partials_by_age_.size() <= settings_.max_partials && partial_bytes_ <= settings_.max_partial_bytes;
    if (!expired && fit) return;
    Object& object = objects_.at(object_id);
    drop_partial(object, object_id, object.partials.find(region));
  }
}

void DeliveryClient::limit_credit(std::uint64_t bytes) {
  credit_limit_ = bytes;
  // A host may be waiting for credit, so a demand is due when the credit can grow by several chunks.
  constexpr std::uint64_t kMinIncrease = 8 * kMaxPayload;
  if (published_credit_limit_ >= settings_.credit || credit_limit_ < published_credit_limit_ + kMinIncrease) return;
  for (auto& [object_id, object] : objects_) object.received_changed = object.received_changed || is_answer_due(object);
}

std::uint64_t DeliveryClient::granted_credit(std::int64_t now_ns) {
  const std::int64_t received_before_ns = now_ns - round_trip_ns_ - 2 * settings_.demand_interval_ns;
  while (published_.size() > 1 && published_[1].at_ns <= received_before_ns) published_.pop_front();
  return published_.empty() ? 0 : published_.front().credit;
}

/// Measures the arrival rate in windows of time. `rate_` is the largest rate, and decays slowly, because a host that
/// has little to send does not fill the link.
void DeliveryClient::measure_rate(std::size_t bytes, std::int64_t now_ns) {
  constexpr std::int64_t kMinWindow = 20'000'000;
  constexpr double kDecay = 0.95;
  window_.bytes += bytes;
  const std::int64_t duration_ns = now_ns - window_.begun_ns;
  if (duration_ns < std::max(kMinWindow, round_trip_ns_)) return;
  const double rate = static_cast<double>(window_.bytes) * kNsPerS / static_cast<double>(duration_ns);
  rate_ = std::max(rate, kDecay * rate_);
  window_ = {now_ns, 0};
}

/// 1.25 times the rate times the sum of round trip and demand interval, within the limits: large enough to discover a
/// faster link, too small to build a long queue.
std::uint32_t DeliveryClient::credit() const {
  constexpr double kMargin = 1.25;
  const double turnaround_s = static_cast<double>(round_trip_ns_ + settings_.demand_interval_ns) / kNsPerS;
  const double credit = std::clamp(kMargin * rate_ * turnaround_s, static_cast<double>(settings_.credit),
                                   static_cast<double>(std::max(settings_.credit, settings_.max_credit)));
  return static_cast<std::uint32_t>(std::min(credit, static_cast<double>(credit_limit_)));
}

void DeliveryClient::answer_base_stored(std::uint64_t object_id) {
  Object& object = objects_.at(object_id);
  object.pending.erase(spm::kNone);
  object.has_base = true;
  begin_epoch(object);
}

void DeliveryClient::answer_base_refused(std::uint64_t object_id) { answer_refused(object_id, spm::kNone); }

void DeliveryClient::answer_stored(std::uint64_t object_id, std::uint32_t region) {
  Object& object = objects_.at(object_id);
  object.pending.erase(region);
  object.retiring.erase(region);
  if (!object.have.insert(region).second) return;
  object.unlisted.insert(region);
  begin_epoch(object);
}

void DeliveryClient::answer_page_stored(std::uint64_t object_id, std::uint32_t number) {
  Object& object = objects_.at(object_id);
  object.pending.erase(number);
  if (object.pages.insert(number).second) begin_epoch(object);
}

void DeliveryClient::forget_page(std::uint64_t object_id, std::uint32_t number) {
  objects_.at(object_id).pages.erase(number);
}

void DeliveryClient::answer_refused(std::uint64_t object_id, std::uint32_t region) {
  Object& object = objects_.at(object_id);
  if (object.pending.erase(region) == 0) return;
  ++counters_.refused;
  object.received_changed = true;
}

void DeliveryClient::postpone_answer(std::uint64_t object_id, std::uint32_t region) {
  objects_.at(object_id).pending.at(region).postponed = true;
}

bool DeliveryClient::retire(std::uint64_t object_id, std::uint32_t region) {
  Object& object = objects_.at(object_id);
  if (object.host != 0 && object.unlisted.count(region) != 0) return false;
  if (object.have.erase(region) == 0) return false;
  begin_epoch(object);
  object.retiring[region] = {object.epoch, 0};
  return true;
}

std::vector<std::uint32_t> DeliveryClient::take_released(std::uint64_t object_id) {
  Object& object = objects_.at(object_id);
  std::vector<std::uint32_t> released;
  if (object.retiring.empty()) return released;
  const bool served = object.host != 0;
  const Stream* const stream = find_stream(object.host, object_id);
  const std::uint32_t received = stream != nullptr ? processed_up_to(object, *stream, true) : 0;
  for (auto at = object.retiring.begin(); at != object.retiring.end();) {
    const Retiring& retiring = at->second;
    const bool echo_processed = retiring.echo_sequence != 0 && retiring.echo_sequence <= received;
    const bool relied_on = std::any_of(object.pending.begin(), object.pending.end(), [&](const auto& entry) {
      return !entry.second.postponed && entry.second.epoch < retiring.epoch;
    });
    if ((served && !echo_processed) || relied_on) {
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
  const auto can_serve = [&](const auto& entry) {
    return entry.second.present && entry.second.find_offer(object_id, object.digest) != nullptr &&
           find_stream(entry.first, object_id) != nullptr;
  };
  const auto is_live = [&](const Host& host) { return now_ns - host.heartbeat_ns < settings_.host_late_ns; };
  const auto current = hosts_.find(object.host);
  const bool serving = object.host != 0 && current != hosts_.end() && can_serve(*current);
  if (!is_answer_due(object)) object.answered_ns = now_ns;
  const bool answers = now_ns - object.answered_ns < settings_.no_answer_ns;
  if (serving && is_live(current->second) && answers) return;
  // Begins with the host after the current one. So the client tries all hosts, even if several of them do not answer.
  const auto is_replacement = [&](const auto& entry) {
    return entry.first != object.host && can_serve(entry) && is_live(entry.second);
  };
  auto next = std::find_if(hosts_.upper_bound(object.host), hosts_.end(), is_replacement);
  if (next == hosts_.end()) next = std::find_if(hosts_.begin(), hosts_.end(), is_replacement);
  if (next != hosts_.end()) {
    serve_from(object, next->first, now_ns);
  } else if (!serving && object.host != 0) {
    serve_from(object, 0, now_ns);
  }
}

void DeliveryClient::serve_from(Object& object, std::uint64_t host, std::int64_t now_ns) {
  if (object.host != 0) ++counters_.host_changes;
  object.host = host;
  object.answered_ns = now_ns;
  object.measured_from_ns = 0;
  for (auto& [region, retiring] : object.retiring) retiring.echo_sequence = 0;
  begin_epoch(object);
}

/// Whether the serving host has to send chunks or an echo for the last demand.
bool DeliveryClient::is_answer_due(const Object& object) const {
  if (object.host == 0) return false;
  if (!object.has_base && object.pending.empty()) return true;
  if (!object.retiring.empty()) return true;
  return std::any_of(object.wanted.begin(), object.wanted.end(), [&](const Wanted& wanted) {
    return object.have.count(wanted.region) == 0 && object.pages.count(wanted.region) == 0 &&
           object.pending.count(wanted.region) == 0;
  });
}

/// Returns the time after which a demand is repeated. A missing answer is more often lost than delayed, so the first
/// repetition follows soon. Then the interval doubles up to `repeat_ns`, because the host may have nothing to send.
std::int64_t DeliveryClient::repetition_interval_ns(const Object& object) const {
  constexpr unsigned kMaxDoublings = 8;
  const std::int64_t first = 2 * round_trip_ns_ + settings_.demand_interval_ns;
  return std::min(first << std::min(object.repetitions, kMaxDoublings), settings_.repeat_ns);
}

std::optional<Demand> DeliveryClient::demand(std::int64_t now_ns) {
  limit_partials(now_ns);
  forget_hosts(now_ns);
  for (auto& [object_id, object] : objects_) {
    choose_host(object_id, object, now_ns);
    Stream* const stream = find_stream(object.host, object_id);
    if (stream == nullptr) continue;  // no host serves the object
    if (has_gap_to_report(*stream, now_ns)) {
      begin_epoch(object);
      object.urgent = true;
    }
    const std::int64_t since = now_ns - object.sent_ns;
    const std::int64_t interval = object.urgent ? settings_.urgent_interval_ns : settings_.demand_interval_ns;
    const bool is_changed = (object.changed || object.received_changed) && since >= interval;
    const bool is_repetition =
        is_answer_due(object) && since >= (is_changed ? settings_.repeat_ns : repetition_interval_ns(object));
    if (object.has_been_sent && !is_changed && !is_repetition && since < settings_.keep_alive_ns) continue;
    if (is_repetition) begin_epoch(object);  // a new epoch makes the host answer again
    object.repetitions = is_changed ? 0 : object.repetitions + 1;
    return make_demand(object_id, object, *stream, now_ns);
  }
  return std::nullopt;
}

Demand DeliveryClient::make_demand(std::uint64_t object_id, Object& object, Stream& stream, std::int64_t now_ns) {
  published_credit_limit_ = credit_limit_;
  if (object.changed && object.measured_from_ns == 0) {
    object.measured_epoch = object.epoch;
    object.measured_from_ns = now_ns;
  }
  object.changed = object.received_changed = object.urgent = false;
  object.unlisted.clear();
  object.has_been_sent = true;
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
    } else if (demand.have.size() < kMaxHaveIntervals) {
      demand.have.push_back({region, 1});
    } else {
      break;  // for omitted regions, the host may then send records again
    }
  }
  for (const Wanted& wanted : object.wanted) {
    if (demand.wanted.size() == kMaxWanted) break;
    if (object.have.count(wanted.region) != 0 || object.retiring.count(wanted.region) != 0 ||
        object.pages.count(wanted.region) != 0)
      continue;
    demand.wanted.push_back(wanted);
  }
  demand.stream = stream.id;
  demand.received = processed_up_to(object, stream, false);
  report_gaps(object, stream, demand, now_ns);
  Host& host = hosts_.at(object.host);
  demand.arrivals = std::exchange(host.arrivals, 0);
  demand.one_way_us = host.one_way_us;
  demand.credit = credit();
  while (!published_.empty() && published_.back().credit <= demand.credit) published_.pop_back();
  published_.push_back({now_ns, demand.credit});
  return demand;
}

DeliveryClient::Sizes DeliveryClient::sizes() const noexcept {
  Sizes sizes{hosts_.size(), 0, streams_.size(), objects_.size(), partials_by_age_.size()};
  for (const auto& [id, host] : hosts_) sizes.offers += host.offers.size();
  return sizes;
}

std::uint64_t DeliveryClient::serving_host(std::uint64_t object_id) const {
  const auto object = objects_.find(object_id);
  return object == objects_.end() ? 0 : object->second.host;
}

}  // namespace tactus::session
