#include "client_sim/sim.hpp"

#include <chrono>
#include <map>
#include <utility>
#include <variant>
#include <vector>

#include "client_sim/remote_hand.hpp"
#include "session/clock.hpp"
#include "session/time_reference.hpp"
#include "sharing/hand_path.hpp"
#include "wire/endpoints.hpp"
#include "wire/inbox.hpp"

namespace tactus::client_sim {
namespace {

using realtime::monotonic_ns;

using Sample = std::variant<session::RosterEntry, session::CatalogueEntry, session::ProbeState, session::Metrics,
                            session::EmergencyStop, session::ForceReset, session::SessionEnd, session::ClockSample,
                            session::ObjectPose>;
using Inbox = wire::Inbox<Sample>;

constexpr std::int64_t kClockRequestNs = 100'000'000;  // between two clock requests, once the clock is synchronised
constexpr auto kTick = std::chrono::milliseconds{2};

/// One participant of this program.
struct Presence {
  explicit Presence(const wire::SessionAddress& address)
      : participants{address}, roster{participants, wire::topics::kRoster}, clock{participants, wire::topics::kClock} {}

  void send(session::Intent intent) {
    auto& writer = intents[intent.user_id];
    intent.origin = participants.origin();
    if (writer) (void)writer->send(intent);
  }

  wire::Participants participants;
  wire::Writer<session::RosterEntry> roster;
  wire::Writer<session::ClockSample> clock;
  std::map<std::uint64_t, std::unique_ptr<wire::Writer<session::Intent>>> intents;  // by user
};

/// A user with a device at the client.
struct RemoteUser {
  RemoteHandSettings settings;
  std::unique_ptr<RemoteHand> hand;  // created at its first intent
};

}  // namespace

struct Sim::Impl {
  explicit Impl(SimOptions given)
      : options{std::move(given)},
        main{options.address},
        core{options.scenario, settings()},
        clock{main.participants.origin(), {}, monotonic_ns()},
        roster{main.participants.origin(), {}} {
    if (main.participants.may_write(wire::topics::kEnd.name)) end_out.emplace(main.participants, wire::topics::kEnd);
    listen(wire::topics::kRoster);
    listen(wire::topics::kCatalogue);
    listen(wire::topics::kProbeState);
    listen(wire::topics::kMetrics);
    listen(wire::topics::kObjectPose);
    listen(wire::topics::kStop);
    listen(wire::topics::kReset);
    listen(wire::topics::kEnd);
    listen(wire::topics::kClock);
  }

  [[nodiscard]] SimSettings settings() const {
    SimSettings made;
    made.session = options.address.session;
    made.name = options.address.participant;
    made.patience = options.patience;
    made.mode = options.mode;
    made.incarnation = main.participants.origin().incarnation;
    return made;
  }

  template <class Typed>
  void listen(const wire::TopicSpec<Typed>& topic) {
    readers.push_back(std::make_shared<wire::Reader<Typed>>(main.participants, topic, [this](Typed&& sample) {
      inbox.put(std::move(sample), wire::kIsSentOnce<Typed> ? wire::Urgency::kMustArrive : wire::Urgency::kWakes);
    }));
  }

  void on_sample(const session::RosterEntry& entry, std::int64_t now_ns) {
    (void)roster.on_entry(entry, now_ns);
    core.on_roster(entry, now_ns);
  }
  void on_sample(const session::CatalogueEntry& entry, std::int64_t) { core.on_catalogue(entry); }
  void on_sample(const session::ProbeState& state, std::int64_t now_ns) {
    core.on_probe_state(state, clock.map().session_time(now_ns));
  }
  void on_sample(const session::Metrics& metrics, std::int64_t now_ns) { core.on_metrics(metrics, now_ns); }
  void on_sample(const session::EmergencyStop& stop, std::int64_t) { core.on_stop(stop); }
  void on_sample(const session::ForceReset& reset, std::int64_t) { core.on_reset(reset); }
  void on_sample(const session::SessionEnd& end, std::int64_t) { core.on_end(end); }
  void on_sample(const session::ObjectPose& pose, std::int64_t) { core.on_object_pose(pose); }
  void on_sample(const session::ClockSample& sample, std::int64_t now_ns) {
    if (sample.answer && sample.peer == main.participants.origin().participant) clock.on_answer(sample, now_ns);
  }

  /// Returns the participant with this id; if it is new, it joins the session.
  Presence& presence_of(std::uint64_t participant, const std::string& name) {
    if (participant == main.participants.origin().participant) return main;
    std::unique_ptr<Presence>& presence = others[participant];
    if (!presence) {
      wire::SessionAddress address = options.address;
      address.participant = name;
      address.incarnation = main.participants.origin().incarnation;
      presence = std::make_unique<Presence>(address);
    }
    return *presence;
  }

  void send(SimMessages&& messages) {
    for (session::RosterEntry& entry : messages.roster) {
      Presence& from = presence_of(entry.origin.participant, entry.name);
      for (const std::string& user : entry.users) {
        from.participants.expect_permitted(user);
        if (const User* const remote = find_remote(user)) {
          RemoteHandSettings& hand = remotes[session::id_of(user)].settings;
          hand.user = user;
          hand.hrtc = entry.requested_hrtc;
          hand.radius = remote->radius;
          continue;
        }
        auto& writer = from.intents[session::id_of(user)];
        if (!writer)
          writer = std::make_unique<wire::Writer<session::Intent>>(from.participants, wire::topics::kIntent,
                                                                   wire::EndpointOptions{wire::user_partition(user)});
      }
      entry.origin = from.participants.origin();
      session::put_time(clock, false, monotonic_ns(), entry);
      (void)from.roster.send(entry);
      if (entry.leaving) leave_messages.emplace_back(&from, entry);
    }
    for (session::Control& control : messages.control) {
      control.origin = main.participants.origin();
      (void)control_out.send(control);
    }
    for (session::SessionEnd& end : messages.ends) {
      end.origin = main.participants.origin();
      if (end_out) (void)end_out->send(end);
    }
    for (session::Intent& intent : messages.intents) {
      const auto other = others.find(intent.origin.participant);
      Presence& from = other == others.end() ? main : *other->second;
      const auto remote = remotes.find(intent.user_id);
      if (remote == remotes.end())
        from.send(std::move(intent));
      else
        move_remote_hand(remote->second, from, intent);
    }
  }

  /// Returns the user with this name if its device is at the client, otherwise null.
  [[nodiscard]] const User* find_remote(const std::string& user) const {
    for (const User& candidate : options.scenario.users)
      if (candidate.name == user && candidate.has_remote_device) return &candidate;
    return nullptr;
  }

  /// Passes an intent to the user's simulated hand. The first intent sets the initial position.
  void move_remote_hand(RemoteUser& remote, Presence& from, const session::Intent& intent) {
    if (!remote.hand) {
      sharing::set_start(intent, remote.settings.hand);
      remote.hand = std::make_unique<RemoteHand>(from.participants, remote.settings);
    }
    remote.hand->set_intent(intent, clock.map());
  }

  void update_session_clock(std::int64_t now_ns) {
    session::update_session_clock(roster, main.participants.origin(), session::Role::kClient, false, now_ns, clock);
    core.set_own_presence(clock.map().session_time(now_ns), clock.joined_ns());
    if (clock.reference() == 0) return;
    const std::int64_t period = clock.synchronised() ? kClockRequestNs : kClockRequestNs / 5;
    if (now_ns - clock_requested_ns < period) return;
    clock_requested_ns = now_ns;
    session::ClockSample request = clock.request(monotonic_ns());
    request.origin = main.participants.origin();
    (void)main.clock.send(request);
  }

  void leave() {
    wire::send_leave_messages([this] {
      for (const auto& [from, entry] : leave_messages) (void)from->roster.send(entry);
    });
    if (end_out) (void)end_out->wait_acknowledged(std::chrono::milliseconds{200});
  }

  SimOptions options;
  Presence main;
  wire::Writer<session::Control> control_out{main.participants, wire::topics::kControl};
  std::optional<wire::Writer<session::SessionEnd>> end_out;  // nothing: the keys do not permit to end the session
  std::map<std::uint64_t, std::unique_ptr<Presence>> others;
  std::map<std::uint64_t, RemoteUser> remotes;  // by user
  std::vector<std::pair<Presence*, session::RosterEntry>> leave_messages;
  SimCore core;
  session::SessionClock clock;
  session::Roster roster;
  std::int64_t clock_requested_ns = 0;
  Inbox inbox{1u << 15};
  std::vector<std::shared_ptr<void>> readers;  // last, so that callbacks end before other members are destroyed
};

Sim::Sim(SimOptions options) : impl_{std::make_unique<Impl>(std::move(options))} {}
Sim::~Sim() = default;

Report Sim::run(const std::atomic<bool>& stop, const std::function<void(const std::string&)>& log) {
  Impl& sim = *impl_;
  if (!sim.end_out) log("these keys do not permit to end the session, so its other programs go on; an operator's do");
  std::string last_logged;
  bool stopped = false;
  while (!sim.core.finished()) {
    for (const Inbox::Arrived& arrived : sim.inbox.take(kTick))
      std::visit([&](const auto& sample) { sim.on_sample(sample, arrived.at_ns); }, arrived.sample);
    const std::int64_t now_ns = monotonic_ns();
    (void)sim.roster.tick(now_ns);
    sim.update_session_clock(now_ns);
    if (stop && !stopped) {
      sim.core.stop("interrupted");
      stopped = true;
    }
    sim.send(sim.core.tick(now_ns, sim.clock.map().session_time(now_ns)));
    if (sim.core.stop_reason() != last_logged && !sim.core.name_taken()) {
      last_logged = sim.core.stop_reason();
      if (!last_logged.empty()) log(stopped || sim.core.finished() ? last_logged : "waiting: " + last_logged);
    }
  }
  sim.leave();
  if (sim.core.name_taken()) throw NameTaken(sim.core.stop_reason());
  Report report = sim.core.report();
  report.implausible += sim.clock.implausible();
  for (const auto& [user, remote] : sim.remotes)
    if (remote.hand) report.implausible += remote.hand->implausible();
  return report;
}

}  // namespace tactus::client_sim
