/// Requests the regions that probes will touch, and stores them compressed. Decodes the regions that will be touched
/// soonest and sends them to the intake, which loads them into the pool. Evicts regions that no probe needs.
///
///   catalogue, chunks -> [assemble] -> store -> [decode] -> IntakeLink -> Intake -> pool
///   reported probes -> [predict] -> demand               answers <-
///
/// The store is the compressed cache. Demands list its regions as present (`have`), except retired ones. The pool is a
/// cache of the store. A region that leaves the pool remains in the store, so it can be loaded again without the
/// network.
///
/// A region counts as loaded once its message to the intake is appended. The answer of the intake revokes this if the
/// intake has refused the region.
///
/// The loader evicts a region from the store in two steps:
///  1. It retires the region: demands no longer list it in `have`.
///  2. When the host has echoed such a demand, the region is evictable. The loader frees it only when it needs memory.
/// If a probe needs the region again before it is freed, the loader cancels the eviction, unless a host has credit for
/// the blocks of the region.
///
/// The host gets credit only for blocks that are free or belong to retired regions, and for missing base meshes. The
/// echo of the host arrives before the data that it sends on that credit. So the loader never evicts a region that the
/// host counts as present.
///
/// The loader requests the pages of the directory that probes come near (loader_pages.cpp), and sends them to the
/// intake. It drops the pages that have been unused for longest when the memory for directories is full.
///
/// The base mesh of a new object reserves its slots at once. If regions occupy these slots, the base mesh waits until
/// the haptic thread has coarsened them. It is refused only if it does not fit besides the other base meshes.
///
/// If an earlier gateway has used the link, the servo still has its objects and regions. The loader keeps an object
/// when a host offers it again. The intake then answers which of its pages and regions are loaded. The loader requests
/// the pages again; the data of the regions are not in the store. It withdraws the objects that no host has offered for
/// `kept_patience_ns`.
///
/// An object is withdrawn when its last host withdraws it or sends a leave message. Predictions, demands and the store
/// then omit it at once. Its memory in the pool is freed when the intake has returned it. If its hosts are only
/// silent, the object and its loaded regions remain, because a user may be touching it and a host may come back.
///
/// One thread, not the haptic one. Allocates while decoding. Memory is bounded by pool, store and
/// LoaderSettings::directory_bytes.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "hrtc_service/intake_sender.hpp"
#include "hrtc_service/servo/tool_touch.hpp"
#include "hrtc_service/servo/touch_objects.hpp"
#include "session/delivery_client.hpp"
#include "session/severity.hpp"
#include "spm/codec/base_codec.hpp"
#include "spm/codec/compressed_cache.hpp"
#include "spm/directory.hpp"
#include "spm/fcl/broad_phase.hpp"
#include "spm/prediction.hpp"
#include "spm/region_grid.hpp"

namespace tactus::hrtc_service {

/// Newest state of a probe from the reports of the haptic thread. World frame.
struct ReportedProbe {
  bool active = false;
  bool in_contact = false;
  std::int64_t time_ns = 0;
  Vec3d device = Vec3d::Zero();
  Vec3d proxy = Vec3d::Zero();  ///< proxy of a tip, valid while `in_contact`; position of a tool, always valid
  Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity();  ///< orientation of the tool
};

struct LoaderSettings {
  double radius = 0.003;  ///< radius of the tips, m
  /// Tool of every probe, m. Null: every probe is a sphere.
  const spm::MeshProbe* tool = nullptr;
  spm::Strategy strategy = spm::Strategy::kMixture;
  double margin = 0.0005;      ///< max distance of a predicted region from a tip's path, m
  double min_speed = 0.05;     ///< speed that the prediction assumes for a tip at rest, m/s
  double near_distance = 0.1;  ///< max distance between a probe and the objects that are near it (NearObjects), m
  double min_lead = 0.02;      ///< min prediction horizon, s; a longer round trip extends it
  double max_lead = 0.5;       ///< max prediction horizon, s
  /// Regions that were wanted within this time are evicted after all others. Contacts separated by less time belong to
  /// one visit.
  std::int64_t recently_wanted_ns = 300'000'000;
  /// Time after which an object of an earlier gateway is withdrawn, if no host has offered it.
  std::int64_t kept_patience_ns = 10'000'000'000;
  /// Clock for the cost of prediction, ns. The loader limits that cost to a share of the time. Null: the cost is 0.
  std::int64_t (*clock)() = nullptr;
  /// Max bytes of the directories of all objects (spm/directory.hpp). An object whose directory does not fit is
  /// refused.
  std::uint64_t directory_bytes = ~std::uint64_t{0};
  /// Whether to request the whole directory of each object, instead of the pages near probes.
  bool wants_whole_directory = false;
  session::DeliverySettings delivery{};
};

struct LoaderFigures {
  std::uint64_t regions_held = 0;       ///< regions in the store
  std::uint64_t regions_evictable = 0;  ///< held regions that hosts no longer count as present
  std::uint64_t regions_loaded = 0;     ///< regions in the pool
  std::uint64_t regions_received = 0;
  std::uint64_t regions_evicted = 0;    ///< regions freed from the store
  std::uint64_t regions_reloaded = 0;   ///< regions received again after their eviction
  std::uint64_t regions_coarsened = 0;  ///< regions removed from the pool
  std::uint64_t records_received = 0;
  std::uint64_t records_received_again = 0;      ///< received records that are or once were in the store
  std::uint64_t records_repeated = 0;            ///< received records that are already in the store
  std::uint64_t records_repeated_unretired = 0;  ///< of these, records in the list of a region that is not retired
  std::uint64_t refused_full = 0;                ///< messages refused because the store was full
  std::uint64_t refused_other = 0;               ///< messages and regions refused because records did not fit together
  std::uint64_t decode_errors = 0;
  std::uint64_t objects_refused = 0;  ///< objects refused because memory was full
  double load_latency = 0;            ///< time from when a region becomes wanted to its storage, smoothed, s
  std::uint32_t slots_used = 0, slots_peak = 0, slots_limit = 0;
  std::uint32_t compressed_used = 0, compressed_peak = 0, compressed_limit = 0;  ///< blocks of the store
};

class Loader {
 public:
  /// `pool`: settings of the pool of the intake. `link` must outlive the loader.
  Loader(const spm::PoolSettings& pool, const session::Origin& self, const LoaderSettings& settings, IntakeLink& link);
  ~Loader();

  /// Called with one line for each event that an operator should see.
  std::function<void(session::Severity, const std::string&)> on_event;

  /// Called with each object whose base mesh is requested from now on.
  std::function<void(const session::CatalogueEntry&)> on_object_found;

  /// Called with each object that is sent to the intake, in that order.
  std::function<void(const ObjectDescription&)> on_object;

  /// Called with each object that was sent to the intake and is now withdrawn. The reference remains valid until
  /// `on_object_gone`.
  std::function<void(const ObjectDescription&)> on_object_withdrawn;

  /// Description of an object. After the base mesh is in the pool, only the counters change.
  struct ObjectInfo {
    std::string name;
    std::uint64_t id = 0;
    std::uint64_t digest = 0;
    double scale = 1;
    std::uint32_t index = spm::kNone;  ///< kNone: the base mesh was not sent to the intake
    std::uint64_t records_received = 0, records_received_again = 0, regions_received = 0, regions_released = 0;
  };
  /// Called with each object that the loader has removed: after the intake has returned it, or before it was sent. A
  /// later object may get its index.
  std::function<void(const ObjectInfo&)> on_object_gone;

  void on_catalogue(const session::CatalogueEntry& entry);
  [[nodiscard]] bool has_object(std::uint64_t object_id) const { return objects_.count(object_id) != 0; }
  /// Returns the bytes of the directories of all objects, at most LoaderSettings::directory_bytes.
  [[nodiscard]] std::uint64_t directory_bytes_used() const noexcept { return directory_bytes_; }
  void on_host_heartbeat(std::uint64_t host, std::uint64_t incarnation, std::int64_t now_ns);
  void on_host_gone(std::uint64_t host);
  /// Processes the leave message of this incarnation.
  void on_host_left(std::uint64_t host, std::uint64_t incarnation);
  void on_host_silent(std::uint64_t host);
  void on_chunk(const session::BulkChunk& chunk, std::int64_t now_ns);

  /// Sets the placement of a movable object for predictions, the broad phase and `regions_at_probes`.
  void on_moved(std::uint32_t object_index, const Placement& placement);

  /// Sets additional wanted regions of an object. The loader requests `regions` as if a probe would touch them in 20 ms,
  /// and `later` as if in 0.5 s.
  void want(std::uint32_t object_index, std::vector<std::uint32_t> regions, std::vector<std::uint32_t> later);

  /// Predicts, evicts, and sends regions to the intake. Call it every few milliseconds. Sets `near` to the
  /// objects near each probe.
  void tick(std::int64_t now_ns, const std::array<ReportedProbe, kMaxProbes>& probes,
            std::array<NearObjects, kMaxProbes>& near);

  /// Sends messages to the intake that did not fit into the ring. Returns whether all are sent.
  bool send_waiting() { return intake_.flush(); }

  /// Returns the next demand to publish, or nothing when none is due.
  [[nodiscard]] std::optional<session::Demand> demand(std::int64_t now_ns) { return delivery_.demand(now_ns); }

  /// Returns whether, at the last tick, no probe had moved for 0.1 s and all wanted regions were stored.
  [[nodiscard]] bool at_rest() const noexcept { return at_rest_; }

  [[nodiscard]] LoaderFigures figures() const;
  /// Time from a demand to the first chunk that answers it, smoothed; 0: not measured yet.
  [[nodiscard]] std::int64_t round_trip_ns() const noexcept { return delivery_.round_trip_ns(); }
  [[nodiscard]] session::DeliveryClient::Sizes delivery_sizes() const noexcept { return delivery_.sizes(); }
  [[nodiscard]] const session::DeliveryClient::Counters& delivery_counters() const noexcept {
    return delivery_.counters();
  }

  /// Returns the objects that were sent to the intake and are not withdrawn.
  [[nodiscard]] std::vector<ObjectInfo> objects() const;
  /// Returns the withdrawn objects that the intake has not returned yet.
  [[nodiscard]] std::vector<ObjectInfo> withdrawn_objects() const;
  [[nodiscard]] const session::CatalogueEntry& entry(std::uint32_t object_index) const {
    return by_index_[object_index]->entry;
  }
  /// Returns the id of the host that serves the object, or 0.
  [[nodiscard]] std::uint64_t serving_host(std::uint64_t object_id) const { return delivery_.serving_host(object_id); }
  /// Returns the number of entries in the list of a region, or 0 if its page is missing.
  [[nodiscard]] std::uint32_t records_of(std::uint32_t object_index, std::uint32_t region) const noexcept {
    const Page* const page = by_index_[object_index]->find_page(region);
    return page == nullptr ? 0 : page->lists[region - page->grid.first_region()].records;
  }
  /// Returns the regions that the probes intersect, with repetitions.
  [[nodiscard]] std::vector<std::uint32_t> regions_at_probes(std::uint32_t object_index,
                                                             const std::array<ReportedProbe, kMaxProbes>& probes) const;
  /// Returns the grid of an object, with the pages that have come.
  [[nodiscard]] const spm::RegionGrid& grid(std::uint32_t object_index) const { return by_index_[object_index]->grid; }
  /// Returns the regions of the object in the newest prediction, and those of `want`.
  [[nodiscard]] std::vector<std::uint32_t> predicted(std::uint32_t object_index) const;
  /// Returns the regions of the object in the newest prediction, without those of `want`.
  [[nodiscard]] std::vector<std::uint32_t> predicted_contacts(std::uint32_t object_index) const;

 private:
  /// State of a region in the store. kRetired: demands no longer list it in `have`. kEvictable: hosts have echoed such
  /// a demand.
  enum class StoreState : std::uint8_t { kAbsent, kHeld, kRetired, kEvictable };
  /// State of a region in the pool. kDeparting: the haptic thread is coarsening it.
  enum class PoolState : std::uint8_t { kNotLoaded, kLoaded, kDeparting };
  /// State of one region. Packed, because every region of every page has one. Times wrap after some 50 days.
  struct RegionProgress {
    std::uint32_t wanted_ms;            // time of the last tick in which the region was wanted
    std::uint32_t last_contact : 28;    // time of the last contact, in ticks of 17 ms; 0: never
    std::uint32_t store_bits : 2;       // StoreState
    std::uint32_t pool_bits : 2;        // PoolState
    std::uint32_t previous_visit : 28;  // last contact of the second-last visit, in ticks of 17 ms; 0: none
    std::uint32_t was_stored : 1;       // has been in the store
    std::uint32_t belongs_in_pool : 1;  // among the predicted regions that fit into the pool, soonest contact first
    std::uint32_t is_faulty : 1;        // the stored data contradicts the model
    std::uint32_t was_incomplete : 1;   // the intake lacked a record at the last attempt to load the region
    [[nodiscard]] StoreState store_state() const noexcept { return static_cast<StoreState>(store_bits); }
    void set(StoreState state) noexcept { store_bits = static_cast<std::uint32_t>(state) & 3u; }
    [[nodiscard]] PoolState pool_state() const noexcept { return static_cast<PoolState>(pool_bits); }
    void set(PoolState state) noexcept { pool_bits = static_cast<std::uint32_t>(state) & 3u; }
    [[nodiscard]] bool is_absent() const noexcept {
      return store_state() == StoreState::kAbsent && pool_state() != PoolState::kLoaded;
    }
    void mark_wanted(std::int64_t now_ns) noexcept { wanted_ms = static_cast<std::uint32_t>(now_ns / kNsPerMs); }
    /// Returns the time since the region was last wanted, ns.
    [[nodiscard]] std::int64_t unwanted_ns(std::int64_t now_ns) const noexcept {
      return static_cast<std::int64_t>(static_cast<std::uint32_t>(now_ns / kNsPerMs) - wanted_ms) * kNsPerMs;
    }
    /// Stores the time of a contact. Contacts separated by less than `pause_ns` belong to one visit.
    void mark_contact(std::int64_t now_ns, std::int64_t pause_ns) noexcept {
      const std::uint32_t now = contact_ticks(now_ns);
      if (((now - last_contact) & kContactTicks) >= pause_ns / kContactTickNs)
        previous_visit = last_contact & kContactTicks;
      last_contact = now & kContactTicks;
    }
    /// Returns the time since the second-last visit, ns. If there was none, returns the largest time.
    [[nodiscard]] std::int64_t since_previous_visit_ns(std::int64_t now_ns) const noexcept {
      return previous_visit == 0
                 ? std::int64_t{kContactTicks} * kContactTickNs
                 : static_cast<std::int64_t>((contact_ticks(now_ns) - previous_visit) & kContactTicks) * kContactTickNs;
    }

   private:
    static constexpr std::int64_t kNsPerMs = 1'000'000, kContactTickNs = 1 << 24;
    static constexpr std::uint32_t kContactTicks = (1u << 28) - 1;
    [[nodiscard]] static std::uint32_t contact_ticks(std::int64_t ns) noexcept {
      return static_cast<std::uint32_t>(ns / kContactTickNs % kContactTicks) + 1;
    }
  };
  static_assert(sizeof(RegionProgress) + sizeof(spm::ListSummary) == spm::kLoaderBytesPerRegion);
  /// A region that a probe is predicted to touch.
  struct WantedRegion {
    std::int64_t since_ns = 0;        // time when it became wanted; 0: more urgent regions fill the store
    std::uint32_t blocks_needed = 0;  // blocks that it needed when the full store refused it; 0: never refused
  };
  /// A page of the directory of an object, with the state of its regions.
  struct Page {
    explicit Page(const spm::Page& page);
    spm::RegionPage grid;
    std::int64_t near_ns = 0;             // time of the last prediction with a probe near it
    std::vector<spm::ListSummary> lists;  // by region
    std::vector<RegionProgress> notes;    // by region
  };
  struct Object {
    explicit Object(const session::CatalogueEntry& offered, std::uint32_t max_pages)
        : entry{offered}, summary{offered.summary}, grid{offered.summary, max_pages} {}
    /// Returns the page with the region, or null.
    [[nodiscard]] Page* find_page(std::uint32_t region) const noexcept;
    [[nodiscard]] Page* find_page(spm::PageId page) const noexcept;
    /// Returns list or state of a region, whose page must have come.
    [[nodiscard]] const spm::ListSummary& list(std::uint32_t region) const noexcept {
      const Page& page = *find_page(region);
      return page.lists[region - page.grid.first_region()];
    }
    [[nodiscard]] RegionProgress& note(std::uint32_t region) const noexcept {
      Page& page = *find_page(region);
      return page.notes[region - page.grid.first_region()];
    }

    ObjectInfo info;
    session::CatalogueEntry entry;
    spm::ModelSummary summary;
    spm::codec::RecordTables tables;
    ObjectDescription described;
    spm::CellBox bounds;                                   // model frame
    Placement placement;                                   // current
    spm::RegionGrid grid;                                  // of `pages`
    std::vector<std::unique_ptr<Page>> pages;              // in the order of their regions
    std::vector<spm::Page> pages_to_send;                  // to the intake, after the base mesh
    std::vector<session::Wanted> wanted_pages;             // missing pages that probes may touch soon
    std::set<spm::PageId> pages_in_servo;                  // of an earlier gateway, missing here
    std::vector<std::uint32_t> regions_in_servo;           // as above, of missing pages
    std::vector<std::uint32_t> also_wanted, wanted_later;  // regions of `want`
    std::vector<std::uint32_t> predicted;                  // regions of the newest prediction
    std::map<std::uint32_t, WantedRegion> wanted_regions;  // by region; the newest prediction
    std::vector<spm::ProbePredictor> predictors;           // by probe
    std::vector<std::uint32_t> held;                       // regions in StoreState::kHeld
    std::vector<std::uint32_t> loaded;                     // regions in PoolState::kLoaded
    std::uint64_t directory_bytes = 0;                     // reserved for its directory
    std::uint32_t base_slots = 0, base_nodes = 0;          // slots and tree nodes reserved for its base mesh
    bool ready = false;                                    // the base mesh was sent to the intake
    bool is_full = false;            // a page did not fit although no page is unused; reported once
    std::int64_t full_ns = 0;        // time of the last such page
    bool has_large_regions = false;  // some do not fit into the pool
    bool withdrawn = false;          // only after `ready`
    bool refused = false;            // base mesh or directory does not fit, or the intake refused it
  };

  [[nodiscard]] bool reserve_directory(Object& object);
  void release_directory(Object& object) noexcept;
  void forget_unoffered(std::int64_t now_ns);
  [[nodiscard]] std::uint32_t max_pages_of(const spm::ModelSummary& summary) const noexcept;
  void drop_waiting(const Object& object);
  void open(const session::CatalogueEntry& entry);
  void postpone(const session::CatalogueEntry& entry);
  template <class Change>
  void change_offers(Change&& change);

  // Withdrawal (loader_withdrawal.cpp).
  void withdraw(Object& object);
  void free_withdrawn(Object& object);
  void keep_refused(Object& object);
  void forget(Object& object);
  void open_postponed();
  [[nodiscard]] bool prediction_is_current(std::int64_t now_ns,
                                           const std::array<ReportedProbe, kMaxProbes>& probes) const;
  void measure_speeds(const std::array<ReportedProbe, kMaxProbes>& probes);
  void observe(Object& object, const std::array<ReportedProbe, kMaxProbes>& probes) const;
  [[nodiscard]] Vec3d sphere_centre(const ReportedProbe& probe, const spm::ProbeSphere& sphere) const noexcept;
  using PlacedSpheres = std::array<spm::PlacedSphere, spm::ProbeShape::kMaxSpheres>;
  [[nodiscard]] std::span<const spm::PlacedSphere> spheres(const ReportedProbe& probe, const Placement& placement,
                                                           PlacedSpheres& out) const noexcept;
  [[nodiscard]] double displacement(const ReportedProbe& probe, const ReportedProbe& before) const noexcept;
  [[nodiscard]] double horizon(double round_trip) const;
  void predict(std::int64_t now_ns, const std::array<ReportedProbe, kMaxProbes>& probes);
  void predict(Object& object, const std::array<ReportedProbe, kMaxProbes>& probes, double round_trip, double lead);
  void find_missing_pages(Object& object, const std::array<ReportedProbe, kMaxProbes>& probes, double lead);
  void predict_under_bodies(Object& object, const std::array<ReportedProbe, kMaxProbes>& probes, double lead);

  // Base meshes (loader_base.cpp).
  void on_base_mesh(Object& object, const std::vector<std::uint8_t>& bytes);
  [[nodiscard]] bool reserve_base(Object& object, const spm::BaseMesh& base);
  [[nodiscard]] std::uint32_t pending_base_slots() const noexcept;
  [[nodiscard]] std::uint64_t base_credit() const;
  void admit_pending_bases();
  void drop_pending_base(Object& object);
  void process_attach(std::int64_t now_ns);
  void withdraw_kept_objects(std::int64_t now_ns);
  [[nodiscard]] std::uint32_t kept_index(const Object& object) const noexcept;
  [[nodiscard]] bool can_admit(const Object& object);
  void withdraw_kept(std::uint32_t index);
  [[nodiscard]] std::uint32_t free_index() const noexcept;
  [[nodiscard]] std::uint32_t take_index(const Object& object) noexcept;
  void admit_base(Object& object, spm::codec::DecodedBase decoded);
  void update_broad_phase(const Object& object);

  // Pages of directories (loader_pages.cpp).
  void on_pages(Object& object, const session::DeliveryClient::Message& message);
  [[nodiscard]] bool add_page(Object& object, spm::Page page);
  [[nodiscard]] bool is_in_use(const Object& object, const Page& page) const;
  [[nodiscard]] bool has_room(const Object& object, std::uint64_t bytes) const noexcept;
  void drop_unused_pages();
  void drop_page(Object& object, spm::PageId page);
  void want_pages(Object& object, const Vec3d& centre, double radius, double contact);
  void want_page(Object& object, spm::PageId page, double contact);
  void process_page_answer(Object& object, spm::PageId page, spm::AcceptResult result);
  [[nodiscard]] std::uint64_t page_credit() const noexcept;

  // The store (loader_store.cpp).
  [[nodiscard]] std::uint32_t blocks_after_eviction() const noexcept {
    return store_.blocks_free() + store_.blocks_retired();
  }
  /// Estimates the memory of a region in the store, in blocks.
  [[nodiscard]] double block_estimate(const Object& object, std::uint32_t region) const noexcept;
  void on_region(Object& object, session::DeliveryClient::Message message, std::int64_t now_ns);
  void store_waiting(std::int64_t now_ns);
  /// Stores or refuses the region of a message. Returns false if the message has to wait for an eviction.
  [[nodiscard]] bool store_or_refuse(Object& object, const session::DeliveryClient::Message& message,
                                     std::int64_t now_ns);
  void request_wanted(std::int64_t now_ns);
  void find_eviction_candidates();
  void cancel_eviction(Object& object, std::uint32_t region);
  void collect_released();
  [[nodiscard]] bool evict_one();
  struct RegionRef {
    Object* object;
    std::uint32_t region;
  };
  void evict(Object& object, std::uint32_t region);
  std::deque<RegionRef>::iterator evict_candidate(std::deque<RegionRef>::iterator candidate);

  // The pool (loader_pool.cpp).
  /// Estimates the slots of all records of a region.
  [[nodiscard]] double slot_estimate(const Object& object, std::uint32_t region) const noexcept;
  /// Estimates the memory that loading a region would take, without its records that are already loaded.
  [[nodiscard]] spm::Cache::Space space_to_load(const Object& object, std::uint32_t region) const noexcept;
  void load_soonest();
  /// Decodes a stored region and sends it to the intake. Returns the memory that the pool lacks for it, zero if it fits
  /// or is faulty.
  [[nodiscard]] spm::Cache::Space load(Object& object, std::uint32_t region);
  void coarsen();
  void process_answers();
  void process_region_answer(Object& object, std::uint32_t region, spm::AcceptResult result);
  void mark_faulty(Object& object, std::uint32_t region);
  void end_departure(Object& object, std::uint32_t region);
  void mark_loaded(Object& object, std::uint32_t region);
  void mark_unloaded(Object& object, std::uint32_t region);
  void find_near(const std::array<ReportedProbe, kMaxProbes>& probes, std::array<NearObjects, kMaxProbes>& near);
  void report_info(const std::string& text) const {
    if (on_event) on_event(session::Severity::kInfo, text);
  }
  void report_warning(const std::string& text) const {
    if (on_event) on_event(session::Severity::kWarning, text);
  }

  [[nodiscard]] std::uint32_t slots_used() const noexcept { return pool_.slots - intake_.free_space().slots; }

  spm::PoolSettings pool_;
  LoaderSettings settings_;
  spm::ProbeShape shape_;  // shape of every probe, m
  IntakeSender intake_;
  spm::codec::CompressedCache store_;
  session::DeliveryClient delivery_;
  spm::fcl::BroadPhase broad_phase_;
  std::map<std::uint64_t, std::unique_ptr<Object>> objects_;    // by id
  std::vector<Object*> active_;                                 // ready and not withdrawn, in the order of arrivals
  std::array<Object*, kMaxObjects> by_index_{};                 // ready; null: none
  std::array<KeptObject, kMaxObjects> kept_objects_{};          // of an earlier gateway, not offered yet
  std::int64_t attached_ns_ = 0;                                // time of the attach
  std::uint32_t next_index_ = 0;                                // at which the search for a free index starts
  std::map<std::uint64_t, session::CatalogueEntry> postponed_;  // by id; entries to open when another object is gone
  struct PredictedContact {
    double uncertainty;      // standard deviations from the predicted path; larger if the region cannot arrive in time
    double request_order;    // s; time to contact; larger if the region cannot arrive before the contact ends
    double time_to_contact;  // s
    Object* object;
    std::uint32_t region;
    WantedRegion* wanted;
  };
  static constexpr std::uint32_t kMaxPredicted = 4096;
  spm::Predictor::Regions predicted_regions_{kMaxPredicted};  // regions of one object, while it is predicted
  std::vector<PredictedContact> predicted_contacts_;          // contacts of the last prediction, all objects
  std::int64_t last_prediction_ns_ = 0;                       // 0: predict in the next tick
  std::int64_t next_prediction_ns_ = 0;                       // a prediction before this time would cost too much
  std::int64_t last_motion_ns_ = 0;                           // time when a probe last moved
  bool at_rest_ = false;
  std::array<ReportedProbe, kMaxProbes> predicted_probes_{}, measured_probes_{};
  std::array<double, kMaxProbes> speeds_{};  // m/s, see measure_speeds
  struct PendingBase {
    Object* object;
    spm::codec::DecodedBase base;
  };
  std::deque<PendingBase> pending_bases_;  // base meshes that wait until regions are coarsened
  struct WaitingMessage {
    Object* object;
    session::DeliveryClient::Message message;
  };
  std::deque<WaitingMessage>
      waiting_messages_;  // wait for memory; in the order of arrival, because one may need records of an earlier one
  std::size_t waiting_bytes_ = 0;
  std::deque<RegionRef> eviction_candidates_;  // regions in kRetired or kEvictable, in the order of eviction
  std::uint32_t blocks_needed_ = 0;            // estimated blocks of the wanted regions that arrive next
  std::uint32_t blocks_reserve_ = 0;           // blocks to free before wanted regions need them
  std::uint32_t faulty_regions_ = 0;           // number of regions with `is_faulty`
  struct Departing {
    Object* object;
    std::uint32_t region;
    spm::Cache::Space space;  // estimated memory that its release frees
  };
  std::vector<Departing> departing_;
  spm::Cache::Space missing_space_;      // estimated memory that the pool lacks for stored regions of `pool_targets_`
  std::vector<RegionRef> pool_targets_;  // regions with `belongs_in_pool`
  std::int64_t last_tick_ns_ = 0;        // time of the last tick, which `mark_wanted` stores in every wanted region
  std::uint32_t base_slots_ = 0;         // slots of all base meshes, loaded or pending
  std::uint32_t base_nodes_ = 0;         // min tree nodes of all base meshes, loaded or pending
  std::uint64_t directory_bytes_ = 0;    // of all objects
  std::int64_t offers_checked_ns_ = 0;   // time of the last search for objects that no host offers
  double undecoded_share_ = 1;           // records that a loaded region had to decode / its records; smoothed
  double blocks_per_record_ = 1;         // blocks that a region took in the store / records of its list; smoothed
  double bytes_per_block_ = 12;          // bytes of a message / blocks that it takes in an empty store; smoothed
  LoaderFigures figures_;
};

}  // namespace tactus::hrtc_service
