/// Manages the roster, the time reference, the failure detection of hosts, and the users who have a probe of this HRTC.
///
///     roster, clock, catalogue, probe states  -->  Membership  -->  roster entry, clock samples, changes of users
///                                                    |    ^
///                         hosts seen, gone, silent   v    |  probes, objects
///                                                   Gateway
///
/// No DDS, thread, clock, file or log: samples and times are arguments. `output` collects samples to send and lines to
/// log until `clear`. One thread at a time. Not realtime.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "hrtc_service/gateway.hpp"
#include "hrtc_service/remote_users.hpp"
#include "session/clock.hpp"
#include "session/failure_detector.hpp"
#include "session/periodic.hpp"
#include "session/roster.hpp"
#include "session/severity.hpp"

namespace tactus::hrtc_service {

struct MembershipSettings {
  std::string name, session;
  std::uint32_t max_users = kMaxProbes;
  /// id_of the users who had the probes under an earlier gateway, by probe; 0: none. They get the same ones.
  std::array<std::uint64_t, kMaxProbes> earlier_users{};
  /// Returns whether the keys of this program permit it to serve a user whom the program with the id `client` brings.
  /// Empty: it may serve all.
  std::function<bool(const std::string& user, std::uint64_t client)> may_serve{};
};

struct SessionEvent {
  session::Severity severity = session::Severity::kInfo;
  std::string text;
};

/// A user who gets a probe, or who leaves it.
struct UserChange {
  bool joined = false;  ///< false: the user has left
  std::uint32_t probe = 0;
  std::uint64_t id = 0, client = 0;
  std::string name;
};

/// Samples, user changes and events for the adapter.
struct MembershipOutput {
  std::optional<session::RosterEntry> roster;
  std::vector<session::ClockSample> clock;          ///< for all participants
  std::vector<session::ClockSample> clock_to_host;  ///< for hosts, in this HRTC's own partition
  std::vector<UserChange> users;
  std::vector<SessionEvent> events;
  bool scene_changed = false;  ///< a participant joined or left: publish metrics soon
  bool name_conflict = false;  ///< an older program has the name of this one, so this one must end
  void clear() { *this = {}; }
};

class Membership {
 public:
  /// `gateway` must outlive it.
  Membership(const session::Origin& self, const MembershipSettings& settings, Gateway& gateway, std::int64_t now_ns);

  MembershipOutput output;

  /// Called when Gateway::on_object_gone is called, with the same argument.
  std::function<void(const Loader::ObjectInfo&)> on_object_gone;

  void on_roster(const session::RosterEntry& entry, std::int64_t now_ns);
  void on_catalogue(const session::CatalogueEntry& entry);
  /// `arrived_ns`: arrival of the sample; `now_ns`: time at which its answer is sent.
  void on_clock(const session::ClockSample& sample, std::int64_t arrived_ns, std::int64_t now_ns);
  /// Processes an answer of a host, for the failure detector and the clock.
  void on_host_answer(const session::ClockSample& answer, std::int64_t now_ns);
  void on_state(const session::ProbeState& state, session::StateStream stream, std::int64_t now_ns);
  void on_metrics(const session::Metrics& metrics, std::int64_t now_ns) { remote_users_.on_metrics(metrics, now_ns); }
  void on_mode(const std::string& text);
  /// Sets the stops that the servo has obeyed. A roster entry acknowledges them at once.
  void on_stops(const std::vector<session::StopRecord>& stops);
  /// Adds a user whose device is at this machine. Returns the probe, or nothing when all probes are in use.
  [[nodiscard]] std::optional<std::uint32_t> add_local(const std::string& name);

  /// Call it every few milliseconds, after the gateway's tick.
  void tick(std::int64_t now_ns);
  /// Requests an answer from each host that serves an object near a probe. Call it every `watch_period_ns`. Returns
  /// true if the failure detector has a new suspect.
  [[nodiscard]] bool watch_hosts(std::int64_t now_ns);
  /// Returns the time between two calls of `watch_hosts`, ns. 0: no call is needed, because no host serves an object
  /// near a probe.
  [[nodiscard]] std::int64_t watch_period_ns() const noexcept;
  struct ClockRequest {
    session::ClockSample sample;
    bool to_host = false;  ///< send it in this HRTC's own partition
  };
  /// Returns the next request to the time reference, if one is due. `now_ns`: time at which it is sent.
  [[nodiscard]] std::optional<ClockRequest> clock_request(std::int64_t now_ns);
  /// Returns the roster entry of this program. `leaving`: it is the leave message.
  [[nodiscard]] session::RosterEntry roster_entry(bool leaving, std::int64_t now_ns);

  [[nodiscard]] const session::Roster& roster() const noexcept { return roster_; }
  [[nodiscard]] const session::ClockMap& clock() const noexcept { return clock_.map(); }
  [[nodiscard]] RemoteUsers& remote_users() noexcept { return remote_users_; }
  [[nodiscard]] const RemoteUsers& remote_users() const noexcept { return remote_users_; }
  /// Returns the ids of the users by probe, 0 where there is no user.
  [[nodiscard]] std::array<std::uint64_t, kMaxProbes> user_ids() const;
  /// Returns the name of the probe's user, or "nobody".
  [[nodiscard]] const std::string& name_at(std::uint32_t probe) const;
  [[nodiscard]] bool has_user(std::uint32_t probe) const { return users_.count(probe) != 0; }
  [[nodiscard]] bool has_found_host() const noexcept { return has_found_host_; }
  [[nodiscard]] std::uint64_t false_suspicions() const noexcept { return failure_detector_.false_suspicions(); }
  [[nodiscard]] std::uint64_t implausible() const noexcept {
    return roster_.implausible() + clock_.implausible() + remote_users_.implausible();
  }
  /// Returns whether a force is on or was on within the last 0.2 s. Session time must not step during this time.
  [[nodiscard]] bool is_force_on(std::int64_t now_ns) const noexcept;

 private:
  struct User {
    std::string name;
    std::uint64_t id = 0;
    std::uint64_t client = 0;                                // participant; 0: the user's device is at this machine
    std::uint64_t incarnation = 0;                           // of the program that listed the user at its last change
    std::optional<std::int64_t> unlisted_ns = std::nullopt;  // time since which no present program lists the user
  };
  /// The host that serves an object.
  struct Serving {
    std::uint64_t host = 0;
    std::int64_t since_ns = 0;         // time of the change of host; 0: records of the new host have arrived
    std::uint64_t regions_before = 0;  // regions of the object received before the change
  };

  void report(session::Severity severity, std::string text) { output.events.push_back({severity, std::move(text)}); }
  void on_event(const session::RosterEvent& event, std::int64_t now_ns);
  void on_client(const session::RosterEvent& event, bool is_gone);
  void add_users(const session::RosterEntry& client);
  void renew_users(const session::RosterEntry& client);
  void remove_unlisted(std::int64_t now_ns);
  template <class Departed>
  std::vector<std::uint64_t> remove_users(Departed&& departed);
  void remove_user(std::uint64_t client, const std::string& name);
  void track_forces(std::int64_t now_ns);
  void choose_hosts_to_watch();
  void report_host_changes(std::int64_t now_ns);
  [[nodiscard]] std::string host_name(std::uint64_t host) const;

  session::Origin self_;
  MembershipSettings settings_;
  Gateway& gateway_;
  session::Roster roster_;
  session::SessionClock clock_;
  session::FailureDetector failure_detector_;
  RemoteUsers remote_users_;
  session::UserTable user_table_;
  std::map<std::uint32_t, User> users_;       // by probe
  std::map<std::uint64_t, Serving> serving_;  // by object
  std::vector<session::StopRecord> stops_;
  session::Heartbeat heartbeat_;
  session::PeriodicTimer clock_request_, modes_, objects_moved_;
  std::uint32_t clock_requests_ = 0;
  std::uint64_t heartbeats_ = 0;
  std::int64_t last_force_ns_;  // last time when a force was on
  bool has_found_host_ = false;
};

}  // namespace tactus::hrtc_service
