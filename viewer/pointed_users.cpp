#include "viewer/pointed_users.hpp"

#include <algorithm>
#include <utility>

#include "haptics/device.hpp"

namespace tactus::viewer {
namespace {

constexpr int kLeaveMessages = 4;  // 20 ms apart, because a roster entry can be lost

bool names_user(const session::RosterEntry& entry, const std::string& user) {
  return std::find(entry.users.begin(), entry.users.end(), user) != entry.users.end() ||
         std::any_of(entry.served_users.begin(), entry.served_users.end(),
                     [&](const session::UserProbe& served) { return served.user == user; });
}

}  // namespace

PointedUsers::PointedUsers(const ViewerCore& core, std::string viewer, std::string session, std::string source)
    : core_{core}, viewer_{std::move(viewer)}, session_{std::move(session)}, source_name_{std::move(source)} {}

bool PointedUsers::has_user(SourceId source) const noexcept {
  return std::any_of(users_.begin(), users_.end(), [&](const User& user) {
    return user.is_leaving() ? user.next && user.next->source == source : user.source == source;
  });
}

PointedUsers::User* PointedUsers::leaving_user(const std::string& name) {
  const auto found = std::find_if(users_.begin(), users_.end(),
                                  [&](const User& user) { return user.is_leaving() && user.name() == name; });
  return found == users_.end() ? nullptr : &*found;
}

/// Returns the HRTC that the source has chosen or, without a choice, the present one with the fewest users. Empty:
/// there is none.
std::string PointedUsers::chosen_hrtc(const TouchRequest& request) const {
  const session::RosterEntry* best = nullptr;
  core_.roster().for_each([&](const session::RosterEntry& entry) {
    if (entry.role != session::Role::kHrtc || (!request.hrtc.empty() && entry.name != request.hrtc)) return;
    if (best == nullptr || entry.served_users.size() < best->served_users.size()) best = &entry;
  });
  return best == nullptr ? std::string{} : best->name;
}

/// Returns why the source cannot have this user; empty: it can. `leaving`: the leaving user with this name, or null.
std::string PointedUsers::refusal(SourceId source, const TouchRequest& request, const User* leaving) const {
  if (!no_users.empty()) return no_users;
  if (has_user(source)) return "this " + source_name_ + " has a probe already";
  if (leaving == nullptr && users_.size() >= kMaxUsers)
    return source_name_ + "s have " + std::to_string(kMaxUsers) + " probes already";
  std::string owner;
  if (leaving == nullptr)
    core_.roster().for_each([&](const session::RosterEntry& entry) {
      if (names_user(entry, request.user)) owner = session::text(entry);
    });
  for (const User& user : users_)
    if (user.name() == request.user && (&user != leaving || user.next)) owner = "another " + source_name_;
  if (!owner.empty()) return "the name '" + request.user + "' is taken by a user of " + owner;
  if (chosen_hrtc(request).empty())
    return request.hrtc.empty() ? "no HRTC is in the session" : "HRTC '" + request.hrtc + "' is not in the session";
  if (viewer_.size() + 1 + request.user.size() > session::kMaxName)
    return "the names of viewer and user have more than " + std::to_string(session::kMaxName - 1) + " bytes together";
  return {};
}

void PointedUsers::on_touch(SourceId source, const TouchRequest& request, std::int64_t now_ns) {
  User* const leaving = leaving_user(request.user);
  if (const std::string reason = refusal(source, request, leaving); !reason.empty()) {
    if (on_refused) on_refused(source, reason);
    return;
  }
  if (leaving != nullptr) {
    leaving->next = {source, request};
    return;
  }
  User user;
  user.source = source;
  user.entry.role = session::Role::kClient;
  user.entry.name = viewer_ + "." + request.user;
  user.entry.session = session_;
  user.entry.origin = {session::id_of(session_), session::id_of(user.entry.name), 0, now_ns};
  user.entry.requested_hrtc = chosen_hrtc(request);
  user.entry.users = {request.user};
  user.heartbeat.repeat_soon();
  user.requested_ns = user.hand_received_ns = now_ns;
  users_.push_back(std::move(user));
}

void PointedUsers::refuse(std::uint64_t client, const std::string& reason) {
  const auto refused = std::find_if(users_.begin(), users_.end(), [&](const User& user) {
    return user.entry.origin.participant == client && !user.is_leaving();
  });
  if (refused == users_.end()) return;
  const SourceId source = refused->source;
  users_.erase(refused);
  if (on_refused) on_refused(source, reason);
}

void PointedUsers::on_hand(SourceId source, const HandRequest& request, std::int64_t now_ns) {
  for (User& user : users_) {
    if (user.source != source || user.is_leaving()) continue;
    user.request = request;
    user.hand_received_ns = now_ns;
  }
}

void PointedUsers::leave(User& user) {
  if (user.is_leaving()) return;
  user.entry.leaving = true;
  user.heartbeat.repeat_soon();
  user.leave_messages = kLeaveMessages;
}

void PointedUsers::on_release(SourceId source) {
  for (User& user : users_) {
    if (user.next && user.next->source == source) user.next.reset();
    if (user.source == source) leave(user);
  }
}

void PointedUsers::release_all() {
  for (User& user : users_) {
    user.next.reset();
    leave(user);
  }
}

bool PointedUsers::is_listed(const User& user) const {
  const session::RosterEntry* const hrtc = core_.roster().find(session::id_of(user.entry.requested_hrtc));
  return hrtc != nullptr && names_user(*hrtc, user.name());
}

/// Returns why the user cannot stay; empty: it can.
std::string PointedUsers::reason_to_leave(const User& user, std::int64_t now_ns) const {
  const std::string& hrtc = user.entry.requested_hrtc;
  if (core_.roster().find(session::id_of(hrtc)) == nullptr) return "HRTC '" + hrtc + "' has left the session";
  if (user.was_served && !is_listed(user)) return "HRTC '" + hrtc + "' has removed the user";
  if (now_ns - user.hand_received_ns > kMaxSilenceNs && user.was_served)
    return "the " + source_name_ + " sent no hand position for 2 s";
  if (now_ns - user.requested_ns > kMaxWaitNs && !user.was_served)
    return "HRTC '" + hrtc + "' has given no probe within 5 s; its log has the reason";
  return {};
}

void PointedUsers::add_messages(User& user, std::int64_t now_ns, PointedUserMessages& out) const {
  const bool sends_entry = !user.is_leaving() || user.leave_messages > 0;
  if (sends_entry && user.heartbeat.due(now_ns)) {
    ++user.entry.heartbeat;
    core_.put_time(user.entry, now_ns);
    out.roster.push_back(user.entry);
    if (user.is_leaving()) {
      --user.leave_messages;
      user.left_ns = now_ns;
    }
  }
  if (!user.was_served || user.is_leaving() || !user.request) return;
  session::Intent intent =
      user.hand.move_to({user.request->target, user.request->orientation}, core_.session_time(now_ns));
  intent.user_id = session::id_of(user.name());
  intent.sequence = ++user.intents;
  intent.buttons = user.request->grabs ? std::uint32_t{haptics::kGrabButton} : 0u;
  user.request.reset();
  out.intents.push_back({user.entry.origin.participant, std::move(intent)});
}

/// True if the user can be removed: its HRTC no longer lists it, or kMaxLeaveNs is over.
bool PointedUsers::has_left(const User& user, std::int64_t now_ns) const {
  return user.is_leaving() && user.leave_messages == 0 && (!is_listed(user) || now_ns - user.left_ns > kMaxLeaveNs);
}

void PointedUsers::remove_left_users(std::int64_t now_ns) {
  std::vector<Touch> touches;
  users_.remove_if([&](const User& user) {
    const bool left = has_left(user, now_ns);
    if (left && user.next) touches.push_back(*user.next);
    return left;
  });
  for (const Touch& touch : touches) on_touch(touch.source, touch.request, now_ns);
}

PointedUserMessages PointedUsers::tick(std::int64_t now_ns) {
  PointedUserMessages out;
  for (User& user : users_) {
    if (!user.was_served && is_listed(user)) {
      user.was_served = true;
      user.hand_received_ns = now_ns;  // a page sends its hand from now on
    }
    if (!user.is_leaving()) {
      if (const std::string reason = reason_to_leave(user, now_ns); !reason.empty()) {
        leave(user);
        if (on_refused) on_refused(user.source, reason);
      }
    }
    add_messages(user, now_ns, out);
  }
  remove_left_users(now_ns);
  return out;
}

}  // namespace tactus::viewer
