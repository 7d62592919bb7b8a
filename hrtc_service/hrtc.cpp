#include "hrtc_service/hrtc.hpp"

#include <poll.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <algorithm>
#include <map>
#include <mutex>
#include <thread>
#include <type_traits>
#include <utility>
#include <variant>

#include "haptics/remote_device.hpp"
#include "haptics/simulated_device.hpp"
#include "hrtc_service/body_exchange.hpp"
#include "hrtc_service/loader.hpp"
#include "hrtc_service/neighbours.hpp"
#include "hrtc_service/realtime.hpp"
#include "hrtc_service/snapshot.hpp"
#include "hrtc_service/statistics.hpp"
#include "session/clock.hpp"
#include "session/roster.hpp"
#include "session/vigil.hpp"
#include "sharing/hand_path.hpp"
#include "wire/ends.hpp"
#include "wire/inbox.hpp"

namespace tactus::hrtc_service {
namespace {

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kServiceNs = 2 * kMs;  // from one pass to the next, at least; so many times a pass; at most
constexpr std::int64_t kServiceRest = 10;
constexpr std::int64_t kServiceMostNs = 10 * kMs;
constexpr std::int64_t kServiceRestingNs = 8 * kMs;  // at least, where no tip moves and all that is wanted is here
constexpr std::int64_t kVigilNs = 2 * kMs, kVigilEaseNs = 4 * kMs;
constexpr std::int64_t kHeartbeatNs = 100 * kMs;
constexpr std::int64_t kClockNs = 200 * kMs;
constexpr std::int64_t kClockFastNs = 20 * kMs;
constexpr std::int64_t kMetricsNs = 500 * kMs;
constexpr std::int64_t kMetricsSoonNs = 100 * kMs;
constexpr std::int64_t kAllMetricsNs = 5000 * kMs;
constexpr std::int64_t kLateToldNs = 1000 * kMs;
constexpr std::int64_t kModesNs = 20 * kMs;
constexpr std::int64_t kNoHostNs = 5000 * kMs;
constexpr std::int64_t kSnapshotNs = 2000 * kMs;
constexpr int kMaxSnapshots = 5;

using wire::Every;
/// What a host answers when it is asked whether it lives (session/vigil.hpp), or for the time.
struct VigilAnswer {
  session::ClockSample sample;
};
/// A probe state that came through the ends of a group.
struct WholeState {
  session::ProbeState state;
};
wire::SessionAddress reads_bulk(wire::SessionAddress address) {
  address.only_reads_bulk = true;
  return address;
}

using Sample = std::variant<VigilAnswer, session::RosterEntry, session::CatalogueEntry, session::BulkChunk,
                            session::Intent, session::ClockSample, session::Control, session::ProbeState,
                            session::Metrics, WholeState, session::ObjectGrant, session::ObjectPose>;
using Inbox = wire::Inbox<Sample>;

/// A thread that sleeps as the haptic one does and then computes for a fixed 30 us: what lateness the system itself
/// brings, and how often it makes little work look like much.
class TimerBeside {
 public:
  TimerBeside(std::int64_t period_ns, int priority)
      : thread_{[this, period_ns, priority] { run(period_ns, priority); }} {}
  ~TimerBeside() {
    running_ = false;
    thread_.join();
  }
  void drain(Samples& samples) {
    std::uint32_t late;
    while (lateness_.pop(late)) samples.add(late);
  }
  /// Its cycles that were late as if by their own work.
  [[nodiscard]] std::uint64_t late() const noexcept { return late_; }

 private:
  static constexpr std::int64_t kWorkNs = 30'000;

  void compute(std::uint32_t steps) noexcept {
    for (std::uint32_t i = 0; i < steps; ++i) number_ = number_ * 6364136223846793005u + 1442695040888963407u;
  }
  [[nodiscard]] std::uint32_t steps_of_work() noexcept {
    constexpr std::uint32_t kTried = 10000;
    std::int64_t best = kWorkNs;
    for (int round = 0; round < 8; ++round) {
      const std::int64_t began = monotonic_ns();
      compute(kTried);
      best = std::min(best, monotonic_ns() - began);
    }
    return static_cast<std::uint32_t>(kTried * kWorkNs / std::max<std::int64_t>(best, 1));
  }
  void run(std::int64_t period_ns, int priority) {
    pthread_setname_np(pthread_self(), "timer");
    if (priority > 0) (void)wire::enter_realtime("timer", priority);
    const std::uint32_t steps = steps_of_work();
    for (PeriodicClock clock{period_ns}; running_;) {
      lateness_.push(static_cast<std::uint32_t>(clock.wait_next()));
      const std::int64_t began = monotonic_ns(), cpu = thread_cpu_ns();
      compute(steps);
      const std::int64_t end = monotonic_ns();
      if (end > clock.due_ns() && own_work(thread_cpu_ns() - cpu, end - began, period_ns)) ++late_;
    }
  }
  std::atomic<bool> running_{true};
  std::atomic<std::uint64_t> late_{0};
  volatile std::uint64_t number_ = 1;
  boost::lockfree::spsc_queue<std::uint32_t> lateness_{8192};
  std::thread thread_;
};

session::Pose pose_at(const Plain3& position) {
  session::Pose pose;
  pose.position = position;
  return pose;
}

bool touches_exactly(const ProbeReports& reports) {
  constexpr std::uint32_t kTouching = session::kInContact | session::kExact;
  return std::any_of(reports.probes.begin(), reports.probes.end(),
                     [](const ProbeOutput& probe) { return (probe.status & kTouching) == kTouching; });
}

std::uint32_t age_us(const ProbeOutput& probe) {
  return static_cast<std::uint32_t>(std::clamp(probe.pose_age * 1e6f, 0.0f, 4e9f));
}

}  // namespace

struct Hrtc::Impl {
  explicit Impl(HrtcOptions given);
  ~Impl();
  int run(const std::atomic<bool>& stop);

  struct User;

  // Samples that arrive.
  void take(const session::RosterEntry& entry, std::int64_t now_ns);
  void take(const session::CatalogueEntry& entry, std::int64_t now_ns);
  void take(const session::BulkChunk& chunk, std::int64_t now_ns) { loader.on_chunk(chunk, now_ns); }
  void take(const session::Intent& intent, std::int64_t now_ns);
  void take(const session::ClockSample& sample, std::int64_t now_ns);
  void take(const VigilAnswer& answer, std::int64_t now_ns) {
    vigil.on_answer(answer.sample, now_ns);
    clock.on_answer(answer.sample, now_ns);
  }
  void take(const session::Control& control, std::int64_t now_ns);
  void stop_forces();
  void take(const session::ProbeState& state, std::int64_t now_ns);
  void take(const WholeState& whole, std::int64_t now_ns);
  void take(const session::Metrics& told, std::int64_t now_ns) { neighbours.on_metrics(told, now_ns); }
  void take(const session::ObjectGrant& grant, std::int64_t now_ns) { exchange.on_grant(grant, now_ns); }
  void take(const session::ObjectPose& pose, std::int64_t now_ns) {
    exchange.on_pose(pose, clock.map().session_time(now_ns));
  }

  void on_event(const session::RosterEvent& event, std::int64_t now_ns);
  void tell_of_fault(std::uint32_t slot, std::uint32_t status);
  void tell_of_hold(std::uint32_t slot, const ProbeOutput& probe);
  void seat(const session::RosterEntry& client);
  void listen_to_device(User& user);
  void open_remote_devices();
  void unseat(const std::string& user);
  void seat_local_users();
  void choose_reference(std::int64_t now_ns);
  void note_first_touch(std::int64_t now_ns);
  void choose_whom_to_watch(const std::array<NearObjects, kMaxProbes>& near);
  [[nodiscard]] bool keep_vigil(std::int64_t now_ns);
  void tell_of_hosts(std::int64_t now_ns);
  void send_roster(bool leaving);
  void send_metrics(bool all);
  void tick_modes(std::int64_t now_ns);
  void tick_bodies(std::int64_t now_ns);
  class StateSender;
  [[nodiscard]] session::ProbeState state_of(const ProbeReports& latest, std::uint32_t probe,
                                             const session::ClockMap& map);
  void send_states();
  void send_commands(const ProbeReports& latest);
  void serve(std::int64_t now_ns);
  void tell_of_late(const CycleTrace& trace);
  void drain_rings();
  void snapshot(std::int64_t now_ns, const ProbeReports& reports);
  void finish();

  struct User {
    std::string name;
    std::uint64_t id = 0;
    std::uint64_t client = 0;                  // participant; 0: a device of our own
    haptics::SimulatedDevice* hand = nullptr;  // once it has a wish
    haptics::RemoteDevice* remote = nullptr;   // what takes its poses, if it sends any
    std::unique_ptr<wire::Reader<session::Intent>> intents;
    std::unique_ptr<wire::Reader<session::DevicePose>> poses;
  };
  /// Where the forces of a remote device go.
  struct RemoteEnd {
    haptics::RemoteDevice* device = nullptr;  // null: this probe has none
    std::uint64_t user_id = 0;
    std::unique_ptr<wire::Writer<session::DeviceCommand>> commands;
  };

  HrtcOptions options;
  wire::Links links;
  Inbox inbox{1u << 14};
  spm::Pool pool;
  spm::NodePool nodes;
  std::unique_ptr<FlightKeeper> flight;  // null: nothing is recorded
  HapticThread haptic;
  Loader loader;
  session::Roster roster;
  session::SessionClock clock;
  session::Vigil vigil;
  session::UserSlots slots;
  std::vector<std::unique_ptr<haptics::Device>> devices;
  HapticCommands commands;
  bool stopped = false;  // by an emergency stop, heard or told of; no reset since
  haptics::Mailbox<session::ClockMap> sender_clock;
  std::atomic<std::int64_t> session_offset_ns{0};  // session time less ours, for the threads that bring poses
  std::mutex remote_mutex;                         // the service's and the sender's
  std::array<RemoteEnd, kMaxProbes> remote_ends;
  std::array<std::atomic<std::uint64_t>, kMaxProbes> user_ids{};
  std::array<std::atomic<std::uint64_t>, kMaxObjects> object_ids{};

  wire::Writer<session::RosterEntry> roster_out;
  wire::Writer<session::Demand> demand_out;
  wire::Writer<session::ClockSample> clock_out;
  wire::Writer<session::ClockSample> vigil_out;
  wire::Writer<session::Metrics> metrics_out, losses_out;
  wire::Writer<session::ProbeState> states_out;  // the sender thread's
  std::atomic<std::uint64_t> states_coded{0}, states_whole{0};
  Neighbours neighbours;
  BodyExchange exchange;
  struct Movable {
    session::CatalogueEntry entry;  // where it stands
    bool moved = false;             // since the modes were told
  };
  std::map<std::uint64_t, Movable> movable;  // by object

  CycleStatistics statistics;
  Samples timer_samples{1'000'000};
  std::unique_ptr<TimerBeside> timer;
  std::unique_ptr<trace::ContactLogWriter> log;
  std::vector<bool> object_logged;
  trace::LoggedQuery logged;

  wire::Heartbeat heartbeat{kHeartbeatNs};
  Every clock_request{kClockFastNs}, metrics{kMetricsNs}, all_metrics{kAllMetricsNs}, no_host{kNoHostNs},
      modes{kModesNs}, bodies_told{kModesNs};
  std::uint64_t beats = 0;
  std::uint32_t clock_requests = 0;
  std::int64_t started_ns = 0;
  bool host_seen = false;
  bool ended = false;
  int exit_code = 0;
  ProbeReports reports;
  std::array<bool, kMaxProbes> faults_told{};
  std::array<std::uint32_t, kMaxProbes> holds_told{};  // status bits
  Every late_told{kLateToldNs};
  std::uint32_t late_untold = 0;  // cycles
  std::uint64_t first_cycle = 0;  // seen; 0: none yet
  std::int64_t first_cycle_ns = 0;
  std::array<ProbeSight, kMaxProbes> sights;
  std::int64_t contact_since_ns = 0, snapshot_asked_ns = 0;
  int snapshots_taken = 0;
  std::uint32_t saves_seen = 0;
  struct Serving {
    std::uint64_t host = 0;
    std::int64_t since_ns = 0;  // of a change whose first records have not come
    std::uint64_t regions_before = 0;
  };
  std::map<std::uint64_t, Serving> servings;  // by object
  std::array<std::vector<std::uint32_t>, kMaxObjects> snapshot_contacts, snapshot_predictions;
  struct {
    std::int64_t catalogue_ns = 0, base_ns = 0, exact_ns = 0;  // when first, each; 0: not yet
    std::uint64_t bytes = 0;                                   // of payload, until the last
  } first;

  std::thread sender;
  std::atomic<bool> sending{false};

  // Last, so that no callback outlives what it fills.
  std::vector<std::shared_ptr<void>> readers;
  std::map<std::uint32_t, User> users;  // by slot; theirs bring poses to devices
  /// What everyone sends to everyone can wait for the service's next pass: there is much of it in a large session.
  template <class Typed>
  static constexpr bool kUrgent =
      !(std::is_same_v<Typed, session::RosterEntry> || std::is_same_v<Typed, session::ClockSample> ||
        std::is_same_v<Typed, session::ProbeState> || std::is_same_v<Typed, session::Metrics>);
  template <class Typed>
  void listen(const wire::TopicSpec<Typed>& topic, const wire::EndOptions& where = {}) {
    readers.push_back(std::make_shared<wire::Reader<Typed>>(
        links, topic, [this](Typed&& sample) { inbox.put(std::move(sample), kUrgent<Typed>); }, where));
  }
};

namespace {

std::array<haptics::DeviceSpec, kMaxProbes> specs_of(const HrtcOptions& options) {
  std::array<haptics::DeviceSpec, kMaxProbes> specs;
  for (std::uint32_t i = 0; i < kMaxProbes; ++i)
    if (i < options.local_users.size())
      specs[i] = options.haptic.frame.to_world(options.local_users[i].device->spec());
    else if (options.haptic.cycle.tool != nullptr)  // a client takes of a command what its device bears
      specs[i].max_torque = options.haptic.cycle.force.max_torque;
  return specs;
}

std::unique_ptr<FlightKeeper> flight_keeper(const HrtcOptions& options) {
  if (options.flight.seconds <= 0) return nullptr;
  return std::make_unique<FlightKeeper>(
      options.flight, flight_start(options.address.participant, options.haptic.cycle, options.pool, specs_of(options)),
      static_cast<std::uint32_t>(std::min<std::size_t>(options.max_users, kMaxProbes)));
}

HapticSettings haptic_settings(const HrtcOptions& options, FlightKeeper* flight) {
  HapticSettings settings = options.haptic;
  if (flight != nullptr) settings.recorder = &flight->recorder();
  return settings;
}

LoaderSettings loader_settings(const HrtcOptions& options) {
  LoaderSettings settings;
  settings.radius = options.haptic.cycle.radius;
  settings.tool = options.haptic.cycle.tool;
  settings.strategy = options.prediction;
  settings.directory_bytes = options.directory_bytes;
  settings.clock = monotonic_ns;
  return settings;
}

}  // namespace

Hrtc::Impl::Impl(HrtcOptions given)
    : options{std::move(given)},
      links{reads_bulk(options.address)},
      pool{options.pool},
      nodes{options.pool.tree_nodes},
      flight{flight_keeper(options)},
      haptic{haptic_settings(options, flight.get()), specs_of(options)},
      loader{pool, nodes, links.origin(), loader_settings(options), haptic.arrivals(), haptic.departures()},
      roster{links.origin(), {}},
      clock{links.origin(), {}},
      vigil{links.origin(), {}},
      slots{std::min<std::size_t>(options.max_users, kMaxProbes)},
      roster_out{links, wire::topics::kRoster},
      demand_out{links, wire::topics::kDemand},
      clock_out{links, wire::topics::kClock},
      vigil_out{links, wire::topics::kClock, {wire::hrtc_partition(options.address.participant)}},
      metrics_out{links, wire::topics::kMetrics},
      losses_out{links, wire::topics::kMetrics, {wire::kLossesPartition}},
      states_out{links, wire::topics::kProbeState},
      neighbours{links, [this](session::ProbeState&& state) { inbox.put(WholeState{std::move(state)}); }},
      exchange{links, haptic.bodies()} {
  loader.on_event = [](const std::string& text) { spdlog::info("{}", text); };
  loader.on_object = [this](const TouchObject& object) {
    if (object.body && !exchange.add(object))
      spdlog::warn("an object that can move will stay where it is: an HRTC moves {} at most", kMaxBodies);
  };
  seat_local_users();
  // Last of what may be refused, so that nothing is left behind.
  if (!options.snapshot.empty()) expect_snapshot_directory(options.snapshot);
  if (!options.log.empty()) log = std::make_unique<trace::ContactLogWriter>(options.log);
  if (!options.snapshot.empty()) std::filesystem::create_directories(options.snapshot);
  listen(wire::topics::kRoster);
  listen(wire::topics::kCatalogue);
  listen(wire::topics::kClock);
  listen(wire::topics::kControl);
  listen(wire::topics::kProbeState);
  listen(wire::topics::kObjectGrant);
  listen(wire::topics::kObjectPose);
  listen(wire::topics::kMetrics, {wire::kLossesPartition});
  const wire::EndOptions own{wire::hrtc_partition(options.address.participant)};
  listen(wire::topics::kBase, own);
  listen(wire::topics::kRecords, own);
  readers.push_back(std::make_shared<wire::Reader<session::ClockSample>>(
      links, wire::topics::kClock, [this](session::ClockSample&& answer) { inbox.put(VigilAnswer{std::move(answer)}); },
      own));
}

Hrtc::Impl::~Impl() {
  haptic.stop();
  sending = false;
  if (sender.joinable()) sender.join();
  if (flight) static_cast<void>(flight->stop());  // while the objects are there
}

void Hrtc::Impl::seat_local_users() {
  for (LocalUser& local : options.local_users) {
    const std::optional<std::uint32_t> slot = slots.grant(local.user);
    if (!slot) throw haptics::DeviceError("no slot left for user " + local.user);
    devices.push_back(std::move(local.device));
    commands.devices[*slot] = devices.back().get();
    commands.framed[*slot] = true;
    User& user = users[*slot];
    user.name = local.user;
    user.id = session::id_of(local.user);
    user_ids[*slot] = user.id;
  }
}

void Hrtc::Impl::take(const session::RosterEntry& entry, std::int64_t now_ns) {
  for (const session::RosterEvent& event : roster.on_entry(entry, now_ns)) on_event(event, now_ns);
  if (entry.role == session::Role::kHost && roster.find(entry.origin.participant) != nullptr && !entry.leaving) {
    host_seen = true;
    loader.on_host_seen(entry.origin.participant, entry.origin.incarnation, now_ns);
  }
}

void Hrtc::Impl::on_event(const session::RosterEvent& event, std::int64_t now_ns) {
  using session::RosterChange;
  const session::RosterEntry& entry = event.entry;
  const bool gone = event.change == RosterChange::kGone || event.change == RosterChange::kLeft;
  if (event.change != RosterChange::kChanged) spdlog::info("{}", session::text(event));
  metrics.hasten(now_ns, kMetricsSoonNs);  // whoever compares scenes need not wait long
  if (event.change == RosterChange::kStopped) stop_forces();
  const bool is_new = event.change == RosterChange::kJoined || event.change == RosterChange::kRestarted;
  if (entry.role == session::Role::kHost && is_new) heartbeat.insist();  // whom it had not yet found before
  if (event.change == RosterChange::kTwins && entry.origin.participant == links.origin().participant) {
    spdlog::error("another program named {} is in session {}; every name may be there once",
                  options.address.participant, options.address.session);
    if (links.origin().incarnation > event.other) {  // the later one yields
      exit_code = 2;
      ended = true;
    }
    return;
  }
  if (entry.role == session::Role::kHost && gone) loader.on_host_gone(entry.origin.participant);
  if (entry.role == session::Role::kHrtc && gone) neighbours.on_controller_gone(entry.origin.participant);
  if (entry.role != session::Role::kClient) return;
  if (gone || event.change == RosterChange::kRestarted)
    for (const std::string& user : entry.users) unseat(user);
  const bool here = event.change == RosterChange::kJoined || event.change == RosterChange::kRestarted ||
                    event.change == RosterChange::kChanged;
  const bool asks = here && entry.controller == options.address.participant;
  // After a restart the others stay: a second program of that name may only have shown itself, and yield.
  if (event.change == RosterChange::kChanged) {
    std::vector<std::string> dismissed;
    for (const auto& [slot, user] : users)
      if (user.client == entry.origin.participant &&
          !(asks && std::find(entry.users.begin(), entry.users.end(), user.name) != entry.users.end()))
        dismissed.push_back(user.name);
    for (const std::string& user : dismissed) unseat(user);
  }
  if (asks) seat(entry);
}

void Hrtc::Impl::seat(const session::RosterEntry& client) {
  for (const std::string& name : client.users) {
    const std::optional<std::uint32_t> slot = slots.grant(name);
    if (!slot) {
      spdlog::warn("user {} refused: all {} probes are taken; raise --users", name, slots.list().size());
      continue;
    }
    User& user = users[*slot];
    if (user.intents) continue;
    user.name = name;
    user.id = session::id_of(name);
    user.client = client.origin.participant;
    user_ids[*slot] = user.id;
    user.intents = std::make_unique<wire::Reader<session::Intent>>(
        links, wire::topics::kIntent, [this](session::Intent&& intent) { inbox.put(std::move(intent)); },
        wire::EndOptions{wire::user_partition(name)});
    listen_to_device(user);
    spdlog::info("user {} has probe {}", name, *slot);
  }
  heartbeat.at_once();
}

/// A device that its client sends the poses of: they go past the service, straight to where the haptic thread looks.
void Hrtc::Impl::listen_to_device(User& user) {
  auto device = std::make_unique<haptics::RemoteDevice>();
  user.remote = device.get();
  devices.push_back(std::move(device));
  const auto on_pose = [this, remote = user.remote, id = user.id,
                        client = user.client](const session::DevicePose& pose) {
    if (pose.user_id != id || pose.origin.participant != client) return;
    haptics::RemotePose taken;
    taken.position = pose.pose.position;
    taken.orientation = pose.pose.orientation;
    taken.velocity = pose.velocity;
    taken.sequence = pose.sequence;
    taken.buttons = pose.buttons;
    taken.command_felt = pose.command_felt;
    taken.taken_ns = pose.session_time_ns - session_offset_ns.load(std::memory_order_relaxed);
    taken.arrived_ns = monotonic_ns();
    (void)remote->on_pose(taken);
  };
  user.poses = std::make_unique<wire::Reader<session::DevicePose>>(links, wire::topics::kDevicePose, on_pose,
                                                                   wire::EndOptions{wire::user_partition(user.name)});
}

void Hrtc::Impl::unseat(const std::string& name) {
  for (auto at = users.begin(); at != users.end(); ++at) {
    if (at->second.name != name || at->second.client == 0) continue;
    commands.devices[at->first] = nullptr;
    haptic.commands().post(commands);
    {
      const std::lock_guard lock{remote_mutex};
      remote_ends[at->first] = {};
    }
    user_ids[at->first] = 0;
    neighbours.on_user_left(at->second.id);
    slots.release(name);
    users.erase(at);
    spdlog::info("user {} has left", name);
    heartbeat.at_once();
    return;
  }
}

void Hrtc::Impl::take(const session::CatalogueEntry& entry, std::int64_t now_ns) {
  if (first.catalogue_ns == 0) first.catalogue_ns = now_ns;
  heartbeat.insist();  // a host makes the ends of an HRTC's bulk once it knows of it
  loader.on_catalogue(entry);
  neighbours.on_catalogue(entry);
  if (sharing::can_move(entry) && !entry.withdrawn) movable.try_emplace(entry.object_id, Movable{entry});
}

void Hrtc::Impl::take(const session::Intent& intent, std::int64_t now_ns) {
  for (auto& [slot, user] : users) {
    if (user.id != intent.user_id || user.client != intent.origin.participant || intent.path.empty()) continue;
    if (commands.devices[slot] != nullptr && user.hand == nullptr) continue;  // it has a device of its own
    // Wishes are in session time, the hand's clock is ours.
    const std::int64_t session_now = clock.map().session_time(now_ns);
    const haptics::HandPath path = sharing::hand_path(intent, now_ns - session_now);
    if (user.hand == nullptr) {
      haptics::HandSettings hand;
      sharing::begin_at(intent, hand);
      hand.seed = slot + 1;
      auto device = std::make_unique<haptics::SimulatedDevice>(hand);
      user.hand = device.get();
      commands.devices[slot] = device.get();
      devices.push_back(std::move(device));
      haptic.commands().post(commands);
    }
    user.hand->wishes().post(path);
  }
}

void Hrtc::Impl::open_remote_devices() {
  for (auto& [slot, user] : users) {
    if (user.remote == nullptr || !user.remote->has_pose() || commands.devices[slot] != nullptr) continue;
    RemoteEnd end;
    end.device = user.remote;
    end.user_id = user.id;
    end.commands = std::make_unique<wire::Writer<session::DeviceCommand>>(
        links, wire::topics::kDeviceCommand, wire::EndOptions{wire::user_partition(user.name)});
    {
      const std::lock_guard lock{remote_mutex};
      remote_ends[slot] = std::move(end);
    }
    commands.devices[slot] = user.remote;
    haptic.commands().post(commands);
    spdlog::info("user {} brings a device of its own", user.name);
  }
}

void Hrtc::Impl::take(const session::ClockSample& sample, std::int64_t now_ns) {
  if (sample.peer != links.origin().participant) return;
  if (sample.answer) {
    clock.on_answer(sample, now_ns);
    return;
  }
  if (!clock.answers()) return;
  session::ClockSample answer = clock.answer(sample, now_ns, monotonic_ns());
  answer.origin = links.origin();
  (void)clock_out.send(answer);
}

void Hrtc::Impl::take(const session::Control& control, std::int64_t) {
  switch (control.kind) {
    case session::ControlKind::kStart:
      spdlog::info("session {} starts", options.address.session);
      break;
    case session::ControlKind::kEnd:
      spdlog::info("session {} ends", options.address.session);
      ended = true;
      break;
    case session::ControlKind::kMode:
      try {
        neighbours.on_mode(control.text);
        spdlog::info("mode: {}", control.text);
      } catch (const std::invalid_argument& error) {
        spdlog::warn("{}", error.what());
      }
      break;
    case session::ControlKind::kEmergencyStop:
      spdlog::warn("emergency stop: {}", control.text);
      stop_forces();
      break;
    case session::ControlKind::kReset:
      spdlog::info("forces are reset: {}", control.text);
      stopped = false;
      heartbeat.at_once();
      ++commands.resets;
      haptic.commands().post(commands);
      break;
  }
}

/// Once, however many tell of it, until a reset; and tells whoever comes.
void Hrtc::Impl::stop_forces() {
  if (stopped) return;
  stopped = true;
  heartbeat.at_once();
  ++commands.stops;
  if (flight) flight->save("emergency stop", false);
  haptic.commands().post(commands);
}

void Hrtc::Impl::take(const session::ProbeState& state, std::int64_t now_ns) {
  const std::int64_t session_ns = clock.map().session_time(now_ns);
  neighbours.on_state(state, session::StateStream::kCoded, now_ns, session_ns);
  exchange.on_transit(session_ns - state.session_time_ns, session_ns);
}

void Hrtc::Impl::take(const WholeState& whole, std::int64_t now_ns) {
  const std::int64_t session_ns = clock.map().session_time(now_ns);
  neighbours.on_state(whole.state, session::StateStream::kWhole, now_ns, session_ns);
  exchange.on_transit(session_ns - whole.state.session_time_ns, session_ns);
}

void Hrtc::Impl::choose_reference(std::int64_t now_ns) {
  const session::TimeReference reference =
      session::time_reference(roster, links.origin(), session::Role::kHrtc, now_ns - started_ns);
  clock.set_reference(reference.participant, reference.incarnation, now_ns);
}
void Hrtc::Impl::send_roster(bool leaving) {
  session::RosterEntry entry;
  entry.origin = links.origin();
  entry.role = session::Role::kHrtc;
  entry.name = options.address.participant;
  entry.session = options.address.session;
  entry.slots = slots.list();
  entry.heartbeat = ++beats;
  entry.leaving = leaving;
  entry.stopped = stopped;
  (void)roster_out.send(entry);
}

void Hrtc::Impl::send_metrics(bool all) {
  namespace names = session::figures;
  session::Metrics sample;
  sample.origin = links.origin();
  sample.scene = session::scene_hash(roster, links.origin(), session::Role::kHrtc);
  statistics.write(sample.figures, all);
  if (all && !timer_samples.empty()) {
    sample.figures.push_back({names::kTimerP50, timer_samples.percentile_us(0.5)});
    sample.figures.push_back({names::kTimerP99, timer_samples.percentile_us(0.99)});
    sample.figures.push_back({names::kTimerMax, timer_samples.percentile_us(1)});
  }
  if (timer != nullptr) sample.figures.push_back({names::kTimerLate, static_cast<double>(timer->late())});
  if (reports.cycle > first_cycle)
    sample.figures.push_back({names::kRate, static_cast<double>(reports.cycle - first_cycle) * 1e9 /
                                                static_cast<double>(reports.time_ns - first_cycle_ns)});
  const LoaderFigures figures = loader.figures();
  const auto& delivery = loader.delivery_counters();
  std::size_t remotes = 0;
  double loop_delay = 0;
  for (const auto& [slot, user] : users) {
    if (user.remote == nullptr || commands.devices[slot] != user.remote) continue;
    ++remotes;
    loop_delay = std::max(loop_delay, user.remote->loop_delay());
  }
  const std::pair<const char*, double> counts[] = {
      {names::kPoolUsed, figures.slots_used},
      {names::kPoolPeak, figures.slots_peak},
      {names::kPoolLimit, figures.slots_limit},
      {names::kCodedUsed, figures.coded_used},
      {names::kCodedPeak, figures.coded_peak},
      {names::kCodedLimit, figures.coded_limit},
      {names::kRegionsHeld, static_cast<double>(figures.regions_held)},
      {names::kRegionsCoarsened, static_cast<double>(figures.regions_coarsened)},
      {names::kRegionsReceived, static_cast<double>(figures.regions_received)},
      {names::kEvictions, static_cast<double>(figures.regions_evicted)},
      {names::kReloads, static_cast<double>(figures.regions_reloaded)},
      {names::kRefusedFull, static_cast<double>(figures.refused_full)},
      {names::kObjectsRefused, static_cast<double>(figures.objects_refused)},
      {names::kRecordsReceived, static_cast<double>(figures.records_received)},
      {names::kRecordsReturned, static_cast<double>(figures.records_returned)},
      {names::kRecordsRepeated, static_cast<double>(figures.records_repeated)},
      {names::kRecordsTold, static_cast<double>(figures.records_told)},
      {names::kBytesReceived, static_cast<double>(delivery.payload_bytes)},
      {names::kLoadLatency, figures.load_latency * 1e6},
      {names::kFalseAlarms, static_cast<double>(vigil.false_alarms())},
      {names::kHostChanges, static_cast<double>(delivery.host_changes)},
      {names::kStatesCoded, static_cast<double>(states_coded)},
      {names::kStatesWhole, static_cast<double>(states_whole)},
      {names::kRemoteDevices, static_cast<double>(remotes)},
      {names::kLoopDelay, loop_delay * 1e6}};
  for (const auto& [name, value] : counts) sample.figures.push_back({name, value});
  static_assert(std::size(names::kInterventions) == haptics::kForceBits);
  for (std::size_t i = 0; i < haptics::kForceBits; ++i)
    sample.figures.push_back({names::kInterventions[i], static_cast<double>(reports.interventions[i])});
  const auto since_catalogue = [&](const char* name, std::int64_t at_ns) {
    if (at_ns != 0) sample.figures.push_back({name, static_cast<double>(at_ns - first.catalogue_ns) * 1e-3});
  };
  since_catalogue(names::kFirstBase, first.base_ns);
  since_catalogue(names::kFirstExact, first.exact_ns);
  if (first.exact_ns != 0) sample.figures.push_back({names::kFirstExactBytes, static_cast<double>(first.bytes)});
  neighbours.write(sample.figures);
  exchange.holdings().write(sample.figures);
  static_assert(kMaxObjects <= session::kMaxMeshes);
  const MeshHashes& hashes = haptic.mesh_hashes().latest();
  for (const Loader::ObjectInfo& object : loader.objects()) sample.meshes.push_back({object.id, hashes[object.index]});
  (void)metrics_out.send(sample);
  sample.meshes.clear();
  sample.figures = neighbours.losses();
  if (!sample.figures.empty()) (void)losses_out.send(sample);
}

void Hrtc::Impl::tick_modes(std::int64_t now_ns) {
  std::array<std::uint64_t, kMaxProbes> ids{};
  for (const auto& [slot, user] : users) {
    ids[slot] = user.id;
    if (reports.probes[slot].active) neighbours.on_own_probe(user.id, reports.probes[slot].device, now_ns);
  }
  neighbours.tick(now_ns, ids);
}

/// What moves is known to move: to those who look for what is near, here and among users.
void Hrtc::Impl::tick_bodies(std::int64_t now_ns) {
  exchange.tick(now_ns, clock.map());
  const bool tell_modes = bodies_told.due(now_ns);
  for (const Holdings::Held& body : exchange.holdings().bodies()) {
    const auto known = movable.find(body.id);
    if (known == movable.end()) continue;
    auto& [entry, moved] = known->second;
    if (body.pose.position != entry.pose.position || body.pose.orientation != entry.pose.orientation) {
      moved = true;
      entry.pose = body.pose;
      loader.on_moved(body.object, Placement{entry.pose, entry.scale});
    }
    if (tell_modes && std::exchange(moved, false)) neighbours.on_catalogue(entry);
  }
}

/// Whole to those who collaborate, coded to the session.
class Hrtc::Impl::StateSender {
 public:
  explicit StateSender(Impl& hrtc) : hrtc_{hrtc} {}

  void send(const ProbeReports& latest, const session::ClockMap& map) {
    // Who has just been found shall see the probes now, not when they have moved.
    const int matched = hrtc_.states_out.matched();
    if (matched > matched_) coders_.fill(Coder{});
    matched_ = matched;
    for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
      if (!latest.probes[i].active) continue;
      const std::uint64_t user = hrtc_.user_ids[i].load(std::memory_order_relaxed);
      if (user == 0) continue;
      Coder& coder = coders_[i];
      if (coder.user != user) coder = Coder{user, session::ProbeEncoder{}};
      session::ProbeState state = hrtc_.state_of(latest, i, map);
      state.user_id = user;
      state.sequence = whole_[i] + 1;
      if (hrtc_.neighbours.send_whole(i, state)) {
        ++whole_[i];
        ++hrtc_.states_whole;
      }
      coder.encoder.set_loss(hrtc_.neighbours.loss());
      if (hrtc_.options.coding && !coder.encoder.step(state)) continue;
      state.sequence = ++coded_[i];
      (void)hrtc_.states_out.send(state);
      ++hrtc_.states_coded;
    }
  }

 private:
  struct Coder {
    std::uint64_t user = 0;
    session::ProbeEncoder encoder{};
  };
  Impl& hrtc_;
  int matched_ = 0;
  std::array<Coder, kMaxProbes> coders_;
  std::array<std::uint32_t, kMaxProbes> coded_{}, whole_{};  // numbers given
};

session::ProbeState Hrtc::Impl::state_of(const ProbeReports& latest, std::uint32_t i, const session::ClockMap& map) {
  const ProbeOutput& probe = latest.probes[i];
  session::ProbeState state;
  state.origin = links.origin();
  state.probe = i;
  state.session_time_ns = map.session_time(latest.time_ns);
  state.time_bound_us =
      static_cast<std::uint32_t>(std::min<std::int64_t>(map.bound(latest.time_ns) / 1000, 0xffffffff));
  state.device = pose_at(probe.device);
  state.proxy = probe.proxy;
  state.velocity = probe.velocity;
  state.force = probe.force;
  state.radius = options.haptic.cycle.radius;
  state.object_id = probe.object < kMaxObjects ? object_ids[probe.object].load(std::memory_order_relaxed) : 0;
  state.status = probe.status;
  state.error_bound = probe.error_bound;
  state.data_age_us = age_us(probe);
  state.stiffness = probe.stiffness;
  return state;
}

void Hrtc::Impl::send_states() {
  pthread_setname_np(pthread_self(), "sender");
  const auto states = std::make_unique<StateSender>(*this);
  const auto gap_ns = static_cast<std::int64_t>(1e9 / options.state_rate) - kMs / 2;
  std::int64_t sent_ns = 0;
  pollfd ready{haptic.event(), POLLIN, 0};
  while (sending) {
    if (poll(&ready, 1, 50) <= 0) continue;
    std::uint64_t cycles;
    (void)!read(haptic.event(), &cycles, sizeof cycles);
    ProbeReports latest;
    if (!haptic.reports_for_sender().take(latest)) continue;
    send_commands(latest);
    exchange.send();
    if (latest.time_ns - sent_ns < gap_ns) continue;
    sent_ns = latest.time_ns;
    states->send(latest, sender_clock.latest());
  }
}

void Hrtc::Impl::send_commands(const ProbeReports& latest) {
  const std::lock_guard lock{remote_mutex};
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
    const RemoteEnd& end = remote_ends[i];
    const ProbeOutput& probe = latest.probes[i];
    if (end.device == nullptr || !probe.active) continue;
    session::DeviceCommand command;
    command.origin = links.origin();
    command.user_id = end.user_id;
    command.probe = i;
    command.sequence = end.device->on_command(latest.time_ns);
    command.pose_answered = probe.pose_sequence;
    command.force = probe.force;
    command.torque = probe.torque;
    command.normal = probe.normal;
    command.status = probe.status;
    command.error_bound = probe.error_bound;
    command.data_age_us = age_us(probe);
    (void)end.commands->send(command);
  }
}

/// What a cycle did that was late by its own work; where several are, one line a second.
void Hrtc::Impl::tell_of_late(const CycleTrace& trace) {
  ++late_untold;
  if (!late_told.due(monotonic_ns())) return;
  const CycleCosts& costs = trace.costs;
  const auto us = [](std::uint32_t ns) { return ns / 1000; };
  spdlog::warn(
      "{} late of its own: {} us of CPU time, of these {} loading, {} refining ({} visits, {} changes), {} refitting, "
      "{} querying, {} on forces, {} waking the sender; {} regions came, {} of {} probes in contact",
      late_untold == 1 ? std::string{"a cycle was"} : fmt::format("{} cycles were, the last", late_untold),
      us(trace.cpu), us(costs.load), us(costs.refine), costs.visits, costs.changes, us(costs.refit), us(costs.query),
      us(costs.force), us(trace.notify), costs.arrivals, trace.in_contact, trace.active);
  late_untold = 0;
}

void Hrtc::Impl::drain_rings() {
  CycleTrace trace;
  while (haptic.traces().pop(trace)) {
    statistics.add(trace);
    if (trace.late && trace.late_is_ours) tell_of_late(trace);
  }
  if (timer) timer->drain(timer_samples);
  if (!log) return;
  const std::vector<Loader::ObjectInfo> objects = loader.objects();
  object_logged.resize(objects.size());
  for (std::size_t i = 0; i < objects.size(); ++i) {
    if (object_logged[i]) continue;
    log->write(trace::LoggedObject{objects[i].index, objects[i].digest, objects[i].scale, objects[i].name});
    object_logged[i] = true;
  }
  while (haptic.log().pop(logged)) log->write(logged);
  if (!log->healthy()) {
    spdlog::error("the contact log {} cannot be written any more (disk full?); the session goes on without it",
                  options.log.string());
    log.reset();
    exit_code = 1;
  }
}

void Hrtc::Impl::snapshot(std::int64_t now_ns, const ProbeReports& latest) {
  if (options.snapshot.empty()) return;
  if (snapshot_asked_ns != 0) {  // one is being copied
    if (haptic.snapshots_done() != commands.snapshots) return;
    for (const Loader::ObjectInfo& object : loader.objects()) {
      const std::vector<SnapshotFace> faces = haptic.snapshot(object.index);
      if (faces.empty()) continue;
      const std::filesystem::path file = options.snapshot / (options.address.participant + "-" + object.name + "-" +
                                                             std::to_string(commands.snapshots) + ".ply");
      try {
        write_snapshot(file, faces, loader.grid(object.index), snapshot_contacts[object.index],
                       snapshot_predictions[object.index]);
      } catch (const std::runtime_error& error) {
        spdlog::error("{}", error.what());
        exit_code = 1;
        options.snapshot.clear();
        return;
      }
      spdlog::info("snapshot {} ({} faces)", file.string(), faces.size());
    }
    snapshot_asked_ns = 0;
    ++snapshots_taken;
    contact_since_ns = 0;
    return;
  }
  if (!touches_exactly(latest)) {
    contact_since_ns = 0;
    return;
  }
  if (contact_since_ns == 0) contact_since_ns = now_ns;
  if (now_ns - contact_since_ns < (snapshots_taken == 0 ? kSnapshotNs / 4 : kSnapshotNs) ||
      snapshots_taken >= kMaxSnapshots)
    return;
  for (const Loader::ObjectInfo& object : loader.objects()) {
    snapshot_contacts[object.index] = loader.regions_met(object.index, sights);
    snapshot_predictions[object.index] = loader.predicted(object.index);
  }
  ++commands.snapshots;
  snapshot_asked_ns = now_ns;
  haptic.commands().post(commands);
}

void Hrtc::Impl::note_first_touch(std::int64_t now_ns) {
  if (first.base_ns == 0 && !loader.objects().empty()) first.base_ns = now_ns;
  if (first.exact_ns != 0 || !touches_exactly(reports)) return;
  first.exact_ns = reports.time_ns;
  first.bytes = loader.delivery_counters().payload_bytes;
}

/// Over the hosts of what tips are near.
void Hrtc::Impl::choose_whom_to_watch(const std::array<NearObjects, kMaxProbes>& near) {
  std::uint64_t objects_near = 0;
  for (const NearObjects& of_probe : near) objects_near |= of_probe.found;
  std::vector<std::uint64_t> hosts;
  for (const Loader::ObjectInfo& object : loader.objects()) {
    const std::uint64_t host = loader.serving_host(object.id);
    if (host != 0 && (objects_near >> object.index & 1u) != 0) hosts.push_back(host);
  }
  vigil.watch(hosts);
}

/// True when a host has just been found silent.
bool Hrtc::Impl::keep_vigil(std::int64_t now_ns) {
  while (auto question = vigil.ask(now_ns)) {
    question->origin = links.origin();
    (void)vigil_out.send(*question);
  }
  const std::vector<session::Vigil::Silent> all_silent = vigil.silent(now_ns);
  for (const session::Vigil::Silent& silent : all_silent) {
    const session::RosterEntry* host = roster.find(silent.host);
    spdlog::warn("host '{}' has not answered for {} ms", host == nullptr ? "?" : host->name, silent.for_ns / kMs);
    loader.on_host_silent(silent.host);
  }
  return !all_silent.empty();
}

/// A line when another host serves an object, and one when its first records are here.
void Hrtc::Impl::tell_of_hosts(std::int64_t now_ns) {
  for (const Loader::ObjectInfo& object : loader.objects()) {
    Serving& serving = servings[object.id];
    const std::uint64_t host = loader.serving_host(object.id);
    if (host != serving.host && host != 0) {
      const session::RosterEntry* entry = roster.find(host);
      const std::string name = entry == nullptr ? "?" : entry->name;
      if (serving.host != 0) spdlog::info("object {} is now served by host '{}'", object.name, name);
      serving = {host, serving.host == 0 ? 0 : now_ns, object.regions_received};
    }
    if (serving.since_ns == 0 || object.regions_received == serving.regions_before) continue;
    spdlog::info("records of object {} come again, {} ms after the change of host", object.name,
                 (now_ns - serving.since_ns) / kMs);
    serving.since_ns = 0;
  }
}

void Hrtc::Impl::tell_of_fault(std::uint32_t slot, std::uint32_t status) {
  const bool fault = (status & session::kFault) != 0;
  if (fault == faults_told[slot]) return;
  faults_told[slot] = fault;
  const auto user = users.find(slot);
  const std::string& name = user == users.end() ? "nobody" : user->second.name;
  if (fault) {
    spdlog::warn("the force of user {} is off until it is reset: {}", name, session::fault_reason(status));
    if (flight) flight->save(session::fault_reason(status), false);
  } else
    spdlog::info("the force of user {} is on again", name);
}

void Hrtc::Impl::tell_of_hold(std::uint32_t slot, const ProbeOutput& probe) {
  constexpr std::uint32_t kHold = session::kHolding | session::kHoldRefused;
  const std::uint32_t now = probe.status & kHold, before = std::exchange(holds_told[slot], now);
  const auto user = users.find(slot);
  if (now == before || user == users.end()) return;
  std::string name = "something";
  for (const Loader::ObjectInfo& object : loader.objects())
    if (object.index == probe.object) name = "'" + object.name + "'";
  if ((now & session::kHolding) != 0) {
    spdlog::info("user {} holds {}", user->second.name, name);
  } else if ((before & session::kHolding) != 0) {
    spdlog::info("user {} has let go", user->second.name);
  } else if ((now & session::kHoldRefused) != 0) {
    spdlog::warn("user {} cannot hold {}: it does not move here, or forces were off since the hand has closed",
                 user->second.name, name);
  }
}

void Hrtc::Impl::serve(std::int64_t now_ns) {
  for (const session::RosterEvent& event : roster.tick(now_ns)) on_event(event, now_ns);
  if (haptic.reports_for_service().take(reports)) {
    if (first_cycle == 0) {
      first_cycle = reports.cycle;
      first_cycle_ns = reports.time_ns;
    }
    for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
      const ProbeOutput& probe = reports.probes[i];
      sights[i] = {probe.active,     (probe.status & session::kInContact) != 0,
                   reports.time_ns,  vec(probe.device),
                   vec(probe.proxy), quaternion(probe.orientation)};
      tell_of_fault(i, probe.status);
      tell_of_hold(i, probe);
    }
  }
  std::array<NearObjects, kMaxProbes> near;
  note_first_touch(now_ns);
  tick_bodies(now_ns);
  loader.tick(now_ns, sights, near);
  haptic.near().post(near);
  for (const Loader::ObjectInfo& object : loader.objects()) object_ids[object.index] = object.id;
  choose_whom_to_watch(near);
  tell_of_hosts(now_ns);
  while (auto demand = loader.demand(now_ns)) {
    demand->origin = links.origin();
    (void)demand_out.send(*demand);
  }
  choose_reference(now_ns);
  if (clock.reference() != 0 && clock.reference() != links.origin().participant && clock_request.due(now_ns)) {
    session::ClockSample request = clock.request(monotonic_ns());
    const std::int64_t sent = request.t0_ns;
    request.origin = links.origin();
    request.t0_ns = sent;
    // A host hears it where nobody else listens.
    const session::RosterEntry* const keeper = roster.find(clock.reference());
    (void)(keeper != nullptr && keeper->role == session::Role::kHost ? vigil_out : clock_out).send(request);
    if (++clock_requests == 10) clock_request.set_period(kClockNs);
  }
  sender_clock.post(clock.map());
  session_offset_ns = clock.map().session_time(now_ns) - now_ns;
  if (heartbeat.due(now_ns)) send_roster(false);
  if (metrics.due(now_ns)) send_metrics(all_metrics.due(now_ns));
  open_remote_devices();
  if (modes.due(now_ns)) tick_modes(now_ns);
  drain_rings();
  if (options.saves != nullptr && saves_seen != *options.saves) {
    saves_seen = *options.saves;
    if (flight) flight->save("asked for by a signal", true);
  }
  snapshot(now_ns, reports);
  if (!host_seen && now_ns - started_ns > kNoHostNs && no_host.due(now_ns))
    spdlog::warn(
        "no host found in session {} on domain {}; still looking (is tactus-host running with the same --session and "
        "--domain?)",
        options.address.session, options.address.domain);
  if (!host_seen && options.host_patience > 0 &&
      static_cast<double>(now_ns - started_ns) > options.host_patience * 1e9) {
    spdlog::error("no host found in session {} on domain {} within {} s", options.address.session,
                  options.address.domain, options.host_patience);
    exit_code = 1;
    ended = true;
  }
}

void Hrtc::Impl::finish() {
  haptic.stop();
  timer.reset();
  sending = false;
  if (sender.joinable()) sender.join();
  drain_rings();
  if (flight && !flight->stop()) exit_code = 1;
  if (haptic.traces_dropped() > 0)
    spdlog::warn("{} cycles are missing in the figures: the service fell behind", haptic.traces_dropped());
  if (inbox.dropped() > 0) spdlog::warn("{} samples found the inbox full and were dropped", inbox.dropped());
  if (log) {
    for (const Loader::ObjectInfo& object : loader.objects())
      log->write(trace::LoggedTotals{object.index, object.records_received, object.records_returned,
                                     object.regions_received, object.regions_released});
    if (haptic.log_dropped() > 0) spdlog::warn("{} contact log entries were dropped", haptic.log_dropped());
    log.reset();
  }
  // Best effort, so said more than once.
  for (int i = 0; i < 3; ++i) {
    send_metrics(true);
    std::this_thread::sleep_for(std::chrono::milliseconds{20});
  }
  for (int i = 0; i < 3; ++i) {
    send_roster(true);
    std::this_thread::sleep_for(std::chrono::milliseconds{10});  // so that one burst of loss does not take all
  }
}

int Hrtc::Impl::run(const std::atomic<bool>& stop) {
  if (options.haptic.priority > 0) spdlog::info("{}", wire::lock_memory());
  started_ns = monotonic_ns();
  haptic.commands().post(commands);
  if (flight) {
    flight->on_event = [](bool trouble, const std::string& text) {
      spdlog::log(trouble ? spdlog::level::warn : spdlog::level::info, "{}", text);
    };
    flight->start();
    spdlog::info("flight recorder: the last {:g} s, {:.1f} MiB at most", options.flight.seconds,
                 static_cast<double>(flight->most_bytes()) / (1 << 20));
  }
  spdlog::info("{}", haptic.start());
  if (options.timer_beside) timer = std::make_unique<TimerBeside>(options.haptic.period_ns(), options.haptic.priority);
  sending = true;
  sender = std::thread{[this] { send_states(); }};
  spdlog::info(
      "{} serves {} probes in session {} on domain {}; pool of {} slots, {:.1f} MiB{}", options.address.participant,
      options.max_users, options.address.session, options.address.domain, options.pool.slots,
      static_cast<double>(options.pool.bytes()) / (1 << 20),
      options.directory_bytes == ~std::uint64_t{0}
          ? std::string{}
          : fmt::format(", and {:.1f} MiB for directories", static_cast<double>(options.directory_bytes) / (1 << 20)));
  // However many samples come, for their number grows with the square of a session's size; and a share of a core at
  // most, for on a machine that is short of time answers come later, so that more has to be told ahead, which takes
  // time. Whether hosts live is asked between passes, too.
  Every due{kServiceNs}, look{kVigilNs};
  while (!stop && !ended) {
    const std::int64_t before_ns = monotonic_ns();
    const auto patience = vigil.watches() ? std::min(due.left(before_ns), look.left(before_ns)) : due.left(before_ns);
    for (const Inbox::Arrived& arrived : inbox.take(patience))
      std::visit([&](const auto& sample) { take(sample, arrived.at_ns); }, arrived.sample);
    const std::int64_t now_ns = monotonic_ns();
    if (vigil.watches() && look.due(now_ns) && keep_vigil(now_ns)) due.at_once();
    look.set_period(vigil.at_ease() ? kVigilEaseNs : kVigilNs);
    if (!due.due(now_ns)) continue;
    serve(now_ns);
    const std::int64_t least_ns = loader.at_rest() ? kServiceRestingNs : kServiceNs;
    due.set_period(std::clamp(kServiceRest * (monotonic_ns() - now_ns), least_ns, kServiceMostNs));
  }
  finish();
  return exit_code;
}

Hrtc::Hrtc(HrtcOptions options) : impl_{std::make_unique<Impl>(std::move(options))} {}
Hrtc::~Hrtc() = default;
int Hrtc::run(const std::atomic<bool>& stop) { return impl_->run(stop); }

}  // namespace tactus::hrtc_service
