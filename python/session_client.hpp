/// A participant for scripts: observes a session, and moves the simulated hands of its own users.
///
/// A thread of its own publishes roster entries, follows session time, sends intents and stores the samples that
/// arrive. Callers read copies of what is stored, so neither this thread nor a thread of DDS ever calls a script.
/// Threads: any.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <variant>
#include <vector>

#include "python/received.hpp"
#include "session/clock.hpp"
#include "session/roster.hpp"
#include "session/stop_latch.hpp"
#include "wire/endpoints.hpp"
#include "wire/inbox.hpp"

namespace tactus::python {

/// The path of a hand: linear between positions at equal intervals of session time.
struct HandMotion {
  std::vector<std::array<double, 3>> path;
  std::int64_t begin_ns = 0, interval_ns = 0;  // session time
  [[nodiscard]] std::int64_t end_ns() const noexcept {
    return begin_ns + static_cast<std::int64_t>(path.size() - 1) * interval_ns;
  }
  /// Position at a session time; the first or last position outside of the path.
  [[nodiscard]] std::array<double, 3> at(std::int64_t session_ns) const noexcept;
};

class SessionClient {
 public:
  /// Time from the discovery of the first host or HRTC until all are assumed discovered, as in `tactus control`.
  static constexpr std::int64_t kDiscoveryNs = 1'500'000'000;

  /// Joins the session. Throws wire::WireError.
  explicit SessionClient(const wire::SessionAddress& address);
  /// Leaves the session.
  ~SessionClient();
  SessionClient(const SessionClient&) = delete;
  SessionClient& operator=(const SessionClient&) = delete;

  struct Member {
    session::RosterEntry entry;
    bool is_late = false;
    std::map<std::string, double> figures;  ///< of topic tactus_metrics
  };
  /// The other participants, by name.
  [[nodiscard]] std::map<std::string, Member> members() const;
  /// The objects that a host offers, by name.
  [[nodiscard]] std::map<std::string, session::CatalogueEntry> objects() const;
  /// The newest state of a user's probe; none before the first.
  [[nodiscard]] std::optional<StateRow> newest_state(const std::string& user) const;
  /// Returns the states of a user's probe that have arrived since the last call, oldest first.
  [[nodiscard]] std::vector<StateRow> take_states(const std::string& user);

  /// Session time, ns; none before the clock is synchronised.
  [[nodiscard]] std::optional<std::int64_t> session_time() const;
  /// The reason for which this program cannot stay, or for which the session ended. Empty: it continues.
  [[nodiscard]] std::string end_reason() const;

  /// Requests a probe for a user from an HRTC. One caller at a time. Throws std::invalid_argument if a roster entry
  /// cannot have one of the names, or one more user, or if a user of this object has another HRTC: a participant brings
  /// its users to one. Throws wire::WireError if the keys do not permit the user.
  void add_user(const std::string& user, const std::string& hrtc);
  /// Returns whether the HRTC serves the user.
  [[nodiscard]] bool is_served(const std::string& user) const;
  /// Publishes a sample of `topic` to all programs. The caller repeats stops and resets until all have acknowledged
  /// them. Throws std::invalid_argument if a text is too long or has a wrong form.
  void publish(session::EmergencyStop& stop);
  void publish(session::ForceReset& reset);
  void publish(session::Control& control);
  void publish(session::SessionEnd& end);
  /// The number of a new stop or reset of this participant.
  [[nodiscard]] std::uint32_t new_number() { return ++numbers_; }
  /// Records the hosts and HRTCs that are present.
  void update(session::Recipients& recipients) const {
    const std::lock_guard lock{mutex_};
    recipients.update(roster_);
  }
  /// The stops that stand at a host or HRTC.
  [[nodiscard]] std::vector<session::StopName> standing_stops() const;
  /// Returns whether the first host or HRTC was found at least kDiscoveryNs ago. All are assumed discovered then,
  /// because discovery reports no end.
  [[nodiscard]] bool has_discovered() const;

  /// Moves the hand of an added user along a path that begins `lead_ns` from now. Returns the motion's begin and end,
  /// session time.
  std::pair<std::int64_t, std::int64_t> move(const std::string& user, std::vector<std::array<double, 3>> path,
                                             std::int64_t interval_ns, std::int64_t lead_ns);

 private:
  using Sample = std::variant<session::RosterEntry, session::CatalogueEntry, session::ProbeState, session::Metrics,
                              session::SessionEnd, session::ClockSample>;
  struct User {
    HandMotion motion;
    std::uint32_t intents = 0;                              // sent so far
    std::int64_t sent_ns = 0;                               // of the last intent, monotonic clock
    std::unique_ptr<wire::Writer<session::Intent>> writer;  // only the client's thread uses it
  };

  template <class Typed>
  void listen(const wire::TopicSpec<Typed>& topic);
  template <class Typed>
  void publish(std::unique_ptr<wire::Writer<Typed>>& writer, const wire::TopicSpec<Typed>& topic, Typed& sample);
  void run();
  void on_sample(const session::RosterEntry& entry, std::int64_t now_ns);
  void on_sample(const session::CatalogueEntry& entry, std::int64_t now_ns);
  void on_sample(const session::ProbeState& state, std::int64_t now_ns);
  void on_sample(const session::Metrics& metrics, std::int64_t now_ns);
  void on_sample(const session::SessionEnd& end, std::int64_t now_ns);
  void on_sample(const session::ClockSample& sample, std::int64_t now_ns);
  void on_events(const std::vector<session::RosterEvent>& events);
  void send_roster_entry(bool leaving);
  void request_clock(std::int64_t now_ns);
  void send_intents(std::int64_t now_ns);
  [[nodiscard]] std::int64_t session_now() const;

  wire::Participants participants_;
  wire::Writer<session::RosterEntry> roster_out_;
  wire::Writer<session::ClockSample> clock_out_;
  wire::Inbox<Sample> inbox_{1u << 15};

  mutable std::mutex mutex_;  // for the members below
  session::RosterEntry self_;
  session::SessionClock clock_;
  session::Roster roster_;
  OfferedObjects objects_;
  std::map<std::uint64_t, std::map<std::string, double>> figures_;  // by participant
  ReceivedStates states_;
  std::map<std::string, User> users_;
  std::string end_reason_;
  std::int64_t found_ns_ = 0;  // time at which the first host or HRTC was found, monotonic clock; 0: none yet

  // Writers of an operator, created when a script first needs them. Only callers use them, one at a time.
  std::unique_ptr<wire::Writer<session::EmergencyStop>> stop_out_;
  std::unique_ptr<wire::Writer<session::ForceReset>> reset_out_;
  std::unique_ptr<wire::Writer<session::Control>> control_out_;
  std::unique_ptr<wire::Writer<session::SessionEnd>> end_out_;
  std::uint32_t numbers_ = 0;

  std::atomic<std::int64_t> beat_ns_{0};  // monotonic clock; time of the newest roster entry, 0: send one at once
  std::int64_t clock_requested_ns_ = 0;   // only the client's thread uses it
  std::atomic<bool> stops_{false};
  std::thread thread_;
  std::vector<std::shared_ptr<void>> readers_;  // last, so that callbacks end before other members are destroyed
};

}  // namespace tactus::python
