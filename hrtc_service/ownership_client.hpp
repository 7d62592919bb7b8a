/// Claims the movable objects that users of this HRTC touch, and derives from the grants of hosts which objects the
/// haptic thread simulates, publishes or couples to the copies of peers.
///
///     reports of the haptic thread --+--> Claimant, one for each object --+--> claims
///     grants, poses of others -------+                                    +--> orders for the servo (BodyIntake)
///
/// If the host is gone and the grant expires, the copies remain coupled as long as they receive samples from each
/// other. Other programs ignore the poses of the copies until a host grants the object again.
///
/// Times are arguments. No DDS. Service thread. Not realtime.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "hrtc_service/servo/bodies.hpp"
#include "session/figures.hpp"
#include "session/ownership.hpp"
#include "session/transit.hpp"

namespace tactus::hrtc_service {

inline constexpr std::int64_t kPosePeriodNs = 4'000'000;  ///< min time between published poses of one object

class OwnershipClient {
 public:
  /// `orders`: mailbox to the servo; must outlive the client.
  OwnershipClient(const session::Origin& self, SharedMailbox<GrantedBodies>& orders,
                  const session::OwnershipSettings& settings = {});

  /// Adds a movable object, at most kMaxBodies at a time. Call it in the order of the arrivals in the haptic thread.
  void add(std::uint32_t object_index, std::uint64_t object_id, const sharing::SharedBody& body);

  /// Removes a withdrawn object.
  void withdraw(std::uint32_t object_index);

  void on_grant(const session::ObjectGrant& grant, std::int64_t now_ns);
  void on_pose(const session::ObjectPose& pose, std::int64_t now_ns);
  /// Stores the arrival time of the newest sample from a peer.
  void on_peer_received(std::uint32_t object_index, std::int64_t now_ns);
  /// Sets ObjectClaim::one_way_ns of the next claims from the measured transit times of arriving samples.
  void on_transits(const session::TransitEstimator& transits) noexcept;

  void on_reports(const BodyReports& reports);
  /// Posts orders, and returns the claims to send now.
  [[nodiscard]] std::vector<session::ObjectClaim> tick(std::int64_t now_ns, const session::ClockMap& clock);

  struct BodyStatus {
    std::uint32_t object_index = 0;
    std::uint64_t id = 0;
    bool is_touched = false;  ///< a user of this HRTC touches it
    session::Pose pose;       ///< in the haptic thread
  };
  /// Returns the status of all movable objects in the last reports.
  [[nodiscard]] const std::vector<BodyStatus>& bodies() const noexcept { return bodies_; }
  /// Returns the grant of the coupling of an object in use; an empty one if the object is not coupled.
  [[nodiscard]] const session::ObjectGrant& group(std::uint32_t object_index) const;
  [[nodiscard]] session::Claimant::Role role(std::uint32_t object_index, std::int64_t now_ns) const;

  void add_figures(std::vector<session::Figure>& figures) const;
  /// Returns the number of grants and poses that were dropped outside their plausible windows.
  [[nodiscard]] std::uint64_t implausible() const noexcept;

 private:
  struct Object {
    std::uint32_t index;
    std::uint64_t id;
    sharing::SharedBody body;
    session::Claimant claimant;
    session::PoseAdmission pose_admission;
    sharing::ReceivedPose received;
    GrantedCoupling coupling;    // in use
    session::ObjectGrant group;  // of `coupling`
    std::int64_t peer_received_ns = 0;
    // Figures.
    std::uint64_t last_fencing = 0;            // of the coupling in `ledger`
    haptics::CopyCoupling::Ledger ledger;      // of the last coupling
    double past_given = 0, past_received = 0;  // J, sums over all couplings before that one
  };

  [[nodiscard]] Object* find(std::uint64_t id);
  /// Sets or releases the object's coupling according to the role of this HRTC.
  void update_coupling(Object& object, std::int64_t now_ns);
  void post_orders();

  session::Origin self_;
  session::OwnershipSettings settings_;
  MailboxWriter<GrantedBodies> orders_out_;
  std::uint64_t pose_number_ = 0;  // of the newest received pose, also under earlier gateways
  GrantedBodies orders_;
  std::vector<std::unique_ptr<Object>> objects_;
  std::vector<BodyStatus> bodies_;
  std::int64_t transit_with_margin_ns_ = 0;
  BodyReports reports_;
  double max_separation_ = 0;
  std::uint64_t couplings_made_ = 0;
};

}  // namespace tactus::hrtc_service
