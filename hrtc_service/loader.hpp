/// What an HRTC holds: asks for the regions that probes will meet, takes what arrives into the pool, evicts what nobody
/// needs.
///
///   catalogue, chunks -> [assemble, decode, slots] -> arrivals ring -> haptic thread
///   probe sights -> [predict] -> demand                 departures ring <-
///
/// A region leaves in two halves. What nobody has wanted for long is left out of `have` ahead of need, and is spare
/// once the host has echoed that: touched as before, and taken back if wanted again. When room is needed, spare regions
/// are coarsened by the haptic thread (departure) and freed, which waits for no network. The host gets credit for what
/// is free and what has been left out of `have`, no more: its echo comes ahead of what it sends on that credit, so that
/// room never has to be made of what it counts on.
///
/// One thread, not the haptic one. Allocates while decoding; what it keeps is bounded by the pool and by the number of
/// regions of its objects.
#pragma once

#include <boost/lockfree/spsc_queue.hpp>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "hrtc_service/touch_object.hpp"
#include "session/delivery_client.hpp"
#include "spm/cache.hpp"
#include "spm/codec/record_codes.hpp"
#include "spm/directory.hpp"
#include "spm/fcl/broad_phase.hpp"
#include "spm/prediction.hpp"

namespace tactus::hrtc_service {

/// What the haptic thread shows of a probe, newest value.
struct ProbeSight {
  bool active = false;
  bool in_contact = false;
  std::int64_t time_ns = 0;
  Vec3d device = Vec3d::Zero();
  Vec3d proxy = Vec3d::Zero();  ///< where the force comes from, while in contact
};

struct LoaderSettings {
  double radius = 0.003;  ///< m, of the tips
  spm::Strategy strategy = spm::Strategy::kMixture;
  double margin = 0.0005;      ///< m; cells this near to a tip's path are loaded
  double least_speed = 0.05;   ///< m/s; a tip at rest is expected to start with this
  double near_distance = 0.1;  ///< m; objects within are offered to the haptic thread's queries
  double least_lead = 0.02;    ///< s; prediction looks at least this far ahead, more when loading takes longer
  double most_lead = 0.5;      ///< s
  std::int64_t idle_before_spare_ns = 300'000'000;  ///< of a region nobody wants, unless the room is needed now
  bool keep_unwanted = true;                        ///< false: what nobody wants goes at once
  /// For the directories of all objects together (spm/directory.hpp); an object whose own does not fit is refused.
  std::uint64_t directory_bytes = ~std::uint64_t{0};
  session::DeliverySettings delivery;
};

struct LoaderFigures {
  std::uint64_t regions_held = 0;
  std::uint64_t regions_spare = 0;  ///< of those held: unknown to the host, so that they can go at any time
  std::uint64_t regions_received = 0;
  std::uint64_t regions_evicted = 0;
  std::uint64_t regions_reloaded = 0;
  std::uint64_t refused_full = 0;
  std::uint64_t refused_other = 0;
  std::uint64_t decode_errors = 0;
  std::uint64_t objects_refused = 0;  ///< for want of memory
  double load_latency = 0;            ///< s, from wanting a region to holding it; smoothed
  std::uint32_t slots_used = 0, slots_peak = 0, slots_limit = 0;
};

class Loader {
 public:
  /// `pool`, `nodes` and the rings must outlive the loader, and the loader the haptic thread.
  Loader(spm::Pool& pool, spm::NodePool& nodes, const session::Origin& self, const LoaderSettings& settings,
         ArrivalRing& arrivals, DepartureRing& departures);
  ~Loader();

  /// Called with one line for each event that an operator should see.
  std::function<void(const std::string&)> on_event;

  void on_catalogue(const session::CatalogueEntry& entry);
  void on_host_seen(std::uint64_t host, std::uint64_t incarnation, std::int64_t now_ns);
  void on_host_gone(std::uint64_t host);
  void on_chunk(const session::BulkChunk& chunk, std::int64_t now_ns);

  /// Predicts, evicts and hands over; every few milliseconds. `near` gets the objects near each probe.
  void tick(std::int64_t now_ns, const std::array<ProbeSight, kMaxProbes>& sights,
            std::array<NearObjects, kMaxProbes>& near);

  /// The next demand to publish, until none is due.
  [[nodiscard]] std::optional<session::Demand> demand(std::int64_t now_ns) { return delivery_.demand(now_ns); }

  [[nodiscard]] LoaderFigures figures() const;
  [[nodiscard]] const spm::CacheCounters& cache_counters() const noexcept { return cache_.counters(); }
  [[nodiscard]] const session::DeliveryClient::Counters& delivery_counters() const noexcept {
    return delivery_.counters();
  }

  /// An object as others may see it: never changed after it is ready.
  struct ObjectInfo {
    std::string name;
    std::uint64_t id = 0;
    std::uint64_t digest = 0;
    double scale = 1;
    std::uint32_t index = 0;
    std::uint64_t records_received = 0, records_returned = 0, regions_received = 0, regions_released = 0;
  };
  [[nodiscard]] std::vector<ObjectInfo> objects() const;
  /// Labelled cells that the tips meet.
  [[nodiscard]] std::vector<std::uint32_t> regions_met(std::uint32_t object_index,
                                                       const std::array<ProbeSight, kMaxProbes>& sights) const;
  [[nodiscard]] const spm::RegionGrid& grid(std::uint32_t object_index) const {
    return by_index_[object_index]->grid();
  }
  /// Regions predicted in the last tick, by object index.
  [[nodiscard]] std::vector<std::uint32_t> predicted(std::uint32_t object_index) const;

 private:
  enum class RegionState : std::uint8_t { kAbsent, kHeld, kLeaving, kSpare, kDeparting };
  /// One for each region of every object, so it is packed. Times are modulo some 50 days.
  struct RegionNote {
    std::uint32_t wanted;           // last time it was, in ms
    std::uint32_t met : 28;         // last time a tip met it, in 17 ms; 0: never
    std::uint32_t state_bits : 4;   // RegionState
    std::uint32_t met_before : 28;  // the same of the visit before that one
    std::uint32_t was_here : 4;
    [[nodiscard]] RegionState state() const noexcept { return static_cast<RegionState>(state_bits); }
    void set(RegionState state) noexcept { state_bits = static_cast<std::uint32_t>(state) & 7u; }
    void want_at(std::int64_t now_ns) noexcept { wanted = static_cast<std::uint32_t>(now_ns / kMs); }
    /// Since it was wanted, ns.
    [[nodiscard]] std::int64_t unwanted_ns(std::int64_t now_ns) const noexcept {
      return static_cast<std::int64_t>(static_cast<std::uint32_t>(now_ns / kMs) - wanted) * kMs;
    }
    /// What follows within `pause_ns` is the same visit.
    void meet_at(std::int64_t now_ns, std::int64_t pause_ns) noexcept {
      const std::uint32_t now = grains(now_ns);
      if (((now - met) & kGrains) >= pause_ns / kGrain) met_before = met & kGrains;
      met = now & kGrains;
    }
    /// Since the visit before the last, ns; as long as can be when there was none.
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
    std::int64_t since_ns = 0;      // since when it is wanted; 0: it is not, for want of room
    std::uint32_t room_needed = 0;  // slots that its records took when they were refused for want of room
  };
  struct Object {
    ObjectInfo info;
    session::CatalogueEntry entry;
    spm::ModelSummary summary;
    spm::codec::RecordTables tables;
    TouchObject touch;
    std::vector<RegionNote> notes;  // by region
    std::map<std::uint32_t, Wish> wishes;
    std::vector<spm::Predictor> predictors;  // by probe
    std::vector<std::uint32_t> held;         // regions in that state
    bool ready = false;                      // base mesh is in
    bool refused = false;                    // base mesh or directory does not fit
    [[nodiscard]] const spm::RegionGrid& grid() const noexcept { return touch.forest->grid(); }  // never changes
  };

  [[nodiscard]] bool take_directory(Object& object);
  void take_base(Object& object, const std::vector<std::uint8_t>& bytes);
  /// False when there is no room now, but will be.
  [[nodiscard]] bool take_region(Object& object, const session::DeliveryClient::Message& message, std::int64_t now_ns);
  void take_messages(std::int64_t now_ns);
  /// That the records of a region take, more or less.
  [[nodiscard]] double slots_of(const Object& object, std::uint32_t region) const noexcept;
  [[nodiscard]] std::uint32_t blocks_of(const Object& object, std::uint32_t region) const noexcept;
  void predict(Object& object, const std::array<ProbeSight, kMaxProbes>& sights);
  void want(std::int64_t now_ns);
  void find_leavers();
  void forget_leaver(const Object& object, std::uint32_t region);
  void take_back(Object& object, std::uint32_t region);
  void let_go();
  void take_departures();
  void hand_over();
  void find_near(const std::array<ProbeSight, kMaxProbes>& sights, std::array<NearObjects, kMaxProbes>& near);
  void say(const std::string& text) const {
    if (on_event) on_event(text);
  }

  spm::Pool& pool_;
  spm::NodePool& nodes_;
  LoaderSettings settings_;
  ArrivalRing& arrivals_;
  DepartureRing& departures_;
  spm::Cache cache_;
  spm::Cache::Room reserve_;  // made ready ahead of need
  session::DeliveryClient delivery_;
  spm::fcl::BroadPhase broad_phase_;
  std::map<std::uint64_t, std::unique_ptr<Object>> objects_;  // by id
  std::vector<Object*> by_index_;
  struct Leaver {  // kLeaving, kSpare or kDeparting
    Object* object;
    std::uint32_t region;
    spm::Cache::Room room;  // that it gives, at least
  };
  struct Prospect {
    double doubt;       // see spm::PredictedRegion
    double order;       // s: when it is met, or later when it could only come too late for that
    double contact_in;  // s
    Object* object;
    std::uint32_t region;
    Wish* wish;
  };
  struct Unplaced {
    Object* object;
    session::DeliveryClient::Message message;
  };
  std::vector<Prospect> prospects_;  // of the last tick, soonest first
  std::deque<Arrival> waiting_;      // for room in the ring
  std::deque<Unplaced> unplaced_;    // for room in the pool; later ones may count on earlier ones
  std::deque<Leaver> leavers_;       // first to go first
  std::uint32_t departing_ = 0;
  std::int64_t wanted_at_ns_ = 0;  // of the last tick: what is wanted was wanted then
  std::uint32_t base_slots_ = 0;   // that base meshes take for good
  std::uint32_t base_nodes_ = 0;   // and of the tree, at least
  std::uint64_t directories_ = 0;  // bytes, of all objects
  spm::Cache::Room leaving_;       // what all leavers give
  spm::Cache::Room needed_;        // for what is wanted and absent, more or less
  double fresh_share_ = 1;         // of a region's records, those that had to be sent; smoothed
  double slot_bytes_ = 32;         // that a slot takes on its way; smoothed
  LoaderFigures figures_;
};

}  // namespace tactus::hrtc_service
