#include "session/modes.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace tactus::session {
namespace {

/// Group of a command for all users; no object has this id, because object ids are hashes of names.
constexpr std::uint64_t kEveryone = 1;

}  // namespace

ModeCommand parse_mode(const std::string& text) {
  const std::size_t space = text.find(' ');
  const std::string name = text.substr(0, space);
  ModeCommand command;
  if (name == "collaborate")
    command.kind = ModeCommand::Kind::kCollaborate;
  else if (name == "large-scale")
    command.kind = ModeCommand::Kind::kLargeScale;
  else if (text != "auto")
    throw std::invalid_argument("mode '" + text +
                                "': expected auto, collaborate or large-scale, the latter two followed by USER,USER... "
                                "or by nothing");
  for (std::size_t begin = space; begin != std::string::npos;) {
    const std::size_t end = text.find(',', begin + 1);
    const std::string user = text.substr(begin + 1, end == std::string::npos ? end : end - begin - 1);
    if (user.empty()) throw std::invalid_argument("mode '" + text + "': found an empty user name");
    command.users.insert(id_of(user));
    begin = end;
  }
  return command;
}

double distance_from(const CatalogueEntry& object, const std::array<double, 3>& position) {
  const auto& [x, y, z, w] = object.pose.orientation;
  const double rotation[3][3] = {{1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)},
                                 {2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)},
                                 {2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)}};
  double squared = 0;
  for (std::size_t axis = 0; axis < 3; ++axis) {  // of the object's frame
    double along = 0;
    for (std::size_t row = 0; row < 3; ++row)
      along += rotation[row][axis] * (position[row] - object.pose.position[row]);
    const double low = object.scale * static_cast<double>(object.summary.bounds_min[axis]);
    const double high = object.scale * static_cast<double>(object.summary.bounds_max[axis]);
    squared += std::pow(std::max({low - along, along - high, 0.0}), 2);
  }
  return std::sqrt(squared);
}

void Modes::on_catalogue(const CatalogueEntry& entry) {
  if (!entry.withdrawn) objects_[entry.object_id] = entry;  // another host may still serve a withdrawn object
}

void Modes::on_probe(std::uint64_t user, std::uint64_t participant, const std::array<double, 3>& position,
                     std::int64_t now_ns) {
  Probe& probe = probes_[user];
  probe.participant = participant;
  probe.position = position;
  probe.received_ns = now_ns;
}

void Modes::assign_object(Probe& probe, std::int64_t now_ns) const {
  const auto near = objects_.find(probe.object);
  if (near != objects_.end()) {
    if (distance_from(near->second, probe.position) <= settings_.apart_distance) probe.near_ns = now_ns;
    if (now_ns - probe.near_ns < settings_.dwell_ns) return;
  }
  probe.object = 0;
  double nearest = settings_.near_distance;
  for (const auto& [id, object] : objects_) {
    const double distance = distance_from(object, probe.position);
    if (distance > nearest) continue;
    nearest = distance;
    probe.object = id;
    probe.near_ns = now_ns;
  }
}

bool Modes::is_commanded(std::uint64_t user) const {
  return command_.kind != ModeCommand::Kind::kAuto && (command_.users.empty() || command_.users.count(user) != 0);
}

std::uint64_t Modes::group_for(std::uint64_t user, const Probe& probe) const {
  if (!is_commanded(user)) return probe.object;
  if (command_.kind == ModeCommand::Kind::kLargeScale) return 0;
  std::uint64_t group = kEveryone;
  for (const std::uint64_t one : command_.users) group = group * 0x9e3779b97f4a7c15u + one;
  return group;
}

void Modes::pause(std::int64_t now_ns) {
  constexpr int kMaxDoublings = 4;
  if (now_ns < paused_until_ns_) return;
  if (now_ns - paused_until_ns_ > settings_.forget_pauses_ns) pauses_ = 0;
  paused_until_ns_ = now_ns + (settings_.pause_ns << std::min(pauses_++, kMaxDoublings));
}

void Modes::tick(std::int64_t now_ns) {
  is_paused_ = now_ns < paused_until_ns_;
  for (auto at = probes_.begin(); at != probes_.end();)
    at = now_ns - at->second.received_ns > settings_.forget_ns ? probes_.erase(at) : std::next(at);
  std::map<std::uint64_t, std::set<std::uint64_t>> own_by_group;
  std::set<std::uint64_t> others;                 // groups with users of other HRTCs
  std::map<std::uint64_t, std::size_t> together;  // users by object
  for (auto& [user, probe] : probes_) {
    assign_object(probe, now_ns);
    if (!is_commanded(user)) ++together[probe.object];
  }
  for (const auto& [user, probe] : probes_) {
    const std::uint64_t group = is_paused_ ? 0 : group_for(user, probe);
    if (group == 0 || (!is_commanded(user) && together[group] > settings_.max_collaborating)) continue;
    if (probe.participant == self_)
      own_by_group[group].insert(user);
    else
      others.insert(group);
  }
  for (const auto& [group, users] : own_by_group)
    if (others.count(group) != 0) groups_[group].ended = false;
  for (auto at = groups_.begin(); at != groups_.end();) {
    Group& group = at->second;
    const auto own = own_by_group.find(at->first);
    if (own != own_by_group.end() && others.count(at->first) != 0) {
      group.own_users = own->second;
    } else if (!group.ended) {
      group.ended = true;
      group.ended_ns = now_ns;
      group.own_users.clear();
    }
    at = group.ended && now_ns - group.ended_ns >= settings_.linger_ns ? groups_.erase(at) : std::next(at);
  }
}

std::vector<std::uint64_t> Modes::groups() const {
  std::vector<std::uint64_t> all;
  for (const auto& [id, group] : groups_) all.push_back(id);
  return all;
}

void Modes::on_peers(std::uint64_t group, bool matched) {
  const auto at = groups_.find(group);
  if (at != groups_.end()) at->second.matched = matched;
}

std::uint64_t Modes::group_of(std::uint64_t user) const {
  for (const auto& [id, group] : groups_)
    if (group.matched && group.own_users.count(user) != 0) return id;
  return 0;
}

}  // namespace tactus::session
