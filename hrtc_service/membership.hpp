/// Who is in the session, whose clock it goes by, which hosts are alive, and which users have a probe here.
///
///     roster, clock, catalogue, probe states  -->  Membership  -->  roster entry, clock samples, users in and out
///                                                    |    ^
///                         hosts seen, gone, silent   v    |  probes, objects
///                                                   Gateway
///
/// Policy without DDS, thread, clock, file or log: samples and times come as arguments; what is to be sent or logged
/// is in `output` until `clear`. One thread at a time. Not realtime.
#pragma once

#include <array>
#include <cstdint>
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

/// A user who has a probe from now on, or no longer.
struct UserChange {
  bool joined = false;
  std::uint32_t probe = 0;
  std::uint64_t id = 0, client = 0;
  std::string name;
};

/// What the adapter shall do.
struct MembershipOutput {
  std::optional<session::RosterEntry> roster;
  std::vector<session::ClockSample> clock;          ///< to everyone
  std::vector<session::ClockSample> clock_to_host;  ///< in this HRTC's own partition, where hosts listen
  std::vector<UserChange> users;
  std::vector<SessionEvent> events;
  bool scene_changed = false;  ///< somebody came or went: publish metrics soon
  bool name_conflict = false;  ///< another program has this name, and this one has to end
  void clear() { *this = {}; }
};

class Membership {
 public:
  /// `gateway` must outlive it.
  Membership(const session::Origin& self, const MembershipSettings& settings, Gateway& gateway, std::int64_t now_ns);

  MembershipOutput output;

  void on_roster(const session::RosterEntry& entry, std::int64_t now_ns);
  void on_catalogue(const session::CatalogueEntry& entry);
  /// `arrived_ns` when the sample came, `now_ns` when the answer leaves.
  void on_clock(const session::ClockSample& sample, std::int64_t arrived_ns, std::int64_t now_ns);
  /// An answer in this HRTC's own partition: to the failure detector, or for the time.
  void on_host_answer(const session::ClockSample& answer, std::int64_t now_ns);
  void on_state(const session::ProbeState& state, session::StateStream stream, std::int64_t now_ns);
  void on_metrics(const session::Metrics& metrics, std::int64_t now_ns) { remote_users_.on_metrics(metrics, now_ns); }
  void on_mode(const std::string& text);
  /// The stops that the servo has obeyed: the next roster entry acknowledges them, at once.
  void on_stops(const std::vector<session::StopRecord>& stops);
  /// A user whose device is at this machine; none when all probes are taken.
  [[nodiscard]] std::optional<std::uint32_t> add_local(const std::string& name);

  /// Every few milliseconds, after the gateway's tick.
  void tick(std::int64_t now_ns);
  /// Between ticks, as often as `watches` says: asks the hosts of near objects whether they live. True when one was
  /// just found silent.
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
  [[nodiscard]] std::uint64_t false_alarms() const noexcept { return failure_detector_.false_alarms(); }
  [[nodiscard]] std::uint64_t implausible() const noexcept {
    return roster_.implausible() + remote_users_.implausible();
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
