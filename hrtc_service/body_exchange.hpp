/// Exchanges samples about movable objects with hosts and other HRTCs: the DDS half of OwnershipClient and Bodies.
///
///     object_grant, object_pose  --> service's inbox     service  --> object_claim
///     object_copy of peers       --> haptic thread's ring     sender --> object_copy, object_pose
///
/// The endpoints for copies of an object are in a partition of that object, and exist only while a user here holds it.
/// So no other participant receives a sample of each holder in each cycle.
///
/// Service thread, except where a comment says otherwise.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <vector>

#include "hrtc_service/gateway.hpp"
#include "hrtc_service/handover.hpp"
#include "session/ownership.hpp"
#include "wire/endpoints.hpp"

namespace tactus::hrtc_service {

class BodyExchange {
 public:
  /// All must outlive it.
  BodyExchange(wire::Participants& participants, BodyLink& link, Gateway& gateway);
  ~BodyExchange();

  /// Adds an object when the HRTC begins to show it.
  void add(const TouchObject& object);
  /// The servo has forgotten the object.
  void remove(std::uint32_t object_index, std::uint64_t object_id);
  /// Before each tick of the gateway: opens and closes endpoints, passes on the transit times of copies.
  void tick(std::int64_t now_ns, const session::ClockMap& clock);
  /// After each tick of the gateway.
  void send_claims();
  /// Copies dropped because they are outside their windows.
  [[nodiscard]] std::uint64_t implausible() const;

  /// Sender's thread: sends the haptic thread's report of its last cycle. Takes no lock.
  void send();

 private:
  struct Endpoints {
    std::uint32_t object = 0;  // index
    std::unique_ptr<wire::Writer<session::ObjectCopy>> out;
    std::unique_ptr<wire::Reader<session::ObjectCopy>> in;
    std::int64_t held_ns = 0;
  };
  /// Of one object index, for the sender.
  struct Slot {
    std::uint64_t id = 0;
    Plain3 centre{};
    wire::Writer<session::ObjectCopy>* copies = nullptr;
  };
  using Slots = std::array<Slot, kMaxObjects>;
  /// The sender's own, by object index.
  struct Sent {
    std::uint32_t copy_sequence = 0, pose_sequence = 0;
    std::int64_t pose_sent_ns = 0;
  };

  void sync_endpoints(std::int64_t now_ns);
  void on_copy(std::uint32_t object, const session::ObjectCopy& copy);

  wire::Participants& participants_;
  BodyLink& link_;
  Gateway& gateway_;
  wire::Writer<session::ObjectClaim> claims_out_;
  wire::Writer<session::ObjectPose> poses_out_;  // the sender's
  mutable std::mutex ring_mutex_;                // guards the producer's end of the haptic thread's ring, and the gates
  std::array<session::CopyGate, kMaxObjects> gates_;
  std::uint64_t implausible_before_ = 0;  // by the gates of objects that are gone
  std::array<std::atomic<std::int64_t>, kMaxObjects> copy_received_ns_{};
  std::atomic<std::int64_t> session_offset_ns_{0};
  std::atomic<std::int64_t> copy_transit_ns_{-1};  // the maximum since the service last read it; -1: none came
  Slots slots_;
  Handover<Slots> slots_out_;                                            // to the sender
  Retired<std::unique_ptr<wire::Writer<session::ObjectCopy>>> dropped_;  // until the sender no longer uses them
  std::array<Sent, kMaxObjects> sent_;
  std::map<std::uint64_t, Endpoints> endpoints_;  // by object; last, so that callbacks end before their targets
};

}  // namespace tactus::hrtc_service
