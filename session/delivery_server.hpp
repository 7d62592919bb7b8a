/// A VE host's side of delivery: compares the regions that each HRTC has with those that it wants, and selects the next
/// chunk to send.
///
/// Each demand is complete, so only the newest demand of each HRTC for each object counts. Lost demands, a restarted
/// host and a returning HRTC need no special case. For each HRTC and object the server stores
///
///     have       the regions that the newest demand lists
///     messages   the regions that were planned and are not yet in `have`: their records, and the pieces still to send
///     in_flight  the pieces in flight: sequence of the chunk, message, index
///
/// A wanted region is sent as its list of records, and with those records that neither a region of `have` nor a sent
/// message lists. The demand alone repairs losses. If a demand reports a chunk as a gap, the pieces of this chunk are
/// encoded anew from the records of the message and sent under a new sequence. If Demand::received states that all
/// chunks of a message were processed, but `have` lacks its region, the HRTC has refused the message. The server plans
/// the message anew while the region is wanted. While chunks are in flight and nothing else is to be sent, the server
/// sends echoes at growing intervals; they show the HRTC whether the last chunks are missing (a tail loss probe, as in
/// RFC 8985).
///
/// The server fills each chunk: first with lost pieces, then with the next piece of the current message, with whole
/// messages, and with the first piece of one more message, cut to the free bytes. For each HRTC and object at most one
/// message is partly sent. That message continues after a newer demand if its region is still wanted and it still
/// contains all missing records. Otherwise it is cancelled and planned anew. The same rule holds for a message with
/// lost pieces. A chunk carries the newest epoch that the server has received. It does not rely on regions that left
/// `have` at this epoch or before.
///
/// A region whose bytes are damaged is never sent: it stays coarse at every HRTC.
///
/// A wanted part of the directory (kFirstPage) is sent like a region. It has no records, and no demand lists it as
/// present: an HRTC that has it no longer wants it. An HRTC that waits for the base mesh gets it after that.
///
/// Order: HRTCs in round robin, chunk by chunk; the objects of one HRTC by soonest contact; lost pieces before new
/// ones. A Pacer for each HRTC limits the bytes in flight and the rate.
///
/// No clock, socket or thread; one thread at a time. Memory for each HRTC and object: the demand, the messages in
/// flight, and the covered records as intervals (spm/interval_set.hpp). The intervals take at most 40 KiB; with more
/// than eight pairs of HRTC and object this limit shrinks, down to 10 KiB. If the regions of an HRTC need more
/// intervals, some of their shared records are sent again.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "session/message_pieces.hpp"
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
  std::uint64_t echoes = 0;            ///< chunks without payload
  std::uint64_t repeated = 0;          ///< pieces sent again
  std::uint64_t bases = 0;             ///< base meshes sent completely
  std::uint64_t pages = 0;             ///< parts of directories sent completely
  std::uint64_t regions = 0;           ///< regions sent completely
  std::uint64_t records = 0;           ///< records in these regions
  std::uint64_t messages_dropped = 0;  ///< messages cancelled after a newer demand
  std::uint64_t comparisons = 0;       ///< demands whose regions were compared with those sent
};

class DeliveryServer {
 public:
  /// `self`: session, participant and incarnation of all chunks. `chunk_bytes`: max encoded size of the pieces of a
  /// chunk, at most kMaxPayload; smaller if messages need bytes for their protection (wire::Participants::chunk_bytes).
  explicit DeliveryServer(const Origin& self, std::size_t chunk_bytes = kMaxPayload);

  /// The data that `model` borrows must outlive the server.
  void add(std::uint64_t object_id, const spm::codec::CompressedModel& model);

  /// Size of the encoded base mesh, for the catalogue. The object must have been added.
  [[nodiscard]] std::uint32_t base_bytes(std::uint64_t object_id) const;

  enum class DemandResult : std::uint8_t {
    kApplied,
    kNotNewer,    ///< of an older epoch, or a repeated sample
    kNotServed,   ///< another session, an unknown object or another digest
    kMalformed,   ///< intervals out of order, or regions that the model does not have
    kImplausible  ///< incarnation, epoch or time outside its window (session/sequence_window.hpp)
  };
  /// Applies a demand if it is newer than the previous ones of this HRTC for this object. Leaves the comparison of its
  /// regions to `next`, which compares only the newest demand. So many demands between two calls of `next` cost one
  /// comparison.
  DemandResult on_demand(const Demand& demand, std::int64_t now_ns);

  /// Drops the state of this HRTC except the last sequence of each of its streams. If the same incarnation returns, its
  /// streams continue there. The server also drops an HRTC that sends no demand for ten keep-alive periods, because a
  /// demand may arrive after its sender has left.
  void on_hrtc_gone(std::uint64_t hrtc);

  /// Returns whether the network can accept a chunk for this HRTC now.
  using CanSend = std::function<bool(std::uint64_t hrtc)>;
  /// Returns the next chunk to send, or none. After none, call it again at `due_ns`, or when a demand arrives. Plans
  /// nothing for an HRTC for which `can_send` is false.
  [[nodiscard]] std::optional<Outgoing> next(std::int64_t now_ns, const CanSend& can_send = {});
  /// Time at which the next chunk may be due, after `next` has returned none.
  [[nodiscard]] std::int64_t due_ns() const noexcept { return due_ns_; }

  /// Damaged bytes of an object, which a wanted region needs.
  struct Damage {
    std::uint64_t object_id = 0;
    std::string text;
  };
  /// Returns the damage that `next` has found, each once.
  [[nodiscard]] std::vector<Damage> take_damage() { return std::exchange(damage_, {}); }

  /// Payload bytes sent to this HRTC that it has not answered. `next` sends no pieces above its newest credit.
  [[nodiscard]] std::uint64_t bytes_in_flight(std::uint64_t hrtc) const;
  /// The pacer of an HRTC that has sent a demand; null for others.
  [[nodiscard]] const Pacer* pacer(std::uint64_t hrtc) const;
  /// Counters of each HRTC since its first demand; HRTCs that were dropped are not listed.
  [[nodiscard]] std::map<std::uint64_t, DeliveryCounters> counters_by_hrtc() const;
  /// Sums over all HRTCs since the start.
  [[nodiscard]] const DeliveryCounters& counters() const noexcept { return counters_; }

 private:
  struct Object {
    spm::codec::CompressedModel model;
    std::uint32_t base_checksum = 0;
    std::set<std::uint32_t> damaged_regions;  // found so far
    std::string damage;                       // the last one found
  };
  struct Message {
    std::uint32_t number = 0;           // in the order of planning
    std::uint32_t region = spm::kNone;  // or a part of the directory (kFirstPage); kNone: the base mesh
    std::uint32_t contact_in_us = 0;
    std::uint32_t checksum = 0;
    MessagePieces pieces;
    std::uint32_t sent_pieces = 0;   // sent at least once
    bool relies_on_removed = false;  // relies on records that the HRTC may no longer have
    std::uint32_t in_flight = 0;     // pieces in flight
    std::uint32_t last_sequence = 0;
    std::vector<std::uint32_t> lost;  // indices of the pieces to send again
    std::vector<spm::Interval> records;
    [[nodiscard]] bool is_sent() const noexcept { return sent_pieces == pieces.count; }
    [[nodiscard]] bool has_arrived() const noexcept { return is_sent() && in_flight == 0 && lost.empty(); }
    [[nodiscard]] bool fits(std::uint32_t piece, std::size_t free_bytes) const noexcept;
  };
  struct SentPiece {
    std::uint32_t sequence, message, at_us, index;
    std::uint16_t bytes;
  };
  /// The delivery of one object to one HRTC.
  struct Service {
    Demand demand;
    SequenceWindow epochs{kEpochNumbers};
    bool serving = false;       // the newest demand names this host as Demand::serving_host
    bool echo_pending = false;  // no chunk has carried the epoch of the newest demand yet
    bool compare_due = false;   // the newest demand has not been compared yet
    // Demand::have of the last compared demand, while `compare_due`. None if `serving` became true after that demand.
    std::optional<std::vector<spm::Interval>> compared_have;
    std::uint32_t stream = 0;
    std::uint32_t sequence = 0;      // of the last chunk
    std::int64_t tail_probe_ns = 0;  // time of the next tail loss probe
    std::int64_t tail_probe_interval_ns = 0;
    std::deque<SentPiece> in_flight;    // by sequence
    std::uint32_t planned = 0;          // number of messages so far
    std::vector<Message> messages;      // by number; all but the last are sent
    std::vector<std::uint8_t> encoded;  // payload of the last message until it is sent
    spm::IntervalSet covered;           // records listed by a region of `have` or by a sent message
    std::vector<Wanted> to_send;        // soonest last
    /// Null when no message is partly sent.
    [[nodiscard]] Message* partly_sent() noexcept {
      return messages.empty() || messages.back().is_sent() ? nullptr : &messages.back();
    }
  };
  struct HrtcState {
    SourceWindow source;
    TimeWindow times;
    WrappedTimeWindow one_ways;
    std::int64_t received_ns = 0;     // arrival of the newest demand
    std::int64_t credit_time_ns = 0;  // sending time of the demand that stated `credit`
    std::uint32_t credit = 0;
    Pacer pacer;
    std::map<std::uint64_t, Service> services;  // by object
    DeliveryCounters counters;
  };

  [[nodiscard]] bool well_formed(const Demand& demand, const spm::ModelSummary& summary) const;
  void record_sequences(const HrtcState& state);
  void apply_receipt(HrtcState& state, Service& service, std::int64_t now_ns);
  void compare(HrtcState& state, Service& service, const Object& object);
  void add_covered_records(Service& service, const Object& object, std::uint32_t region) const;
  [[nodiscard]] static Message* first_lost(Service& service, std::size_t free_bytes = kMaxPayload);
  [[nodiscard]] static bool is_base_due(const Service& service) noexcept;
  [[nodiscard]] static std::optional<std::uint32_t> urgency(Service& service);
  [[nodiscard]] bool plan(Service& service, std::uint64_t object_id, std::size_t free_bytes);
  void drop_changed(HrtcState& state, Service& service, std::uint64_t object_id, const Message& message);
  void add_damage(std::uint64_t object_id, std::uint32_t region, const std::string& damage);
  [[nodiscard]] static std::uint64_t unanswered(const HrtcState& state);
  [[nodiscard]] std::optional<Outgoing> next(std::uint64_t hrtc, HrtcState& state, std::int64_t now_ns);
  [[nodiscard]] Outgoing send_echo(std::uint64_t hrtc, HrtcState& state, Service& service, std::int64_t now_ns);
  [[nodiscard]] Outgoing send_pieces(std::uint64_t hrtc, HrtcState& state, std::uint64_t object_id,
                                     std::int64_t now_ns);
  [[nodiscard]] std::optional<BulkPiece> next_piece(HrtcState& state, Service& service, std::uint64_t object_id,
                                                    const BulkChunk& chunk, std::size_t free_bytes);
  std::map<std::uint64_t, HrtcState>::iterator drop(std::map<std::uint64_t, HrtcState>::iterator state);
  [[nodiscard]] BulkChunk make_chunk(HrtcState& state, Service& service, std::int64_t now_ns);
  template <class Count>
  void count(HrtcState& state, Count add) {
    add(state.counters);
    add(counters_);
  }

  Origin self_;
  std::size_t chunk_bytes_;
  std::map<std::uint64_t, Object> objects_;
  std::map<std::uint64_t, HrtcState> hrtcs_;                  // by HRTC
  std::uint64_t last_served_ = 0;                             // HRTC of the last chunk
  std::map<std::uint32_t, std::uint32_t> dropped_sequences_;  // last sequence of each stream to a dropped HRTC
  std::int64_t due_ns_ = 0;
  std::vector<Damage> damage_;  // until `take_damage`
  DeliveryCounters counters_;
};

}  // namespace tactus::session
