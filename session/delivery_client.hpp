/// An HRTC's side of delivery: publishes which regions it has and wants of each object, and joins chunks to messages.
///
///     offer, host_seen, host_gone     which host serves what   (catalogue, roster)
///     want, held, refused, retire     decisions of the HRTC    (prediction, cache)
///     on_chunk -> Messages            complete messages        (base, records)
///     demand -> Demand                to publish               (demand)
///     take_released                   regions that may be freed
///
/// The caller must answer every message: base_held or base_refused, held or refused; at once or, after `park`, later.
/// Until then `received` stays below the message, so that no host takes a region for lost while it waits for decoding.
/// A refused region that is still wanted comes again. A caller without room for it stops wanting it.
///
/// A retired region leaves `have` at once, but chunks that hosts sent before they received that demand may rely on its
/// records. The region is released when the serving host has echoed that epoch and all earlier chunks are processed,
/// or when no host serves. From then on messages of earlier epochs are dropped. A message that was begun earlier is
/// valid if its last chunk has a later epoch, because its host has checked it against the newer demand.
///
/// The demand alone repairs losses. Each stream numbers its chunks, repeated parts included. A sequence that did not
/// arrive is a hole. When a hole is older than reordering explains (`overtaking_ns`), a demand of a new epoch reports
/// it as a gap. A chunk of that epoch or a later one shows that the host has received the report. The hole is then
/// closed, because its parts come under new numbers. If a demand or its answer is lost, the demand is repeated.
///
/// A chunk whose sequence or sending time is implausible (session/sequence_window.hpp) is dropped: a demand would
/// otherwise report all chunks up to it as lost.
///
/// No clock, socket or thread; one thread at a time.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "session/messages.hpp"
#include "session/sequence_window.hpp"

namespace tactus::session {

struct DeliverySettings {
  std::int64_t overtaking_ns = 3'000'000;       ///< age at which a hole in the stream is reported as a gap
  std::int64_t demand_interval_ns = 5'000'000;  ///< min time between demands of one object
  std::int64_t urgent_interval_ns = 2'000'000;  ///< the same, when a new region is wanted within `urgent_us`
  std::uint32_t urgent_us = 25'000;
  /// Max time between demands of one object while an answer is due; each has a new epoch. The first repetitions come
  /// sooner on short round trips.
  std::int64_t repeat_ns = 20'000'000;
  std::int64_t keep_alive_ns = 500'000'000;  ///< period of unchanged demands
  std::int64_t host_late_ns = 250'000'000;   ///< silence after which another host is chosen, if there is one
  /// Time after which the offers of a host that is gone are dropped. Longer than the DDS lease: a host that comes back
  /// within the lease counts as the same writer, so DDS does not send its catalogue again.
  std::int64_t forget_host_ns = 10'000'000'000;
  std::int64_t partial_timeout_ns = 2'000'000'000;  ///< an incomplete message without a new chunk is dropped
  std::uint32_t credit = 256 * 1024;                ///< initial credit: bytes in flight from a host to this HRTC
  std::uint32_t max_credit = 8u << 20;              ///< limit of the credit, which grows with rate and round trip
  std::size_t max_partial_bytes = 64u << 20;  ///< of incomplete messages; above it those idle for longest are dropped
};

class DeliveryClient {
 public:
  /// `self`: session, participant (this HRTC) and incarnation of all demands.
  DeliveryClient(const Origin& self, const DeliverySettings& settings);

  /// A host offers an object, or withdraws it.
  void offer(const CatalogueEntry& entry);
  /// A heartbeat. A new incarnation begins new streams.
  void host_seen(std::uint64_t host, std::uint64_t incarnation, std::int64_t now_ns);
  void host_gone(std::uint64_t host);
  /// The program of this incarnation has left on purpose: what it offers is withdrawn.
  void host_left(std::uint64_t host, std::uint64_t incarnation);
  /// The host may have failed: until its next heartbeat another host is preferred. A false suspicion loses no data.
  void suspect_host(std::uint64_t host);

  /// Opens an object: its base mesh is wanted from now on. Chunks of objects that are not open are ignored.
  void open(std::uint64_t object_id, std::uint64_t digest);
  /// Drops the object's state, including incomplete messages. Its chunks are ignored from now on.
  void close(std::uint64_t object_id);
  /// Whether a host offers the object with this digest. A host that is gone, and a program of a host that was replaced
  /// by a newer one, count for `forget_host_ns`. A second program of that name, which yields it, withdraws only its
  /// own.
  [[nodiscard]] bool offered(std::uint64_t object_id, std::uint64_t digest) const;
  /// Replaces the wanted regions, in any order. The kMaxWanted soonest are requested.
  void want(std::uint64_t object_id, std::vector<Wanted> wanted);

  struct Message {
    std::uint64_t object_id = 0;
    BulkKind kind = BulkKind::kBase;
    std::uint32_t region = 0;
    std::uint32_t epoch = 0;
    std::vector<std::uint8_t> bytes;
  };
  /// Takes a chunk of topic base or records. Returns the messages that it completes; the caller must answer them in
  /// this order.
  [[nodiscard]] std::vector<Message> on_chunk(const BulkChunk& chunk, std::int64_t now_ns);

  /// Sets the payload bytes of regions for which the caller has room; limits the credit. No limit at first.
  void set_room(std::uint64_t bytes);
  /// Payload bytes that hosts may have in flight under published credits; the caller must keep room for them.
  [[nodiscard]] std::uint64_t granted_credit(std::int64_t now_ns);
  void base_held(std::uint64_t object_id);
  void base_refused(std::uint64_t object_id);
  /// The region is in the cache. Cancels `retire` if the region is not released yet.
  void held(std::uint64_t object_id, std::uint32_t region);
  void refused(std::uint64_t object_id, std::uint32_t region);
  /// Delays the answer until there is room. Regions are released as if the answer had been given, so the message may
  /// rely on records that are gone. Hosts wait too: the message still counts as in flight.
  void park(std::uint64_t object_id, std::uint32_t region);
  /// The region is to be freed. Until take_released names it, a message may still rely on its records; a caller that
  /// frees it earlier must detect the missing records and refuse the message. Returns false and changes nothing while
  /// no demand has reported the region: hosts would take it, and all messages that rely on it, for lost.
  [[nodiscard]] bool retire(std::uint64_t object_id, std::uint32_t region);
  /// Regions that no later message can rely on; each is returned once.
  [[nodiscard]] std::vector<std::uint32_t> take_released(std::uint64_t object_id);

  /// The next demand that is due, or none. Also applies timeouts: call it every few milliseconds until it returns none.
  [[nodiscard]] std::optional<Demand> demand(std::int64_t now_ns);

  /// Time from a demand to the first chunk that echoes its epoch, smoothed over the objects; 0 before the first.
  [[nodiscard]] std::int64_t round_trip_ns() const noexcept { return round_trip_ns_; }
  /// Payload bytes/s that arrived in the best of the last windows.
  [[nodiscard]] double rate() const noexcept { return rate_; }
  /// 0 when no host serves the object.
  [[nodiscard]] std::uint64_t serving_host(std::uint64_t object_id) const;
  /// Number of stored entries; falls again when hosts and objects have gone.
  struct Sizes {
    std::size_t hosts = 0, offers = 0, streams = 0, objects = 0;
  };
  [[nodiscard]] Sizes sizes() const noexcept;
  /// Bytes of incomplete messages, at most `max_partial_bytes`.
  [[nodiscard]] std::size_t partial_bytes() const noexcept { return partial_bytes_; }

  struct Counters {
    std::uint64_t chunks = 0;
    std::uint64_t payload_bytes = 0;
    std::uint64_t messages = 0;
    std::uint64_t foreign = 0;       ///< chunks of an unknown stream, of a future epoch, or malformed
    std::uint64_t implausible = 0;   ///< chunks whose sequence or sending time is outside its window
    std::uint64_t stale = 0;         ///< chunks that rely on released regions, or of regions that are held
    std::uint64_t corrupt = 0;       ///< messages with a wrong checksum
    std::uint64_t lost = 0;          ///< chunks reported as gaps
    std::uint64_t refused = 0;       ///< messages refused by the caller
    std::uint64_t host_changes = 0;  ///< times that a serving host was replaced or lost
  };
  [[nodiscard]] const Counters& counters() const noexcept { return counters_; }

 private:
  /// Chunks from one incarnation of a host about one object.
  struct Stream {
    struct Hole {
      std::uint32_t last;
      std::int64_t since_ns;         // when it was detected
      std::uint32_t reported_epoch;  // of the first demand that reported it; 0: none
    };
    std::uint64_t host = 0, object_id = 0;
    SequenceWindow numbers{kChunkNumbers};
    std::uint32_t newest = 0;             // largest sequence received
    std::map<std::uint32_t, Hole> holes;  // below `newest`, by first sequence
    [[nodiscard]] std::uint32_t received() const noexcept { return holes.empty() ? newest : holes.begin()->first - 1; }
  };
  struct Host {
    bool live = false;
    std::int64_t seen_ns = 0;
    std::int64_t absent_ns = 0;  // when a tick first saw it gone; 0: it is live, or no tick since
    std::uint64_t incarnation = 0;
    std::int64_t incarnation_ns = 0;  // when it was first seen
    // (object, incarnation) -> digest
    std::map<std::pair<std::uint64_t, std::uint64_t>, std::uint64_t> offers;
    [[nodiscard]] bool offers_object(std::uint64_t object, std::uint64_t digest) const;
    std::uint32_t arrivals = 0, one_way_us = 0;  // as in Demand
    WrappedTimeWindow times;
  };
  struct Partial {
    std::uint32_t checksum = 0;
    std::uint32_t parts = 1;
    std::uint32_t epoch = 0;
    std::uint32_t stream = 0;
    std::uint32_t last_sequence = 0;
    std::int64_t touched_ns = 0;
    std::size_t bytes = 0;
    std::map<std::uint32_t, std::vector<std::uint8_t>> payloads;  // by part
  };
  struct Pending {  // a message for which the caller owes an answer
    std::uint32_t stream = 0;
    std::uint32_t epoch = 0;
    std::uint32_t last_sequence = 0;
    bool parked = false;
  };
  struct Retiring {
    std::uint32_t epoch = 0;
    std::uint32_t echo_sequence = 0;  // of the serving host's stream; 0: not echoed
  };
  struct Object {
    std::uint64_t digest = 0;
    std::uint64_t host = 0;
    bool has_base = false;
    std::set<std::uint32_t> have;
    std::set<std::uint32_t> unannounced;  // of these, added since the last demand
    std::vector<Wanted> wanted;
    std::map<std::uint32_t, Pending> pending;    // by region; kNone: the base mesh
    std::map<std::uint32_t, Retiring> retiring;  // by region
    std::map<std::uint32_t, Partial> partials;   // by region; kNone: the base mesh
    std::uint32_t epoch = 0;
    std::uint32_t released_epoch = 0;  // messages of earlier epochs may rely on released regions
    bool changed = false;              // since the last demand; `epoch` is already that of the next
    bool acknowledge = false;          // `received` may have grown
    bool urgent = false;               // a new region is wanted soon
    bool sent_once = false;
    std::int64_t sent_ns = 0;
    unsigned repeats = 0;           // of the demand, since it changed
    std::uint32_t timed_epoch = 0;  // its round trip is being measured,
    std::int64_t timed_ns = 0;      // since then; 0: none is
  };

  void change(Object& object);
  void begin_streams(std::uint64_t host, std::uint64_t incarnation);
  void begin_stream(std::uint64_t host, std::uint64_t object_id);
  [[nodiscard]] std::uint32_t stream_from(std::uint64_t host, std::uint64_t object_id) const;
  void note_sequence(Stream& stream, const BulkChunk& chunk, std::int64_t now_ns) const;
  [[nodiscard]] bool has_unreported_gap(const Stream& stream, std::int64_t now_ns) const;
  void report_gaps(Object& object, Stream& stream, Demand& demand, std::int64_t now_ns);
  [[nodiscard]] std::uint32_t processed_up_to(const Object& object, std::uint32_t stream, bool or_parked) const;
  void note_echo(Object& object, const Stream& stream, const BulkChunk& chunk, std::int64_t now_ns);
  [[nodiscard]] std::optional<Message> assemble(Object& object, std::uint64_t object_id, const BulkChunk& chunk,
                                                const BulkPiece& piece, std::int64_t now_ns);
  void drop_partial(Object& object, std::map<std::uint32_t, Partial>::iterator at);
  void bound_partials(std::int64_t now_ns);
  void forget_hosts(std::int64_t now_ns);
  void end_streams(std::uint64_t host);
  void choose_host(std::uint64_t object_id, Object& object, std::int64_t now_ns);
  void serve_from(Object& object, std::uint64_t host);
  void note_rate(std::size_t bytes, std::int64_t now_ns);
  [[nodiscard]] std::uint32_t credit() const;
  [[nodiscard]] bool awaits_answer(const Object& object) const;
  [[nodiscard]] std::int64_t repeat_after(const Object& object) const;
  [[nodiscard]] Demand make_demand(std::uint64_t object_id, Object& object, std::int64_t now_ns);

  Origin self_;
  DeliverySettings settings_;
  std::map<std::uint64_t, Host> hosts_;
  std::map<std::uint64_t, Object> objects_;
  std::map<std::uint32_t, Stream> streams_;  // by stream_id
  std::uint32_t last_epoch_ = 0;             // of objects that were closed: one that comes again is older to no host
  std::size_t partial_bytes_ = 0;
  std::int64_t round_trip_ns_ = 0;
  std::uint64_t room_ = ~std::uint64_t{0}, room_published_ = 0;
  struct Published {
    std::int64_t at_ns;
    std::uint32_t credit;
  };
  std::deque<Published> published_;  // of the last round trip, each credit less than the one before; and the last
  struct Window {
    std::int64_t begun_ns = 0;
    std::uint64_t bytes = 0;
  } window_;
  double rate_ = 0;  // bytes/s, in the best of the last windows
  Counters counters_;
};

}  // namespace tactus::session
