/// An HRTC's side of delivery: publishes the regions that the HRTC has and wants of each object, and assembles messages
/// from the pieces in received chunks.
///
///     on_catalogue, on_host_...       hosts and the objects that they serve   (catalogue, roster)
///     set_wanted, answer_..., retire  decisions of the HRTC                   (prediction, cache)
///     on_chunk -> Messages            complete messages                       (base, records)
///     demand -> Demand                the demand to publish                   (demand)
///     take_released                   regions that the HRTC may free
///
/// The caller must answer every message: a base mesh with answer_base_stored or answer_base_refused, a region with
/// answer_stored or answer_refused. It answers at once or, after postpone_answer, later. Until the answer,
/// Demand::received stays below the last chunk of the message. So the host does not send a region again while it waits
/// for memory. A refused region is sent again while it is wanted, so a caller without memory for a region must also
/// remove it from the wanted regions.
///
/// A retired region leaves Demand::have at once. Chunks that hosts sent before they received that demand may still rely
/// on the records of the region. So the region is released only when the serving host has echoed the epoch of that
/// demand and all earlier chunks are processed, or when no host serves the object. From then on, a message is dropped
/// if the epochs of all its chunks precede the epoch of that demand. If at least one chunk has that epoch or a later
/// one, the message is accepted, because the host has checked it against that demand.
///
/// The demand alone repairs losses. Each stream numbers its chunks; a repeated piece travels in a chunk with a new
/// number. A skipped number is a gap. When a gap is older than reordering explains (`overtaking_ns`), a demand of a new
/// epoch reports it. A chunk of that epoch or a later one shows that the host has received the report, so the client
/// forgets the gap. If a demand or its answer is lost, the client repeats the demand.
///
/// The client accepts chunks only from hosts that offer the object with the digest that it has opened. Keys can restrict
/// a host to some objects, but a chunk names no object. So wire/ can check only the offer of the host.
///
/// A chunk whose sequence or sending time is implausible (session/sequence_window.hpp) is dropped. Otherwise the next
/// demand would report all chunks up to a wrong sequence as lost.
///
/// No clock, socket or thread; one thread at a time.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <set>
#include <tuple>
#include <utility>
#include <vector>

#include "session/messages.hpp"
#include "session/sequence_window.hpp"

namespace tactus::session {

struct DeliverySettings {
  std::int64_t overtaking_ns = 3'000'000;       ///< age at which a gap in the stream is reported
  std::int64_t demand_interval_ns = 5'000'000;  ///< min time between demands of one object
  /// Min time between demands if there is a gap to report, or a new region with contact within `urgent_us`.
  std::int64_t urgent_interval_ns = 2'000'000;
  std::uint32_t urgent_us = 25'000;
  /// Max time between demands of one object while an answer is due. Each repetition has a new epoch. On short round
  /// trips the first repetitions follow sooner.
  std::int64_t repeat_ns = 20'000'000;
  std::int64_t keep_alive_ns = 500'000'000;  ///< period of unchanged demands
  std::int64_t host_late_ns = 250'000'000;   ///< silence after which another host is chosen if one offers the object
  /// Time without a chunk, while an answer is due, after which another host is chosen if one offers the object. The
  /// client repeats the demand about 250 times in 5 s, so lost samples do not explain a longer silence. Failures of
  /// programs and links show sooner, in the heartbeats.
  std::int64_t no_answer_ns = 5'000'000'000;
  /// Time after which the offers of an absent host are dropped. It is longer than the DDS lease: for DDS, a host that
  /// returns within the lease is the same writer, so DDS does not deliver its catalogue again.
  std::int64_t forget_host_ns = 10'000'000'000;
  std::int64_t partial_timeout_ns =
      2'000'000'000;                          ///< time without a new piece after which an incomplete message is dropped
  std::uint32_t credit = 256 * 1024;          ///< initial credit: bytes in flight from a host to this HRTC
  std::uint32_t max_credit = kMaxCredit;      ///< max credit; the credit grows with rate and round trip
  std::size_t max_partial_bytes = 64u << 20;  ///< max bytes of incomplete messages; above it the messages
                                              ///< without a new piece for longest are dropped
  /// Max number of incomplete messages; above it the messages without a new piece for longest are dropped. A chunk
  /// begins at most one message that it does not complete, and 8 MiB of max credit are 6000 chunks. So the bound holds
  /// the messages of two hosts.
  std::size_t max_partials = 16'384;
};

class DeliveryClient {
 public:
  /// `self`: session, participant (this HRTC) and incarnation of all demands.
  DeliveryClient(const Origin& self, const DeliverySettings& settings);

  /// Max number of offers of one host: two starts with 1,024 objects, the limit of the topic.
  static constexpr std::size_t kMaxOffers = 2048;
  /// Applies a catalogue entry: a host offers an object or withdraws it.
  void on_catalogue(const CatalogueEntry& entry);
  /// Reports a heartbeat of a host. A new incarnation begins new streams.
  void on_host_heartbeat(std::uint64_t host, std::uint64_t incarnation, std::int64_t now_ns);
  /// Reports that a host is silent. Its offers remain for `forget_host_ns`.
  void on_host_gone(std::uint64_t host);
  /// Reports the leave message of this incarnation: withdraws the objects that it offers.
  void on_host_left(std::uint64_t host, std::uint64_t incarnation);
  /// Reports that the host may have failed: until its next heartbeat another host is preferred. A false suspicion loses
  /// no data.
  void suspect_host(std::uint64_t host);

  /// Opens an object and requests its base mesh. Chunks of objects that are not open are ignored.
  void open(std::uint64_t object_id, std::uint64_t digest);
  /// Drops the state of an object, including incomplete messages. Later chunks of the object are ignored.
  void close(std::uint64_t object_id);
  /// Whether a host offers the object with this digest. The offers of an absent host, and those of an incarnation that
  /// a newer one replaced, remain valid for `forget_host_ns`. In a name conflict, the program that leaves withdraws
  /// only its own offers.
  [[nodiscard]] bool is_offered(std::uint64_t object_id, std::uint64_t digest) const;
  /// Sets the wanted regions and parts of the directory, in any order. Of those that are neither held nor retired, the
  /// kMaxWanted with the soonest contact are requested.
  void set_wanted(std::uint64_t object_id, std::vector<Wanted> wanted);

  /// A complete message. `region` is spm::kNone for a base mesh, and may be a part of the directory (kFirstPage).
  struct Message {
    std::uint64_t object_id = 0;
    BulkKind kind = BulkKind::kBase;
    std::uint32_t region = 0;
    std::uint32_t epoch = 0;
    std::vector<std::uint8_t> bytes;
  };
  /// Processes a chunk of topic base or records. Returns the messages that the chunk completes; the caller must answer
  /// them in this order.
  [[nodiscard]] std::vector<Message> on_chunk(const BulkChunk& chunk, std::int64_t now_ns);

  /// Limits the credit to the payload bytes that the caller can store now. Without a call: no limit.
  void limit_credit(std::uint64_t bytes);
  /// Payload bytes that hosts may have in flight under the published credits. The caller must reserve memory for them.
  [[nodiscard]] std::uint64_t granted_credit(std::int64_t now_ns);
  /// Answers that the caller has stored the base mesh.
  void answer_base_stored(std::uint64_t object_id);
  /// Answers that the caller did not store the base mesh.
  void answer_base_refused(std::uint64_t object_id);
  /// Answers that the region is in the cache. Cancels `retire` if the region is not released yet.
  void answer_stored(std::uint64_t object_id, std::uint32_t region);
  /// Answers that the caller has a part of the directory (kFirstPage).
  void answer_page_stored(std::uint64_t object_id, std::uint32_t number);
  /// Reports that the caller has freed a part of the directory.
  void forget_page(std::uint64_t object_id, std::uint32_t number);
  /// Answers that the caller did not store the region, or the part of the directory.
  void answer_refused(std::uint64_t object_id, std::uint32_t region);
  /// Postpones the answer until the caller has memory for the region. Meanwhile the message counts as in flight for the
  /// credit. Retired regions are released as if the caller had answered, so this message may rely on released records.
  void postpone_answer(std::uint64_t object_id, std::uint32_t region);
  /// Marks a region that the caller wants to free. Until take_released returns the region, a message may rely on its
  /// records; a caller that frees them earlier must refuse such a message. Returns false and changes nothing if the
  /// region is not held, or if a host serves the object but no demand has listed the region yet. A host treats a region
  /// as refused if it was received but never listed, and with it all messages that rely on the region.
  [[nodiscard]] bool retire(std::uint64_t object_id, std::uint32_t region);
  /// Returns the retired regions on which no later message can rely, each once.
  [[nodiscard]] std::vector<std::uint32_t> take_released(std::uint64_t object_id);

  /// Returns the next demand to publish, or none when none is due. Also applies timeouts. Call it every few
  /// milliseconds until it returns none.
  [[nodiscard]] std::optional<Demand> demand(std::int64_t now_ns);

  /// Time from a demand to the first chunk that echoes its epoch, smoothed over all objects; 0: not measured yet.
  [[nodiscard]] std::int64_t round_trip_ns() const noexcept { return round_trip_ns_; }
  /// Largest recent arrival rate, bytes/s of payload.
  [[nodiscard]] double rate() const noexcept { return rate_; }
  /// Participant id of the host that serves the object; 0: none.
  [[nodiscard]] std::uint64_t serving_host(std::uint64_t object_id) const;
  /// Numbers of stored entries. They decrease when hosts are forgotten, objects are closed, and messages are completed
  /// or dropped.
  struct Sizes {
    std::size_t hosts = 0, offers = 0, streams = 0, objects = 0, partials = 0;
  };
  [[nodiscard]] Sizes sizes() const noexcept;
  /// Bytes of incomplete messages, at most `max_partial_bytes`.
  [[nodiscard]] std::size_t partial_bytes() const noexcept { return partial_bytes_; }

  struct Counters {
    std::uint64_t chunks = 0;
    std::uint64_t payload_bytes = 0;
    std::uint64_t messages = 0;
    std::uint64_t foreign = 0;       ///< chunks of an unknown stream, a host without the object, a future epoch or a
                                     ///< region outside the model, malformed chunks, and offers beyond kMaxOffers
    std::uint64_t implausible = 0;   ///< chunks with a sequence or sending time outside its window
    std::uint64_t stale = 0;         ///< pieces that are no longer needed, and messages that rely on released regions
    std::uint64_t corrupt = 0;       ///< messages with a wrong checksum
    std::uint64_t lost = 0;          ///< chunks reported as gaps
    std::uint64_t refused = 0;       ///< messages refused by the caller
    std::uint64_t host_changes = 0;  ///< number of times that a serving host was replaced or lost
  };
  [[nodiscard]] const Counters& counters() const noexcept { return counters_; }

 private:
  /// Chunks from one incarnation of a host about one object.
  struct Stream {
    /// Consecutive skipped numbers; the first is the key in `gaps`.
    struct Gap {
      std::uint32_t last;
      std::int64_t detected_ns;
      std::uint32_t reported_epoch;  // epoch of the first demand that reported the gap; 0: none
    };
    std::uint32_t id = 0;
    std::uint64_t host = 0, object_id = 0;
    SequenceWindow numbers{kChunkNumbers};
    std::uint32_t newest = 0;           // largest sequence received
    std::map<std::uint32_t, Gap> gaps;  // below `newest`, by first number
    [[nodiscard]] std::uint32_t received() const noexcept { return gaps.empty() ? newest : gaps.begin()->first - 1; }
  };
  struct Offer {
    std::uint64_t digest = 0;
    std::uint32_t regions = 0;  // of the model
  };
  struct Host {
    bool present = false;
    std::int64_t heartbeat_ns = 0;             // arrival of the last heartbeat, earlier after a suspicion
    std::int64_t absent_ns = 0;                // when forget_hosts first found the host absent; 0: not yet
    std::optional<std::uint64_t> incarnation;  // none before the first heartbeat
    std::int64_t incarnation_ns = 0;           // arrival of the first heartbeat of `incarnation`
    std::map<std::pair<std::uint64_t, std::uint64_t>, Offer> offers;  // by object and incarnation
    [[nodiscard]] const Offer* find_offer(std::uint64_t object, std::uint64_t digest) const;
    std::uint32_t arrivals = 0, one_way_us = 0;  // for the fields of Demand with these names
    WrappedTimeWindow times;
  };
  /// An incomplete message.
  struct Partial {
    std::uint32_t checksum = 0;
    std::uint32_t piece_count = 1;
    std::uint32_t epoch = 0;  // largest epoch of its chunks
    std::uint32_t stream = 0;
    std::uint32_t last_sequence = 0;
    std::int64_t received_ns = 0;  // arrival of its last piece
    std::size_t bytes = 0;
    std::map<std::uint32_t, std::vector<std::uint8_t>> payloads;  // by index of the piece
  };
  /// A message that the caller has not answered.
  struct Pending {
    std::uint32_t stream = 0;
    std::uint32_t epoch = 0;
    std::uint32_t last_sequence = 0;
    bool postponed = false;
  };
  struct Retiring {
    std::uint32_t epoch = 0;          // of the first demand without the region
    std::uint32_t echo_sequence = 0;  // first chunk of the serving host that echoed this epoch; 0: none
  };
  struct Object {
    std::uint64_t digest = 0;
    std::uint64_t host = 0;  // serving host; 0: none
    bool has_base = false;
    std::set<std::uint32_t> pages;  // parts of the directory that the caller has (kFirstPage)
    std::set<std::uint32_t> have;
    std::set<std::uint32_t> unlisted;  // regions of `have` that no demand has listed yet
    std::vector<Wanted> wanted;
    std::map<std::uint32_t, Pending> pending;    // by region; kNone: the base mesh
    std::map<std::uint32_t, Retiring> retiring;  // by region
    std::map<std::uint32_t, Partial> partials;   // by region; kNone: the base mesh
    std::uint32_t epoch = 0;
    std::uint32_t released_epoch = 0;  // messages of earlier epochs may rely on released regions
    bool changed = false;              // since the last demand; `epoch` is then that of the next demand
    bool received_changed = false;     // Demand::received may have grown since the last demand
    bool urgent = false;               // the next demand has a new region that is wanted soon, or a gap to report
    bool has_been_sent = false;        // a demand for this object has been published
    std::int64_t sent_ns = 0;          // when the last demand was published
    std::int64_t answered_ns = 0;      // when the serving host last sent a chunk, or no answer was due
    unsigned repetitions = 0;          // of the last changed demand
    // The demand whose round trip is being measured.
    std::uint32_t measured_epoch = 0;
    std::int64_t measured_from_ns = 0;  // 0: no measurement
  };

  void begin_epoch(Object& object);
  void begin_streams(std::uint64_t host, std::uint64_t incarnation);
  void begin_stream(std::uint64_t host, std::uint64_t object_id);
  [[nodiscard]] Stream* find_stream(std::uint64_t host, std::uint64_t object_id);
  void track_gaps(Stream& stream, const BulkChunk& chunk, std::int64_t now_ns) const;
  [[nodiscard]] bool has_gap_to_report(const Stream& stream, std::int64_t now_ns) const;
  void report_gaps(Object& object, Stream& stream, Demand& demand, std::int64_t now_ns);
  [[nodiscard]] std::uint32_t processed_up_to(const Object& object, const Stream& stream, bool or_postponed) const;
  void on_echo(Object& object, const Stream& stream, const BulkChunk& chunk, std::int64_t now_ns);
  [[nodiscard]] std::optional<Message> assemble(Object& object, std::uint64_t object_id, const BulkChunk& chunk,
                                                const BulkPiece& piece, std::int64_t now_ns);
  [[nodiscard]] std::optional<Message> complete(Object& object, std::uint64_t object_id, BulkKind kind,
                                                std::map<std::uint32_t, Partial>::iterator at);
  void drop_partial(Object& object, std::uint64_t object_id, std::map<std::uint32_t, Partial>::iterator at);
  void limit_partials(std::int64_t now_ns);
  void forget_hosts(std::int64_t now_ns);
  void end_streams(std::uint64_t host);
  void choose_host(std::uint64_t object_id, Object& object, std::int64_t now_ns);
  void serve_from(Object& object, std::uint64_t host, std::int64_t now_ns);
  void measure_rate(std::size_t bytes, std::int64_t now_ns);
  [[nodiscard]] std::uint32_t credit() const;
  [[nodiscard]] bool is_answer_due(const Object& object) const;
  [[nodiscard]] std::int64_t repetition_interval_ns(const Object& object) const;
  [[nodiscard]] Demand make_demand(std::uint64_t object_id, Object& object, Stream& stream, std::int64_t now_ns);

  Origin self_;
  DeliverySettings settings_;
  std::map<std::uint64_t, Host> hosts_;
  std::map<std::uint64_t, Object> objects_;
  std::map<std::uint32_t, Stream> streams_;  // by stream_id
  std::uint32_t last_epoch_ = 0;  // largest epoch of closed objects; an object that is opened again continues there
  std::size_t partial_bytes_ = 0;
  // All incomplete messages, oldest first: Partial::received_ns, object, region.
  std::set<std::tuple<std::int64_t, std::uint64_t, std::uint32_t>> partials_by_age_;
  std::int64_t round_trip_ns_ = 0;
  std::uint64_t credit_limit_ = ~std::uint64_t{0}, published_credit_limit_ = 0;
  struct Published {
    std::int64_t at_ns;
    std::uint32_t credit;
  };
  // Credits that a host may still use, in the order of publication. Each is smaller than the one before.
  std::deque<Published> published_;
  /// The current measurement of the arrival rate.
  struct RateWindow {
    std::int64_t begun_ns = 0;
    std::uint64_t bytes = 0;
  } window_;
  double rate_ = 0;  // bytes/s
  Counters counters_;
};

}  // namespace tactus::session
