/// Manages the roster, the time reference, the liveness of hosts, and the users who have a probe here.
///
///     roster, clock, catalogue, probe states  -->  Membership  -->  roster entry, clock samples, users in and out
///                                                    |    ^
///                         hosts seen, gone, silent   v    |  probes, objects
///                                                   Gateway
///
/// Policy without DDS, thread, clock, file or log: samples and times are arguments; `output` holds samples to send and
/// lines to log until `clear`. One thread at a time. Not realtime.
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

namespace tactus::hrtc_service {

struct MembershipSettings {
  std::string name, session;
  std::uint32_t max_users = kMaxProbes;
};

struct SessionEvent {
  enum class Severity : std::uint8_t { kInfo, kWarning, kError } severity = Severity::kInfo;
  std::string text;
};

/// A user who gets a probe, or gives it back.
struct UserChange {
  bool joined = false;
  std::uint32_t probe = 0;
  std::uint64_t id = 0, client = 0;
  std::string name;
};

/// The orders for the adapter.
struct MembershipOutput {
  std::optional<session::RosterEntry> roster;
  std::vector<session::ClockSample> clock;          ///< to everyone
  std::vector<session::ClockSample> clock_to_host;  ///< in this HRTC's own partition, where hosts listen
  std::vector<UserChange> users;
  std::vector<SessionEvent> events;
  bool scene_changed = false;  ///< a participant joined or left: publish metrics soon
  bool name_conflict = false;  ///< another program has this name, so this one must end
  void clear() { *this = {}; }
};

class Membership {
 public:
  /// `gateway` must outlive it.
  Membership(const session::Origin& self, const MembershipSettings& settings, Gateway& gateway, std::int64_t now_ns);

  MembershipOutput output;

  /// After an object was forgotten, see Gateway::on_object_gone.
  std::function<void(const Loader::ObjectInfo&)> on_object_gone;

  void on_roster(const session::RosterEntry& entry, std::int64_t now_ns);
  void on_catalogue(const session::CatalogueEntry& entry);
  /// `arrived_ns` when the sample came, `now_ns` when the answer leaves.
  void on_clock(const session::ClockSample& sample, std::int64_t arrived_ns, std::int64_t now_ns);
  /// An answer in this HRTC's own partition, for the failure detector or for the clock.
  void on_host_answer(const session::ClockSample& answer, std::int64_t now_ns);
  void on_state(const session::ProbeState& state, session::StateStream stream, std::int64_t now_ns);
  void on_metrics(const session::Metrics& metrics, std::int64_t now_ns) { remote_users_.on_metrics(metrics, now_ns); }
  void on_mode(const std::string& text);
  /// Sets the stops that the servo has obeyed; the next roster entry, which is due at once, acknowledges them.
  void on_stops(const std::vector<session::StopRecord>& stops);
  /// Adds a user whose device is at this machine. Returns the probe; none when all probes are in use.
  [[nodiscard]] std::optional<std::uint32_t> add_local(const std::string& name);

  /// Every few milliseconds, after the gateway's tick.
  void tick(std::int64_t now_ns);
  /// Between ticks, as often as `watches` says: requests an answer of each host of a near object. True when the failure
  /// detector has just reported one.
  [[nodiscard]] bool watch_hosts(std::int64_t now_ns);
  /// ns between two calls of watch_hosts; 0: no host needs it.
  [[nodiscard]] std::int64_t watch_period_ns() const noexcept;
  struct ClockRequest {
    session::ClockSample sample;
    bool to_host = false;  ///< in this HRTC's own partition, where hosts listen
  };
  /// The next request to the reference of session time, if one is due; `now_ns` when it leaves.
  [[nodiscard]] std::optional<ClockRequest> clock_request(std::int64_t now_ns);
  /// This program's roster entry now; `leaving`: the last one.
  [[nodiscard]] session::RosterEntry roster_entry(bool leaving, std::int64_t now_ns);

  [[nodiscard]] const session::Roster& roster() const noexcept { return roster_; }
  [[nodiscard]] const session::ClockMap& clock() const noexcept { return clock_.map(); }
  [[nodiscard]] RemoteUsers& remote_users() noexcept { return remote_users_; }
  [[nodiscard]] const RemoteUsers& remote_users() const noexcept { return remote_users_; }
  /// Ids by probe, 0 where there is no user.
  [[nodiscard]] std::array<std::uint64_t, kMaxProbes> user_ids() const;
  /// "nobody" where there is none.
  [[nodiscard]] const std::string& name_at(std::uint32_t probe) const;
  [[nodiscard]] bool taken(std::uint32_t probe) const { return users_.count(probe) != 0; }
  [[nodiscard]] bool host_seen() const noexcept { return host_seen_; }
  [[nodiscard]] std::uint64_t false_suspicions() const noexcept { return failure_detector_.false_suspicions(); }
  [[nodiscard]] std::uint64_t implausible() const noexcept {
    return roster_.implausible() + clock_.implausible() + remote_users_.implausible();
  }
  /// A force is on, or was a moment ago: then session time must not step.
  [[nodiscard]] bool force_on(std::int64_t now_ns) const noexcept;

 private:
  struct User {
    std::string name;
    std::uint64_t id = 0;
    std::uint64_t client = 0;  // participant; 0: a device of our own
  };
  /// Which host serves an object, and since when without its first records.
  struct Serving {
    std::uint64_t host = 0;
    std::int64_t since_ns = 0;  // 0: its records have come
    std::uint64_t regions_before = 0;
  };

  void say(SessionEvent::Severity severity, std::string text) { output.events.push_back({severity, std::move(text)}); }
  void on_event(const session::RosterEvent& event, std::int64_t now_ns);
  void on_client(const session::RosterEvent& event, bool gone);
  void add_users(const session::RosterEntry& client);
  void remove_user(std::uint64_t client, const std::string& name);
  void follow_forces(std::int64_t now_ns);
  void choose_hosts_to_watch();
  void follow_serving_hosts(std::int64_t now_ns);
  [[nodiscard]] std::string host_name(std::uint64_t host) const;

  session::Origin self_;
  MembershipSettings settings_;
  Gateway& gateway_;
  session::Roster roster_;
  session::SessionClock clock_;
  session::FailureDetector failure_detector_;
  RemoteUsers remote_users_;
  session::UserSlots slots_;
  std::map<std::uint32_t, User> users_;       // by probe
  std::map<std::uint64_t, Serving> serving_;  // by object
  std::vector<session::StopRecord> stops_;
  session::Heartbeat heartbeat_;
  session::Every clock_request_, modes_, objects_moved_;
  std::uint32_t clock_requests_ = 0;
  std::uint64_t beats_ = 0;
  std::int64_t force_ns_;  // when a force was on last
  bool host_seen_ = false;
};

}  // namespace tactus::hrtc_service
