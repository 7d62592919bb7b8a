/// A VE host's half of delivery: compares what each HRTC has with what it wants, and says which chunk to send next.
///
/// State, not commands: the newest demand of each HRTC for each object is all that counts, so lost demands, a restarted
/// host and an HRTC that comes back need no special case. Per HRTC and object it keeps
///
///     have      the regions that the newest demand names
///     messages  regions planned since and not yet in `have`: which records, which of its parts are to be sent
///     under way the parts sent and not yet told of: sequence of the chunk, message, part
///
/// A wanted region travels as its list and the records that no list of `have` or of a message sent holds. The demand is
/// the only repair. A chunk that it tells missing is sent again under a new sequence, its payload encoded anew from the
/// message's records; a message that has come whole and was passed (`received`) without being taken into `have` was
/// refused there and is planned anew if still wanted. While chunks are under way and nothing else is to be sent, an
/// echo now and then shows the HRTC whether the last of them are missing.
///
/// A chunk is filled: with parts that were lost, the rest of a message, the next ones whole, and the first part of one
/// more, cut to what room is left. One message at a time is begun per HRTC and object. A newer demand may find one
/// begun: it goes on when its region is still wanted and still carries all that is missing; otherwise the rest of it is
/// never sent and it is planned anew. So does one whose last parts were lost. So every chunk holds under the epoch it
/// carries, which is the newest seen: whatever left `have` at that epoch or before is not counted on. Order: round
/// robin between HRTCs chunk by chunk; within one, soonest contact first over its objects, and what was lost before
/// what is new. A Pacer for each HRTC says how much and how fast.
///
/// No clock, socket or thread in it; one thread at a time. Memory for each HRTC and object served: the demand, the
/// messages under way and what they and `have` cover as runs of records (spm/interval_set.hpp), some 30 KiB. Of an HRTC
/// that holds more scattered regions than these runs can tell, records that others of its regions list are sent again.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <vector>

#include "session/message_parts.hpp"
#include "session/messages.hpp"
#include "session/pacer.hpp"
#include "session/sequence_window.hpp"
#include "spm/codec/compressed_model.hpp"
#include "spm/interval_set.hpp"
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
  std::uint64_t repeated = 0;          ///< and those sent again
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
  void add(std::uint64_t object_id, const spm::codec::CompressedModel& model);

  /// Size of the encoded base mesh, for the catalogue. The object must have been added.
  [[nodiscard]] std::uint32_t base_bytes(std::uint64_t object_id) const;

  enum class DemandResult : std::uint8_t {
    kTaken,
    kNotNewer,    ///< an older epoch or repetition
    kNotServed,   ///< another session, an unknown object or another digest
    kMalformed,   ///< runs out of order, regions that the model does not have
    kImplausible  ///< its incarnation, epoch or time is outside its window (session/sequence_window.hpp)
  };
  DemandResult on_demand(const Demand& demand, std::int64_t now_ns);

  /// Forgets what it knew of this HRTC. Its next stream goes on above every sequence used so far. An HRTC that sends no
  /// demand for ten keep-alive periods is forgotten without this call: a demand may arrive after its sender has left.
  void on_hrtc_gone(std::uint64_t hrtc);

  /// Whether a chunk could be handed to the network for this HRTC now.
  using CanSend = std::function<bool(std::uint64_t hrtc)>;
  /// The next chunk to send, or none until `due_ns` or a demand. Nothing is planned for an HRTC that `can_send` denies.
  [[nodiscard]] std::optional<Outgoing> next(std::int64_t now_ns, const CanSend& can_send = {});
  /// After `next` gave none: when it may give one though no demand comes.
  [[nodiscard]] std::int64_t due_ns() const noexcept { return due_ns_; }

  /// Bytes sent to this HRTC that it has not answered; never above the credit that it gave.
  [[nodiscard]] std::uint64_t bytes_under_way(std::uint64_t hrtc) const;
  /// That of an HRTC which has sent a demand; none for others.
  [[nodiscard]] const Pacer* pacer(std::uint64_t hrtc) const;
  /// Since the HRTC was first heard of; HRTCs that are gone are left out.
  [[nodiscard]] std::map<std::uint64_t, DeliveryCounters> counters_by_hrtc() const;
  /// Of all HRTCs since the start.
  [[nodiscard]] const DeliveryCounters& counters() const noexcept { return counters_; }

 private:
  struct Object {
    spm::codec::CompressedModel model;
    std::uint32_t base_checksum = 0;
  };
  struct Message {
    std::uint32_t number = 0;           // in the order of planning
    std::uint32_t region = spm::kNone;  // kNone: the base mesh
    std::uint32_t contact_in_us = 0;
    std::uint32_t checksum = 0;
    MessageParts parts;
    std::uint32_t begun = 0;      // parts sent at least once
    bool doubtful = false;        // counts on what the HRTC may not have any more
    std::uint32_t under_way = 0;  // chunks
    std::uint32_t last_sequence = 0;
    std::vector<std::uint32_t> lost;  // parts to be sent again
    std::vector<spm::Interval> records;
    [[nodiscard]] bool sent() const noexcept { return begun == parts.count; }
    [[nodiscard]] bool arrived() const noexcept { return sent() && under_way == 0 && lost.empty(); }
    [[nodiscard]] bool fits(std::uint32_t part, std::size_t room) const noexcept;
  };
  struct Sent {
    std::uint32_t sequence, message, at_us, part;
    std::uint16_t bytes;
  };
  /// One object to one HRTC.
  struct Service {
    Demand demand;
    SequenceWindow epochs{kEpochNumbers};
    bool serving = false;
    bool echo_owed = false;
    std::uint32_t stream = 0;
    std::uint32_t sequence = 0;  // last used
    std::int64_t mark_ns = 0;    // when an echo shows what is missing
    std::int64_t mark_interval_ns = 0;
    std::deque<Sent> under_way;         // by sequence
    std::uint32_t planned = 0;          // messages
    std::vector<Message> messages;      // by number; none but the last is not sent()
    std::vector<std::uint8_t> encoded;  // payload of the last while it is not
    spm::IntervalSet covered;           // records that a region of have lists, or a message that is sent()
    std::vector<Wanted> to_send;        // soonest last
    [[nodiscard]] Message* begun() noexcept {
      return messages.empty() || messages.back().sent() ? nullptr : &messages.back();
    }
  };
  struct Controller {
    SourceWindow source;
    TimeWindow times;
    WrappedTimeWindow one_ways;
    std::int64_t received_ns = 0;  // the newest demand
    std::int64_t credit_time_ns = 0;
    std::uint32_t credit = 0;
    Pacer pacer;
    std::map<std::uint64_t, Service> services;  // by object
    DeliveryCounters counters;
  };

  [[nodiscard]] bool well_formed(const Demand& demand, const spm::ModelSummary& summary) const;
  void note_sequences(const Controller& controller);
  void acknowledge(Controller& controller, Service& service, std::int64_t now_ns);
  void compare(Controller& controller, Service& service, const Object& object, const std::vector<spm::Interval>* had);
  void cover(Service& service, const Object& object, std::uint32_t region) const;
  [[nodiscard]] static Message* first_lost(Service& service, std::size_t room = kMaxPayload);
  [[nodiscard]] static std::optional<std::uint32_t> urgency(Service& service);
  void plan(Service& service, const Object& object, std::size_t room) const;
  [[nodiscard]] static std::uint64_t unanswered(const Controller& controller);
  [[nodiscard]] std::optional<Outgoing> next(std::uint64_t hrtc, Controller& controller, std::int64_t now_ns);
  [[nodiscard]] Outgoing send_echo(std::uint64_t hrtc, Controller& controller, Service& service, std::int64_t now_ns);
  [[nodiscard]] Outgoing send_parts(std::uint64_t hrtc, Controller& controller, std::uint64_t object_id,
                                    std::int64_t now_ns);
  [[nodiscard]] std::optional<BulkPiece> next_piece(Controller& controller, Service& service, const Object& object,
                                                    const BulkChunk& chunk, std::size_t room);
  std::map<std::uint64_t, Controller>::iterator forget(std::map<std::uint64_t, Controller>::iterator controller);
  [[nodiscard]] BulkChunk make_chunk(Controller& controller, Service& service, std::int64_t now_ns);
  template <class Count>
  void count(Controller& controller, Count add) {
    add(controller.counters);
    add(counters_);
  }

  Origin self_;
  std::map<std::uint64_t, Object> objects_;
  std::map<std::uint64_t, Controller> controllers_;  // by HRTC
  std::uint64_t last_served_ = 0;
  std::uint32_t highest_forgotten_ = 0;  // sequence used in a stream to an HRTC that is gone
  std::int64_t due_ns_ = 0;
  DeliveryCounters counters_;
};

}  // namespace tactus::session
