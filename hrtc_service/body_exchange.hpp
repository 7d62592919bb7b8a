/// Sends and receives the samples of OwnershipClient and Bodies about movable objects.
///
///     object_copy of peers  --> ring BodyLink::copies     sender thread   --> object_copy, object_pose
///                                                         service thread  --> object_claim
///
/// The endpoints for copies of an object are in a partition of that object. They exist only while a user of this HRTC
/// touches the object. So only the HRTCs that simulate the object receive its copies, one sample in each cycle.
///
/// Service thread, unless a comment names another one.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <map>
#include <memory>
#include <vector>

#include "hrtc_service/gateway.hpp"
#include "hrtc_service/handover.hpp"
#include "realtime/inheriting_mutex.hpp"
#include "session/ownership.hpp"
#include "wire/endpoints.hpp"

namespace tactus::hrtc_service {

class BodyExchange {
 public:
  /// The arguments must outlive the exchange.
  BodyExchange(wire::Participants& participants, BodyLink& link, Gateway& gateway);
  ~BodyExchange();

  /// Adds an object that was passed to the servo. Ignores fixed objects.
  void add(const ObjectDescription& object);
  /// Removes an object that the servo has returned.
  void remove(std::uint32_t object_index, std::uint64_t object_id);
  /// Opens and closes endpoints, and passes the transit times of copies to the gateway. Call it before each tick of the
  /// gateway.
  void tick(std::int64_t now_ns, const session::ClockMap& clock);
  /// Sends the claims of the gateway, and accepts copies of the groups that it has joined. Call it after each tick of
  /// the gateway.
  void after_tick();
  /// Returns the number of copies that were dropped outside their plausible windows.
  [[nodiscard]] std::uint64_t implausible() const;

  /// Sends copies and poses from the haptic thread's newest reports. Sender thread. Takes no lock.
  void send();

 private:
  struct Endpoints {
    std::uint32_t object = 0;  // index
    std::unique_ptr<wire::Writer<session::ObjectCopy>> writer;
    std::unique_ptr<wire::Reader<session::ObjectCopy>> reader;
    std::int64_t held_ns = 0;  // time when a user last touched the object
  };
  /// Data of one object for the sender.
  struct Slot {
    std::uint64_t id = 0;                                 // 0: no movable object has this index
    Plain3 centre{};                                      // of mass, model frame times scale, m
    wire::Writer<session::ObjectCopy>* copies = nullptr;  // null: no user touches the object
  };
  using Slots = std::array<Slot, kMaxObjects>;
  /// State of the sender for one object.
  struct Sent {
    std::uint32_t copy_sequence = 0, pose_sequence = 0;
    std::int64_t pose_sent_ns = 0;
  };

  void sync_endpoints(std::int64_t now_ns);
  void admit_groups();
  void on_copy(std::uint32_t object, const session::ObjectCopy& copy);

  wire::Participants& participants_;
  RingWriter<CopyArrival, BodyLink::kCopies> copies_out_;
  MailboxReader<BodyReports> reports_in_;  // sender thread only
  Gateway& gateway_;
  wire::Writer<session::ObjectClaim> claims_out_;
  wire::Writer<session::ObjectPose> poses_out_;   // sender thread only
  mutable realtime::InheritingMutex ring_mutex_;  // guards copies_out_ and copy_admissions_
  std::array<session::CopyAdmission, kMaxObjects> copy_admissions_;
  std::uint64_t past_implausible_ = 0;  // copies that the admissions of removed objects dropped
  std::array<std::atomic<std::int64_t>, kMaxObjects> copy_received_ns_{};
  std::atomic<std::int64_t> session_offset_ns_{0};
  std::atomic<std::int64_t> copy_transit_ns_{-1};  // max transit since the last tick; -1: no copy arrived
  Slots slots_;
  Handover<Slots> slots_out_;  // to the sender
  DeferredDestruction<std::unique_ptr<wire::Writer<session::ObjectCopy>>>
      dropped_;                         // until the sender no longer uses them
  std::array<Sent, kMaxObjects> sent_;  // by object index; sender thread only
  // By object id. Declared last, so that the callbacks of readers end before the members that they use are destroyed.
  std::map<std::uint64_t, Endpoints> endpoints_;
};

}  // namespace tactus::hrtc_service
