#include "study/shared_run.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "session/figures.hpp"
#include "study/constants.hpp"
#include "study/shared_session.hpp"

namespace tactus::study {
namespace {

using client_sim::ActionKind;
using client_sim::Scenario;

constexpr double kTremor = 1e-4;  // m rms, of resting hands
constexpr double kDegree = 3.14159265358979323846 / 180;
/// The value of a figure without samples; std::fmax ignores it.
constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

SharedSessionSettings settings_of(const netem::LinkSettings& link, std::uint64_t seed) {
  SharedSessionSettings settings;
  settings.link = link;
  settings.seed = seed;
  settings.tremor = kTremor;
  return settings;
}

/// Adds the users. Those with the same HRTC name share an HRTC.
void add_users(SharedSession& session, const Scenario& scenario) {
  std::map<std::string, std::size_t> hrtcs;
  for (const client_sim::User& user : scenario.users) {
    if (hrtcs.find(user.hrtc) == hrtcs.end()) hrtcs[user.hrtc] = session.add_hrtc();
    (void)session.add_user(hrtcs[user.hrtc], user);
  }
}

double force_on(const SharedSession& session, std::size_t user) {
  return hrtc_service::vec(session.probe(user).force).norm();
}

/// Returns the largest distance between corresponding corners of two copies, m; NaN without two copies.
double separation(const SharedSession& session) {
  double max = kNone;
  const haptics::BodySettings& shape = session.shared().settings;
  for (std::size_t a = 0; a < session.hrtcs(); ++a)
    for (std::size_t b = 0; b < a; ++b) {
      const auto *one = session.body(a), *other = session.body(b);
      if (one == nullptr || other == nullptr || !one->is_simulated || !other->is_simulated) continue;
      for (std::uint32_t i = 0; i < shape.point_count; ++i)
        max = std::fmax(max, (one->state.to_world(shape.points[i]) - other->state.to_world(shape.points[i])).norm());
    }
  return max;
}

double lowest_port(const SharedSession& session, std::size_t users) {
  double lowest = 0;
  for (std::size_t user = 0; user < users; ++user) lowest = std::min(lowest, session.port(user).lowest);
  return lowest;
}

}  // namespace

const client_sim::Action& action_of(const client_sim::User& user, ActionKind kind) {
  return *std::find_if(user.script.begin(), user.script.end(),
                       [&](const client_sim::Action& action) { return action.kind == kind; });
}

ScenarioRun press_to_target(const Scenario& scenario, const Subject& subject, const netem::LinkSettings& link,
                            std::uint64_t seed, const std::atomic<bool>& cancelled) {
  constexpr std::size_t kSettlingMs = 1000, kMinOnTargetMs = 200;
  struct Press {
    double target;              // N
    std::size_t hold;           // index of the action
    std::vector<double> force;  // N, of each millisecond
  };
  std::vector<Press> presses;
  double shortest = std::numeric_limits<double>::infinity();  // s
  for (const client_sim::User& user : scenario.users) {
    const client_sim::Action& hold = action_of(user, ActionKind::kHold);
    presses.push_back({hold.force, static_cast<std::size_t>(&hold - user.script.data()), {}});
    shortest = std::min(shortest, hold.seconds);
  }
  SharedSession session{subject, settings_of(link, seed)};
  add_users(session, client_sim::varied(scenario, seed));
  std::vector<bool> was_holding(presses.size());
  std::size_t released = std::numeric_limits<std::size_t>::max(), end = 0;  // ms
  for (double time = 0; time < scenario.duration; time += kCycle, ++end) {
    if (cancelled) return {};
    session.step();
    for (std::size_t user = 0; user < presses.size(); ++user) {
      presses[user].force.push_back(force_on(session, user));
      const bool is_holding = session.operator_of(user).action() == presses[user].hold;
      if (was_holding[user] && !is_holding) released = std::min(released, end);
      was_holding[user] = is_holding;
    }
  }

  const auto all = [&](std::size_t ms, auto&& holds) {
    return std::all_of(presses.begin(), presses.end(),
                       [&](const Press& press) { return holds(press.force[ms], press.target); });
  };
  const auto is_on_target = [&](double force, double target) {
    return std::abs(force - target) <= scenario.force_tolerance;
  };
  std::size_t begin = 0;
  while (begin < end && !all(begin, [](double force, double) { return force >= kMinForce; })) ++begin;
  std::size_t reached = begin, ms_on_target = 0;
  for (; reached < end && ms_on_target < kMinOnTargetMs; ++reached)
    ms_on_target = all(reached, is_on_target) ? ms_on_target + 1 : 0;
  double squares = 0, max = kNone;
  std::size_t on_target = 0, lost = 0, evaluated = 0;
  const std::size_t last = std::min({end, released, begin + static_cast<std::size_t>(shortest / kCycle)});
  for (std::size_t ms = begin + kSettlingMs; ms < last; ++ms) {
    for (const Press& press : presses) {
      const double off = std::abs(press.force[ms] - press.target);
      squares += off * off;
      max = std::fmax(max, off);
      on_target += off <= scenario.force_tolerance ? 1 : 0;
      lost += press.force[ms] < kMinForce ? 1 : 0;
      ++evaluated;
    }
  }
  const double count = evaluated > 0 ? static_cast<double>(evaluated) : kNone;
  const auto percent = [&](std::size_t of) { return 100 * static_cast<double>(of) / count; };
  // An event that did not happen counts with the whole duration.
  const std::size_t to_target = ms_on_target < kMinOnTargetMs ? end : reached - begin;
  return {{{"time until all touch", "ms", static_cast<double>(begin)},
           {"time to target", "ms", static_cast<double>(to_target)},
           {"time on target", "%", percent(on_target)},
           {"deviation from target, rms", "N", std::sqrt(squares / count)},
           {"deviation from target, max", "N", max},
           {"time without contact", "%", percent(lost)},
           {"lowest port energy", "mJ", 1e3 * lowest_port(session, scenario.users.size())}},
          {}};
}

ScenarioRun lift_together(const Scenario& scenario, const Subject& subject, const netem::LinkSettings& link,
                          std::uint64_t seed, const std::atomic<bool>& cancelled) {
  constexpr double kHeldShare = 0.9;  // share of the lift's height above which the object counts as held up
  // A study refuses a scenario whose lifts have different heights.
  const double height_of_lift = action_of(scenario.users.front(), ActionKind::kLift).height;
  SharedSession session{subject, settings_of(link, seed)};
  add_users(session, client_sim::varied(scenario, seed));
  const double ground = session.shared().start.position.z();
  double highest = kNone, held = 0, tilt = kNone, furthest = kNone, peak = 0;
  for (double time = 0; time < scenario.duration; time += kCycle) {
    if (cancelled) return {};
    session.step();
    furthest = std::fmax(furthest, separation(session));
    for (std::size_t user = 0; user < scenario.users.size(); ++user) peak = std::max(peak, force_on(session, user));
    if (session.viewer_pose().fencing == 0) continue;
    const haptics::BodyState seen = sharing::state_of(session.viewer_pose(), session.shared().centre);
    const double height = seen.position.z() - ground;
    highest = std::fmax(highest, height);
    held += height >= kHeldShare * height_of_lift ? kCycle : 0;
    tilt = std::fmax(tilt, std::acos(std::clamp((seen.orientation * Vec3d::UnitZ()).z(), -1.0, 1.0)) / kDegree);
  }
  std::uint32_t lifts = 0, lost = 0;
  for (std::size_t user = 0; user < scenario.users.size(); ++user) {
    lifts += session.operator_of(user).tally().lifts;
    lost += session.operator_of(user).tally().lifts_lost;
  }
  double given = 0;
  for (std::size_t i = 0; i < session.hrtcs(); ++i) given += session.figure(i, session::figures::kCopyGiven);
  const double left = session.viewer_pose().fencing == 0
                          ? kNone
                          : sharing::state_of(session.viewer_pose(), session.shared().centre).position.z();
  return {{{"completed lifts", "", static_cast<double>(lifts)},
           {"lost lifts", "", static_cast<double>(lost)},
           {"largest height", "mm", 1e3 * highest},
           {"time held up", "s", held},
           {"largest tilt", "degrees", tilt},
           {"largest distance of copies", "mm", 1e3 * furthest},
           {"injected energy", "mJ", 1e-3 * given},
           {"peak force", "N", peak},
           {"lowest port energy", "mJ", 1e3 * lowest_port(session, scenario.users.size())},
           {"height at the end", "mm", 1e3 * (left - ground)}},
          {}};
}

}  // namespace tactus::study
