#include "tests/session/simulated_hrtc.hpp"

#include <algorithm>
#include <array>
#include <utility>

#include "spm/codec/model_codec.hpp"
#include "spm/codec/region_codec.hpp"

namespace tactus::test_support {

using namespace session;

namespace {

constexpr std::int64_t kTickNs = 2 * kMs;
constexpr std::size_t kSlots = 8;  // more than there are users

std::vector<std::uint32_t> records_of(const std::vector<spm::Interval>& intervals) {
  std::vector<std::uint32_t> records;
  for (const spm::Interval& interval : intervals)
    for (std::uint32_t r = interval.first; r != interval.first + interval.count; ++r) records.push_back(r);
  return records;
}

std::uint32_t regions_of(std::uint64_t object) { return model_of(object).summary.regions; }

/// The detector polls up to a tick late, and counts from the poll before the answer.
constexpr std::int64_t kMaxSilenceNs = FailureDetectorSettings{}.max_timeout_ns + 4 * kTickNs;

std::string name_of(std::uint64_t object, std::uint32_t region) {
  return "region " + std::to_string(region) + " of object " + std::to_string(object);
}

struct RegionRecords {
  bool whole = false;  // the bytes equal a host's encoding of the region
  std::vector<std::uint32_t> list, sent;
};

/// Depends on its arguments alone, so results are shared by the schedules of one thread.
const RegionRecords& decoded(std::uint64_t object, std::uint32_t region, const std::vector<std::uint8_t>& bytes) {
  thread_local std::map<std::pair<std::uint64_t, std::vector<std::uint8_t>>, RegionRecords> known;
  constexpr std::size_t kMaxKnown = 20'000;
  if (known.size() == kMaxKnown) known.clear();
  const auto [at, is_new] = known.try_emplace({object << 32 | region, bytes});
  if (!is_new) return at->second;
  const spm::codec::CompressedModel& model = coded_of(object);
  const auto data = spm::codec::decode_region(bytes, model_of(object).summary, model.tables());
  if (data && spm::index(data->region) == region && bytes == spm::codec::encode_region(model, data->region, data->sent))
    at->second = {true, records_of(data->list), records_of(data->sent)};
  return at->second;
}

}  // namespace

const spm::OwnedModel& model_of(std::uint64_t object) {
  static const std::array<spm::OwnedModel, kObjects> all{random_model(5, 120, 3), random_model(6, 60, 3)};
  return all[object - kFirstObject];
}

const spm::codec::CompressedModel& coded_of(std::uint64_t object) {
  static const std::array<spm::codec::EncodedModel, kObjects> all{
      spm::codec::EncodedModel{model_of(kFirstObject).model()},
      spm::codec::EncodedModel{model_of(kFirstObject + 1).model()}};
  return all[object - kFirstObject].compressed();
}

SimulatedHrtc::SimulatedHrtc(World& world, std::uint64_t id, const HrtcFaults& faults)
    : Program{world, id, Role::kHrtc}, faults_{faults} {}

void SimulatedHrtc::begin() {
  DeliverySettings settings;
  settings.credit = kMaxCredit / 2;
  settings.max_credit = kMaxCredit;
  settings.max_partial_bytes = kMaxPartialBytes;
  client_ = std::make_unique<DeliveryClient>(self(), settings);
  failure_detector_ = std::make_unique<FailureDetector>(self(), FailureDetectorSettings{});
  answered_ns_.clear();
  suspects_.clear();
  slots_ = std::make_unique<UserSlots>(kSlots);
  client_of_.clear();
  caches_.clear();
  answers_.clear();
  for (std::uint64_t object = kFirstObject; object < kFirstObject + kObjects; ++object) {
    const spm::ModelSummary& summary = model_of(object).summary;
    Cache& cache = caches_[object];
    cache.count.assign(summary.records, 0);
    cache.firm.assign(summary.records, 0);
    cache.touched = static_cast<std::uint32_t>(world_.below(summary.regions));
    client_->open(object, summary.digest);
    wander(object);
  }
}

void SimulatedHrtc::on_sample(const Sample& sample) {
  if (const auto* entry = std::get_if<RosterEntry>(&sample); entry != nullptr && entry->role == Role::kHost &&
                                                             !entry->leaving &&
                                                             roster().find(entry->origin.participant) != nullptr)
    client_->on_host_heartbeat(entry->origin.participant, entry->origin.incarnation, local_ns());
  if (const auto* liveness = std::get_if<LivenessSample>(&sample)) {
    const std::uint64_t host = liveness->sample.origin.participant, before = failure_detector_->false_suspicions();
    failure_detector_->on_answer(liveness->sample, local_ns());
    figures_.false_suspicions += failure_detector_->false_suspicions() - before;
    if (failure_detector_->watches(host)) answered_ns_[host] = world_.now_ns;
    suspects_.erase(host);
  }
  if (const auto* offer = std::get_if<CatalogueEntry>(&sample)) client_->on_catalogue(*offer);
  if (const auto* chunk = std::get_if<BulkChunk>(&sample)) take_chunk(*chunk);
}

void SimulatedHrtc::react(const RosterEvent& event) {
  const RosterEntry& entry = event.entry;
  const bool gone = event.change == RosterChange::kGone || event.change == RosterChange::kLeft;
  if (entry.role == Role::kHost && gone) client_->on_host_gone(entry.origin.participant);
  const bool news = event.change == RosterChange::kJoined || event.change == RosterChange::kRestarted ||
                    event.change == RosterChange::kChanged;
  if (entry.role != Role::kClient || (!gone && !news)) return;
  const bool chosen = !gone && entry.requested_hrtc == std::to_string(id());
  for (auto at = client_of_.begin(); at != client_of_.end();) {
    const bool stays = chosen && std::find(entry.users.begin(), entry.users.end(), at->first) != entry.users.end();
    if (at->second == entry.origin.participant && !stays) {
      slots_->release(at->first);
      at = client_of_.erase(at);
    } else {
      ++at;
    }
  }
  if (chosen)
    for (const std::string& user : entry.users)
      if (slots_->grant(user)) client_of_[user] = entry.origin.participant;
  publish_entry_at_once();
}

void SimulatedHrtc::describe(RosterEntry& entry) const { entry.slots = slots_->list(); }

/// A postponed message may rely on regions that are released meanwhile; then it comes again with the messages after it.
void SimulatedHrtc::unless_excused(const std::string& what) {
  if (faults_.postponing == 0 && !world_.excused(id()))
    world_.broken(std::to_string(id()) + ": " + what + ", although nothing had been lost");
}

void SimulatedHrtc::run_failure_detector() {
  std::vector<std::uint64_t> hosts;
  for (std::uint64_t object = kFirstObject; object < kFirstObject + kObjects; ++object)
    if (const std::uint64_t host = client_->serving_host(object); host != 0) hosts.push_back(host);
  failure_detector_->watch(hosts);
  for (auto at = answered_ns_.begin(); at != answered_ns_.end();)
    at = failure_detector_->watches(at->first) ? std::next(at) : answered_ns_.erase(at);
  while (const std::optional<ClockSample> request = failure_detector_->next_request(local_ns()))
    send(request->peer, LivenessSample{*request});
  if (world_.sabotage != Sabotage::kTrusting) {
    for (const FailureDetector::Suspect& silent : failure_detector_->take_suspects(local_ns())) {
      suspects_.insert(silent.host);
      client_->suspect_host(silent.host);
      const Program* host = world_.find(silent.host);
      if (host->up()) continue;
      ++figures_.deaths_noticed;
      figures_.noticed_ns = std::max(figures_.noticed_ns, world_.now_ns - host->stopped_ns());
    }
  }
  for (const auto& [host, answered_ns] : answered_ns_)
    if (world_.now_ns - answered_ns > kMaxSilenceNs && suspects_.count(host) == 0)
      world_.broken(std::to_string(id()) + " relies on host " + std::to_string(host) + ", which has not answered for " +
                    std::to_string((world_.now_ns - answered_ns) / kMs) + " ms");
}

void SimulatedHrtc::take_chunk(const BulkChunk& chunk) {
  for (DeliveryClient::Message& message : client_->on_chunk(chunk, local_ns())) {
    if (message.epoch < caches_.at(message.object_id).released_epoch)
      world_.broken(name_of(message.object_id, message.region) + " came under epoch " + std::to_string(message.epoch) +
                    " and may rely on a region released before epoch " +
                    std::to_string(caches_.at(message.object_id).released_epoch));
    const std::int64_t due_ns = world_.now_ns + world_.below(faults_.decode_ns);
    if (message.kind == BulkKind::kRegion && world_.chance(faults_.postponing))
      client_->postpone_answer(message.object_id, message.region);
    answers_.push_back({answers_.empty() ? due_ns : std::max(due_ns, answers_.back().due_ns), std::move(message)});
    answer();
  }
  if (client_->partial_bytes() > kMaxPartialBytes) world_.broken("incomplete messages over their bound");
}

void SimulatedHrtc::answer() {
  while (!answers_.empty() && answers_.front().due_ns <= world_.now_ns) {
    const DeliveryClient::Message message = std::move(answers_.front().message);
    answers_.pop_front();
    if (message.kind == BulkKind::kRegion) {
      accept(message);
      continue;
    }
    const std::span<const std::uint8_t> base = coded_of(message.object_id).spans().base;
    if (!std::equal(base.begin(), base.end(), message.bytes.begin(), message.bytes.end()))
      world_.broken("a base mesh differs from the model's");
    client_->answer_base_stored(message.object_id);
  }
}

/// Accepts a region when each record of its list is held or in the message, as a cache does.
void SimulatedHrtc::accept(const DeliveryClient::Message& message) {
  const auto name = [&] { return name_of(message.object_id, message.region); };
  const RegionRecords& records = decoded(message.object_id, message.region, message.bytes);
  if (!records.whole) return world_.broken(name() + " came and differs from the model's");
  Cache& cache = caches_[message.object_id];
  if (cache.lists.count(message.region) != 0) world_.broken(name() + " came and is held");
  const std::vector<std::uint32_t>&sent = records.sent, &list = records.list;
  for (std::size_t i = 0, s = 0; i < list.size(); ++i) {
    const bool with_it = s < sent.size() && sent[s] == list[i];
    if (with_it) ++s;
    if (with_it || cache.count[list[i]] != 0) continue;
    ++figures_.regions_refused;
    unless_excused(name() + " came without record " + std::to_string(list[i]));
    return client_->answer_refused(message.object_id, message.region);
  }
  const auto repeated = std::count_if(sent.begin(), sent.end(), [&](std::uint32_t r) { return cache.firm[r] != 0; });
  figures_.records_received += sent.size();
  figures_.records_repeated += static_cast<std::uint64_t>(repeated);
  if (repeated != 0)
    unless_excused(name() + " came with " + std::to_string(repeated) + " records that were held all along");
  for (const std::uint32_t r : list) {
    ++cache.count[r];
    ++cache.firm[r];
  }
  cache.lists[message.region] = list;
  cache.firm_regions.insert(message.region);
  client_->answer_stored(message.object_id, message.region);
  ++figures_.regions_held;
}

void SimulatedHrtc::wander(std::uint64_t object) {
  const std::uint32_t regions = regions_of(object);
  std::uint32_t& at = caches_[object].touched;
  const auto move = static_cast<std::uint32_t>(world_.below(40));
  at = move == 0 ? static_cast<std::uint32_t>(world_.below(regions)) : (at + regions + (move % 3) - 1) % regions;
  std::vector<Wanted> wanted;
  for (std::uint32_t away = 0; away <= kReach; ++away) {
    wanted.push_back({(at + away) % regions, away * 20'000});
    if (away != 0) wanted.push_back({(at + regions - away) % regions, away * 20'000 + 5'000});
  }
  client_->set_wanted(object, wanted);
}

void SimulatedHrtc::retire_and_take_back(std::uint64_t object) {
  Cache& cache = caches_[object];
  const std::uint32_t regions = regions_of(object);
  std::vector<std::uint32_t> freed;
  for (const auto& [region, list] : cache.lists) {
    const std::uint32_t ahead = (region + regions - cache.touched) % regions;
    const std::uint32_t away = std::min(ahead, regions - ahead);
    const bool retired = cache.retired.count(region) != 0;
    if (away > kKeep && !retired) {
      if (!client_->retire(object, region)) continue;
      cache.retired[region] = 0;
      if (cache.firm_regions.erase(region) != 0)
        for (const std::uint32_t r : list) --cache.firm[r];
      if (world_.sabotage == Sabotage::kFreeEarly) freed.push_back(region);
    } else if (away <= kReach && retired && world_.below(2) == 0) {
      cache.retired.erase(region);
      client_->answer_stored(object, region);
    }
  }
  for (const std::uint32_t region : freed) free(cache, region);
  if (world_.sabotage == Sabotage::kForget && !cache.lists.empty() && world_.chance(0.1))
    for (const std::uint32_t r : cache.lists.begin()->second) cache.count[r] = 0;
}

void SimulatedHrtc::free(Cache& cache, std::uint32_t region) {
  for (const std::uint32_t r : cache.lists.at(region))
    if (cache.count[r] > 0) --cache.count[r];
  cache.lists.erase(region);
}

void SimulatedHrtc::release(std::uint64_t object) {
  Cache& cache = caches_[object];
  for (const std::uint32_t region : client_->take_released(object)) {
    const auto retired = cache.retired.find(region);
    if (retired == cache.retired.end()) {
      world_.broken(name_of(object, region) + " was released but not retired");
      continue;
    }
    const std::uint32_t epoch = retired->second == 0 ? cache.epoch + 1 : retired->second;
    cache.released_epoch = std::max(cache.released_epoch, epoch);
    cache.retired.erase(retired);
    if (cache.lists.count(region) != 0) free(cache, region);
    ++figures_.regions_released;
  }
}

void SimulatedHrtc::publish() {
  while (std::optional<Demand> demand = client_->demand(local_ns())) {
    Cache& cache = caches_[demand->object_id];
    for (const std::uint32_t region : records_of(demand->have)) {
      const auto list = cache.lists.find(region);
      const auto name = [&] { return name_of(demand->object_id, region); };
      if (list == cache.lists.end() || cache.retired.count(region) != 0) {
        world_.broken("a demand claims " + name());
        continue;
      }
      for (const std::uint32_t r : list->second)
        if (cache.count[r] == 0)
          world_.broken("a demand claims " + name() + ", whose record " + std::to_string(r) + " is not held");
    }
    if (demand->wanted.size() > 2 * kReach + 1) world_.broken("a demand wants too many regions");
    if (demand->credit > kMaxCredit) world_.broken("a demand gives more than the max credit");
    if (demand->epoch < cache.epoch) world_.broken("an epoch steps back");
    cache.epoch = demand->epoch;
    for (auto& [region, epoch] : cache.retired)
      if (epoch == 0) epoch = demand->epoch;
    std::vector<Program*> hosts;
    for (Program* program : world_.programs)
      if (program->role() == Role::kHost) hosts.push_back(program);
    send_all(hosts, std::move(*demand));
  }
}

bool SimulatedHrtc::content_with(std::uint64_t object) const {
  const Cache& cache = caches_.at(object);
  const std::uint32_t regions = regions_of(object);
  if (!cache.retired.empty()) return false;
  for (std::uint32_t i = 0; i <= 2 * kReach; ++i)
    if (cache.lists.count((cache.touched + regions + i - kReach) % regions) == 0) return false;
  return true;
}

std::int64_t SimulatedHrtc::work() {
  answer();
  run_failure_detector();
  const bool moves = world_.wandering && wander_.due(world_.now_ns);
  for (std::uint64_t object = kFirstObject; object < kFirstObject + kObjects; ++object) {
    release(object);
    if (!moves) continue;
    wander(object);
    retire_and_take_back(object);
  }
  publish();
  return kTickNs;
}

}  // namespace tactus::test_support
