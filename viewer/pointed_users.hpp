/// Users who point: the user of a page, or of a ROS topic with target poses. An HRTC simulates the hand of the user,
/// which follows the targets of this source.
///
///     touch request   --> roster entry of a client with this user, until an HRTC lists the user as served
///     hand requests   --> intents
///     release, silence, refusal --> leave message of the client
///
/// Each user belongs to a client of its own, because a client names only one HRTC. The adapter
/// (viewer/viewer_participant.cpp) makes a participant for each client.
///
/// No DDS, socket or clock: times are arguments, of this program's monotonic clock. One thread at a time.
#pragma once

#include <cstdint>
#include <functional>
#include <list>
#include <optional>
#include <string>
#include <vector>

#include "session/messages.hpp"
#include "session/periodic.hpp"
#include "sharing/pointed_hand.hpp"
#include "viewer/page_request.hpp"
#include "viewer/viewer_core.hpp"

namespace tactus::viewer {

/// Number of a source of targets: the id of a page, or a number that the program chooses.
using SourceId = std::uint64_t;

/// Samples to send after a tick.
struct PointedUserMessages {
  std::vector<session::RosterEntry> roster;  ///< origin.participant names the client
  struct HandIntent {
    std::uint64_t client = 0;
    session::Intent intent;
  };
  std::vector<HandIntent> intents;
};

class PointedUsers {
 public:
  static constexpr std::size_t kMaxUsers = 8;
  /// Time without a hand request after which the user leaves, for example because a page is hidden. The hand would
  /// otherwise continue to press.
  static constexpr std::int64_t kMaxSilenceNs = 2'000'000'000;
  static constexpr std::int64_t kHeartbeatNs = 100'000'000;
  /// Max time from the request until an HRTC has given a probe.
  static constexpr std::int64_t kMaxWaitNs = 5'000'000'000;
  /// Max time after the last leave message in which a request waits until the HRTC has removed the user. Later it is
  /// refused.
  static constexpr std::int64_t kMaxLeaveNs = 1'000'000'000;

  /// `core` must outlive the users; `viewer` and `session` are the names of this program and its session. Messages call
  /// a source `source`, for example "page".
  PointedUsers(const ViewerCore& core, std::string viewer, std::string session, std::string source);

  /// Called with the reason when a source gets no probe, or loses it without having given it back.
  std::function<void(SourceId source, const std::string& reason)> on_refused;

  /// The reason for which no one may be a user; empty: users may join.
  std::string no_users;

  /// If a leaving user of this program still has the name, the request waits until that user is removed.
  void on_touch(SourceId source, const TouchRequest& request, std::int64_t now_ns);
  void on_hand(SourceId source, const HandRequest& request, std::int64_t now_ns);
  /// The source gives its probe back, or has ended.
  void on_release(SourceId source);
  /// All users leave.
  void release_all();
  /// The user of this client cannot join: its source gets no probe, and no leave message is sent.
  void refuse(std::uint64_t client, const std::string& reason);

  /// Returns the samples to send. Call it every few milliseconds.
  [[nodiscard]] PointedUserMessages tick(std::int64_t now_ns);

  /// True also while the source waits for a name.
  [[nodiscard]] bool has_user(SourceId source) const noexcept;
  /// Number of users, also of those that are leaving.
  [[nodiscard]] std::size_t size() const noexcept { return users_.size(); }

 private:
  struct Touch {
    SourceId source = 0;
    TouchRequest request;
  };
  struct User {
    SourceId source = 0;
    session::RosterEntry entry;  // of its client
    session::Heartbeat heartbeat{kHeartbeatNs};
    sharing::PointedHand hand;
    std::optional<HandRequest> request;  // newest, not sent
    std::int64_t requested_ns = 0;       // time of the touch request
    std::int64_t hand_received_ns = 0;   // time of the newest hand request
    std::uint32_t intents = 0;
    bool was_served = false;    // its HRTC has listed it
    int leave_messages = 0;     // still to send; 0 while the user stays
    std::int64_t left_ns = 0;   // time of the newest leave message
    std::optional<Touch> next;  // gets the name after this user has left

    [[nodiscard]] const std::string& name() const { return entry.users.front(); }
    [[nodiscard]] bool is_leaving() const { return entry.leaving; }
  };

  [[nodiscard]] std::string refusal(SourceId source, const TouchRequest& request, const User* leaving) const;
  [[nodiscard]] std::string chosen_hrtc(const TouchRequest& request) const;
  [[nodiscard]] bool is_listed(const User& user) const;
  [[nodiscard]] std::string reason_to_leave(const User& user, std::int64_t now_ns) const;
  [[nodiscard]] User* leaving_user(const std::string& name);
  [[nodiscard]] bool has_left(const User& user, std::int64_t now_ns) const;
  void leave(User& user);
  void remove_left_users(std::int64_t now_ns);
  void add_messages(User& user, std::int64_t now_ns, PointedUserMessages& out) const;

  const ViewerCore& core_;
  std::string viewer_, session_, source_name_;
  std::list<User> users_;
};

}  // namespace tactus::viewer
