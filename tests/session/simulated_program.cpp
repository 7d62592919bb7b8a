#include "tests/session/simulated_program.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <utility>

namespace tactus::test_support {

using namespace session;

namespace {

/// Max time from a fault to its last effect: detection of a gap, a demand, a round trip and the timeout of a host.
constexpr std::int64_t kFaultEffectNs = 1500 * kMs;
/// Rounding error of conversions between clocks.
constexpr std::int64_t kRoundingNs = 2000;

}  // namespace

void World::report_violation(const std::string& description) {
  violations.push_back("at " + std::to_string(static_cast<double>(now_ns) * 1e-6) + " ms: " + description);
}

bool World::has_recent_fault(std::uint64_t program) const {
  if (now_ns - last_crash_ns < kFaultEffectNs) return true;
  return std::any_of(programs.begin(), programs.end(), [&](const Program* other) {
    return network.last_fault_ns(program, other->id()) > now_ns - kFaultEffectNs;
  });
}

Program* World::find(std::uint64_t id) const {
  const auto found =
      std::find_if(programs.begin(), programs.end(), [id](const Program* program) { return program->id() == id; });
  return found == programs.end() ? nullptr : *found;
}

Program::Program(World& world, std::uint64_t id, Role role) : world_{world}, id_{id}, role_{role} {
  constexpr double kSecond = 1e9, kHour = 3600 * kSecond;
  clock_start_ns_ = world_.random_below(static_cast<std::int64_t>(kHour));
  clock_rate_ = 90e-6 * (static_cast<double>(world_.random_below(2001)) / 1000 - 1);
}

std::int64_t Program::local_ns() const noexcept {
  const double rate = world_.bug == InjectedBug::kClocksDrift ? clock_rate_ * 40 : clock_rate_;
  return clock_start_ns_ + world_.now_ns + std::llround(static_cast<double>(world_.now_ns) * rate);
}

void Program::start() {
  self_ = Origin{kSession, id_, ++world_.incarnations, 0};
  running_ = true;
  roster_ = std::make_unique<Roster>(self_, RosterSettings{});
  clock_ = std::make_unique<SessionClock>(self_, ClockSettings{}, local_ns());
  entry_timer_ = session::PeriodicTimer{100 * kMs};
  clock_request_timer_ = session::PeriodicTimer{20 * kMs};
  clock_requests_ = 0;
  heartbeat_ = 0;
  last_answer_from_ = {};
  checked_session_ns_ = std::numeric_limits<std::int64_t>::min() / 2;
  next_tick_ns_ = world_.now_ns + world_.random_below(5 * kMs);
  on_start();
}

void Program::stop(bool sends_leave_message) {
  if (sends_leave_message) send_all(world_.programs, entry(true));
  running_ = false;
  stopped_ns_ = world_.now_ns;
}

RosterEntry Program::entry(bool leaving) {
  RosterEntry entry;
  entry.origin = self_;
  entry.origin.time_ns = local_ns();
  entry.role = role_;
  entry.name = std::to_string(id_);
  entry.heartbeat = ++heartbeat_;
  entry.leaving = leaving;
  put_time(*clock_, force_on(), local_ns(), entry);
  complete_entry(entry);
  return entry;
}

void Program::send(std::uint64_t to, Sample sample) {
  const bool is_time_stamped =
      std::holds_alternative<ClockSample>(sample) || std::holds_alternative<LivenessSample>(sample);
  world_.network.send(world_.now_ns, id_, to, std::make_shared<const Sample>(std::move(sample)),
                      is_time_stamped ? SimulatedNetwork::Reliability::kBestEffort : world_.reliability);
}

void Program::send_all(const std::vector<Program*>& to, Sample sample) {
  const auto shared = std::make_shared<const Sample>(std::move(sample));
  for (const Program* program : to)
    if (program != this) world_.network.send(world_.now_ns, id_, program->id(), shared, world_.reliability);
}

void Program::receive(const SimulatedNetwork::Packet& packet) {
  if (world_.bug == InjectedBug::kReceivesNothing && world_.programs.front() == this &&
      packet.from == world_.programs.back()->id())
    return;
  if (const auto* entry = std::get_if<RosterEntry>(packet.sample.get())) {
    for (const RosterEvent& event : roster_->on_entry(*entry, local_ns())) on_roster_event(event);
  }
  if (const auto* sample = std::get_if<ClockSample>(packet.sample.get())) return on_clock_sample(*sample);
  on_sample(*packet.sample);
}

void Program::on_clock_sample(const ClockSample& sample) {
  if (sample.answer) {
    if (!clock_->on_answer(sample, local_ns())) return;
    last_answer_from_ = {sample.origin.participant, sample.origin.incarnation};
    last_answer_ns_ = world_.now_ns;
  } else if (clock_->answers_requests()) {
    send(sample.origin.participant, clock_->answer(sample, local_ns(), local_ns()));
  }
}

void Program::update_clock() {
  session::update_session_clock(*roster_, self_, role_, force_on(), local_ns(), *clock_);
  const std::uint64_t reference = clock_->reference();
  if (reference != last_answer_from_.first) last_answer_from_ = {};
  if (reference == 0 || reference == id_ || !clock_request_timer_.due(local_ns())) return;
  send(reference, clock_->request(local_ns()));
  if (++clock_requests_ == 10) clock_request_timer_.set_period(200 * kMs);
}

void Program::check_clock() {
  if (!clock_->synchronised()) return;
  const std::int64_t session_ns = clock_->map().session_time(local_ns());
  const std::uint64_t reference = clock_->reference();
  const Program* reference_program = reference == 0 ? nullptr : world_.find(reference);
  // The bound holds only against a reference that follows no other program, and that has answered since its election
  // and since its last step.
  if (reference_program != nullptr && reference_program != this && reference_program->running_ &&
      reference_program->clock_->reference() == reference && reference_program->last_step_ns_ < last_answer_ns_ &&
      last_answer_from_ == std::make_pair(reference, reference_program->incarnation())) {
    const std::int64_t error_ns =
        std::abs(session_ns - reference_program->clock_->map().session_time(reference_program->local_ns()));
    if (error_ns > clock_bound_ns() + kRoundingNs)
      world_.report_violation("the clock of " + std::to_string(id_) + " is wrong by " + std::to_string(error_ns) +
                              " ns and states a bound of " + std::to_string(clock_bound_ns()));
  }
  // A step back is valid only when sessions merge, and then it is large.
  const std::int64_t gained_ns = session_ns - checked_session_ns_ - (local_ns() - checked_local_ns_);
  if (session_ns < checked_session_ns_ - kRoundingNs && -gained_ns < ClockSettings{}.step_ns)
    world_.report_violation("the clock of " + std::to_string(id_) + " has stepped back by " +
                            std::to_string(-gained_ns) + " ns");
  if (std::abs(gained_ns) >= ClockSettings{}.step_ns) last_step_ns_ = world_.now_ns;
  checked_local_ns_ = local_ns();
  checked_session_ns_ = session_ns;
}

void Program::tick() {
  for (const RosterEvent& event : roster_->tick(local_ns())) on_roster_event(event);
  update_clock();
  check_clock();
  if (entry_timer_.due(local_ns())) send_all(world_.programs, entry(false));
  next_tick_ns_ = std::numeric_limits<std::int64_t>::max();
  call_at(world_.now_ns + work());
}

SimulatedClient::SimulatedClient(World& world, std::uint64_t id, std::uint64_t hrtc)
    : Program{world, id, Role::kClient}, hrtc_{hrtc} {}

void SimulatedClient::choose_users() {
  users_.clear();
  for (std::int64_t i = 1 + world_.random_below(3); i > 0; --i)
    users_.push_back("user " + std::to_string(world_.random_below(4)) + " of " + std::to_string(id()));
  std::sort(users_.begin(), users_.end());
  users_.erase(std::unique(users_.begin(), users_.end()), users_.end());
}

std::vector<std::string> SimulatedClient::users_at(std::uint64_t hrtc) const {
  return is_running() && hrtc == hrtc_ ? users_ : std::vector<std::string>{};
}

std::int64_t SimulatedClient::work() {
  if (world_.users_move && world_.chance(0.02)) {
    choose_users();
    publish_entry_at_once();
  }
  return 20 * kMs;
}

void SimulatedClient::complete_entry(RosterEntry& entry) const {
  entry.requested_hrtc = std::to_string(hrtc_);
  entry.users = users_;
}

}  // namespace tactus::test_support
