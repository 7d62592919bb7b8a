#include "tests/session/simulated_session.hpp"

#include <algorithm>
#include <map>
#include <memory>
#include <random>
#include <set>
#include <variant>

#include "session/delivery_client.hpp"
#include "session/delivery_server.hpp"
#include "session/roster.hpp"
#include "spm/codec/model_codec.hpp"
#include "spm/codec/region_codec.hpp"
#include "tests/support/random_model.hpp"

namespace tactus::test_support {
namespace {

using namespace session;

constexpr std::int64_t kMs = 1'000'000;
constexpr std::uint64_t kSession = 77;
constexpr std::uint64_t kFirstHost = 100, kFirstHrtc = 200, kFirstObject = 300;
constexpr int kHosts = 2, kObjects = 2;
constexpr int kLatencyMs = 2;
constexpr int kChunksPerMs = 12;
constexpr int kQuietMs = 700;        // longer than the keep-alive
constexpr std::uint32_t kReach = 2;  // regions wanted around the one that is touched
constexpr std::uint32_t kKeep = 4;   // farther ones are retired
constexpr std::uint32_t kCredit = 24 * 1024, kMostCredit = 2 * kCredit;

const std::vector<OwnedModel>& models() {
  static const std::vector<OwnedModel> all{random_model(5, 700, 3), random_model(6, 300, 3)};
  return all;
}

const spm::codec::CodedModel& coded(std::uint64_t object) {
  static const std::array<spm::codec::EncodedModel, 2> all{spm::codec::EncodedModel{models()[0].view()},
                                                           spm::codec::EncodedModel{models()[1].view()}};
  return all[object - kFirstObject].coded();
}

std::vector<std::uint32_t> records_of(const std::vector<spm::Run>& runs) {
  std::vector<std::uint32_t> records;
  for (const spm::Run& run : runs) {
    for (std::uint32_t r = run.first; r != run.first + run.count; ++r) records.push_back(r);
  }
  return records;
}

/// The cache of an HRTC for one object, as a set of records counted by the regions that list them.
struct CacheModel {
  std::map<std::uint32_t, std::vector<std::uint32_t>> lists;  // held or retired regions
  std::set<std::uint32_t> retired;
  std::map<std::uint32_t, int> count;    // by record, over all lists
  std::set<std::uint32_t> firm_regions;  // held and never retired: hosts count on them at all times
  std::map<std::uint32_t, int> firm;     // by record, over those

  static void add(std::map<std::uint32_t, int>& counts, const std::vector<std::uint32_t>& records, int by) {
    for (const std::uint32_t r : records) {
      if ((counts[r] += by) == 0) counts.erase(r);
    }
  }
};

struct Answer {  // the decoder's, in time
  std::int64_t due;
  DeliveryClient::Message message;
};

struct Hrtc {
  std::uint64_t id = 0;
  std::uint64_t incarnation = 0;
  std::unique_ptr<DeliveryClient> client;
  std::unique_ptr<Roster> roster;
  std::map<std::uint64_t, CacheModel> caches;
  std::map<std::uint64_t, std::uint32_t> touched;  // region by object
  std::vector<Answer> answers;
  std::uint64_t heartbeat = 0;
  std::int64_t down_until = -1;
};

struct Host {
  std::uint64_t id = 0;
  std::uint64_t incarnation = 0;
  std::unique_ptr<DeliveryServer> server;
  std::unique_ptr<Roster> roster;
  std::uint64_t heartbeat = 0;
  std::int64_t down_until = -1;
};

using Sample = std::variant<RosterEntry, CatalogueEntry, Demand, BulkChunk>;

class Simulation {
 public:
  Simulation(std::uint64_t seed, const Faults& faults, int hrtcs) : random_{seed}, faults_{faults} {
    for (int i = 0; i < kHosts; ++i) {
      hosts_.emplace_back();
      hosts_.back().id = kFirstHost + static_cast<std::uint64_t>(i);
      start(hosts_.back());
    }
    for (int i = 0; i < hrtcs; ++i) {
      hrtcs_.emplace_back();
      hrtcs_.back().id = kFirstHrtc + static_cast<std::uint64_t>(i);
      start(hrtcs_.back());
    }
  }

  SimulationResult run(int wander_ms) {
    for (; now_ms_ < wander_ms && result_.broken.empty(); ++now_ms_) step(true);
    faults_ = Faults{};
    cuts_.clear();
    for (Host& host : hosts_) host.down_until = std::min<std::int64_t>(host.down_until, now_ms_);
    for (Hrtc& hrtc : hrtcs_) hrtc.down_until = std::min<std::int64_t>(hrtc.down_until, now_ms_);
    const int end = now_ms_ + 10'000;
    last_chunk_ms_ = now_ms_;
    for (; now_ms_ < end && result_.broken.empty() && !result_.converged; ++now_ms_) {
      step(false);
      result_.converged = now_ms_ - last_chunk_ms_ >= kQuietMs && all_hold_what_they_want();
    }
    return result_;
  }

 private:
  // ---- chance

  bool chance(double p) { return p > 0 && std::uniform_real_distribution<double>{0, 1}(random_) < p; }
  int below(int n) { return n <= 0 ? 0 : static_cast<int>(random_() % static_cast<std::uint64_t>(n)); }
  [[nodiscard]] std::int64_t now() const { return std::int64_t{now_ms_} * kMs; }
  void broken(std::string what) {
    result_.broken.push_back("at " + std::to_string(now_ms_) + " ms: " + std::move(what));
  }

  // ---- programs

  void start(Host& host) {
    ++host.incarnation;
    const Origin self{kSession, host.id, host.incarnation, 0};
    host.server = std::make_unique<DeliveryServer>(self);
    host.roster = std::make_unique<Roster>(self, RosterSettings{});
    for (std::uint64_t i = 0; i < kObjects; ++i) {
      if (serves(host.id, i)) host.server->add(kFirstObject + i, coded(kFirstObject + i));
    }
  }

  /// Both hosts serve the first object, one of them the second.
  static bool serves(std::uint64_t host, std::uint64_t object) { return object == 0 || host == kFirstHost; }

  void start(Hrtc& hrtc) {
    ++hrtc.incarnation;
    const Origin self{kSession, hrtc.id, hrtc.incarnation, 0};
    DeliverySettings settings;
    settings.credit = kCredit;
    settings.most_credit = kMostCredit;
    settings.max_partial_bytes = 200'000;
    hrtc.client = std::make_unique<DeliveryClient>(self, settings);
    hrtc.roster = std::make_unique<Roster>(self, RosterSettings{});
    hrtc.caches.clear();
    hrtc.answers.clear();
    for (std::uint64_t i = 0; i < kObjects; ++i) {
      hrtc.client->open(kFirstObject + i, models()[i].summary.digest);
      hrtc.touched[kFirstObject + i] = static_cast<std::uint32_t>(below(static_cast<int>(models()[i].summary.regions)));
      wander(hrtc, kFirstObject + i);
    }
  }

  // ---- network

  void send(std::uint64_t from, std::uint64_t to, Sample sample) {
    if (chance(faults_.loss)) return;
    if (auto* chunk = std::get_if<BulkChunk>(&sample);
        chunk != nullptr && !chunk->payload.empty() && chance(faults_.corruption)) {
      chunk->payload[random_() % chunk->payload.size()] ^= static_cast<std::uint8_t>(1 + below(255));
    }
    for (int copies = chance(faults_.duplication) ? 2 : 1; copies > 0; --copies) {
      const int late = chance(faults_.reordering) ? below(faults_.reorder_ms) : 0;
      in_flight_.emplace(now_ms_ + kLatencyMs + late, Packet{from, to, sample});
    }
  }

  void deliver() {
    while (!in_flight_.empty() && in_flight_.begin()->first <= now_ms_) {
      const Packet packet = std::move(in_flight_.extract(in_flight_.begin()).mapped());
      const auto cut = cuts_.find(std::minmax(packet.from, packet.to));
      if (cut != cuts_.end() && now_ms_ < cut->second) continue;
      for (Host& host : hosts_) {
        if (host.id == packet.to && up(host)) take(host, packet.sample);
      }
      for (Hrtc& hrtc : hrtcs_) {
        if (hrtc.id == packet.to && up(hrtc)) take(hrtc, packet.sample);
      }
    }
  }

  template <class Program>
  [[nodiscard]] bool up(const Program& program) const {
    return program.down_until <= now_ms_;
  }

  void take(Host& host, const Sample& sample) {
    if (const auto* entry = std::get_if<RosterEntry>(&sample)) react(host, host.roster->on_entry(*entry, now()));
    if (const auto* demand = std::get_if<Demand>(&sample)) {
      if (host.server->on_demand(*demand) == DeliveryServer::DemandResult::kMalformed) broken("a malformed demand");
    }
  }

  void react(Host& host, const std::vector<RosterEvent>& events) {
    for (const RosterEvent& event : events) {
      if (event.change == RosterChange::kGone) host.server->on_hrtc_gone(event.entry.origin.participant);
    }
  }

  void take(Hrtc& hrtc, const Sample& sample) {
    if (const auto* entry = std::get_if<RosterEntry>(&sample)) {
      (void)hrtc.roster->on_entry(*entry, now());
      hrtc.client->host_seen(entry->origin.participant, entry->origin.incarnation, now());
    }
    if (const auto* offer = std::get_if<CatalogueEntry>(&sample)) hrtc.client->offer(*offer);
    if (const auto* chunk = std::get_if<BulkChunk>(&sample)) {
      if (auto message = hrtc.client->on_chunk(*chunk, now())) {
        const std::int64_t due = std::max<std::int64_t>(now_ms_ + below(faults_.decode_ms),
                                                        hrtc.answers.empty() ? 0 : hrtc.answers.back().due);
        if (message->kind == BulkKind::kRegion && chance(faults_.parking))
          hrtc.client->park(message->object_id, message->region);
        hrtc.answers.push_back({due, std::move(*message)});
      }
      if (hrtc.client->partial_bytes() > 200'000) broken("incomplete messages over their bound");
    }
  }

  // ---- what an HRTC does

  void answer(Hrtc& hrtc) {
    while (!hrtc.answers.empty() && hrtc.answers.front().due <= now_ms_) {
      const DeliveryClient::Message message = std::move(hrtc.answers.front().message);
      hrtc.answers.erase(hrtc.answers.begin());
      const spm::Model model = models()[message.object_id - kFirstObject].view();
      if (message.kind == BulkKind::kBase) {
        const spm::Span<const std::uint8_t> base = coded(message.object_id).spans().base;
        if (!std::equal(base.begin(), base.end(), message.bytes.begin(), message.bytes.end()))
          broken("a base mesh that is not the model's");
        hrtc.client->base_held(message.object_id);
      } else {
        accept(hrtc, message, model);
      }
    }
  }

  void accept(Hrtc& hrtc, const DeliveryClient::Message& message, const spm::Model& model) {
    const spm::codec::CodedModel& whole = coded(message.object_id);
    const auto data = spm::codec::decode_region(message.bytes, model.summary, whole.tables());
    if (!data || message.bytes != spm::codec::encode_region(whole, data->region, data->sent) ||
        spm::index(data->region) != message.region) {
      broken("a region that is not the model's");
      return;
    }
    CacheModel& cache = hrtc.caches[message.object_id];
    if (cache.lists.count(message.region) != 0) broken("a region came that is here");
    const std::vector<std::uint32_t> sent = records_of(data->sent);
    const std::set<std::uint32_t> with_it(sent.begin(), sent.end());
    const std::vector<std::uint32_t> list = records_of(data->list);
    for (const std::uint32_t r : list) {
      if (with_it.count(r) != 0 || cache.count.count(r) != 0) continue;
      ++result_.regions_refused;
      hrtc.client->refused(message.object_id, message.region);
      return;
    }
    for (const std::uint32_t r : sent) result_.records_repeated += cache.firm.count(r);
    CacheModel::add(cache.count, list, 1);
    CacheModel::add(cache.firm, list, 1);
    cache.lists[message.region] = list;
    cache.firm_regions.insert(message.region);
    hrtc.client->held(message.object_id, message.region);
    ++result_.regions_held;
  }

  /// Regions stand on a ring; the touched one and its neighbours are wanted.
  void wander(Hrtc& hrtc, std::uint64_t object) {
    const std::uint32_t regions = models()[object - kFirstObject].summary.regions;
    std::uint32_t& at = hrtc.touched[object];
    const int move = below(40);
    at = move == 0 ? static_cast<std::uint32_t>(below(static_cast<int>(regions)))
                   : (at + regions + (move % 3) - 1) % regions;
    std::vector<Wanted> wanted;
    for (std::uint32_t away = 0; away <= kReach; ++away) {
      wanted.push_back({(at + away) % regions, away * 20'000});
      if (away != 0) wanted.push_back({(at + regions - away) % regions, away * 20'000 + 5'000});
    }
    hrtc.client->want(object, wanted);
    CacheModel& cache = hrtc.caches[object];
    for (const auto& [region, list] : cache.lists) {
      const std::uint32_t ahead = (region + regions - at) % regions;
      const std::uint32_t away = std::min(ahead, regions - ahead);
      const bool retired = cache.retired.count(region) != 0;
      if (away > kKeep && !retired) {
        if (!hrtc.client->retire(object, region)) continue;
        cache.retired.insert(region);
        if (cache.firm_regions.erase(region) != 0) CacheModel::add(cache.firm, list, -1);
      } else if (away <= kReach && retired && below(2) == 0) {
        cache.retired.erase(region);
        hrtc.client->held(object, region);
      }
    }
  }

  void release(Hrtc& hrtc, std::uint64_t object) {
    CacheModel& cache = hrtc.caches[object];
    for (const std::uint32_t region : hrtc.client->take_released(object)) {
      if (cache.retired.erase(region) == 0) {
        broken("a region was released that is not retired");
        continue;
      }
      CacheModel::add(cache.count, cache.lists.at(region), -1);
      cache.lists.erase(region);
      ++result_.regions_released;
    }
  }

  void publish(Hrtc& hrtc) {
    while (const std::optional<Demand> demand = hrtc.client->demand(now())) {
      const CacheModel& cache = hrtc.caches[demand->object_id];
      for (const std::uint32_t region : records_of(demand->have)) {
        if (cache.lists.count(region) == 0 || cache.retired.count(region) != 0) broken("a demand claims too much");
      }
      if (demand->wanted.size() > 2 * kReach + 1) broken("a demand wants too much");
      for (const Host& host : hosts_) send(hrtc.id, host.id, *demand);
    }
  }

  [[nodiscard]] bool all_hold_what_they_want() const {
    return std::all_of(hrtcs_.begin(), hrtcs_.end(), [](const Hrtc& hrtc) {
      for (const auto& [object, at] : hrtc.touched) {
        const std::uint32_t regions = models()[object - kFirstObject].summary.regions;
        const CacheModel& cache = hrtc.caches.at(object);
        if (!cache.retired.empty()) return false;
        for (std::uint32_t i = 0; i <= 2 * kReach; ++i) {
          if (cache.lists.count((at + regions + i - kReach) % regions) == 0) return false;
        }
      }
      return true;
    });
  }

  // ---- one millisecond

  void crash_and_cut() {
    const auto crash = [&](auto& programs, double per_second) {
      for (auto& program : programs) {
        if (!up(program) || !chance(per_second / 1000)) continue;
        program.down_until = now_ms_ + 1 + below(900);
        ++result_.crashes;
        start(program);
      }
    };
    crash(hosts_, faults_.host_crash);
    crash(hrtcs_, faults_.hrtc_crash);
    for (const Host& host : hosts_) {
      for (const Hrtc& hrtc : hrtcs_) {
        if (chance(faults_.partition / 1000)) cuts_[{host.id, hrtc.id}] = now_ms_ + below(1500);
      }
    }
  }

  RosterEntry beat(std::uint64_t id, std::uint64_t incarnation, Role role, std::uint64_t heartbeat) const {
    RosterEntry entry;
    entry.origin = {kSession, id, incarnation, now()};
    entry.role = role;
    entry.name = std::to_string(id);
    entry.heartbeat = heartbeat;
    return entry;
  }

  void step(bool wandering) {
    crash_and_cut();
    deliver();
    for (Host& host : hosts_) {
      if (up(host)) step(host);
    }
    for (Hrtc& hrtc : hrtcs_) {
      if (up(hrtc)) step(hrtc, wandering);
    }
  }

  void step(Host& host) {
    react(host, host.roster->tick(now()));
    if (now_ms_ % 100 == 0) {
      const RosterEntry entry = beat(host.id, host.incarnation, Role::kHost, ++host.heartbeat);
      for (const Hrtc& hrtc : hrtcs_) {
        send(host.id, hrtc.id, entry);
        for (std::uint64_t i = 0; i < kObjects; ++i) {
          if (!serves(host.id, i)) continue;
          CatalogueEntry offer;
          offer.origin = entry.origin;
          offer.object_id = kFirstObject + i;
          offer.summary = models()[i].summary;
          send(host.id, hrtc.id, offer);
        }
      }
    }
    for (int i = 0; i < kChunksPerMs; ++i) {
      std::optional<Outgoing> out = host.server->next(now());
      if (!out) break;
      ++result_.chunks;
      last_chunk_ms_ = now_ms_;
      if (host.server->bytes_under_way(out->hrtc) > kMostCredit) broken("more under way than the credit");
      send(host.id, out->hrtc, std::move(out->chunk));
    }
  }

  void step(Hrtc& hrtc, bool wandering) {
    for (const RosterEvent& event : hrtc.roster->tick(now())) {
      if (event.change == RosterChange::kGone) hrtc.client->host_gone(event.entry.origin.participant);
    }
    answer(hrtc);
    for (std::uint64_t object = kFirstObject; object < kFirstObject + kObjects; ++object) {
      release(hrtc, object);
      if (wandering && now_ms_ % 15 == 0) wander(hrtc, object);
    }
    publish(hrtc);
    if (now_ms_ % 100 == 50) {
      const RosterEntry entry = beat(hrtc.id, hrtc.incarnation, Role::kHrtc, ++hrtc.heartbeat);
      for (const Host& host : hosts_) send(hrtc.id, host.id, entry);
    }
    result_.host_changes = std::max(result_.host_changes, hrtc.client->counters().host_changes);
  }

  struct Packet {
    std::uint64_t from, to;
    Sample sample;
  };

  std::mt19937_64 random_;
  Faults faults_;
  std::vector<Host> hosts_;
  std::vector<Hrtc> hrtcs_;
  std::multimap<int, Packet> in_flight_;                         // by arrival
  std::map<std::pair<std::uint64_t, std::uint64_t>, int> cuts_;  // host, HRTC -> until when
  int now_ms_ = 0;
  int last_chunk_ms_ = 0;
  SimulationResult result_;
};

}  // namespace

Faults random_faults(std::uint64_t seed) {
  std::mt19937_64 random{seed ^ 0x5eedull};
  const auto one_of = [&](std::initializer_list<double> values) {
    return *(values.begin() + random() % values.size());
  };
  Faults f;
  f.loss = one_of({0, 0.01, 0.05, 0.2});
  f.duplication = one_of({0, 0.02, 0.2});
  f.corruption = one_of({0, 0, 0.02});
  f.reordering = one_of({0, 0.05, 0.5});
  f.reorder_ms = static_cast<int>(one_of({5, 30, 300}));
  f.host_crash = one_of({0, 0, 0.5, 1.5});
  f.hrtc_crash = one_of({0, 0, 0.5});
  f.partition = one_of({0, 0, 0.5});
  f.decode_ms = static_cast<int>(one_of({0, 10, 60}));
  f.parking = one_of({0, 0.1});
  return f;
}

SimulationResult simulate(std::uint64_t seed, const Faults& faults, int hrtcs, int wander_ms) {
  return Simulation{seed, faults, hrtcs}.run(wander_ms);
}

}  // namespace tactus::test_support
