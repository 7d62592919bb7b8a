/// The base of all programs of a simulated session (presence, session time), and the clients (users).
///
/// Roster and SessionClock are the real ones. Each program has a clock of its own, with a random start and a slightly
/// wrong rate; the state machines get no other time.
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

namespace tactus::test_support {

inline constexpr std::uint64_t kSession = 77;
inline constexpr std::int64_t kMs = 1'000'000;

class Program;

/// Planted mistakes, to test that the simulation detects them.
enum class Sabotage : std::uint8_t {
  kNone,
  kFreeEarly,  ///< HRTCs free a region as soon as they retire it
  kForget,     ///< HRTCs lose a record now and then without reporting it
  kRunFast,    ///< clocks drift by more than ClockSettings::drift
  kSendTwice,  ///< hosts drop the state of an HRTC now and then
  kDeaf,       ///< one program receives nothing from one other
  kTrusting,   ///< HRTCs do not poll the failure detector
};

/// State that the programs of one session share.
struct World {
  World(std::uint64_t seed, std::int64_t delay_ns, const NetworkFaults& faults, SimulatedNetwork::Carrier carrier_)
      : random{seed}, network{seed ^ 0x6e6574ull, delay_ns, faults}, carrier{carrier_} {}

  [[nodiscard]] std::int64_t below(std::int64_t n) {
    return n <= 0 ? 0 : static_cast<std::int64_t>(random() % static_cast<std::uint64_t>(n));
  }
  [[nodiscard]] bool chance(double p) { return p > 0 && static_cast<double>(random() >> 11) * 0x1p-53 < p; }
  /// Records a violated invariant.
  void broken(const std::string& what);
  /// Whether a recent fault explains that this program receives records that it holds or cannot use.
  [[nodiscard]] bool excused(std::uint64_t program) const;
  [[nodiscard]] Program* find(std::uint64_t id) const;

  std::mt19937_64 random;
  SimulatedNetwork network;
  SimulatedNetwork::Carrier carrier;
  Sabotage sabotage = Sabotage::kNone;
  std::vector<Program*> programs;
  std::int64_t now_ns = 0;
  std::int64_t last_crash_ns = std::numeric_limits<std::int64_t>::min() / 2;
  std::int64_t last_payload_ns = 0;  // when a host last sent payload
  bool wandering = true;             // users still move
  std::uint64_t incarnations = 0;
  std::vector<std::string> violations;
};

class Program {
 public:
  Program(World& world, std::uint64_t id, session::Role role);
  virtual ~Program() = default;
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;

  /// Starts a new incarnation without state.
  void start();
  void stop(bool sends_leave_message);
  void take(const SimulatedNetwork::Packet& packet);
  /// Does all due work and sets the time of the next call.
  void tick();

  [[nodiscard]] bool up() const noexcept { return up_; }
  /// When it ended; only if it is not up.
  [[nodiscard]] std::int64_t stopped_ns() const noexcept { return stopped_ns_; }
  [[nodiscard]] std::uint64_t id() const noexcept { return id_; }
  [[nodiscard]] std::uint64_t incarnation() const noexcept { return self_.incarnation; }
  [[nodiscard]] session::Role role() const noexcept { return role_; }
  [[nodiscard]] std::int64_t next_tick_ns() const noexcept {
    return up_ ? next_tick_ns_ : std::numeric_limits<std::int64_t>::max();
  }
  [[nodiscard]] const session::Roster& roster() const noexcept { return *roster_; }
  [[nodiscard]] const session::SessionClock& clock() const noexcept { return *clock_; }
  /// Time of its own clock.
  [[nodiscard]] std::int64_t local_ns() const noexcept;
  /// Its clock's stated error bound now.
  [[nodiscard]] std::int64_t clock_bound_ns() const noexcept { return clock_->map().error_bound(local_ns()); }
  /// Its roster entry.
  [[nodiscard]] session::RosterEntry entry(bool leaving);

 protected:
  virtual void begin() {}
  virtual void on_sample(const Sample& sample) = 0;
  virtual void react(const session::RosterEvent&) {}
  /// Does the work of the role; returns the longest time until the next call, ns.
  virtual std::int64_t work() = 0;
  virtual void describe(session::RosterEntry&) const {}
  /// Whether a force is on here.
  [[nodiscard]] virtual bool force_on() const { return false; }

  void send(std::uint64_t to, Sample sample);
  void send_all(const std::vector<Program*>& to, Sample sample);
  void publish_entry_at_once() { beat_.make_due(); }
  void call_at(std::int64_t at_ns) { next_tick_ns_ = std::min(next_tick_ns_, at_ns); }
  [[nodiscard]] const session::Origin& self() const noexcept { return self_; }
  World& world_;

 private:
  void update_session_clock();
  void check_clock();
  void on_clock_sample(const session::ClockSample& sample);

  std::uint64_t id_;
  session::Role role_;
  session::Origin self_;
  std::int64_t clock_start_ns_ = 0;
  double clock_rate_ = 0;  // relative error
  bool up_ = false;
  std::int64_t stopped_ns_ = 0;
  std::int64_t next_tick_ns_ = 0;
  std::unique_ptr<session::Roster> roster_;
  std::unique_ptr<session::SessionClock> clock_;
  session::PeriodicTimer beat_{100 * kMs}, request_{20 * kMs};
  int requests_ = 0;
  std::uint64_t heartbeat_ = 0;
  std::pair<std::uint64_t, std::uint64_t> answered_by_;  // participant, incarnation
  std::int64_t last_session_ns_ = 0, last_local_ns_ = 0, answered_ns_ = 0, stepped_ns_ = 0;
};

/// Asks an HRTC to serve its users, who change now and then.
class SimulatedClient : public Program {
 public:
  SimulatedClient(World& world, std::uint64_t id, std::uint64_t hrtc);
  [[nodiscard]] std::vector<std::string> users_at(std::uint64_t hrtc) const;

 protected:
  void begin() override;
  void on_sample(const Sample&) override {}
  std::int64_t work() override;
  void describe(session::RosterEntry& entry) const override;

 private:
  std::uint64_t hrtc_;
  std::vector<std::string> users_;
};

}  // namespace tactus::test_support
