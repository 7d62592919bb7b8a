#include "tools/chaos/health.hpp"

#include <cmath>
#include <cstdio>

#include "tools/has_room.hpp"

namespace tactus::chaos {
namespace {

using tools::has_room;

constexpr std::size_t kMaxViolations = 100;        // stored
constexpr std::int64_t kRecentNs = 2'000'000'000;  // age of an exact contact of the reference
constexpr double kRounding = 1 + 1e-6;             // of a force that is equal to the limit

}  // namespace

Health::Health(const session::Origin& self, const HealthSettings& settings) : settings_{settings}, roster_{self, {}} {}

void Health::report(std::uint64_t user, const char* violation) {
  if (violations_.size() >= kMaxViolations) return;
  violations_.push_back(name_of(user));
  violations_.back().append(": ").append(violation);
}

std::string Health::name_of(std::uint64_t user) const {
  const auto known = names_.find(user);
  std::string name{"user "};
  return name.append(known == names_.end() ? std::to_string(user) : known->second);
}

void Health::on_sample(const session::RosterEntry& entry, std::int64_t now_ns) {
  (void)roster_.on_entry(entry, now_ns);
  for (const session::UserProbe& served : entry.served_users) {
    const std::uint64_t user = session::id_of(served.user);
    if (has_room(names_, user)) names_[user] = served.user;
  }
}

void Health::on_sample(const session::ProbeState& state, std::int64_t now_ns) {
  ++states_;
  if (has_room(incarnations_, state.origin.participant)) {
    std::uint64_t& incarnation = incarnations_[state.origin.participant];
    if (state.origin.incarnation < incarnation) {
      report(state.user_id, "a state of an earlier process of its HRTC arrived after one of a later process");
      return;
    }
    incarnation = state.origin.incarnation;
  }
  const double force = std::hypot(state.force[0], state.force[1], state.force[2]);
  max_force_ = std::fmax(max_force_, force);
  if (!(force <= settings_.max_force * kRounding)) {
    char line[120];
    std::snprintf(line, sizeof line, "a force of %.3g N, expected at most %g N", force, settings_.max_force);
    report(state.user_id, line);
  }
  if (!has_room(states_of_, state.user_id)) return;
  User& user = states_of_[state.user_id];
  user.newest = state;
  user.received_ns = now_ns;
  constexpr std::uint32_t kExactContact = session::kInContact | session::kExact;
  if ((state.status & kExactContact) == kExactContact) user.exact_ns = now_ns;
}

void Health::tick(std::int64_t now_ns) { (void)roster_.tick(now_ns); }

void Health::set_reference(std::int64_t now_ns) {
  participants_.clear();
  users_.clear();
  roster_.for_each([&](const session::RosterEntry& entry) {
    if (entry.role != session::Role::kViewer) participants_[entry.origin.participant] = text(entry);
  });
  for (const auto& [id, user] : states_of_)
    if (now_ns - user.received_ns <= settings_.max_silence_ns)
      users_[id] = user.exact_ns != 0 && now_ns - user.exact_ns <= kRecentNs;
}

/// Returns why the user cannot touch as before, or null.
const char* Health::obstacle_of(std::uint64_t id, std::int64_t now_ns) const {
  const User& user = states_of_.at(id);
  if (now_ns - user.received_ns > settings_.max_silence_ns) return "no states";
  if ((user.newest.status & session::kFault) != 0) return session::fault_reason(user.newest.status);
  if ((user.newest.status & session::kStalePose) != 0) return "its device sends no poses";
  const bool touches = (user.newest.status & session::kInContact) != 0;
  return users_.at(id) && touches && (user.newest.status & session::kExact) == 0 ? "its contact is not exact" : nullptr;
}

std::string Health::reference_text() const {
  std::string names;
  const auto add = [&](const std::string& name) { names.append(names.empty() ? "" : ", ").append(name); };
  for (const auto& [id, name] : participants_) add(name);
  for (const auto& [id, had_exact_contacts] : users_) add(name_of(id));
  return names;
}

std::vector<std::string> Health::missing(std::int64_t now_ns) const {
  std::vector<std::string> all;
  for (const auto& [id, name] : participants_)
    if (roster_.find(id) == nullptr || roster_.is_late(id)) all.push_back(name);
  for (const auto& [id, had_exact_contacts] : users_)
    if (const char* const obstacle = obstacle_of(id, now_ns))
      all.emplace_back(name_of(id)).append(": ").append(obstacle);
  return all;
}

}  // namespace tactus::chaos
