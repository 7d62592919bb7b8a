#include "tests/session/simulated_program.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <utility>

namespace tactus::test_support {

using namespace session;

namespace {

/// Max delay between a fault and its effects: a hole is closed, a demand, a round trip, a host is late.
constexpr std::int64_t kExcuseNs = 1500 * kMs;
/// Rounding error of conversions between clocks.
constexpr std::int64_t kRoundingNs = 2000;

}  // namespace

void World::broken(const std::string& what) {
  violations.push_back("at " + std::to_string(static_cast<double>(now_ns) * 1e-6) + " ms: " + what);
}

bool World::excused(std::uint64_t program) const {
  if (now_ns - last_crash_ns < kExcuseNs) return true;
  return std::any_of(programs.begin(), programs.end(), [&](const Program* other) {
    const std::int64_t harmed_ns = network.last_harm_ns(program, other->id());
    return harmed_ns > now_ns - kExcuseNs;
  });
}

Program* World::find(std::uint64_t id) const {
  const auto at = std::find_if(programs.begin(), programs.end(), [id](const Program* p) { return p->id() == id; });
  return at == programs.end() ? nullptr : *at;
}

Program::Program(World& world, std::uint64_t id, Role role) : world_{world}, id_{id}, role_{role} {
  constexpr double kSecond = 1e9, kHour = 3600 * kSecond;
  clock_start_ns_ = world_.below(static_cast<std::int64_t>(kHour));
  clock_rate_ = 90e-6 * (static_cast<double>(world_.below(2001)) / 1000 - 1);
}

std::int64_t Program::local_ns() const noexcept {
  const double rate = world_.sabotage == Sabotage::kRunFast ? clock_rate_ * 40 : clock_rate_;
  return clock_start_ns_ + world_.now_ns + std::llround(static_cast<double>(world_.now_ns) * rate);
}

void Program::start() {
  self_ = Origin{kSession, id_, ++world_.incarnations, 0};
  up_ = true;
  roster_ = std::make_unique<Roster>(self_, RosterSettings{});
  clock_ = std::make_unique<SessionClock>(self_, ClockSettings{}, local_ns());
  beat_ = session::PeriodicTimer{100 * kMs};
  request_ = session::PeriodicTimer{20 * kMs};
  requests_ = 0;
  heartbeat_ = 0;
  answered_by_ = {};
  last_session_ns_ = std::numeric_limits<std::int64_t>::min() / 2;
  next_tick_ns_ = world_.now_ns + world_.below(5 * kMs);
  begin();
}

void Program::stop(bool sends_leave_message) {
  if (sends_leave_message) send_all(world_.programs, entry(true));
  up_ = false;
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
  describe(entry);
  return entry;
}

void Program::send(std::uint64_t to, Sample sample) {
  const bool stamps = std::holds_alternative<ClockSample>(sample) || std::holds_alternative<LivenessSample>(sample);
  world_.network.send(world_.now_ns, id_, to, std::make_shared<const Sample>(std::move(sample)),
                      stamps ? SimulatedNetwork::Carrier::kLossy : world_.carrier);
}

void Program::send_all(const std::vector<Program*>& to, Sample sample) {
  const auto shared = std::make_shared<const Sample>(std::move(sample));
  for (const Program* program : to)
    if (program != this) world_.network.send(world_.now_ns, id_, program->id(), shared, world_.carrier);
}

void Program::take(const SimulatedNetwork::Packet& packet) {
  if (world_.sabotage == Sabotage::kDeaf && world_.programs.front() == this &&
      packet.from == world_.programs.back()->id())
    return;
  if (const auto* entry = std::get_if<RosterEntry>(packet.sample.get())) {
    for (const RosterEvent& event : roster_->on_entry(*entry, local_ns())) react(event);
  }
  if (const auto* sample = std::get_if<ClockSample>(packet.sample.get())) return on_clock_sample(*sample);
  on_sample(*packet.sample);
}

void Program::on_clock_sample(const ClockSample& sample) {
  if (sample.answer) {
    if (!clock_->on_answer(sample, local_ns())) return;
    answered_by_ = {sample.origin.participant, sample.origin.incarnation};
    answered_ns_ = world_.now_ns;
  } else if (clock_->answers_requests()) {
    send(sample.origin.participant, clock_->answer(sample, local_ns(), local_ns()));
  }
}

void Program::update_session_clock() {
  session::update_session_clock(*roster_, self_, role_, force_on(), local_ns(), *clock_);
  const std::uint64_t reference = clock_->reference();
  if (reference != answered_by_.first) answered_by_ = {};
  if (reference == 0 || reference == id_ || !request_.due(local_ns())) return;
  send(reference, clock_->request(local_ns()));
  if (++requests_ == 10) request_.set_period(200 * kMs);
}

void Program::check_clock() {
  if (!clock_->synchronised()) return;
  const std::int64_t session_ns = clock_->map().session_time(local_ns());
  const std::uint64_t reference = clock_->reference();
  const Program* reference_program = reference == 0 ? nullptr : world_.find(reference);
  // Checks the bound against a reference that keeps its own time and has answered since its election and last step.
  if (reference_program != nullptr && reference_program != this && reference_program->up_ &&
      reference_program->clock_->reference() == reference && reference_program->stepped_ns_ < answered_ns_ &&
      answered_by_ == std::make_pair(reference, reference_program->incarnation())) {
    const std::int64_t wrong_ns =
        std::abs(session_ns - reference_program->clock_->map().session_time(reference_program->local_ns()));
    if (wrong_ns > clock_bound_ns() + kRoundingNs)
      world_.broken("the clock of " + std::to_string(id_) + " is wrong by " + std::to_string(wrong_ns) +
                    " ns and states a bound of " + std::to_string(clock_bound_ns()));
  }
  // Checks against its own clock: only a step to another session's time may be large.
  const std::int64_t gained_ns = session_ns - last_session_ns_ - (local_ns() - last_local_ns_);
  if (session_ns < last_session_ns_ - kRoundingNs && -gained_ns < ClockSettings{}.step_ns)
    world_.broken("the clock of " + std::to_string(id_) + " has stepped back by " + std::to_string(-gained_ns) + " ns");
  if (std::abs(gained_ns) >= ClockSettings{}.step_ns) stepped_ns_ = world_.now_ns;
  last_local_ns_ = local_ns();
  last_session_ns_ = session_ns;
}

void Program::tick() {
  for (const RosterEvent& event : roster_->tick(local_ns())) react(event);
  update_session_clock();
  check_clock();
  if (beat_.due(local_ns())) send_all(world_.programs, entry(false));
  next_tick_ns_ = std::numeric_limits<std::int64_t>::max();
  call_at(world_.now_ns + work());
}

SimulatedClient::SimulatedClient(World& world, std::uint64_t id, std::uint64_t hrtc)
    : Program{world, id, Role::kClient}, hrtc_{hrtc} {}

void SimulatedClient::begin() {
  users_.clear();
  for (std::int64_t i = 1 + world_.below(3); i > 0; --i)
    users_.push_back("user " + std::to_string(world_.below(4)) + " of " + std::to_string(id()));
  std::sort(users_.begin(), users_.end());
  users_.erase(std::unique(users_.begin(), users_.end()), users_.end());
}

std::vector<std::string> SimulatedClient::users_at(std::uint64_t hrtc) const {
  return up() && hrtc == hrtc_ ? users_ : std::vector<std::string>{};
}

std::int64_t SimulatedClient::work() {
  if (world_.wandering && world_.chance(0.02)) {
    begin();
    publish_entry_at_once();
  }
  return 20 * kMs;
}

void SimulatedClient::describe(RosterEntry& entry) const {
  entry.requested_hrtc = std::to_string(hrtc_);
  entry.users = users_;
}

}  // namespace tactus::test_support
