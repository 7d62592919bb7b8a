/// An HRTC's half of delivery: states what it has and wants of each object, and joins the chunks that come.
///
///     offer, host_seen, host_gone     who serves what          (catalogue, roster)
///     want, held, refused, retire     what the HRTC decides    (prediction, cache)
///     on_chunk -> Messages            that are complete        (base, records)
///     demand -> Demand                to publish               (demand)
///     take_released                   regions that may be freed
///
/// Every message handed out must be answered: base_held or base_refused, held or refused, at once or, when it is
/// parked, later. Until then `received` stays below it, so that a host never takes a region for lost that is only
/// waiting to be decoded. What was refused and is still wanted comes again; a caller that has no room for it stops
/// wanting it.
///
/// A region that is retired leaves `have` at once, but what hosts sent before they knew may count on its records. It is
/// released when the serving host has echoed that epoch and everything before the echo has been dealt with; or when no
/// host serves. From then on messages of earlier epochs are dropped, however late they come; one that was begun before
/// counts when its last chunk is of a later epoch, for then its host has found that it still holds.
///
/// What gets lost heals by the demand alone. Each stream numbers its chunks, whatever is sent again included; numbers
/// that did not come are holes. Once a hole is older than chunks that overtake each other explain, a demand of a new
/// epoch tells it as a gap; an answer to that epoch or a later one shows that the host knows, and the hole is closed:
/// what was in it comes under other numbers. Whatever else is lost, a demand asks again while something is owed.
///
/// A chunk whose sequence or sending time is implausible (session/sequence_window.hpp) is dropped: it would tell the
/// host that everything up to it is lost.
///
/// No clock, socket or thread in it; one thread at a time.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <set>
#include <vector>

#include "session/messages.hpp"
#include "session/sequence_window.hpp"

namespace tactus::session {

struct DeliverySettings {
  std::int64_t overtaking_ns = 3'000'000;       ///< then a hole in the stream is told as a gap
  std::int64_t demand_interval_ns = 5'000'000;  ///< of one object: changes wait for the next
  std::int64_t urgent_interval_ns = 2'000'000;  ///< instead, when something new is wanted within `urgent_us`
  std::uint32_t urgent_us = 25'000;
  /// Of one object: asks again, under a new epoch, while something is owed. Sooner at first where round trips are
  /// short.
  std::int64_t repeat_ns = 20'000'000;
  std::int64_t keep_alive_ns = 500'000'000;  ///< unchanged demands repeat
  std::int64_t host_late_ns = 250'000'000;   ///< without heartbeat; then another host is chosen if there is one
  /// Of a host that is gone: then its offers are forgotten. Longer than the lease of its participant: within that DDS
  /// takes it for the same writer when it comes back, and sends no catalogue again.
  std::int64_t forget_host_ns = 10'000'000'000;
  std::int64_t partial_timeout_ns = 2'000'000'000;  ///< incomplete messages without a new chunk are dropped
  std::uint32_t credit = 256 * 1024;                ///< bytes that a host may have under way to this HRTC, at first
  std::uint32_t max_credit = 8u << 20;              ///< grows so far where rate and round trip ask for it
  std::size_t max_partial_bytes = 64u << 20;  ///< of incomplete messages; above it the longest untouched are dropped
};

class DeliveryClient {
 public:
  /// `self` gives session, participant (this HRTC) and incarnation of all demands.
  DeliveryClient(const Origin& self, const DeliverySettings& settings);

  /// A host offers an object, or withdraws it.
  void offer(const CatalogueEntry& entry);
  /// A heartbeat. A new incarnation begins new streams.
  void host_seen(std::uint64_t host, std::uint64_t incarnation, std::int64_t now_ns);
  void host_gone(std::uint64_t host);
  /// It may be dead: until its next heartbeat another host is preferred. Costs nothing but the change when it is not.
  void host_silent(std::uint64_t host);

  /// Begins with an object: its base mesh is wanted from now on. Chunks of other objects are ignored.
  void open(std::uint64_t object_id, std::uint64_t digest);
  /// Forgets the object: what it holds, wants and has half received. Chunks of it are ignored from now on.
  void close(std::uint64_t object_id);
  /// Whether some host offers the object with this digest, here or gone for less than `forget_host_ns`.
  [[nodiscard]] bool offered(std::uint64_t object_id, std::uint64_t digest) const;
  /// Replaces what is wanted; soonest first is not required. At most the kMaxWanted soonest are asked for.
  void want(std::uint64_t object_id, std::vector<Wanted> wanted);

  struct Message {
    std::uint64_t object_id = 0;
    BulkKind kind = BulkKind::kBase;
    std::uint32_t region = 0;
    std::uint32_t epoch = 0;
    std::vector<std::uint8_t> bytes;
  };
  /// Takes a chunk of topic base or records; gives the messages that it completes, each of which must be answered, in
  /// this order.
  [[nodiscard]] std::vector<Message> on_chunk(const BulkChunk& chunk, std::int64_t now_ns);

  /// Payload bytes of regions that the caller has room for; hosts send no more than that ahead. No limit at first.
  void set_room(std::uint64_t bytes);
  /// Payload bytes that may be under way, for which room was told and must be kept.
  [[nodiscard]] std::uint64_t promised(std::int64_t now_ns);
  void base_held(std::uint64_t object_id);
  void base_refused(std::uint64_t object_id);
  /// The region is kept. On a region that is retired and not released this takes it back.
  void held(std::uint64_t object_id, std::uint32_t region);
  void refused(std::uint64_t object_id, std::uint32_t region);
  /// The answer must wait for room: regions are released as if it had been given, so the message may turn out to count
  /// on what is gone. Hosts wait too: what waits is still under way to them.
  void park(std::uint64_t object_id, std::uint32_t region);
  /// The region, held so far, shall be freed. Before take_released names it a message may still count on its records:
  /// who frees it earlier must be able to tell that they are missing, and refuse the message. False, and nothing has
  /// changed, while no demand has told that it is here: hosts would take it for lost, and what counts on it too.
  [[nodiscard]] bool retire(std::uint64_t object_id, std::uint32_t region);
  /// Regions that no message to come can count on; each is named once.
  [[nodiscard]] std::vector<std::uint32_t> take_released(std::uint64_t object_id);

  /// The next demand that is due, or none. Also where time passes: call it at least every few milliseconds until none.
  [[nodiscard]] std::optional<Demand> demand(std::int64_t now_ns);

  /// From publishing a demand to the first chunk that knows it, smoothed over the objects; 0 before the first.
  [[nodiscard]] std::int64_t round_trip_ns() const noexcept { return round_trip_ns_; }
  /// Payload bytes/s that arrived in the best of the last moments.
  [[nodiscard]] double rate() const noexcept { return rate_; }
  /// 0 when nobody serves the object.
  [[nodiscard]] std::uint64_t serving_host(std::uint64_t object_id) const;
  /// How much is remembered; falls again when hosts and objects have gone.
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
    std::uint64_t foreign = 0;       ///< chunks of an unknown stream, an epoch to come, or malformed
    std::uint64_t implausible = 0;   ///< chunks whose sequence or sending time is outside its window
    std::uint64_t stale = 0;         ///< chunks that count on what is released, or of regions that are here
    std::uint64_t corrupt = 0;       ///< messages whose checksum is wrong
    std::uint64_t lost = 0;          ///< chunks told as gaps
    std::uint64_t refused = 0;       ///< messages refused by the caller
    std::uint64_t host_changes = 0;  ///< serving host replaced by another or lost
  };
  [[nodiscard]] const Counters& counters() const noexcept { return counters_; }

 private:
  /// From one life of a host, about one object.
  struct Stream {
    struct Hole {
      std::uint32_t last;
      std::int64_t since_ns;          // when it was noticed
      std::uint32_t published_epoch;  // that told it first; 0: none has
    };
    std::uint64_t host = 0, object_id = 0;
    SequenceWindow numbers{kChunkNumbers};
    std::uint32_t newest = 0;             // sequence that came
    std::map<std::uint32_t, Hole> holes;  // below, by first
    [[nodiscard]] std::uint32_t received() const noexcept { return holes.empty() ? newest : holes.begin()->first - 1; }
  };
  struct Host {
    bool live = false;
    std::int64_t seen_ns = 0;
    std::int64_t absent_ns = 0;  // since when it is known and not live; 0: it is, or no time has passed since
    std::uint64_t incarnation = 0;
    std::map<std::uint64_t, std::uint64_t> offers;  // object -> digest
    std::uint32_t arrivals = 0, one_way_us = 0;     // as in Demand
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
  struct Handed {  // a message that waits for the caller's answer
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
    std::set<std::uint32_t> unannounced;  // of these, since the last demand
    std::vector<Wanted> wanted;
    std::map<std::uint32_t, Handed> handed;      // by region; kNone: the base mesh
    std::map<std::uint32_t, Retiring> retiring;  // by region
    std::map<std::uint32_t, Partial> partials;   // by region; kNone: the base mesh
    std::uint32_t epoch = 0;
    std::uint32_t released_epoch = 0;  // messages of earlier epochs may count on what is gone
    bool changed = false;              // since the last demand; `epoch` is already that of the next
    bool acknowledge = false;          // `received` may have grown
    bool urgent = false;               // something is wanted soon that the last demand did not name
    bool sent_once = false;
    std::int64_t sent_ns = 0;
    unsigned repeats = 0;           // of the demand, since it had news
    std::uint32_t timed_epoch = 0;  // its way is timed,
    std::int64_t timed_ns = 0;      // since then; 0: none is
  };

  void change(Object& object);
  void begin_streams(std::uint64_t host, std::uint64_t incarnation);
  void begin_stream(std::uint64_t host, std::uint64_t object_id);
  [[nodiscard]] std::uint32_t stream_from(std::uint64_t host, std::uint64_t object_id) const;
  void note_sequence(Stream& stream, const BulkChunk& chunk, std::int64_t now_ns) const;
  [[nodiscard]] bool has_news(const Stream& stream, std::int64_t now_ns) const;
  void tell_gaps(Object& object, Stream& stream, Demand& demand, std::int64_t now_ns);
  [[nodiscard]] std::uint32_t dealt_with(const Object& object, std::uint32_t stream, bool or_parked) const;
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
  [[nodiscard]] bool owed(const Object& object) const;
  [[nodiscard]] std::int64_t repeat_after(const Object& object) const;
  [[nodiscard]] Demand make_demand(std::uint64_t object_id, Object& object, std::int64_t now_ns);

  Origin self_;
  DeliverySettings settings_;
  std::map<std::uint64_t, Host> hosts_;
  std::map<std::uint64_t, Object> objects_;
  std::map<std::uint32_t, Stream> streams_;  // by stream_id
  std::size_t partial_bytes_ = 0;
  std::int64_t round_trip_ns_ = 0;
  std::uint64_t room_ = ~std::uint64_t{0}, room_published_ = 0;
  struct Published {
    std::int64_t at_ns;
    std::uint32_t credit;
  };
  std::deque<Published> published_;  // within the last round trip, each less than the one before; and the last
  struct Window {
    std::int64_t begun_ns = 0;
    std::uint64_t bytes = 0;
  } window_;
  double rate_ = 0;  // bytes/s that arrived in the best of the last windows
  Counters counters_;
};

}  // namespace tactus::session
