/// A host, HRTCs and users of one moving object in virtual time. Host and HRTCs run the classes that their services use
/// for shared objects. An emulated link connects each pair of host, viewer and HRTCs.
///
///     Operator --> SimulatedDevice --> HrtcCore  ~~ link ~~  HostCore
///
/// There are no threads, sockets and discovery. As in a live session, the HRTCs request the session time from the host,
/// and samples are in session time. World frame, SI. The same settings and calls give the same run. One thread.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "client_sim/operator.hpp"
#include "haptics/simulated_device.hpp"
#include "host_service/host_core.hpp"
#include "hrtc_service/servo/bodies.hpp"
#include "netem/profile.hpp"
#include "session/units.hpp"
#include "study/subject.hpp"
#include "study/virtual_link.hpp"

namespace tactus::study {

/// Called before and after the work of an HRTC's haptic thread in each cycle.
class CycleObserver {
 public:
  virtual ~CycleObserver() = default;
  virtual void on_begin() = 0;
  virtual void on_end() = 0;
};

struct SharedSessionSettings {
  CycleObserver* observer = nullptr;  ///< must outlive the session; may be null
  netem::LinkSettings link;           ///< `a_to_b` is from the host to HRTCs and viewer
  std::uint64_t seed = 1;             ///< of losses, delays and hands
  double mass = 0.5;                  ///< kg, of the object
  double tremor = 0;                  ///< m rms, of the hands
  bool host_begins_late = false;      ///< the host begins the session after the first HRTC has joined
};

class SharedSession {
 public:
  /// The object is on the ground at the origin. `subject` must outlive this.
  SharedSession(const Subject& subject, const SharedSessionSettings& settings);
  ~SharedSession();

  /// Adds an HRTC whose machine has a clock that is ahead of the host's by `clock_offset_ns`. Returns its index.
  std::size_t add_hrtc(std::int64_t clock_offset_ns = 0);
  /// Adds a user at the HRTC. The user's hand starts where the script begins. Returns the user's index.
  std::size_t add_user(std::size_t hrtc, const client_sim::User& user);
  /// Adds a user without a script, whose hand moves only by move_hand. Returns the user's index.
  std::size_t add_hand(std::size_t hrtc, const spm::Vec3d& start);
  void move_hand(std::size_t user, const spm::Vec3d& to);

  void stop_host();
  /// Starts the host again, with a new incarnation.
  void start_host();
  /// Ends all sending and receiving of the HRTC.
  void kill_hrtc(std::size_t hrtc);

  /// Advances by one millisecond.
  void step();

  [[nodiscard]] std::int64_t now_ns() const noexcept { return now_ns_; }
  [[nodiscard]] std::size_t hrtcs() const noexcept { return hrtcs_.size(); }
  [[nodiscard]] const sharing::SharedBody& shared() const noexcept { return shared_; }
  /// State of the body after the last haptic cycle of an HRTC; null before the HRTC has the object.
  [[nodiscard]] const hrtc_service::BodyReport* body(std::size_t hrtc) const;
  [[nodiscard]] session::Claimant::Role role(std::size_t hrtc) const;
  [[nodiscard]] double figure(std::size_t hrtc, const std::string& name) const;
  [[nodiscard]] const haptics::PassivityController::Ledger& port(std::size_t user) const;
  [[nodiscard]] const hrtc_service::ProbeOutput& probe(std::size_t user) const;
  /// The operator of a user. The user must have a script.
  [[nodiscard]] const client_sim::Operator& operator_of(std::size_t user) const {
    return *users_[user].script_operator;
  }
  /// Returns whether all scripts have ended.
  [[nodiscard]] bool done() const;
  /// Call only while the host runs.
  [[nodiscard]] const host_service::ObjectAuthority& object_authority() const { return host_->authority(); }
  /// The newest pose that a viewer has accepted.
  [[nodiscard]] const session::ObjectPose& viewer_pose() const noexcept { return viewer_pose_; }

 private:
  struct Hrtc;
  struct User {
    std::size_t hrtc = 0;
    std::uint32_t probe = 0;
    std::uint64_t id = 0;
    std::uint32_t sequence = 0;                             // number of the last probe state
    std::unique_ptr<haptics::SimulatedDevice> device;       // null until the hand's start position is known
    std::unique_ptr<client_sim::Operator> script_operator;  // null: a user without a script
    haptics::HandSettings hand;
  };
  using Arrive = std::function<void()>;

  std::size_t append_user(std::size_t hrtc, User user);
  void add_links(std::size_t node);
  void send(std::size_t from, std::size_t to, std::size_t bytes, Arrive arrive);
  void to_host(std::size_t from, std::size_t bytes, Arrive arrive);
  void to_hrtc(std::size_t from, std::size_t i, std::size_t bytes, std::function<void(Hrtc&)> arrive);
  void publish(std::size_t from, const session::ObjectPose& pose);
  void on_viewer_pose(const session::ObjectPose& pose);

  void haptic_cycle(std::size_t i);
  void send_reports(std::size_t i);
  void step_gateway(std::size_t i);
  void step_user(User& user);
  void host_tick();
  void send_to_hrtcs(std::size_t from, std::size_t bytes, const std::function<void(Hrtc&)>& arrive);
  void send_catalogue(std::size_t hrtc);
  void send_clock(std::size_t from, const session::ClockSample& sample);
  void send_membership(std::size_t i);

  const Subject& subject_;
  SharedSessionSettings settings_;
  session::CatalogueEntry entry_;
  sharing::SharedBody shared_;
  std::unique_ptr<host_service::HostCore> host_;
  std::uint64_t host_changes_ = 0;  // number of starts and stops of the host
  std::vector<std::unique_ptr<Hrtc>> hrtcs_;
  std::vector<User> users_;
  std::vector<std::vector<VirtualLink<Arrive>>> links_;  // [from][to]; order: host, viewer, HRTCs
  client_sim::Objects view_;                             // objects as the viewer sees them
  session::PoseAdmission pose_admission_;                // of the viewer
  session::ObjectPose viewer_pose_;
  std::int64_t now_ns_ = 10'000 * kMs;
};

}  // namespace tactus::study
