/// What an HRTC and the others tell each other of objects that can move: the DDS half of OwnershipClient and Bodies.
///
///     object_grant, object_pose  --> service's inbox     service  --> object_claim
///     object_copy of peers       --> haptic thread's ring     sender --> object_copy, object_pose
///
/// The ends for copies of an object are in a partition of its own, and only there while a user here holds it: nobody
/// else is burdened with a sample from each holder each cycle.
///
/// Service thread, but for what says otherwise.
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

  /// An object that is shown from now on.
  void add(const TouchObject& object);
  /// Before each tick of the gateway: opens and closes endpoints, passes on the transit times of copies.
  void tick(std::int64_t now_ns, const session::ClockMap& clock);
  /// After it.
  void send_claims();
  /// Copies dropped because they are outside their windows.
  [[nodiscard]] std::uint64_t implausible() const;

  /// Sender's thread: what the haptic thread reported of its last cycle. Takes no lock.
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
  mutable std::mutex ring_mutex_;                // of those who fill the haptic thread's ring, and of the gates
  std::array<session::CopyGate, kMaxObjects> gates_;
  std::array<std::atomic<std::int64_t>, kMaxObjects> copy_received_ns_{};
  std::atomic<std::int64_t> session_offset_ns_{0};
  std::atomic<std::int64_t> copy_transit_ns_{-1};  // the greatest since the service last looked; -1: none came
  Slots slots_;
  Handover<Slots> slots_out_;                                            // to the sender
  Retired<std::unique_ptr<wire::Writer<session::ObjectCopy>>> dropped_;  // until the sender has let go of them
  std::array<Sent, kMaxObjects> sent_;
  std::map<std::uint64_t, Endpoints> endpoints_;  // by object; last, so that no callback outlives what it fills
};

}  // namespace tactus::hrtc_service
