#include "tests/session/simulated_hrtc.hpp"

#include <algorithm>
#include <array>
#include <utility>

#include "spm/codec/model_codec.hpp"
#include "spm/codec/page_codec.hpp"
#include "spm/codec/region_codec.hpp"

namespace tactus::test_support {

using namespace session;

namespace {

constexpr std::int64_t kTickNs = 2 * kMs;
constexpr std::size_t kSlots = 8;  // more than there are users

std::vector<std::uint32_t> records_of(const std::vector<spm::Interval>& intervals) {
  std::vector<std::uint32_t> records;
  for (const spm::Interval& interval : intervals)
    for (std::uint32_t record = interval.first; record != interval.first + interval.count; ++record)
      records.push_back(record);
  return records;
}

std::uint32_t regions_of(std::uint64_t object) { return model_of(object).summary.regions; }

/// The failure detector is called up to one tick late. It measures silence from the call before the last answer.
constexpr std::int64_t kMaxSilenceNs = FailureDetectorSettings{}.max_timeout_ns + 4 * kTickNs;

std::string region_text(std::uint64_t object, std::uint32_t region) {
  return "region " + std::to_string(region) + " of object " + std::to_string(object);
}
std::string page_text(std::uint64_t object, std::uint32_t number) {
  return "page " + std::to_string(number - kFirstPage) + " of object " + std::to_string(object);
}
std::string part_text(std::uint64_t object, std::uint32_t number) {
  return number < kFirstPage ? region_text(object, number) : page_text(object, number);
}

/// The number of a page that an HRTC wants while a region is touched: `which` is 0 to kWantedPages - 1.
std::uint32_t wanted_page(std::uint64_t object, std::uint32_t touched, std::uint32_t which) {
  return kFirstPage + (touched * kSimulatedPages / regions_of(object) + which) % kSimulatedPages;
}

struct RegionRecords {
  bool correct = false;  // the bytes equal a host's encoding of the region
  std::vector<std::uint32_t> closed_list, sent;
};

/// Decodes a region. The result depends only on the arguments, so all simulations in a thread share the results.
const RegionRecords& decoded(std::uint64_t object, std::uint32_t region, const std::vector<std::uint8_t>& bytes) {
  thread_local std::map<std::pair<std::uint64_t, std::vector<std::uint8_t>>, RegionRecords> results;
  constexpr std::size_t kMaxResults = 20'000;
  if (results.size() == kMaxResults) results.clear();
  const auto [result, is_new] = results.try_emplace({object << 32 | region, bytes});
  if (!is_new) return result->second;
  const spm::codec::CompressedModel& model = compressed_of(object);
  const auto data = spm::codec::decode_region(bytes, model_of(object).summary, model.tables());
  if (data && spm::index(data->region) == region &&
      bytes == *spm::codec::encode_region(model, data->region, data->sent))
    result->second = {true, records_of(data->list), records_of(data->sent)};
  return result->second;
}

}  // namespace

const spm::OwnedModel& model_of(std::uint64_t object) {
  static const std::array<spm::OwnedModel, kObjects> all{random_model(5, 120, 3), random_model(6, 60, 3)};
  return all[object - kFirstObject];
}

const spm::codec::CompressedModel& compressed_of(std::uint64_t object) {
  static const std::array<spm::codec::EncodedModel, kObjects> all{
      spm::codec::EncodedModel{model_of(kFirstObject).model()},
      spm::codec::EncodedModel{model_of(kFirstObject + 1).model()}};
  return all[object - kFirstObject].compressed();
}

SimulatedHrtc::SimulatedHrtc(World& world, std::uint64_t id, const HrtcFaults& faults)
    : Program{world, id, Role::kHrtc}, faults_{faults} {}

void SimulatedHrtc::on_start() {
  DeliverySettings settings;
  settings.credit = kSimulatedMaxCredit / 2;
  settings.max_credit = kSimulatedMaxCredit;
  settings.max_partial_bytes = kMaxPartialBytes;
  client_ = std::make_unique<DeliveryClient>(self(), settings);
  failure_detector_ = std::make_unique<FailureDetector>(self(), FailureDetectorSettings{});
  last_answer_ns_.clear();
  suspects_.clear();
  user_table_ = std::make_unique<UserTable>(kSlots);
  client_of_.clear();
  caches_.clear();
  decodings_.clear();
  for (std::uint64_t object = kFirstObject; object < kFirstObject + kObjects; ++object) {
    const spm::ModelSummary& summary = model_of(object).summary;
    Cache& cache = caches_[object];
    cache.regions_with.assign(summary.records, 0);
    cache.never_retired_with.assign(summary.records, 0);
    cache.touched = static_cast<std::uint32_t>(world_.random_below(summary.regions));
    client_->open(object, summary.digest);
    move_user(object);
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
    if (failure_detector_->watches(host)) last_answer_ns_[host] = world_.now_ns;
    suspects_.erase(host);
  }
  if (const auto* offer = std::get_if<CatalogueEntry>(&sample)) client_->on_catalogue(*offer);
  if (const auto* chunk = std::get_if<BulkChunk>(&sample)) take_chunk(*chunk);
}

void SimulatedHrtc::on_roster_event(const RosterEvent& event) {
  const RosterEntry& entry = event.entry;
  const bool gone = event.change == RosterChange::kGone || event.change == RosterChange::kLeft;
  if (entry.role == Role::kHost && gone) client_->on_host_gone(entry.origin.participant);
  const bool updated = event.change == RosterChange::kJoined || event.change == RosterChange::kRestarted ||
                       event.change == RosterChange::kChanged;
  if (entry.role != Role::kClient || (!gone && !updated)) return;
  const bool requests_this_hrtc = !gone && entry.requested_hrtc == std::to_string(id());
  for (auto user = client_of_.begin(); user != client_of_.end();) {
    const bool remains =
        requests_this_hrtc && std::find(entry.users.begin(), entry.users.end(), user->first) != entry.users.end();
    if (user->second == entry.origin.participant && !remains) {
      user_table_->release(user->first);
      user = client_of_.erase(user);
    } else {
      ++user;
    }
  }
  if (requests_this_hrtc)
    for (const std::string& name : entry.users)
      if (user_table_->grant(name)) client_of_[name] = entry.origin.participant;
  publish_entry_at_once();
}

void SimulatedHrtc::complete_entry(RosterEntry& entry) const { entry.served_users = user_table_->list(); }

/// Reports a violation unless a recent fault or postponed answers explain it. The regions on which a postponed message
/// relies may be released before its answer. Then the host sends this message and later messages again.
void SimulatedHrtc::report_unless_explained(const std::string& description) {
  if (faults_.postponing == 0 && !world_.has_recent_fault(id()))
    world_.report_violation(std::to_string(id()) + ": " + description + ", although nothing was lost");
}

void SimulatedHrtc::run_failure_detector() {
  std::vector<std::uint64_t> hosts;
  for (std::uint64_t object = kFirstObject; object < kFirstObject + kObjects; ++object)
    if (const std::uint64_t host = client_->serving_host(object); host != 0) hosts.push_back(host);
  failure_detector_->watch(hosts);
  for (auto answer = last_answer_ns_.begin(); answer != last_answer_ns_.end();)
    answer = failure_detector_->watches(answer->first) ? std::next(answer) : last_answer_ns_.erase(answer);
  while (const std::optional<ClockSample> request = failure_detector_->next_request(local_ns()))
    send(request->peer, LivenessSample{*request});
  if (world_.bug != InjectedBug::kIgnoresFailureDetector) {
    for (const FailureDetector::Suspect& silent : failure_detector_->take_suspects(local_ns())) {
      suspects_.insert(silent.host);
      client_->suspect_host(silent.host);
      const Program* host = world_.find(silent.host);
      if (host->is_running()) continue;
      ++figures_.failures_detected;
      figures_.max_detection_ns = std::max(figures_.max_detection_ns, world_.now_ns - host->stopped_ns());
    }
  }
  for (const auto& [host, answer_ns] : last_answer_ns_)
    if (world_.now_ns - answer_ns > kMaxSilenceNs && suspects_.count(host) == 0)
      world_.report_violation(std::to_string(id()) + " relies on host " + std::to_string(host) +
                              ", which has not answered for " + std::to_string((world_.now_ns - answer_ns) / kMs) +
                              " ms");
}

void SimulatedHrtc::take_chunk(const BulkChunk& chunk) {
  for (DeliveryClient::Message& message : client_->on_chunk(chunk, local_ns())) {
    const std::uint32_t released_epoch = caches_.at(message.object_id).released_epoch;
    if (message.epoch < released_epoch)
      world_.report_violation(part_text(message.object_id, message.region) + " was received under epoch " +
                              std::to_string(message.epoch) + " and may rely on a region released before epoch " +
                              std::to_string(released_epoch));
    const std::int64_t decoded_ns = world_.now_ns + world_.random_below(faults_.decode_ns);
    if (message.region < kFirstPage && world_.chance(faults_.postponing))
      client_->postpone_answer(message.object_id, message.region);
    const std::int64_t end_ns = decodings_.empty() ? decoded_ns : std::max(decoded_ns, decodings_.back().end_ns);
    decodings_.push_back({end_ns, std::move(message)});
    answer_decoded();
  }
  if (client_->partial_bytes() > kMaxPartialBytes)
    world_.report_violation("incomplete messages exceed their max bytes");
}

void SimulatedHrtc::answer_decoded() {
  while (!decodings_.empty() && decodings_.front().end_ns <= world_.now_ns) {
    const DeliveryClient::Message message = std::move(decodings_.front().message);
    decodings_.pop_front();
    if (message.kind == BulkKind::kRegion) {
      message.region < kFirstPage ? answer_region(message) : answer_page(message);
      continue;
    }
    const std::span<const std::uint8_t> base = compressed_of(message.object_id).spans().base;
    if (!std::equal(base.begin(), base.end(), message.bytes.begin(), message.bytes.end()))
      world_.report_violation("a base mesh differs from the base mesh of the model");
    client_->answer_base_stored(message.object_id);
  }
}

/// Holds the region if each record of its closed list is held or in the message, and refuses it otherwise.
void SimulatedHrtc::answer_region(const DeliveryClient::Message& message) {
  const auto region = [&] { return region_text(message.object_id, message.region); };
  const RegionRecords& records = decoded(message.object_id, message.region, message.bytes);
  if (!records.correct) return world_.report_violation(region() + " was received and differs from the model");
  Cache& cache = caches_[message.object_id];
  if (cache.closed_lists.count(message.region) != 0)
    world_.report_violation(region() + " was received although it is held");
  const std::vector<std::uint32_t>&sent = records.sent, &closed_list = records.closed_list;
  auto next_sent = sent.begin();
  for (const std::uint32_t record : closed_list) {
    const bool is_sent = next_sent != sent.end() && *next_sent == record;
    if (is_sent) ++next_sent;
    if (is_sent || cache.regions_with[record] != 0) continue;
    ++figures_.regions_refused;
    report_unless_explained(region() + " was received without record " + std::to_string(record));
    return client_->answer_refused(message.object_id, message.region);
  }
  const auto repeated = std::count_if(sent.begin(), sent.end(),
                                      [&](std::uint32_t record) { return cache.never_retired_with[record] != 0; });
  figures_.records_received += sent.size();
  figures_.records_repeated += static_cast<std::uint64_t>(repeated);
  if (repeated != 0)
    report_unless_explained(region() + " was received with " + std::to_string(repeated) +
                            " records of regions that were never retired");
  for (const std::uint32_t record : closed_list) {
    ++cache.regions_with[record];
    ++cache.never_retired_with[record];
  }
  cache.closed_lists[message.region] = closed_list;
  cache.never_retired.insert(message.region);
  client_->answer_stored(message.object_id, message.region);
  ++figures_.regions_held;
}

/// Stores the page, or refuses it: the memory for directories may be full.
void SimulatedHrtc::answer_page(const DeliveryClient::Message& message) {
  const spm::PageId page{message.region - kFirstPage};
  const auto violation = [&](const char* what) {
    world_.report_violation(page_text(message.object_id, message.region) + " was received " + what);
  };
  if (message.bytes != spm::codec::encode_page(spm::page_with_id(model_of(message.object_id).regions, page)))
    return violation("and differs from the model");
  constexpr double kFull = 0.05;
  if (world_.chance(kFull)) {
    ++figures_.pages_refused;
    return client_->answer_refused(message.object_id, message.region);
  }
  if (!caches_[message.object_id].pages.insert(message.region).second) return violation("although it is held");
  client_->answer_page_stored(message.object_id, message.region);
  ++figures_.pages_held;
}

/// Drops each unwanted page with probability 0.2, and each wanted one with 0.02; the HRTC requests the latter again.
void SimulatedHrtc::forget_pages(std::uint64_t object) {
  Cache& cache = caches_[object];
  for (auto page = cache.pages.begin(); page != cache.pages.end();) {
    bool is_wanted = false;
    for (std::uint32_t which = 0; which < kWantedPages; ++which)
      is_wanted = is_wanted || *page == wanted_page(object, cache.touched, which);
    if (!world_.chance(is_wanted ? 0.02 : 0.2)) {
      ++page;
      continue;
    }
    if (world_.bug != InjectedBug::kForgetsPagesSilently) client_->forget_page(object, *page);
    page = cache.pages.erase(page);
    ++figures_.pages_forgotten;
  }
}

void SimulatedHrtc::move_user(std::uint64_t object) {
  const std::uint32_t regions = regions_of(object);
  std::uint32_t& touched = caches_[object].touched;
  const auto choice = static_cast<std::uint32_t>(world_.random_below(40));
  touched = choice == 0 ? static_cast<std::uint32_t>(world_.random_below(regions))
                        : (touched + regions + (choice % 3) - 1) % regions;
  std::vector<Wanted> wanted;
  for (std::uint32_t distance = 0; distance <= kWantedDistance; ++distance) {
    wanted.push_back({(touched + distance) % regions, distance * 20'000});
    if (distance != 0) wanted.push_back({(touched + regions - distance) % regions, distance * 20'000 + 5'000});
  }
  for (std::uint32_t which = 0; which < kWantedPages; ++which)
    wanted.push_back({wanted_page(object, touched, which), which * 50'000});
  client_->set_wanted(object, wanted);
}

void SimulatedHrtc::retire_and_hold_again(std::uint64_t object) {
  Cache& cache = caches_[object];
  const std::uint32_t regions = regions_of(object);
  std::vector<std::uint32_t> freed;
  for (const auto& [region, closed_list] : cache.closed_lists) {
    const std::uint32_t ahead = (region + regions - cache.touched) % regions;
    const std::uint32_t distance = std::min(ahead, regions - ahead);
    const bool retired = cache.retired_epoch.count(region) != 0;
    if (distance > kRetireDistance && !retired) {
      if (!client_->retire(object, region)) continue;
      cache.retired_epoch[region] = 0;
      if (cache.never_retired.erase(region) != 0)
        for (const std::uint32_t record : closed_list) --cache.never_retired_with[record];
      if (world_.bug == InjectedBug::kFreesRegionsEarly) freed.push_back(region);
    } else if (distance <= kWantedDistance && retired && world_.random_below(2) == 0) {
      cache.retired_epoch.erase(region);
      client_->answer_stored(object, region);
    }
  }
  for (const std::uint32_t region : freed) free(cache, region);
  if (world_.bug == InjectedBug::kLosesRecords && !cache.closed_lists.empty() && world_.chance(0.1))
    for (const std::uint32_t record : cache.closed_lists.begin()->second) cache.regions_with[record] = 0;
}

void SimulatedHrtc::free(Cache& cache, std::uint32_t region) {
  for (const std::uint32_t record : cache.closed_lists.at(region))
    if (cache.regions_with[record] > 0) --cache.regions_with[record];
  cache.closed_lists.erase(region);
}

void SimulatedHrtc::release(std::uint64_t object) {
  Cache& cache = caches_[object];
  for (const std::uint32_t region : client_->take_released(object)) {
    const auto retired = cache.retired_epoch.find(region);
    if (retired == cache.retired_epoch.end()) {
      world_.report_violation(region_text(object, region) + " was released but not retired");
      continue;
    }
    const std::uint32_t epoch = retired->second == 0 ? cache.epoch + 1 : retired->second;
    cache.released_epoch = std::max(cache.released_epoch, epoch);
    cache.retired_epoch.erase(retired);
    if (cache.closed_lists.count(region) != 0) free(cache, region);
    ++figures_.regions_released;
  }
}

void SimulatedHrtc::check_demand(const Cache& cache, const Demand& demand) {
  for (const std::uint32_t region : records_of(demand.have)) {
    const auto closed_list = cache.closed_lists.find(region);
    const auto claim = [&] { return "a demand lists " + region_text(demand.object_id, region) + " as present"; };
    if (closed_list == cache.closed_lists.end() || cache.retired_epoch.count(region) != 0) {
      world_.report_violation(claim());
      continue;
    }
    for (const std::uint32_t record : closed_list->second)
      if (cache.regions_with[record] == 0)
        world_.report_violation(claim() + ", whose record " + std::to_string(record) + " is not held");
  }
  if (demand.wanted.size() > 2 * kWantedDistance + 1 + kWantedPages)
    world_.report_violation("a demand wants too many regions and pages");
  for (const Wanted& wanted : demand.wanted)
    if (cache.pages.count(wanted.region) != 0)
      world_.report_violation("a demand wants " + page_text(demand.object_id, wanted.region) + ", which is held");
  if (demand.credit > kSimulatedMaxCredit) world_.report_violation("a demand gives more than the max credit");
  if (demand.epoch < cache.epoch) world_.report_violation("an epoch is smaller than the previous epoch");
}

void SimulatedHrtc::publish_demands() {
  while (std::optional<Demand> demand = client_->demand(local_ns())) {
    Cache& cache = caches_[demand->object_id];
    check_demand(cache, *demand);
    cache.epoch = demand->epoch;
    for (auto& [region, epoch] : cache.retired_epoch)
      if (epoch == 0) epoch = demand->epoch;
    std::vector<Program*> hosts;
    for (Program* program : world_.programs)
      if (program->role() == Role::kHost) hosts.push_back(program);
    send_all(hosts, std::move(*demand));
  }
}

bool SimulatedHrtc::holds_wanted_parts(std::uint64_t object) const {
  const Cache& cache = caches_.at(object);
  const std::uint32_t regions = regions_of(object);
  if (!cache.retired_epoch.empty()) return false;
  for (std::uint32_t which = 0; which < kWantedPages; ++which)
    if (cache.pages.count(wanted_page(object, cache.touched, which)) == 0) return false;
  for (std::uint32_t offset = 0; offset <= 2 * kWantedDistance; ++offset)
    if (cache.closed_lists.count((cache.touched + regions + offset - kWantedDistance) % regions) == 0) return false;
  return true;
}

std::int64_t SimulatedHrtc::work() {
  answer_decoded();
  run_failure_detector();
  const bool moves = world_.users_move && move_timer_.due(world_.now_ns);
  for (std::uint64_t object = kFirstObject; object < kFirstObject + kObjects; ++object) {
    release(object);
    if (!moves) continue;
    move_user(object);
    retire_and_hold_again(object);
    forget_pages(object);
  }
  publish_demands();
  return kTickNs;
}

}  // namespace tactus::test_support
