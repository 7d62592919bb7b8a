/// The ownership client: claims the movable objects that users of an HRTC hold, and decides who simulates each object.
///
///     reports of the haptic thread --> Holder --> claims
///     grants, poses of others -------->        --> orders for the haptic thread (Bodies)
///
/// A coupling is made here, where its histories may be filled, and stays until the haptic thread has seen orders
/// without it. When a host is gone and a grant runs out, the copies continue together as long as they receive each
/// other's samples; the poses that they publish are valid again once a host has granted the object.
///
/// Times come as arguments; no DDS, no thread. The service's thread. Not realtime.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <vector>

#include "hrtc_service/bodies.hpp"
#include "session/figures.hpp"
#include "session/ownership.hpp"
#include "session/transit.hpp"

namespace tactus::hrtc_service {

inline constexpr std::int64_t kBodyPoseNs = 4'000'000;  ///< between poses of what moves here

class OwnershipClient {
 public:
  /// `orders` belongs to the haptic thread and must outlive this.
  OwnershipClient(const session::Origin& self, haptics::Mailbox<BodyOrders>& orders,
                  const session::OwnershipSettings& settings = {});

  /// An object that can move, in the order in which the haptic thread gets them. False: there are kMaxBodies already,
  /// and it will stay where it is.
  bool add(std::uint32_t object_index, std::uint64_t object_id, const sharing::SharedBody& body);

  /// The object is withdrawn: it is claimed no more, and orders do not name it. Its couplings stay until `free`.
  void withdraw(std::uint32_t object_index);
  /// The haptic thread has forgotten it.
  void free(std::uint32_t object_index) { withdrawn_.erase(object_index); }

  void on_grant(const session::ObjectGrant& grant, std::int64_t now_ns);
  void on_pose(const session::ObjectPose& pose, std::int64_t now_ns);
  /// Reports the arrival of a peer's sample.
  void on_peer_received(std::uint32_t object_index, std::int64_t now_ns);
  /// Sets ObjectClaim::one_way_ns of the next claims from the measured transit of the samples that arrive here.
  void on_transits(const session::TransitEstimator& transits) noexcept;

  void on_reports(const BodyReports& reports);
  /// Posts orders; the claims to send now.
  [[nodiscard]] std::vector<session::ObjectClaim> tick(std::int64_t now_ns, const session::ClockMap& clock);

  struct Held {
    std::uint32_t object = 0;  ///< index
    std::uint64_t id = 0;
    bool held = false;   ///< by a user here
    session::Pose pose;  ///< where it is shown
  };
  /// All bodies, as of the last reports.
  [[nodiscard]] const std::vector<Held>& bodies() const noexcept { return shown_; }
  [[nodiscard]] session::Holder::Role role(std::uint32_t object_index, std::int64_t now_ns) const;

  void write(std::vector<session::Figure>& figures) const;
  /// Grants and poses dropped because they are outside their windows.
  [[nodiscard]] std::uint64_t implausible() const noexcept;

 private:
  struct Group {
    std::uint64_t fencing = 0;
    std::unique_ptr<haptics::CopyCoupling> coupling;
    std::uint64_t unused_from = 0;  // number of the first orders without it; 0: in use
  };
  struct Object {
    std::uint32_t index;
    std::uint64_t id;
    sharing::SharedBody body;
    session::Holder holder;
    session::PoseGate gate;
    sharing::ReceivedPose received;
    std::deque<Group> groups;  // the last may be in use
    std::int64_t peer_received_ns = 0;
    // Figures.
    std::uint64_t last_group = 0;
    haptics::CopyCoupling::Ledger ledger;
    double given_before = 0, received_before = 0;  // by groups before the last
  };

  [[nodiscard]] Object* find(std::uint64_t id);
  void choose_group(Object& object, std::int64_t now_ns);
  void post();

  session::Origin self_;
  session::OwnershipSettings settings_;
  haptics::Mailbox<BodyOrders>& orders_out_;
  BodyOrders orders_;
  std::vector<std::unique_ptr<Object>> objects_;
  std::map<std::uint32_t, std::unique_ptr<Object>> withdrawn_;  // by index
  std::vector<Held> shown_;
  std::int64_t one_way_ns_ = 0;
  BodyReports reports_;
  double apart_max_ = 0;
  std::uint64_t groups_made_ = 0;
};

}  // namespace tactus::hrtc_service
