/// The regions that an HRTC holds: it requests those that probes will meet, stores them compressed as they arrive,
/// decodes those that probes meet next into the pool, and evicts those that no probe needs.
///
///   catalogue, chunks -> [assemble] -> store -> [decode, slots] -> arrivals ring -> haptic thread
///   probe sights -> [predict] -> demand               departures ring <-
///
/// Demands publish the content of the store (`have`). The pool is a cache of the store: it gets the regions that are
/// met soonest, and a region that leaves the pool stays in the store, so that no force waits for the network.
///
/// A region leaves the store in two steps. A region that nobody has wanted for long is left out of `have` before its
/// room is needed. Once the host has echoed that, the region is spare: it is still stored, it is taken back if it is
/// wanted again, and it is freed when room is needed. The host gets credit for the free room and for the regions left
/// out of `have`, and no more. Its echo arrives before the data that it sends on that credit, so the loader never
/// evicts a region that the host counts as present.
///
/// An object is withdrawn when a host says so, in the catalogue or by leaving, and no other host offers it. It leaves
/// at once for predictions and demands; its memory is freed once the haptic thread has given it back. An object whose
/// hosts only fell silent stays, frozen at what is loaded: a user may be touching it, and a host may come back.
///
/// One thread, not the haptic one. Allocates while decoding; what it keeps is bounded by pool and store and by the
/// number of regions of its objects.
#pragma once

#include <boost/lockfree/spsc_queue.hpp>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "hrtc_service/tool_touch.hpp"
#include "session/delivery_client.hpp"
#include "spm/cache.hpp"
#include "spm/codec/compressed_cache.hpp"
#include "spm/directory.hpp"
#include "spm/fcl/broad_phase.hpp"
#include "spm/prediction.hpp"

namespace tactus::hrtc_service {

/// The newest state of a probe, as the haptic thread reports it.
struct ProbeSight {
  bool active = false;
  bool in_contact = false;
  std::int64_t time_ns = 0;
  Vec3d device = Vec3d::Zero();
  Vec3d proxy = Vec3d::Zero();  ///< where the force comes from, while in contact; always where a tool is
  Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity();  ///< of the tool
};

struct LoaderSettings {
  double radius = 0.003;  ///< m, of the tips
  /// The tool that every probe holds instead of a sphere, m. Null: a sphere.
  const spm::MeshProbe* tool = nullptr;
  spm::Strategy strategy = spm::Strategy::kMixture;
  double margin = 0.0005;      ///< m; cells this near to a tip's path are loaded
  double min_speed = 0.05;     ///< m/s; a tip at rest is expected to start with this
  double near_distance = 0.1;  ///< m; objects within are offered to the haptic thread's queries
  double min_lead = 0.02;      ///< s; prediction looks at least this far ahead, more when loading takes longer
  double max_lead = 0.5;       ///< s
  std::int64_t idle_before_spare_ns = 300'000'000;  ///< until an unwanted region becomes spare, at most
  bool keep_unwanted = true;                        ///< false: an unwanted region is evicted at once
  /// ns; measures the cost of prediction, which is limited to a share of the time. Null: the cost counts as 0.
  std::int64_t (*clock)() = nullptr;
  /// For the directories of all objects together (spm/directory.hpp); an object whose own does not fit is refused.
  std::uint64_t directory_bytes = ~std::uint64_t{0};
  session::DeliverySettings delivery;
};

struct LoaderFigures {
  std::uint64_t regions_held = 0;   ///< in the store
  std::uint64_t regions_spare = 0;  ///< of those held: unknown to the host, so that they can go at any time
  std::uint64_t regions_shown = 0;  ///< in the pool
  std::uint64_t regions_received = 0;
  std::uint64_t regions_evicted = 0;    ///< from the store, for want of room
  std::uint64_t regions_reloaded = 0;   ///< received again after that
  std::uint64_t regions_coarsened = 0;  ///< gone from the pool
  std::uint64_t records_received = 0;
  std::uint64_t records_returned = 0;   ///< of these, which were here already or once
  std::uint64_t records_repeated = 0;   ///< of these, which were here already
  std::uint64_t records_published = 0;  ///< of these, in regions published to hosts
  std::uint64_t refused_full = 0;
  std::uint64_t refused_other = 0;
  std::uint64_t decode_errors = 0;
  std::uint64_t objects_refused = 0;  ///< because memory was full
  double load_latency = 0;            ///< s, from wanting a region to holding it; smoothed
  std::uint32_t slots_used = 0, slots_peak = 0, slots_limit = 0;
  std::uint32_t compressed_used = 0, compressed_peak = 0, compressed_limit = 0;  ///< blocks of the store
};

class Loader {
 public:
  /// `pool`, `nodes` and the rings must outlive the loader, and the loader the haptic thread.
  Loader(spm::Pool& pool, spm::NodePool& nodes, const session::Origin& self, const LoaderSettings& settings,
         ArrivalRing& arrivals, DepartureRing& departures);
  ~Loader();

  /// Called with one line for each event that an operator should see.
  std::function<void(const std::string&)> on_event;

  /// Called with each object that is wanted from now on.
  std::function<void(const session::CatalogueEntry&)> on_object_found;

  /// Called with each object that is handed to the haptic thread, in the same order.
  std::function<void(const TouchObject&)> on_object;

  /// Called with each object that was handed over and is withdrawn. It stays until `on_object_gone`.
  std::function<void(const TouchObject&)> on_object_withdrawn;

  /// An object as others may see it: never changed after it is ready.
  struct ObjectInfo {
    std::string name;
    std::uint64_t id = 0;
    std::uint64_t digest = 0;
    double scale = 1;
    std::uint32_t index = spm::kNone;  ///< kNone: it has not come yet
    std::uint64_t records_received = 0, records_returned = 0, regions_received = 0, regions_released = 0;
  };
  /// Called with each object that is forgotten: no host offers it any more, and the haptic thread does not have it. Its
  /// index may come again with another object.
  std::function<void(const ObjectInfo&)> on_object_gone;

  void on_catalogue(const session::CatalogueEntry& entry);
  [[nodiscard]] bool knows(std::uint64_t object_id) const { return objects_.count(object_id) != 0; }
  /// Bytes of the directories of all objects, at most LoaderSettings::directory_bytes.
  [[nodiscard]] std::uint64_t directories() const noexcept { return directories_; }
  void on_host_seen(std::uint64_t host, std::uint64_t incarnation, std::int64_t now_ns);
  void on_host_gone(std::uint64_t host);
  /// That program has left on purpose.
  void on_host_left(std::uint64_t host, std::uint64_t incarnation);
  void on_host_silent(std::uint64_t host);
  void on_chunk(const session::BulkChunk& chunk, std::int64_t now_ns);

  /// Sets the placement of an object for predictions, the broad phase and `regions_met`.
  void on_moved(std::uint32_t object_index, const Placement& placement);

  /// Predicts, evicts and hands over; every few milliseconds. `near` gets the objects near each probe.
  void tick(std::int64_t now_ns, const std::array<ProbeSight, kMaxProbes>& sights,
            std::array<NearObjects, kMaxProbes>& near);

  /// The next demand to publish, until none is due.
  [[nodiscard]] std::optional<session::Demand> demand(std::int64_t now_ns) { return delivery_.demand(now_ns); }

  /// In the last tick no tip had moved for some time, and all wanted regions were stored.
  [[nodiscard]] bool at_rest() const noexcept { return at_rest_; }

  [[nodiscard]] LoaderFigures figures() const;
  [[nodiscard]] const spm::CacheCounters& cache_counters() const noexcept { return cache_.counters(); }
  [[nodiscard]] std::uint32_t list_blocks_used() const noexcept {
    return pool_.settings.list_blocks - cache_.blocks_free();
  }
  [[nodiscard]] session::DeliveryClient::Sizes delivery_sizes() const noexcept { return delivery_.sizes(); }
  [[nodiscard]] const session::DeliveryClient::Counters& delivery_counters() const noexcept {
    return delivery_.counters();
  }

  /// Those that were handed over, but for withdrawn ones.
  [[nodiscard]] std::vector<ObjectInfo> objects() const;
  /// Those that are withdrawn and that the haptic thread has not given back yet.
  [[nodiscard]] std::vector<ObjectInfo> leaving() const;
  [[nodiscard]] const session::CatalogueEntry& entry(std::uint32_t object_index) const {
    return by_index_[object_index]->entry;
  }
  /// 0 when nobody does.
  [[nodiscard]] std::uint64_t serving_host(std::uint64_t object_id) const { return delivery_.serving_host(object_id); }
  /// Labelled cells that the tips meet.
  [[nodiscard]] std::vector<std::uint32_t> regions_met(std::uint32_t object_index,
                                                       const std::array<ProbeSight, kMaxProbes>& sights) const;
  [[nodiscard]] const spm::RegionGrid& grid(std::uint32_t object_index) const {
    return by_index_[object_index]->grid();
  }
  /// Regions predicted in the last tick, by object index.
  [[nodiscard]] std::vector<std::uint32_t> predicted(std::uint32_t object_index) const;

 private:
  /// In the store: leaving is out of `have`, spare once hosts know that.
  enum class Kept : std::uint8_t { kAbsent, kHeld, kLeaving, kSpare };
  /// In the pool.
  enum class Shown : std::uint8_t { kNot, kShown, kDeparting };
  /// One for each region of every object, so it is packed. Times are modulo some 50 days.
  struct RegionNote {
    std::uint32_t wanted;           // last time it was, in ms
    std::uint32_t met : 28;         // last time a tip met it, in 17 ms; 0: never
    std::uint32_t kept_bits : 2;    // Kept
    std::uint32_t shown_bits : 2;   // Shown
    std::uint32_t met_before : 28;  // the same of the visit before that one
    std::uint32_t was_here : 1;
    std::uint32_t due : 1;     // met so soon that it belongs into the pool
    std::uint32_t faulty : 1;  // the stored data contradicts the model
    [[nodiscard]] Kept kept() const noexcept { return static_cast<Kept>(kept_bits); }
    void set(Kept kept) noexcept { kept_bits = static_cast<std::uint32_t>(kept) & 3u; }
    [[nodiscard]] Shown shown() const noexcept { return static_cast<Shown>(shown_bits); }
    void set(Shown shown) noexcept { shown_bits = static_cast<std::uint32_t>(shown) & 3u; }
    [[nodiscard]] bool absent() const noexcept { return kept() == Kept::kAbsent && shown() != Shown::kShown; }
    void want_at(std::int64_t now_ns) noexcept { wanted = static_cast<std::uint32_t>(now_ns / kMs); }
    /// Since it was wanted, ns.
    [[nodiscard]] std::int64_t unwanted_ns(std::int64_t now_ns) const noexcept {
      return static_cast<std::int64_t>(static_cast<std::uint32_t>(now_ns / kMs) - wanted) * kMs;
    }
    /// Contacts within `pause_ns` belong to the same visit.
    void meet_at(std::int64_t now_ns, std::int64_t pause_ns) noexcept {
      const std::uint32_t now = grains(now_ns);
      if (((now - met) & kGrains) >= pause_ns / kGrain) met_before = met & kGrains;
      met = now & kGrains;
    }
    /// Since the visit before the last, ns; the maximum when there was none.
    [[nodiscard]] std::int64_t since_visit_ns(std::int64_t now_ns) const noexcept {
      return met_before == 0 ? std::int64_t{kGrains} * kGrain
                             : static_cast<std::int64_t>((grains(now_ns) - met_before) & kGrains) * kGrain;
    }

   private:
    static constexpr std::int64_t kMs = 1'000'000, kGrain = 1 << 24;
    static constexpr std::uint32_t kGrains = (1u << 28) - 1;
    [[nodiscard]] static std::uint32_t grains(std::int64_t ns) noexcept {
      return static_cast<std::uint32_t>(ns / kGrain % kGrains) + 1;
    }
  };
  static_assert(sizeof(RegionNote) == spm::kRegionNoteBytes);
  /// Of a region that a tip is expected to meet.
  struct Wish {
    std::int64_t since_ns = 0;        // start of being wanted; 0: not wanted, because memory was full
    std::uint32_t blocks_needed = 0;  // that it needed when it was refused because memory was full
  };
  struct Object {
    ObjectInfo info;
    session::CatalogueEntry entry;
    spm::ModelSummary summary;
    spm::codec::RecordTables tables;
    TouchObject touch;
    Placement placement;            // where it stands now
    std::vector<RegionNote> notes;  // by region
    std::map<std::uint32_t, Wish> wishes;
    std::vector<spm::ProbePredictor> predictors;   // by probe
    std::vector<std::uint32_t> held;               // regions in that state
    std::vector<std::uint32_t> shown;              // regions in the pool
    std::uint32_t base_slots = 0, base_nodes = 0;  // that its base mesh takes
    bool ready = false;                            // base mesh is in
    bool withdrawn = false;                        // after that
    bool refused = false;                          // base mesh or directory does not fit
    [[nodiscard]] const spm::RegionGrid& grid() const noexcept { return touch.forest->grid(); }  // never changes
  };

  [[nodiscard]] bool take_directory(Object& object);
  void forget_unoffered(std::int64_t now_ns);
  void drop_parked(const Object& object);
  void open(const session::CatalogueEntry& entry);
  void postpone(const session::CatalogueEntry& entry);
  template <class Change>
  void change_offers(Change&& change);

  // Withdrawal (loader_withdrawal.cpp).
  void withdraw(Object& object);
  void free_withdrawn(Object& object);
  void forget(Object& object);
  void open_postponed();
  void take_base(Object& object, const std::vector<std::uint8_t>& bytes);
  [[nodiscard]] bool still_ahead(std::int64_t now_ns, const std::array<ProbeSight, kMaxProbes>& sights) const;
  void observe(Object& object, const std::array<ProbeSight, kMaxProbes>& sights) const;
  [[nodiscard]] Vec3d centre(const ProbeSight& sight, const spm::ProbeSphere& sphere) const noexcept;
  using PlacedSpheres = std::array<spm::PlacedSphere, spm::ProbeShape::kMaxSpheres>;
  [[nodiscard]] std::span<const spm::PlacedSphere> spheres(const ProbeSight& sight, const Placement& placement,
                                                           PlacedSpheres& out) const noexcept;
  [[nodiscard]] double moved(const ProbeSight& sight, const ProbeSight& before) const noexcept;
  [[nodiscard]] double lead(double round_trip) const;
  void predict(std::int64_t now_ns, const std::array<ProbeSight, kMaxProbes>& sights);
  void predict(Object& object, const std::array<ProbeSight, kMaxProbes>& sights, double round_trip, double lead);
  void predict_under_bodies(const Object& object, const std::array<ProbeSight, kMaxProbes>& sights, double lead);

  // The store (loader_store.cpp).
  [[nodiscard]] std::uint32_t room_to_come() const noexcept { return store_.blocks_free() + store_.blocks_leaving(); }
  /// The estimated memory of a region in the store.
  [[nodiscard]] double coded_of(const Object& object, std::uint32_t region) const noexcept;
  void take(Object& object, session::DeliveryClient::Message message, std::int64_t now_ns);
  void take_parked(std::int64_t now_ns);
  /// False when there is no room now, but will be.
  [[nodiscard]] bool keep(Object& object, const session::DeliveryClient::Message& message, std::int64_t now_ns);
  void want(std::int64_t now_ns);
  void find_eviction_candidates();
  void take_back(Object& object, std::uint32_t region);
  void take_released();
  [[nodiscard]] bool free_spare();
  struct Place {
    Object* object;
    std::uint32_t region;
  };
  void evict(Object& object, std::uint32_t region);
  std::deque<Place>::iterator free_now(std::deque<Place>::iterator eviction_candidate);

  // The pool (loader_pool.cpp).
  /// The estimated memory of a region's records in the pool: of all, or of those that are not there yet.
  [[nodiscard]] double slots_of(const Object& object, std::uint32_t region) const noexcept;
  [[nodiscard]] spm::Cache::Room fresh_room_of(const Object& object, std::uint32_t region) const noexcept;
  void show_due();
  /// The memory that is missing; nothing when the region was decoded.
  [[nodiscard]] spm::Cache::Room show(Object& object, std::uint32_t region);
  void coarsen();
  void take_departures();
  void hand_over();
  void find_near(const std::array<ProbeSight, kMaxProbes>& sights, std::array<NearObjects, kMaxProbes>& near);
  void say(const std::string& text) const {
    if (on_event) on_event(text);
  }

  spm::Pool& pool_;
  spm::NodePool& nodes_;
  LoaderSettings settings_;
  spm::ProbeShape shape_;  // of every probe; m
  ArrivalRing& arrivals_;
  DepartureRing& departures_;
  spm::Cache cache_;
  spm::codec::CompressedCache store_;
  session::DeliveryClient delivery_;
  spm::fcl::BroadPhase broad_phase_;
  std::map<std::uint64_t, std::unique_ptr<Object>> objects_;    // by id
  std::vector<Object*> active_;                                 // handed over and not withdrawn, in this order
  std::array<Object*, kMaxObjects> by_index_{};                 // handed over; null: none
  std::map<std::uint64_t, session::CatalogueEntry> postponed_;  // by id: until what is in the way is gone
  struct Prospect {
    double doubt;       // see spm::PredictedRegion
    double order;       // s: when it is met, or later when it could only come too late for that
    double contact_in;  // s
    Object* object;
    std::uint32_t region;
    Wish* wish;
  };
  static constexpr std::uint32_t kMaxMet = 4096;
  spm::Predictor::Answer met_{kMaxMet};  // of one object, in a prediction
  std::vector<Prospect> prospects_;      // of the last prediction
  std::int64_t predicted_ns_ = 0, predict_next_ns_ = 0;
  std::int64_t moved_ns_ = 0;  // when a tip last left what was predicted
  bool at_rest_ = false;
  std::array<ProbeSight, kMaxProbes> predicted_for_{};
  std::deque<Arrival> waiting_;  // for room in the ring
  struct Parked {
    Object* object;
    session::DeliveryClient::Message message;
  };
  std::deque<Parked> parked_;  // for room in the store; later ones may count on earlier ones
  std::size_t parked_bytes_ = 0;
  std::deque<Place> eviction_candidates_;  // kLeaving or kSpare, first to go first
  std::uint32_t needed_ = 0;               // blocks, for what is wanted soonest and absent, more or less
  std::uint32_t reserve_ = 0;              // blocks, made ready ahead of need
  std::uint32_t faulty_ = 0;               // regions that are
  struct Departing {
    Object* object;
    std::uint32_t region;
    spm::Cache::Room room;  // that it gives, at least
  };
  std::vector<Departing> departing_;
  spm::Cache::Room room_needed_;   // in the pool, for what is due, kept and not shown, more or less
  std::vector<Place> due_;         // of the last tick
  std::int64_t wanted_at_ns_ = 0;  // of the last tick: what is wanted was wanted then
  std::uint32_t base_slots_ = 0;   // that base meshes take
  std::uint32_t base_nodes_ = 0;   // and of the tree, at least
  std::uint64_t directories_ = 0;  // bytes, of all objects
  std::int64_t looked_at_offers_ns_ = 0;
  double fresh_share_ = 1;        // of a region's records, those that had to be decoded; smoothed
  double blocks_per_record_ = 1;  // of a region's list, that its message took; smoothed
  double bytes_per_block_ = 12;   // on its way; smoothed
  LoaderFigures figures_;
};

}  // namespace tactus::hrtc_service
