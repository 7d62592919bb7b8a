#include "tests/session/simulated_session.hpp"

#include <algorithm>
#include <cstdio>
#include <memory>
#include <numeric>
#include <set>
#include <utility>

#include "session/delivery_server.hpp"

namespace tactus::test_support {

using namespace session;

namespace {

constexpr std::size_t kHosts = 2, kHrtcs = 3, kClients = 2, kPrograms = kHosts + kHrtcs + kClients;
constexpr std::uint64_t kFirstHost = 100, kFirstHrtc = 200, kFirstClient = 400;
constexpr int kChunksPerMs = 12;
/// After recovery a host may have missed the last demand, and still repair cancelled regions until it is repeated.
constexpr std::int64_t kOnTheWayNs = DeliverySettings{}.keep_alive_ns + 100 * kMs;
constexpr std::int64_t kSilenceNs = 100 * kMs;  // time in which no payload may be sent after that
constexpr std::int64_t kLookNs = 5 * kMs;       // between checks of recovery

class SimulatedHost : public Program {
 public:
  SimulatedHost(World& world, std::uint64_t id) : Program{world, id, Role::kHost} {}
  [[nodiscard]] std::uint64_t chunks() const noexcept { return chunks_; }

  /// Both hosts serve the first object, one of them the second.
  [[nodiscard]] bool serves(std::uint64_t object) const { return object == kFirstObject || id() == kFirstHost; }

 protected:
  void begin() override {
    server_ = std::make_unique<DeliveryServer>(self());
    for (std::uint64_t object = kFirstObject; object < kFirstObject + kObjects; ++object)
      if (serves(object)) server_->add(object, coded_of(object));
  }
  void on_sample(const Sample& sample) override {
    if (const auto* request = std::get_if<LivenessSample>(&sample); request != nullptr && !request->sample.answer)
      send(request->sample.origin.participant, LivenessSample{clock().answer(request->sample, local_ns(), local_ns())});
    const auto* demand = std::get_if<Demand>(&sample);
    if (demand == nullptr) return;
    if (server_->on_demand(*demand, local_ns()) == DeliveryServer::DemandResult::kMalformed)
      world_.broken("a malformed demand");
    call_at(std::max(world_.now_ns, last_sent_ns_ + kMs));
  }
  void react(const RosterEvent& event) override {
    const bool gone = event.change == RosterChange::kGone || event.change == RosterChange::kLeft;
    if (event.entry.role == Role::kHrtc && gone) server_->on_hrtc_gone(event.entry.origin.participant);
  }
  std::int64_t work() override {
    if (offers_.due(world_.now_ns)) offer();
    for (int i = 0; i < kChunksPerMs; ++i) {
      std::optional<Outgoing> out = server_->next(local_ns());
      if (!out) return 10 * kMs;
      ++chunks_;
      if (!out->chunk.pieces.empty() && world_.find(out->hrtc)->up()) world_.last_payload_ns = world_.now_ns;
      if (server_->bytes_in_flight(out->hrtc) > kMaxCredit) world_.broken("more bytes in flight than the credit");
      if (world_.sabotage == Sabotage::kSendTwice && world_.chance(0.02)) server_->on_hrtc_gone(out->hrtc);
      send(out->hrtc, std::move(out->chunk));
    }
    last_sent_ns_ = world_.now_ns;
    return kMs;
  }

 private:
  void on_catalogue() {
    for (std::uint64_t object = kFirstObject; object < kFirstObject + kObjects; ++object) {
      if (!serves(object)) continue;
      CatalogueEntry offer;
      offer.origin = self();
      offer.object_id = object;
      offer.summary = model_of(object).summary;
      send_all(world_.programs, std::move(offer));
    }
  }

  std::unique_ptr<DeliveryServer> server_;
  session::PeriodicTimer offers_{100 * kMs};
  std::int64_t last_sent_ns_ = 0;
  std::uint64_t chunks_ = 0;
};

class Simulation {
 public:
  Simulation(std::uint64_t seed, const Schedule& schedule, const std::function<void(const std::string&)>& trace)
      : schedule_{schedule}, world_{seed, schedule.delay_ns, schedule.network, schedule.carrier}, trace_{trace} {
    world_.sabotage = schedule.sabotage;
    if (trace_) world_.network.trace = [this](std::int64_t, const std::string& line) { say(line); };
    for (std::uint64_t i = 0; i < kHosts; ++i)
      hosts_.push_back(std::make_unique<SimulatedHost>(world_, kFirstHost + i));
    for (std::uint64_t i = 0; i < kHrtcs; ++i)
      hrtcs_.push_back(std::make_unique<SimulatedHrtc>(world_, kFirstHrtc + i, schedule_.hrtcs));
    for (std::uint64_t i = 0; i < kClients; ++i)
      clients_.push_back(std::make_unique<SimulatedClient>(world_, kFirstClient + i, kFirstHrtc + i));
    for (const auto& host : hosts_) world_.programs.push_back(host.get());
    for (const auto& hrtc : hrtcs_) world_.programs.push_back(hrtc.get());
    for (const auto& client : clients_) world_.programs.push_back(client.get());
    for (Program* program : world_.programs) program->start();
  }

  SimulationResult run() {
    std::stable_sort(schedule_.planned.begin(), schedule_.planned.end(),
                     [](const PlannedFault& a, const PlannedFault& b) { return a.at_ns < b.at_ns; });
    while (world_.now_ns < schedule_.wander_ns && world_.violations.empty()) step(schedule_.wander_ns);
    heal();
    const std::int64_t healed_from_ns = world_.now_ns;
    while (world_.violations.empty()) {
      step(world_.now_ns + kLookNs);
      std::string missing = what_is_wrong();
      if (missing.empty()) break;
      result_.healed_ns = world_.now_ns - healed_from_ns;
      if (result_.healed_ns > kHealNs) world_.broken("not recovered: " + missing);
    }
    const std::int64_t from_ns = world_.now_ns + kOnTheWayNs, end_ns = from_ns + kSilenceNs;
    while (world_.now_ns < end_ns && world_.violations.empty()) {
      step(end_ns);
      if (world_.last_payload_ns > from_ns) world_.broken("records are sent although nothing is wanted");
    }
    return result();
  }

 private:
  void say(const std::string& line) const {
    char at[24];
    std::snprintf(at, sizeof at, "%10.3f ms  ", static_cast<double>(world_.now_ns) * 1e-6);
    trace_(at + line);
  }

  /// Advances to the next event, or to `until_ns`.
  void step(std::int64_t until_ns) {
    std::int64_t next_ns = std::min(until_ns, world_.network.next_ns());
    for (const Program* program : world_.programs) next_ns = std::min(next_ns, program->next_tick_ns());
    for (const auto& [at_ns, who] : returns_) next_ns = std::min(next_ns, at_ns);
    if (planned_done_ < schedule_.planned.size()) next_ns = std::min(next_ns, schedule_.planned[planned_done_].at_ns);
    world_.now_ns = std::max(world_.now_ns, next_ns);
    if (world_.wandering) {
      while (planned_done_ < schedule_.planned.size() && schedule_.planned[planned_done_].at_ns <= world_.now_ns)
        happen(schedule_.planned[planned_done_++]);
    }
    while (!returns_.empty() && returns_.begin()->first <= world_.now_ns) restart(returns_.begin());
    while (world_.network.next_ns() <= world_.now_ns) {
      const std::optional<SimulatedNetwork::Packet> packet = world_.network.take();
      if (!packet) continue;
      Program* to = world_.find(packet->to);
      if (to->up()) to->take(*packet);
    }
    for (Program* program : world_.programs)
      if (program->next_tick_ns() <= world_.now_ns) program->tick();
  }

  void happen(const PlannedFault& fault) {
    for (std::size_t i = 0; i < kPrograms; ++i) {
      if ((fault.programs >> i & 1u) == 0) continue;
      Program& program = *world_.programs[i];
      if (fault.kind == FaultKind::kPartition) {
        cut_off(i, fault);
      } else if (program.up()) {
        if (trace_)
          say(std::to_string(program.id()) + (fault.sends_leave_message ? " ends" : " is killed") +
              (fault.for_good ? " for good" : ""));
        ++result_.faults[static_cast<std::size_t>(fault.kind)];
        world_.last_crash_ns = world_.now_ns;
        program.stop(fault.sends_leave_message);
        if (!fault.for_good) returns_.emplace(std::min(world_.now_ns + fault.lasts_ns, schedule_.wander_ns), &program);
      }
    }
  }

  void cut_off(std::size_t place, const PlannedFault& fault) {
    const std::uint64_t id = world_.programs[place]->id();
    if (trace_)
      say(std::to_string(id) + (fault.one_way ? " cannot send" : " is cut off") + " for " +
          std::to_string(fault.lasts_ns / kMs) + " ms");
    for (std::size_t i = 0; i < kPrograms; ++i) {
      if ((fault.programs >> i & 1u) != 0) continue;
      const std::int64_t until_ns = std::min(world_.now_ns + fault.lasts_ns, schedule_.wander_ns);
      world_.network.cut(id, world_.programs[i]->id(), until_ns);
      if (!fault.one_way) world_.network.cut(world_.programs[i]->id(), id, until_ns);
    }
  }

  void restart(std::multimap<std::int64_t, Program*>::iterator at) {
    if (trace_) say(std::to_string(at->second->id()) + " restarts");
    world_.last_crash_ns = world_.now_ns;
    at->second->start();
    returns_.erase(at);
  }

  void heal() {
    if (trace_) say("no more faults");
    world_.network.heal();
    world_.wandering = false;
    while (!returns_.empty()) restart(returns_.begin());
  }

  [[nodiscard]] bool served(std::uint64_t object) const {
    return std::any_of(hosts_.begin(), hosts_.end(),
                       [object](const auto& host) { return host->up() && host->serves(object); });
  }

  /// Empty when all programs agree and hold what they want.
  [[nodiscard]] std::string what_is_wrong() const {
    for (const auto& hrtc : hrtcs_)
      for (std::uint64_t object = kFirstObject; object < kFirstObject + kObjects; ++object)
        if (hrtc->up() && served(object) && !hrtc->content_with(object))
          return std::to_string(hrtc->id()) + " lacks wanted regions of object " + std::to_string(object);
    for (const Program* program : world_.programs) {
      if (!program->up()) continue;
      const std::string name = std::to_string(program->id());
      if (!sees_all(*program)) return "the roster of " + name;
      const Program* reference_program = world_.find(program->clock().reference());
      if (reference_program == nullptr || !reference_program->up() ||
          reference_program->clock().reference() != reference_program->id())
        return "the time reference of " + name;
      if (!program->clock().synchronised() || program->clock_bound_ns() > kClockNs) return "the clock of " + name;
    }
    return slots_that_are_wrong();
  }

  [[nodiscard]] bool sees_all(const Program& program) const {
    std::size_t known = 0;
    bool right = true;
    program.roster().for_each([&](const RosterEntry& entry) {
      const Program* other = world_.find(entry.origin.participant);
      right = right && other->up() && other->incarnation() == entry.origin.incarnation;
      ++known;
    });
    const auto up =
        std::count_if(world_.programs.begin(), world_.programs.end(), [](const Program* other) { return other->up(); });
    return right && known + 1 == static_cast<std::size_t>(up);
  }

  [[nodiscard]] std::string slots_that_are_wrong() const {
    for (const auto& hrtc : hrtcs_) {
      if (!hrtc->up()) continue;
      std::set<std::string> requested, given;
      for (const auto& client : clients_)
        for (const std::string& user : client->users_at(hrtc->id())) requested.insert(user);
      std::set<std::uint32_t> numbers;
      for (const UserSlot& slot : hrtc->slots()) {
        given.insert(slot.user);
        numbers.insert(slot.slot);
      }
      if (requested != given || numbers.size() != given.size()) return "the users of " + std::to_string(hrtc->id());
      for (const Program* program : world_.programs) {
        if (!program->up() || program == hrtc.get()) continue;
        std::set<std::string> published;
        for (const UserSlot& slot : program->roster().find(hrtc->id())->slots) published.insert(slot.user);
        if (published != given)
          return "the users of " + std::to_string(hrtc->id()) + " as seen by " + std::to_string(program->id());
      }
    }
    return {};
  }

  SimulationResult result() {
    result_.broken = world_.violations;
    result_.messages = world_.network.sent();
    result_.virtual_ns = world_.now_ns;
    for (std::size_t i = 0; i < kFaultKinds; ++i) result_.faults[i] += world_.network.faults_done()[i];
    for (const auto& host : hosts_) result_.chunks += host->chunks();
    for (const auto& hrtc : hrtcs_) {
      const HrtcFigures& figures = hrtc->figures();
      result_.hrtcs.regions_held += figures.regions_held;
      result_.hrtcs.regions_refused += figures.regions_refused;
      result_.hrtcs.regions_released += figures.regions_released;
      result_.hrtcs.records_received += figures.records_received;
      result_.hrtcs.records_repeated += figures.records_repeated;
      result_.hrtcs.deaths_noticed += figures.deaths_noticed;
      result_.hrtcs.noticed_ns = std::max(result_.hrtcs.noticed_ns, figures.noticed_ns);
      result_.hrtcs.false_suspicions += figures.false_suspicions;
      result_.host_changes += hrtc->delivery().counters().host_changes;
    }
    return result_;
  }

  Schedule schedule_;
  World world_;
  std::function<void(const std::string&)> trace_;
  std::vector<std::unique_ptr<SimulatedHost>> hosts_;
  std::vector<std::unique_ptr<SimulatedHrtc>> hrtcs_;
  std::vector<std::unique_ptr<SimulatedClient>> clients_;
  std::size_t planned_done_ = 0;
  std::multimap<std::int64_t, Program*> returns_;  // by when
  SimulationResult result_;
};

}  // namespace

std::string Schedule::text() const {
  char line[400];
  std::snprintf(
      line, sizeof line,
      "%lld ms of wandering; %s carrier, %g ms one way; loss %g %%, duplication %g %%, reordering %g %% by up to "
      "%g ms, corruption %g %%; decoding up to %g ms, postponing %g %%; %zu crashes, restarts and partitions",
      static_cast<long long>(wander_ns / kMs), carrier == SimulatedNetwork::Carrier::kLossy ? "lossy" : "reliable",
      static_cast<double>(delay_ns) * 1e-6, 100 * network.loss, 100 * network.duplication, 100 * network.reordering,
      static_cast<double>(network.reorder_ns) * 1e-6, 100 * network.corruption,
      static_cast<double>(hrtcs.decode_ns) * 1e-6, 100 * hrtcs.postponing, planned.size());
  return line;
}

Schedule random_schedule(std::uint64_t seed) {
  std::mt19937_64 random{seed ^ 0x5eedull};
  const auto below = [&](std::int64_t n) {
    return static_cast<std::int64_t>(random() % static_cast<std::uint64_t>(n));
  };
  const auto one_of = [&](std::initializer_list<double> values) {
    return *(values.begin() + below(static_cast<std::int64_t>(values.size())));
  };
  Schedule schedule;
  schedule.wander_ns = static_cast<std::int64_t>(one_of({600, 600, 800, 1600})) * kMs;
  schedule.delay_ns = static_cast<std::int64_t>(one_of({0.2, 1, 5, 20}) * 1e6);
  if (below(3) == 0) schedule.carrier = SimulatedNetwork::Carrier::kReliable;
  schedule.hrtcs.decode_ns = static_cast<std::int64_t>(one_of({0, 10, 60}) * 1e6);
  schedule.hrtcs.postponing = one_of({0, 0, 0.1});

  std::vector<FaultKind> kinds{FaultKind::kCrash, FaultKind::kRestart, FaultKind::kPartition};
  if (schedule.carrier == SimulatedNetwork::Carrier::kLossy)
    kinds.insert(kinds.end(), {FaultKind::kReordering, FaultKind::kDuplication, FaultKind::kLoss});
  else
    kinds.push_back(FaultKind::kLoss);
  std::shuffle(kinds.begin(), kinds.end(), random);
  std::array<std::uint32_t, kPrograms> places;  // each fails at most once
  std::iota(places.begin(), places.end(), 0u);
  std::shuffle(places.begin(), places.end(), random);
  std::size_t hit = 0;
  kinds.resize(3 + static_cast<std::size_t>(below(static_cast<std::int64_t>(kinds.size()) - 2)));
  for (const FaultKind kind : kinds) {
    if (kind == FaultKind::kLoss) {
      schedule.network.loss = one_of({0.01, 0.05, 0.2});
      if (schedule.carrier == SimulatedNetwork::Carrier::kLossy) schedule.network.corruption = one_of({0, 0, 0.02});
    } else if (kind == FaultKind::kDuplication) {
      schedule.network.duplication = one_of({0.02, 0.2});
    } else if (kind == FaultKind::kReordering) {
      schedule.network.reordering = one_of({0.05, 0.5});
      schedule.network.reorder_ns = static_cast<std::int64_t>(one_of({5, 30, 300}) * 1e6);
    } else {
      for (std::int64_t i = 1 + below(2); i > 0; --i) {
        PlannedFault fault;
        fault.kind = kind;
        fault.at_ns = 100 * kMs + below(schedule.wander_ns - 400 * kMs);
        fault.lasts_ns = (kind == FaultKind::kRestart ? 1 + below(80) : 120 + below(1200)) * kMs;
        fault.one_way = below(3) == 0;
        fault.sends_leave_message = kind == FaultKind::kRestart && below(2) == 0;
        fault.programs = 1u << places[hit++];
        if (kind == FaultKind::kPartition && below(2) == 0) fault.programs |= 1u << below(kPrograms);
        fault.for_good = kind == FaultKind::kCrash && below(4) == 0;
        schedule.planned.push_back(fault);
      }
    }
  }
  return schedule;
}

std::size_t SimulationResult::kinds() const {
  return static_cast<std::size_t>(
      std::count_if(faults.begin(), faults.end(), [](std::uint64_t count) { return count != 0; }));
}

SimulationResult simulate(std::uint64_t seed, const Schedule& schedule,
                          const std::function<void(const std::string&)>& trace) {
  return Simulation{seed, schedule, trace}.run();
}

}  // namespace tactus::test_support
