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
/// Time after recovery in which a host may still send cancelled regions, because it has not received the last demand.
constexpr std::int64_t kLastDemandNs = DeliverySettings{}.keep_alive_ns + 100 * kMs;
constexpr std::int64_t kSilenceNs = 100 * kMs;    // after kLastDemandNs; no payload may be sent in this time
constexpr std::int64_t kCheckPeriodNs = 5 * kMs;  // of recovery

class SimulatedHost : public Program {
 public:
  SimulatedHost(World& world, std::uint64_t id) : Program{world, id, Role::kHost} {}
  [[nodiscard]] std::uint64_t chunks() const noexcept { return chunks_; }

  /// Both hosts serve the first object, one of them the second.
  [[nodiscard]] bool serves(std::uint64_t object) const { return object == kFirstObject || id() == kFirstHost; }

 protected:
  void on_start() override {
    server_ = std::make_unique<DeliveryServer>(self());
    for (std::uint64_t object = kFirstObject; object < kFirstObject + kObjects; ++object)
      if (serves(object)) server_->add(object, compressed_of(object));
  }
  void on_sample(const Sample& sample) override {
    if (const auto* request = std::get_if<LivenessSample>(&sample); request != nullptr && !request->sample.answer)
      send(request->sample.origin.participant, LivenessSample{clock().answer(request->sample, local_ns(), local_ns())});
    const auto* demand = std::get_if<Demand>(&sample);
    if (demand == nullptr) return;
    if (server_->on_demand(*demand, local_ns()) == DeliveryServer::DemandResult::kMalformed)
      world_.report_violation("a demand is malformed");
    call_at(std::max(world_.now_ns, last_sent_ns_ + kMs));
  }
  void on_roster_event(const RosterEvent& event) override {
    const bool gone = event.change == RosterChange::kGone || event.change == RosterChange::kLeft;
    if (event.entry.role == Role::kHrtc && gone) server_->on_hrtc_gone(event.entry.origin.participant);
  }
  std::int64_t work() override {
    if (catalogue_timer_.due(world_.now_ns)) publish_catalogue();
    for (int i = 0; i < kChunksPerMs; ++i) {
      std::optional<Outgoing> out = server_->next(local_ns());
      if (!out) return 10 * kMs;
      ++chunks_;
      if (!out->chunk.pieces.empty() && world_.find(out->hrtc)->is_running()) world_.last_payload_ns = world_.now_ns;
      if (server_->bytes_in_flight(out->hrtc) > kSimulatedMaxCredit)
        world_.report_violation("more bytes are in flight than the credit allows");
      if (world_.bug == InjectedBug::kHostsDropHrtcs && world_.chance(0.02)) server_->on_hrtc_gone(out->hrtc);
      send(out->hrtc, std::move(out->chunk));
    }
    last_sent_ns_ = world_.now_ns;
    return kMs;
  }

 private:
  void publish_catalogue() {
    for (std::uint64_t object = kFirstObject; object < kFirstObject + kObjects; ++object) {
      if (!serves(object)) continue;
      CatalogueEntry entry;
      entry.origin = self();
      entry.object_id = object;
      entry.summary = model_of(object).summary;
      send_all(world_.programs, std::move(entry));
    }
  }

  std::unique_ptr<DeliveryServer> server_;
  session::PeriodicTimer catalogue_timer_{100 * kMs};
  std::int64_t last_sent_ns_ = 0;
  std::uint64_t chunks_ = 0;
};

class Simulation {
 public:
  Simulation(std::uint64_t seed, const Schedule& schedule, const std::function<void(const std::string&)>& trace)
      : schedule_{schedule},
        world_{seed, schedule.delay_ns, schedule.network_faults, schedule.reliability},
        trace_{trace} {
    world_.bug = schedule.bug;
    if (trace_) world_.network.trace = [this](std::int64_t, const std::string& line) { log(line); };
    for (std::uint64_t i = 0; i < kHosts; ++i)
      hosts_.push_back(std::make_unique<SimulatedHost>(world_, kFirstHost + i));
    for (std::uint64_t i = 0; i < kHrtcs; ++i)
      hrtcs_.push_back(std::make_unique<SimulatedHrtc>(world_, kFirstHrtc + i, schedule_.hrtc_faults));
    for (std::uint64_t i = 0; i < kClients; ++i)
      clients_.push_back(std::make_unique<SimulatedClient>(world_, kFirstClient + i, kFirstHrtc + i));
    for (const auto& host : hosts_) world_.programs.push_back(host.get());
    for (const auto& hrtc : hrtcs_) world_.programs.push_back(hrtc.get());
    for (const auto& client : clients_) world_.programs.push_back(client.get());
    for (Program* program : world_.programs) program->start();
  }

  SimulationResult run() {
    std::stable_sort(schedule_.planned_faults.begin(), schedule_.planned_faults.end(),
                     [](const PlannedFault& a, const PlannedFault& b) { return a.at_ns < b.at_ns; });
    while (world_.now_ns < schedule_.faulty_phase_ns && world_.violations.empty()) step(schedule_.faulty_phase_ns);
    heal();
    const std::int64_t last_fault_ns = world_.now_ns;
    while (world_.violations.empty()) {
      step(world_.now_ns + kCheckPeriodNs);
      const std::int64_t elapsed_ns = world_.now_ns - last_fault_ns;
      const std::string obstacle = recovery_obstacle();
      if (obstacle.empty()) {
        result_.recovery_ns = elapsed_ns;
        break;
      }
      if (elapsed_ns > kMaxRecoveryNs) world_.report_violation("not recovered: " + obstacle);
    }
    const std::int64_t silence_start_ns = world_.now_ns + kLastDemandNs, end_ns = silence_start_ns + kSilenceNs;
    while (world_.now_ns < end_ns && world_.violations.empty()) {
      step(end_ns);
      if (world_.last_payload_ns > silence_start_ns)
        world_.report_violation("records are sent although all wanted regions are held");
    }
    return result();
  }

 private:
  void log(const std::string& line) const {
    char time[24];
    std::snprintf(time, sizeof time, "%10.3f ms  ", static_cast<double>(world_.now_ns) * 1e-6);
    trace_(time + line);
  }

  /// Advances to the next event, or to `until_ns`.
  void step(std::int64_t until_ns) {
    std::int64_t next_ns = std::min(until_ns, world_.network.next_ns());
    for (const Program* program : world_.programs) next_ns = std::min(next_ns, program->next_tick_ns());
    if (!restarts_.empty()) next_ns = std::min(next_ns, restarts_.begin()->first);
    const std::vector<PlannedFault>& faults = schedule_.planned_faults;
    if (next_fault_ < faults.size()) next_ns = std::min(next_ns, faults[next_fault_].at_ns);
    world_.now_ns = std::max(world_.now_ns, next_ns);
    if (world_.users_move) {
      while (next_fault_ < faults.size() && faults[next_fault_].at_ns <= world_.now_ns) apply(faults[next_fault_++]);
    }
    while (!restarts_.empty() && restarts_.begin()->first <= world_.now_ns) restart_next();
    while (world_.network.next_ns() <= world_.now_ns) {
      const std::optional<SimulatedNetwork::Packet> packet = world_.network.take();
      if (!packet) continue;
      Program* receiver = world_.find(packet->to);
      if (receiver->is_running()) receiver->receive(*packet);
    }
    for (Program* program : world_.programs)
      if (program->next_tick_ns() <= world_.now_ns) program->tick();
  }

  void apply(const PlannedFault& fault) {
    for (std::size_t i = 0; i < kPrograms; ++i) {
      if ((fault.programs >> i & 1u) == 0) continue;
      Program& program = *world_.programs[i];
      if (fault.kind == FaultKind::kPartition) {
        partition(program, fault);
      } else if (program.is_running()) {
        if (trace_)
          log(std::to_string(program.id()) + (fault.sends_leave_message ? " leaves" : " crashes") +
              (fault.permanent ? " permanently" : ""));
        ++result_.fault_counts[static_cast<std::size_t>(fault.kind)];
        world_.last_crash_ns = world_.now_ns;
        program.stop(fault.sends_leave_message);
        if (!fault.permanent) restarts_.emplace(end_of(fault), &program);
      }
    }
  }

  [[nodiscard]] std::int64_t end_of(const PlannedFault& fault) const {
    return std::min(world_.now_ns + fault.duration_ns, schedule_.faulty_phase_ns);
  }

  /// Cuts the program off from all programs without this fault.
  void partition(const Program& program, const PlannedFault& fault) {
    if (trace_)
      log(std::to_string(program.id()) + (fault.one_way ? " cannot send" : " is cut off") + " for " +
          std::to_string(fault.duration_ns / kMs) + " ms");
    for (std::size_t i = 0; i < kPrograms; ++i) {
      if ((fault.programs >> i & 1u) != 0) continue;
      const std::uint64_t other = world_.programs[i]->id();
      world_.network.cut(program.id(), other, end_of(fault));
      if (!fault.one_way) world_.network.cut(other, program.id(), end_of(fault));
    }
  }

  void restart_next() {
    Program& program = *restarts_.begin()->second;
    if (trace_) log(std::to_string(program.id()) + " restarts");
    world_.last_crash_ns = world_.now_ns;
    program.start();
    restarts_.erase(restarts_.begin());
  }

  void heal() {
    if (trace_) log("all faults end");
    world_.network.heal();
    world_.users_move = false;
    while (!restarts_.empty()) restart_next();
  }

  [[nodiscard]] bool served(std::uint64_t object) const {
    return std::any_of(hosts_.begin(), hosts_.end(),
                       [object](const auto& host) { return host->is_running() && host->serves(object); });
  }

  /// Names one program that has not recovered, and the state concerned. Empty when the session has recovered.
  [[nodiscard]] std::string recovery_obstacle() const {
    for (const auto& hrtc : hrtcs_)
      for (std::uint64_t object = kFirstObject; object < kFirstObject + kObjects; ++object)
        if (hrtc->is_running() && served(object) && !hrtc->holds_wanted_parts(object))
          return std::to_string(hrtc->id()) + " lacks wanted regions or pages of object " + std::to_string(object);
    for (const Program* program : world_.programs) {
      if (!program->is_running()) continue;
      const std::string name = std::to_string(program->id());
      if (!has_correct_roster(*program)) return "the roster of " + name;
      const Program* reference_program = world_.find(program->clock().reference());
      if (reference_program == nullptr || !reference_program->is_running() ||
          reference_program->clock().reference() != reference_program->id())
        return "the time reference of " + name;
      if (!program->clock().synchronised() || program->clock_bound_ns() > kMaxClockBoundNs)
        return "the clock of " + name;
    }
    return slot_obstacle();
  }

  /// Whether the roster lists exactly the other running programs, each with its incarnation.
  [[nodiscard]] bool has_correct_roster(const Program& program) const {
    std::size_t entries = 0;
    bool correct = true;
    program.roster().for_each([&](const RosterEntry& entry) {
      const Program* other = world_.find(entry.origin.participant);
      correct = correct && other->is_running() && other->incarnation() == entry.origin.incarnation;
      ++entries;
    });
    const auto running = std::count_if(world_.programs.begin(), world_.programs.end(),
                                       [](const Program* other) { return other->is_running(); });
    return correct && entries + 1 == static_cast<std::size_t>(running);
  }

  /// Names an HRTC whose served users differ from the requests of the clients, or from those in the roster of a
  /// program.
  [[nodiscard]] std::string slot_obstacle() const {
    for (const auto& hrtc : hrtcs_) {
      if (!hrtc->is_running()) continue;
      std::set<std::string> requested, granted;
      for (const auto& client : clients_)
        for (const std::string& user : client->users_at(hrtc->id())) requested.insert(user);
      std::set<std::uint32_t> probe_numbers;
      for (const UserProbe& probe : hrtc->served_users()) {
        granted.insert(probe.user);
        probe_numbers.insert(probe.probe);
      }
      if (requested != granted || probe_numbers.size() != granted.size())
        return "the users of " + std::to_string(hrtc->id());
      for (const Program* program : world_.programs) {
        if (!program->is_running() || program == hrtc.get()) continue;
        std::set<std::string> published;
        for (const UserProbe& probe : program->roster().find(hrtc->id())->served_users) published.insert(probe.user);
        if (published != granted)
          return "the users of " + std::to_string(hrtc->id()) + " in the roster of " + std::to_string(program->id());
      }
    }
    return {};
  }

  SimulationResult result() {
    result_.violations = world_.violations;
    result_.samples_sent = world_.network.sent();
    result_.virtual_ns = world_.now_ns;
    for (std::size_t i = 0; i < kFaultKinds; ++i) result_.fault_counts[i] += world_.network.fault_counts()[i];
    for (const auto& host : hosts_) result_.chunks += host->chunks();
    for (const auto& hrtc : hrtcs_) {
      const HrtcFigures& figures = hrtc->figures();
      result_.hrtcs.regions_held += figures.regions_held;
      result_.hrtcs.regions_refused += figures.regions_refused;
      result_.hrtcs.pages_held += figures.pages_held;
      result_.hrtcs.pages_refused += figures.pages_refused;
      result_.hrtcs.pages_forgotten += figures.pages_forgotten;
      result_.hrtcs.regions_released += figures.regions_released;
      result_.hrtcs.records_received += figures.records_received;
      result_.hrtcs.records_repeated += figures.records_repeated;
      result_.hrtcs.failures_detected += figures.failures_detected;
      result_.hrtcs.max_detection_ns = std::max(result_.hrtcs.max_detection_ns, figures.max_detection_ns);
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
  std::size_t next_fault_ = 0;                      // in the schedule
  std::multimap<std::int64_t, Program*> restarts_;  // by time
  SimulationResult result_;
};

}  // namespace

std::string Schedule::text() const {
  char line[400];
  std::snprintf(
      line, sizeof line,
      "%lld ms with faults; %s delivery, %g ms one way; loss %g %%, duplication %g %%, reordering %g %% by at most "
      "%g ms, corruption %g %%; decoding in at most %g ms, postponing %g %%; %zu crashes, restarts and partitions",
      static_cast<long long>(faulty_phase_ns / kMs),
      reliability == SimulatedNetwork::Reliability::kBestEffort ? "best-effort" : "reliable",
      static_cast<double>(delay_ns) * 1e-6, 100 * network_faults.loss, 100 * network_faults.duplication,
      100 * network_faults.reordering, static_cast<double>(network_faults.reorder_ns) * 1e-6,
      100 * network_faults.corruption, static_cast<double>(hrtc_faults.decode_ns) * 1e-6, 100 * hrtc_faults.postponing,
      planned_faults.size());
  return line;
}

Schedule random_schedule(std::uint64_t seed) {
  std::mt19937_64 random{seed ^ 0x5eedull};
  const auto random_below = [&](std::int64_t bound) {
    return static_cast<std::int64_t>(random() % static_cast<std::uint64_t>(bound));
  };
  const auto choose = [&](std::initializer_list<double> values) {
    return *(values.begin() + random_below(static_cast<std::int64_t>(values.size())));
  };
  Schedule schedule;
  schedule.faulty_phase_ns = static_cast<std::int64_t>(choose({600, 600, 800, 1600})) * kMs;
  schedule.delay_ns = static_cast<std::int64_t>(choose({0.2, 1, 5, 20}) * 1e6);
  if (random_below(3) == 0) schedule.reliability = SimulatedNetwork::Reliability::kReliable;
  schedule.hrtc_faults.decode_ns = static_cast<std::int64_t>(choose({0, 10, 60}) * 1e6);
  schedule.hrtc_faults.postponing = choose({0, 0, 0.1});

  std::vector<FaultKind> kinds{FaultKind::kCrash, FaultKind::kRestart, FaultKind::kPartition};
  if (schedule.reliability == SimulatedNetwork::Reliability::kBestEffort)
    kinds.insert(kinds.end(), {FaultKind::kReordering, FaultKind::kDuplication, FaultKind::kLoss});
  else
    kinds.push_back(FaultKind::kLoss);
  std::shuffle(kinds.begin(), kinds.end(), random);
  std::array<std::uint32_t, kPrograms> program_order;  // each program is the first of at most one fault
  std::iota(program_order.begin(), program_order.end(), 0u);
  std::shuffle(program_order.begin(), program_order.end(), random);
  std::size_t failed_programs = 0;
  kinds.resize(3 + static_cast<std::size_t>(random_below(static_cast<std::int64_t>(kinds.size()) - 2)));
  for (const FaultKind kind : kinds) {
    if (kind == FaultKind::kLoss) {
      schedule.network_faults.loss = choose({0.01, 0.05, 0.2});
      if (schedule.reliability == SimulatedNetwork::Reliability::kBestEffort)
        schedule.network_faults.corruption = choose({0, 0, 0.02});
    } else if (kind == FaultKind::kDuplication) {
      schedule.network_faults.duplication = choose({0.02, 0.2});
    } else if (kind == FaultKind::kReordering) {
      schedule.network_faults.reordering = choose({0.05, 0.5});
      schedule.network_faults.reorder_ns = static_cast<std::int64_t>(choose({5, 30, 300}) * 1e6);
    } else {
      for (std::int64_t remaining = 1 + random_below(2); remaining > 0; --remaining) {
        PlannedFault fault;
        fault.kind = kind;
        fault.at_ns = 100 * kMs + random_below(schedule.faulty_phase_ns - 400 * kMs);
        fault.duration_ns = (kind == FaultKind::kRestart ? 1 + random_below(80) : 120 + random_below(1200)) * kMs;
        fault.one_way = random_below(3) == 0;
        fault.sends_leave_message = kind == FaultKind::kRestart && random_below(2) == 0;
        fault.programs = 1u << program_order[failed_programs++];
        if (kind == FaultKind::kPartition && random_below(2) == 0) fault.programs |= 1u << random_below(kPrograms);
        fault.permanent = kind == FaultKind::kCrash && random_below(4) == 0;
        schedule.planned_faults.push_back(fault);
      }
    }
  }
  return schedule;
}

std::size_t SimulationResult::fault_kinds() const {
  return static_cast<std::size_t>(
      std::count_if(fault_counts.begin(), fault_counts.end(), [](std::uint64_t count) { return count != 0; }));
}

SimulationResult simulate(std::uint64_t seed, const Schedule& schedule,
                          const std::function<void(const std::string&)>& trace) {
  return Simulation{seed, schedule, trace}.run();
}

}  // namespace tactus::test_support
