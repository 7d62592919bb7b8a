#include "viewer/playback.hpp"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <type_traits>
#include <variant>

#include "session/message_pieces.hpp"
#include "session/units.hpp"
#include "trace/mcap.hpp"
#include "wire/topics.hpp"

namespace tactus::viewer {
namespace {

constexpr std::int64_t kTickNs = 5 * kMs;       // between two ticks of the core
constexpr std::int64_t kSkimTickNs = 50 * kMs;  // while the samples before a step's end are skimmed
constexpr std::int64_t kStatesNs = 2000 * kMs;  // states older than this are not shown
constexpr std::int64_t kSettleNs = 100 * kMs;   // the core reads its meshes every 50 ms
constexpr std::int64_t kMaxLengthNs = 86400 * std::int64_t{1'000'000'000};
constexpr std::uint64_t kMaxTimeNs = std::uint64_t{1} << 62;
constexpr const char* kParticipant = "playback";

/// True for a sample of which only the newest is shown.
bool is_state(const std::string& topic) {
  return topic == wire::topics::kProbeState.name || topic == wire::topics::kShownRegions.name;
}

bool is_bulk(const std::string& topic) {
  return topic == wire::topics::kBase.name || topic == wire::topics::kRecords.name;
}

/// True for a topic whose samples the core processes in the order of their arrival.
bool is_played(const std::string& topic) {
  return is_state(topic) || topic == wire::topics::kRoster.name || topic == wire::topics::kCatalogue.name ||
         topic == wire::topics::kMetrics.name || topic == wire::topics::kObjectPose.name ||
         topic == wire::topics::kStop.name || topic == wire::topics::kReset.name || topic == wire::topics::kEnd.name;
}

/// Joins the pieces of one message.
struct Partial {
  std::uint32_t count = 0, checksum = 0;
  std::map<std::uint32_t, std::vector<std::uint8_t>> pieces;  // by index
};

}  // namespace

Playback::Playback(const std::filesystem::path& file, const spm::PoolSettings& pool, std::uint32_t faces)
    : pool_{pool}, faces_{faces} {
  status_.file = file.filename().string();
  read(file);
  if (session_ == 0)
    throw trace::McapError(file.string() + ": found no roster entry, expected a recording of `tactus record`");
  status_.began = static_cast<double>(begin_ns_) / kNsPerS;
  status_.seconds = static_cast<double>(end_ns_ - begin_ns_) / kNsPerS;
  status_.is_playing = true;
  restart();
}

void Playback::read(const std::filesystem::path& file) {
  trace::McapReader reader{file};
  std::vector<std::pair<std::int64_t, session::BulkChunk>> chunks;
  std::map<std::uint32_t, std::uint64_t> objects;  // by stream_id
  trace::McapMessage message;
  while (reader.next(message)) {
    const bool is_demand = message.topic == wire::topics::kDemand.name;
    if (!is_played(message.topic) && !is_bulk(message.topic) && !is_demand) continue;
    // Full-rate states have the same topic and a later channel. A viewer does not receive them.
    const auto [channel, is_new] = channels_.try_emplace(message.topic, message.channel);
    if (message.channel < channel->second) channel->second = message.channel;
    if (message.channel != channel->second) continue;
    if (message.log_time > kMaxTimeNs)
      throw trace::McapError(file.string() + ": found time " + std::to_string(message.log_time) +
                             " ns, expected at most " + std::to_string(kMaxTimeNs));
    const auto at_ns = static_cast<std::int64_t>(message.log_time);
    const Recorded recorded{at_ns, &channel->first, bytes_.size(), message.bytes.size()};
    bytes_.insert(bytes_.end(), message.bytes.begin(), message.bytes.end());
    const auto forget_bytes = [&] { bytes_.resize(recorded.begin); };
    if (!is_bulk(message.topic) && !is_demand && message.topic != wire::topics::kRoster.name) {
      samples_.push_back(recorded);
      continue;
    }
    const std::optional<wire::AnySample> sample = decode(recorded);
    if (!sample) {
      forget_bytes();
      continue;
    }
    if (const auto* const demand = std::get_if<session::Demand>(&*sample)) {
      objects[demand->stream] = demand->object_id;
      forget_bytes();
    } else if (const auto* const chunk = std::get_if<session::BulkChunk>(&*sample)) {
      if (chunk->kind() != session::BulkKind::kEcho) chunks.emplace_back(at_ns, *chunk);
      forget_bytes();
    } else if (const auto* const entry = std::get_if<session::RosterEntry>(&*sample)) {
      if (session_ == 0) {
        session_ = entry->origin.session;
        session_name_ = entry->session;
      }
      const std::int64_t offset = at_ns - entry->session_time_ns;
      const auto [known, is_first] =
          clock_offsets_.try_emplace({entry->origin.participant, entry->origin.incarnation}, offset);
      known->second = std::min(known->second, offset);
      samples_.push_back(recorded);
    }
  }
  if (samples_.empty()) return;
  std::stable_sort(samples_.begin(), samples_.end(),
                   [](const Recorded& a, const Recorded& b) { return a.at_ns < b.at_ns; });
  if (samples_.back().at_ns - samples_.front().at_ns > kMaxLengthNs)
    throw trace::McapError(file.string() + ": found samples more than a day apart, expected one session");
  begin_ns_ = samples_.front().at_ns;
  end_ns_ = samples_.back().at_ns;
  read_bulk(chunks, objects);
  std::uint64_t bulk_bytes = 0;  // of the regions, each counted once
  for (const auto& [id, delivery] : deliveries_) {
    std::map<std::uint32_t, std::size_t> sizes;
    for (const Message& each : delivery.regions) sizes[each.region] = each.bytes.size();
    for (const auto& [region, bytes] : sizes) bulk_bytes += bytes;
  }
  // A record takes at least one block of 20 bytes; on the wire some have 9. Less than 1/16 free makes the loader evict.
  constexpr double kBlocksPerByte = 0.25;
  pool_.compressed_blocks = static_cast<std::uint32_t>(std::clamp(kBlocksPerByte * static_cast<double>(bulk_bytes),
                                                                  double{1u << 16}, double{spm::kMaxCompressedBlocks}));
}

/// Joins the pieces of each stream to messages. The streams to different HRTCs have different pieces.
void Playback::read_bulk(const std::vector<std::pair<std::int64_t, session::BulkChunk>>& chunks,
                         const std::map<std::uint32_t, std::uint64_t>& objects) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, Partial> partials;  // by stream and region
  for (const auto& [at_ns, chunk] : chunks) {
    const auto object = objects.find(chunk.stream);
    if (object == objects.end()) continue;  // the recording has no demand of its reader
    for (const session::BulkPiece& piece : chunk.pieces) {
      Partial& partial = partials[{chunk.stream, piece.region}];
      if (partial.count != piece.count || partial.checksum != piece.checksum)
        partial = {piece.count, piece.checksum, {}};
      partial.pieces.insert_or_assign(piece.index, piece.payload);
      if (partial.pieces.size() < partial.count) continue;
      Message message{piece.region, {}};
      for (const auto& [index, payload] : partial.pieces)
        message.bytes.insert(message.bytes.end(), payload.begin(), payload.end());
      partials.erase({chunk.stream, piece.region});
      if (session::checksum_of(message.bytes) != piece.checksum) continue;
      Delivery& delivery = deliveries_[object->second];
      (piece.region == spm::kNone ? delivery.bases : delivery.regions).push_back(std::move(message));
    }
  }
}

std::optional<wire::AnySample> Playback::decode(const Recorded& recorded) const {
  return wire::decode(*recorded.topic, {bytes_.data() + recorded.begin, recorded.size});
}

void Playback::restart() {
  const std::uint64_t incarnation = static_cast<std::uint64_t>(begin_ns_);
  now_ns_ = shown_ns_ = begin_ns_ - 1;
  next_ = 0;
  streams_.clear();
  for (auto& [id, delivery] : deliveries_) delivery.sent = 0;
  core_.emplace(session::Origin{session_, session::id_of(kParticipant), incarnation, now_ns_},
                ViewerSettings{.name = kParticipant, .session = session_name_, .pool = pool_, .faces = faces_},
                now_ns_);
  for (const auto& [page, camera] : cameras_) core_->set_camera(page, camera);
  core_->show_meshes_of(shown_hrtc_);
  ++status_.restarts;
}

void Playback::play(bool plays) {
  if (plays == status_.is_playing) return;
  status_.is_playing = plays;
  if (!plays) return settle();
  if (now_ns_ >= end_ns_) seek(0);
}

void Playback::seek(double seconds) {
  const auto after_ns = static_cast<std::int64_t>(std::clamp(seconds, 0.0, status_.seconds) * kNsPerS);
  const std::int64_t to_ns = begin_ns_ + after_ns;
  shown_hrtc_ = core_->shown_hrtc();
  cameras_ = core_->cameras();
  if (to_ns < shown_ns_) restart();
  play_until(to_ns - kStatesNs, kSkimTickNs, to_ns - kStatesNs);
  play_until(to_ns, kTickNs, to_ns - kStatesNs);
  if (!status_.is_playing) settle();
}

/// Lets the shown mesh follow the last samples before a pause.
void Playback::settle() {
  for (const std::int64_t end_ns = now_ns_ + kSettleNs; now_ns_ < end_ns;) {
    now_ns_ += kTickNs;
    tick();
  }
}

void Playback::advance(std::int64_t ns) {
  if (!status_.is_playing) return;
  play_until(std::min(now_ns_ + ns, end_ns_), kTickNs, 0);
  if (now_ns_ >= end_ns_) play(false);
}

/// Plays the samples up to `to_ns`. Skips states before `states_from_ns`.
void Playback::play_until(std::int64_t to_ns, std::int64_t tick_ns, std::int64_t states_from_ns) {
  while (now_ns_ < to_ns) {
    now_ns_ += tick_ns;
    // A step leaps over times without samples.
    if (tick_ns == kSkimTickNs && next_ < samples_.size()) now_ns_ = std::max(now_ns_, samples_[next_].at_ns);
    now_ns_ = std::min(now_ns_, to_ns);
    for (; next_ < samples_.size() && samples_[next_].at_ns <= now_ns_; ++next_) {
      const Recorded& recorded = samples_[next_];
      if (recorded.at_ns < states_from_ns && is_state(*recorded.topic)) continue;
      const std::optional<wire::AnySample> sample = decode(recorded);
      if (!sample) continue;
      const std::int64_t at_ns = recorded.at_ns;
      std::visit(
          [&](const auto& value) {
            using Value = std::decay_t<decltype(value)>;
            if constexpr (std::is_same_v<Value, session::RosterEntry>) core_->on_roster(value, at_ns);
            if constexpr (std::is_same_v<Value, session::CatalogueEntry>) core_->on_catalogue(value);
            if constexpr (std::is_same_v<Value, session::ProbeState>) core_->on_probe_state(value, at_ns);
            if constexpr (std::is_same_v<Value, session::Metrics>) core_->on_metrics(value, at_ns);
            if constexpr (std::is_same_v<Value, session::ShownRegions>) core_->on_shown_regions(value, at_ns);
            if constexpr (std::is_same_v<Value, session::ObjectPose>) core_->on_object_pose(value, at_ns);
            if constexpr (std::is_same_v<Value, session::EmergencyStop>) core_->on_stop(value, at_ns);
            if constexpr (std::is_same_v<Value, session::ForceReset>) core_->on_reset(value, at_ns);
            if constexpr (std::is_same_v<Value, session::SessionEnd>) core_->on_end(value, at_ns);
          },
          *sample);
    }
    tick();
  }
  shown_ns_ = to_ns;
  status_.at = static_cast<double>(std::max<std::int64_t>(to_ns - begin_ns_, 0)) / kNsPerS;
}

void Playback::tick() {
  const ViewerMessages out = core_->tick(now_ns_);
  if (out.clock_request) answer(*out.clock_request);
  for (const session::Demand& demand : out.demands) deliver(demand);
}

/// Answers as the time reference, whose recorded roster entries state session time.
void Playback::answer(const session::ClockSample& request) {
  const session::RosterEntry* const reference = core_->roster().find(request.peer);
  if (reference == nullptr) return;
  const auto offset = clock_offsets_.find({request.peer, reference->origin.incarnation});
  if (offset == clock_offsets_.end()) return;
  session::ClockSample answer = request;
  answer.origin = {session_, request.peer, reference->origin.incarnation, now_ns_};
  answer.peer = session::id_of(kParticipant);
  answer.answer = true;
  answer.t1_ns = answer.t2_ns = now_ns_ - offset->second;
  core_->on_clock(answer, now_ns_);
}

/// Sends the base mesh while the core lacks it, then all regions of the recording.
void Playback::deliver(const session::Demand& demand) {
  const auto at = deliveries_.find(demand.object_id);
  if (at == deliveries_.end() || demand.serving_host == 0) return;
  Delivery& delivery = at->second;
  if (demand.need_base) {
    delivery.sent = 0;
    for (const Message& base : delivery.bases) send(demand, base);
    return;
  }
  const auto objects = core_->loader().objects();
  const bool is_ready =
      std::any_of(objects.begin(), objects.end(), [&](const auto& object) { return object.id == demand.object_id; });
  if (!is_ready) return;
  for (; delivery.sent < delivery.regions.size(); ++delivery.sent) send(demand, delivery.regions[delivery.sent]);
}

void Playback::send(const session::Demand& demand, const Message& message) {
  const auto pieces = session::MessagePieces::cut(static_cast<std::uint32_t>(message.bytes.size()), message.region,
                                                  session::kMaxPayload);
  const std::uint32_t checksum = session::checksum_of(message.bytes);
  for (std::uint32_t i = 0; i < pieces.count; ++i) {
    const auto [from, to] = pieces.range(i);
    session::BulkChunk chunk;
    chunk.stream = demand.stream;
    chunk.sequence = ++streams_[demand.stream].sequence;
    chunk.epoch = demand.epoch;
    chunk.sent_us = static_cast<std::uint32_t>(now_ns_ / 1000);
    chunk.pieces.push_back({message.region,
                            i,
                            pieces.count,
                            checksum,
                            {message.bytes.begin() + static_cast<std::ptrdiff_t>(from),
                             message.bytes.begin() + static_cast<std::ptrdiff_t>(to)}});
    core_->on_chunk(chunk, now_ns_);
  }
}

}  // namespace tactus::viewer
