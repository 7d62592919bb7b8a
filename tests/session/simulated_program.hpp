/// The base class of all programs of a simulated session, with presence and session time. This header also defines the
/// clients, which have users.
///
/// Roster and SessionClock are the production classes. Each program has its own clock, with a random start and a slight
/// rate error. The production classes receive no other time.
#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "session/clock.hpp"
#include "session/periodic.hpp"
#include "session/roster.hpp"
#include "session/time_reference.hpp"
#include "tests/session/simulated_network.hpp"
#include "tests/support/constants.hpp"

namespace tactus::test_support {

class Program;

/// Bugs that a test injects, to check that the simulation detects them.
enum class InjectedBug : std::uint8_t {
  kNone,
  kFreesRegionsEarly,       ///< HRTCs free a region as soon as they retire it
  kLosesRecords,            ///< HRTCs sometimes lose the records of a region without reporting it
  kClocksDrift,             ///< clocks drift by more than ClockSettings::drift
  kHostsDropHrtcs,          ///< hosts sometimes drop the state of an HRTC
  kReceivesNothing,         ///< one program receives nothing from one other program
  kIgnoresFailureDetector,  ///< HRTCs do not poll the failure detector
  kForgetsPagesSilently,    ///< HRTCs drop pages of the directory without DeliveryClient::forget_page
};

/// State that the programs of one session share.
struct World {
  World(std::uint64_t seed, std::int64_t delay_ns, const NetworkFaults& faults,
        SimulatedNetwork::Reliability reliability_)
      : random{seed}, network{seed ^ 0x6e6574ull, delay_ns, faults}, reliability{reliability_} {}

  [[nodiscard]] std::int64_t random_below(std::int64_t bound) {
    return bound <= 0 ? 0 : static_cast<std::int64_t>(random() % static_cast<std::uint64_t>(bound));
  }
  [[nodiscard]] bool chance(double probability) {
    return probability > 0 && static_cast<double>(random() >> 11) * 0x1p-53 < probability;
  }
  /// Records that an invariant is violated.
  void report_violation(const std::string& description);
  /// Whether a recent fault explains that the program receives records that it already holds or cannot use.
  [[nodiscard]] bool has_recent_fault(std::uint64_t program) const;
  [[nodiscard]] Program* find(std::uint64_t id) const;

  std::mt19937_64 random;
  SimulatedNetwork network;
  SimulatedNetwork::Reliability reliability;
  InjectedBug bug = InjectedBug::kNone;
  std::vector<Program*> programs;
  std::int64_t now_ns = 0;
  std::int64_t last_crash_ns = std::numeric_limits<std::int64_t>::min() / 2;
  std::int64_t last_payload_ns = 0;  // when a host last sent payload to a running program
  bool users_move = true;
  std::uint64_t incarnations = 0;
  std::vector<std::string> violations;
};

class Program {
 public:
  Program(World& world, std::uint64_t id, session::Role role);
  virtual ~Program() = default;
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;

  /// Starts a new incarnation, which remembers nothing of earlier ones.
  void start();
  void stop(bool sends_leave_message);
  void receive(const SimulatedNetwork::Packet& packet);
  /// Does all work that is due, and sets the time at which `tick` has to be called next.
  void tick();

  [[nodiscard]] bool is_running() const noexcept { return running_; }
  /// When the program stopped; valid while it does not run.
  [[nodiscard]] std::int64_t stopped_ns() const noexcept { return stopped_ns_; }
  [[nodiscard]] std::uint64_t id() const noexcept { return id_; }
  [[nodiscard]] std::uint64_t incarnation() const noexcept { return self_.incarnation; }
  [[nodiscard]] session::Role role() const noexcept { return role_; }
  [[nodiscard]] std::int64_t next_tick_ns() const noexcept {
    return running_ ? next_tick_ns_ : std::numeric_limits<std::int64_t>::max();
  }
  [[nodiscard]] const session::Roster& roster() const noexcept { return *roster_; }
  [[nodiscard]] const session::SessionClock& clock() const noexcept { return *clock_; }
  /// Time of the program's own clock.
  [[nodiscard]] std::int64_t local_ns() const noexcept;
  /// The error bound that the session clock states now.
  [[nodiscard]] std::int64_t clock_bound_ns() const noexcept { return clock_->map().error_bound(local_ns()); }
  /// The next roster entry.
  [[nodiscard]] session::RosterEntry entry(bool leaving);

 protected:
  virtual void on_start() {}
  virtual void on_sample(const Sample& sample) = 0;
  virtual void on_roster_event(const session::RosterEvent&) {}
  /// Does the work of the role. Returns the max time until the next call, ns.
  virtual std::int64_t work() = 0;
  /// Adds the fields of the role to a roster entry.
  virtual void complete_entry(session::RosterEntry&) const {}
  /// Whether this program exerts a force.
  [[nodiscard]] virtual bool force_on() const { return false; }

  void send(std::uint64_t to, Sample sample);
  void send_all(const std::vector<Program*>& to, Sample sample);
  void publish_entry_at_once() { entry_timer_.make_due(); }
  void call_at(std::int64_t at_ns) { next_tick_ns_ = std::min(next_tick_ns_, at_ns); }
  [[nodiscard]] const session::Origin& self() const noexcept { return self_; }
  World& world_;

 private:
  void update_clock();
  void check_clock();
  void on_clock_sample(const session::ClockSample& sample);

  std::uint64_t id_;
  session::Role role_;
  session::Origin self_;
  std::int64_t clock_start_ns_ = 0;
  double clock_rate_ = 0;  // relative error
  bool running_ = false;
  std::int64_t stopped_ns_ = 0;
  std::int64_t next_tick_ns_ = 0;
  std::unique_ptr<session::Roster> roster_;
  std::unique_ptr<session::SessionClock> clock_;
  session::PeriodicTimer entry_timer_{100 * kMs}, clock_request_timer_{20 * kMs};
  int clock_requests_ = 0;
  std::uint64_t heartbeat_ = 0;
  std::pair<std::uint64_t, std::uint64_t> last_answer_from_;    // participant, incarnation
  std::int64_t last_answer_ns_ = 0;                             // virtual time of the last clock answer
  std::int64_t last_step_ns_ = 0;                               // virtual time of the last step of the clock
  std::int64_t checked_session_ns_ = 0, checked_local_ns_ = 0;  // session time and own clock at the last check
};

/// A client that requests the service of an HRTC for its users. The set of its users changes at random.
class SimulatedClient : public Program {
 public:
  SimulatedClient(World& world, std::uint64_t id, std::uint64_t hrtc);
  [[nodiscard]] std::vector<std::string> users_at(std::uint64_t hrtc) const;

 protected:
  void on_start() override { choose_users(); }
  void on_sample(const Sample&) override {}
  std::int64_t work() override;
  void complete_entry(session::RosterEntry& entry) const override;

 private:
  void choose_users();

  std::uint64_t hrtc_;
  std::vector<std::string> users_;
};

}  // namespace tactus::test_support
