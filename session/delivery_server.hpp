/// A VE host's half of delivery: compares what each HRTC has with what it wants, and says which chunk to send next.
///
/// State, not commands: the newest demand of each HRTC for each object is all that counts, so lost demands, a restarted
/// host and an HRTC that comes back need no special case. Per HRTC and object it keeps
///
///     have   the regions that the newest demand names
///     sent   regions sent since and not yet in `have`, each with the stream sequence of its last chunk
///
/// A wanted region travels as its list and the records that no list of `have` or `sent` holds. A sent region that the
/// HRTC has passed (`received`) without taking it into `have` was lost or refused there and is sent again if still
/// wanted.
///
/// One message at a time per HRTC and object. A newer demand may find one under way: it goes on when its region is
/// still wanted and still carries all that is missing; otherwise the rest of it is never sent and it is planned anew.
/// So every chunk holds under the epoch it carries, which is the newest seen: whatever left `have` at that epoch or
/// before is not counted on. Order: round robin between HRTCs chunk by chunk; within one, soonest contact first over
/// its objects.
///
/// No clock, socket or thread in it; one thread at a time. Memory: a bit per record and the message under way, for each
/// HRTC and object served.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <vector>

#include "session/messages.hpp"
#include "spm/codec/coded_model.hpp"
#include "spm/model.hpp"

namespace tactus::session {

/// A chunk and the HRTC whose stream it belongs to.
struct Outgoing {
  std::uint64_t hrtc = 0;
  BulkChunk chunk;
};

struct DeliveryCounters {
  std::uint64_t chunks = 0;
  std::uint64_t payload_bytes = 0;
  std::uint64_t echoes = 0;            ///< of the chunks, those without payload
  std::uint64_t bases = 0;             ///< base meshes sent to their end
  std::uint64_t regions = 0;           ///< regions sent to their end
  std::uint64_t records = 0;           ///< records in them
  std::uint64_t messages_dropped = 0;  ///< under way when a newer demand cancelled or contradicted them
};

class DeliveryServer {
 public:
  /// `self` gives session, participant and incarnation of all that is sent.
  explicit DeliveryServer(const Origin& self);

  /// What `model` borrows must outlive the server.
  void add(std::uint64_t object_id, const spm::codec::CodedModel& model);

  /// Size of the encoded base mesh, for the catalogue. The object must have been added.
  [[nodiscard]] std::uint32_t base_bytes(std::uint64_t object_id) const;

  enum class DemandResult : std::uint8_t {
    kTaken,
    kNotNewer,   ///< an older epoch, incarnation or repetition
    kNotServed,  ///< another session, an unknown object or another digest
    kMalformed   ///< runs out of order, regions that the model does not have
  };
  DemandResult on_demand(const Demand& demand);

  /// Forgets what it knew of this HRTC. Its next stream goes on above every sequence used so far.
  void on_hrtc_gone(std::uint64_t hrtc);

  /// Whether a chunk could be handed to the network for this HRTC now.
  using CanSend = std::function<bool(std::uint64_t hrtc)>;
  /// The next chunk to send, or none until a demand arrives. Nothing is planned for an HRTC that `can_send` denies.
  [[nodiscard]] std::optional<Outgoing> next(std::int64_t now_ns, const CanSend& can_send = {});

  /// Bytes sent to this HRTC that it has not yet acknowledged; never above the credit that it gave.
  [[nodiscard]] std::uint64_t bytes_under_way(std::uint64_t hrtc) const;
  /// Since the HRTC was first heard of; HRTCs that are gone are left out.
  [[nodiscard]] std::map<std::uint64_t, DeliveryCounters> counters_by_hrtc() const;
  /// Of all HRTCs since the start.
  [[nodiscard]] const DeliveryCounters& counters() const noexcept { return counters_; }

 private:
  struct Object {
    spm::codec::CodedModel model;
    std::uint64_t base_checksum = 0;
  };
  struct UnderWay {
    BulkKind kind = BulkKind::kBase;
    std::uint32_t region = spm::kNone;
    std::uint32_t contact_in_us = 0;
    std::vector<std::uint8_t> bytes;  // empty for a base mesh: the object's are used
    std::vector<spm::Run> records;
    std::uint64_t checksum = 0;
    std::uint32_t part = 0, parts = 1;
  };
  /// One object to one HRTC.
  struct Service {
    Demand demand;
    bool serving = false;
    bool echo_owed = false;
    std::map<std::uint32_t, std::uint32_t> sent;  // region -> sequence of its last chunk
    std::uint32_t count_on_after = 0;             // what was sent up to here may be refused
    std::optional<std::uint32_t> base_sent;       // sequence of the last chunk of the base mesh
    std::vector<std::uint64_t> covered;           // bit per record: listed by a region of have, or sent and counted on
    std::vector<Wanted> to_send;                  // soonest last
    std::optional<UnderWay> under_way;
  };
  struct Stream {
    std::uint64_t hrtc_incarnation = 0;
    std::uint32_t sequence = 0;  // last used
    std::int64_t credit_time_ns = 0;
    std::uint32_t credit = 0;
    std::deque<std::pair<std::uint32_t, std::uint32_t>> unacknowledged;  // sequence, bytes
    std::uint64_t unacknowledged_bytes = 0;
    std::map<std::uint64_t, Service> services;  // by object
    DeliveryCounters counters;
  };

  [[nodiscard]] bool well_formed(const Demand& demand, const spm::ModelSummary& summary) const;
  void acknowledge(Stream& stream, std::uint32_t received) const;
  void compare(Service& service, const Object& object, const std::vector<spm::Run>* had, std::uint32_t received,
               Stream& stream);
  void cover(Service& service, const spm::codec::CodedModel& model, std::uint32_t region) const;
  [[nodiscard]] std::vector<spm::Run> missing(const Service& service, const spm::codec::CodedModel& model,
                                              std::uint32_t region) const;
  [[nodiscard]] bool still_holds(const Service& service, const spm::codec::CodedModel& model) const;
  [[nodiscard]] static std::optional<std::uint32_t> urgency(const Service& service);
  void begin(Service& service, const Object& object) const;
  [[nodiscard]] Outgoing send_part(std::uint64_t hrtc, Stream& stream, std::uint64_t object_id, std::int64_t now_ns);
  [[nodiscard]] BulkChunk make_chunk(std::uint64_t hrtc, Stream& stream, std::uint64_t object_id, Service& service,
                                     std::int64_t now_ns);
  template <class Count>
  void count(Stream& stream, Count add) {
    add(stream.counters);
    add(counters_);
  }

  Origin self_;
  std::map<std::uint64_t, Object> objects_;
  std::map<std::uint64_t, Stream> streams_;  // by HRTC
  std::uint64_t last_served_ = 0;
  std::uint32_t highest_forgotten_ = 0;  // sequence used by a stream that is gone
  DeliveryCounters counters_;
};

}  // namespace tactus::session
