/// A viewer in a session: holds the objects near the users' probes at full resolution, and the state of the session
/// that its pages show.
///
///     roster, catalogue, probe states, metrics, poses --> state for pages
///     catalogue, base, records --> [Loader] --> [Intake] --arrivals--> [forests] --> ShownMesh
///     demands, roster entries, clock requests <--
///
/// The loader is that of an HRTC (hrtc_service/loader.hpp). It predicts from the probe states of the session instead of
/// those of devices of its own. HRTCs publish which regions determine their meshes (tactus_shown_regions), and the
/// viewer applies the same entries. The mesh of a chosen HRTC is therefore shown with the same mesh hash. If no HRTC is
/// chosen, regions that nobody touches are refined for the screens of pages (screen_refinement.hpp). As long as no HRTC
/// publishes regions of an object and no page has a view, the regions near the probes are refined, and stay refined
/// until their memory is needed.
///
/// No DDS, socket, thread, clock or log: samples and times are arguments, samples to send are results. Times are of
/// this program's monotonic clock. One thread at a time. Not realtime.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "hrtc_service/loader.hpp"
#include "hrtc_service/servo/intake.hpp"
#include "session/clock.hpp"
#include "session/ownership.hpp"
#include "session/periodic.hpp"
#include "session/roster.hpp"
#include "session/sequence_window.hpp"
#include "session/stop_latch.hpp"
#include "session/time_reference.hpp"
#include "viewer/screen_refinement.hpp"
#include "viewer/shown_mesh.hpp"

namespace tactus::viewer {

struct ViewerSettings {
  std::string name{};     ///< of the participant
  std::string session{};  ///< session to join
  spm::PoolSettings pool;
  /// Refinement in a tick, in units of spm::Budget. The default takes about 10 ms.
  std::uint32_t budget = 1u << 18;
  /// Max number of faces that are added only for the screens of pages.
  std::uint32_t faces = 20000;
};

/// Samples to send after a tick, in this order.
struct ViewerMessages {
  std::optional<session::EmergencyStop> stop;
  std::optional<session::RosterEntry> roster;
  std::optional<session::ClockSample> clock_request;
  std::vector<session::Demand> demands;
};

/// The newest probe state of a user.
struct SeenProbe {
  session::ProbeState state;
  std::int64_t received_ns = 0;
};

/// The reason for which a region is refined, or will be. If several apply, a region has the last of them.
enum class RegionMark : std::uint32_t {
  kResident = 1,   ///< a chosen HRTC publishes it as refined
  kPredicted = 2,  ///< the prediction from the probe states contains it
  kContact = 3     ///< a probe in contact intersects it
};
struct MarkedRegion {
  RegionMark mark{};
  std::array<float, 3> low{};  ///< lowest corner of its cell, model frame, file units
  float edge = 0;              ///< edge length of its cell, file units
  [[nodiscard]] bool operator==(const MarkedRegion&) const = default;
};

/// The fronts in the vertex forest of an object, as shares of its list entries. The regions, in the order of their ids,
/// are divided into at most kMaxColumns columns. Source: Liu, Georganas, Roth, 3DIM 2005, figure 5.
struct Fronts {
  static constexpr std::size_t kMaxColumns = 100;
  std::vector<double> refined;  ///< by column: share of the entries that are applied
  std::vector<double> loaded;   ///< by column: share of the entries in the pool
};

struct SeenObject {
  std::uint32_t number = 0;  ///< for frames to pages; never used again after the object is gone
  session::CatalogueEntry entry;
  session::Pose pose;  ///< newest
  session::PoseAdmission admission;
  ShownMesh mesh;
  std::vector<MarkedRegion> regions;  ///< at most kMaxMarkedRegions
  std::uint32_t regions_number = 0;   ///< grows with each change of `regions`
};

/// How far the HRTCs of the session obey emergency stops.
struct StopProgress {
  bool is_requested = false;  ///< this viewer has sent a stop that not all hosts and HRTCs have acknowledged
  std::uint32_t hrtcs = 0;    ///< number of present HRTCs
  std::uint32_t stopped = 0;  ///< number of these in which a stop stands
  /// Names of the hosts and HRTCs that have not acknowledged the stop of this viewer, also of those that have fallen
  /// silent.
  std::vector<std::string> missing;
  [[nodiscard]] bool operator==(const StopProgress&) const = default;
};

struct Event {
  std::int64_t at_ns = 0;
  std::string text;
  bool is_of_page = false;  ///< a page has caused it
};

class ViewerCore {
 public:
  /// A probe is not shown if its newest state is older than this.
  static constexpr std::int64_t kMaxStateAgeNs = 1'000'000'000;
  /// Max number of marked regions of an object. If there are more, the residents with the largest numbers are omitted.
  static constexpr std::size_t kMaxMarkedRegions = 4096;
  /// Number of events that are kept for new pages.
  static constexpr std::size_t kMaxEvents = 100;
  /// Number of these events that pages may have caused. A page that floods cannot replace the other events.
  static constexpr std::size_t kMaxPageEvents = 50;
  static constexpr std::uint32_t kMaxPageEventsPerSecond = 10;  ///< further ones are left out

  ViewerCore(const session::Origin& self, const ViewerSettings& settings, std::int64_t now_ns);
  ~ViewerCore();
  ViewerCore(const ViewerCore&) = delete;
  ViewerCore& operator=(const ViewerCore&) = delete;

  /// Called with the text of each event.
  std::function<void(const std::string&)> on_event;

  void on_roster(const session::RosterEntry& entry, std::int64_t now_ns);
  void on_catalogue(const session::CatalogueEntry& entry) { loader_->on_catalogue(entry); }
  void on_chunk(const session::BulkChunk& chunk, std::int64_t now_ns) { loader_->on_chunk(chunk, now_ns); }
  void on_probe_state(const session::ProbeState& state, std::int64_t now_ns);
  void on_metrics(const session::Metrics& metrics, std::int64_t now_ns);
  void on_shown_regions(const session::ShownRegions& shown, std::int64_t now_ns);
  void on_object_pose(const session::ObjectPose& pose, std::int64_t now_ns);
  void on_stop(const session::EmergencyStop& stop, std::int64_t now_ns);
  void on_reset(const session::ForceReset& reset, std::int64_t now_ns);
  void on_end(const session::SessionEnd& end, std::int64_t now_ns);
  /// `sample`: an answer to a clock request.
  void on_clock(const session::ClockSample& sample, std::int64_t now_ns);

  /// Chooses the HRTC whose meshes are shown. Empty: a region is as fine as in the finest mesh of all HRTCs.
  void show_meshes_of(const std::string& hrtc);
  [[nodiscard]] const std::string& shown_hrtc() const noexcept { return shown_hrtc_; }

  /// Sets the view of a page. While no HRTC is chosen, regions that nobody touches are refined for these views.
  void set_camera(std::uint64_t page, const Camera& camera) { cameras_[page] = camera; }
  void forget_camera(std::uint64_t page) { cameras_.erase(page); }
  [[nodiscard]] const std::map<std::uint64_t, Camera>& cameras() const noexcept { return cameras_; }

  /// Stops all forces of the session. The stop is repeated until all hosts and HRTCs have acknowledged it, or until a
  /// reset names it and those that are present have acknowledged it.
  void stop_forces(const std::string& reason, std::int64_t now_ns);
  void add_event(const std::string& text, std::int64_t now_ns);
  /// Adds an event that a page has caused, within the limits of such events.
  void add_page_event(const std::string& text, std::int64_t now_ns);

  /// While no page can receive a frame, `tick` reads no shown faces and marks no regions. True at the start.
  void set_watched(bool is_watched) { is_watched_ = is_watched; }

  /// Loads, refines and returns the samples to send. Call it every few milliseconds.
  [[nodiscard]] ViewerMessages tick(std::int64_t now_ns);
  [[nodiscard]] session::RosterEntry roster_entry(bool leaving, std::int64_t now_ns);
  /// Fills the fields of a roster entry of this program that state time.
  void put_time(session::RosterEntry& entry, std::int64_t now_ns) const {
    session::put_time(clock_, false, now_ns, entry);
  }

  /// True once an older program has this viewer's name, so that this viewer has to leave.
  [[nodiscard]] bool is_name_taken() const noexcept { return name_taken_; }

  // State for pages.
  [[nodiscard]] const session::Roster& roster() const noexcept { return roster_; }
  [[nodiscard]] const std::map<std::uint64_t, SeenObject>& objects() const noexcept { return objects_; }
  [[nodiscard]] const std::map<std::uint64_t, SeenProbe>& probes() const noexcept { return probes_; }
  /// Newest values of the figures of each participant, by name.
  [[nodiscard]] const std::map<std::uint64_t, std::map<std::string, double>>& metrics() const noexcept {
    return metrics_;
  }
  /// Largest share of the probe states of another HRTC that an HRTC reports as lost, in the last 2 s.
  [[nodiscard]] double lost_share(std::uint64_t hrtc) const;
  /// The fronts of an object in this viewer; empty: its base mesh is not shown.
  [[nodiscard]] Fronts fronts(std::uint64_t object) const;
  [[nodiscard]] const std::deque<Event>& events() const noexcept { return events_; }
  [[nodiscard]] const StopProgress& stop_progress() const noexcept { return stop_progress_; }
  /// Returns the mesh hash that an HRTC has published last for an object; none if it has published no regions.
  [[nodiscard]] std::optional<std::uint64_t> published_hash(std::uint64_t hrtc, std::uint64_t object) const;
  /// Grows when roster, catalogue, events or the progress of a stop change.
  [[nodiscard]] std::uint32_t scene_number() const noexcept { return scene_number_; }
  /// Grows with each metrics sample.
  [[nodiscard]] std::uint32_t metrics_number() const noexcept { return metrics_number_; }
  [[nodiscard]] const hrtc_service::Loader& loader() const noexcept { return *loader_; }
  /// Time of the last tick.
  [[nodiscard]] std::int64_t now_ns() const noexcept { return now_ns_; }
  [[nodiscard]] std::int64_t session_time(std::int64_t now_ns) const noexcept {
    return clock_.map().session_time(now_ns);
  }

 private:
  void add(Event event);
  using Entries = std::map<std::uint32_t, std::uint32_t>;  // by region: number of list entries to apply

  /// An object in the pool. The intake owns it until its departure.
  struct Loaded {
    hrtc_service::TouchObject* object = nullptr;
    bool withdrawn = false;
    std::vector<BaseRegion> base_regions{};  // by region; empty: base mesh or directory is missing
    double distinct = 1;                     // number of records / entries of the lists of all regions
  };

  void process(const session::RosterEvent& event, std::int64_t now_ns);
  void forget_object(std::uint64_t object);
  void load(std::int64_t now_ns);
  void process_arrivals();
  void refine();
  void set_targets(const Loaded& loaded);
  [[nodiscard]] std::optional<Entries> shown_entries(const Loaded& loaded) const;
  void set_base_regions(Loaded& loaded);
  void choose_screen_entries();
  template <class Visit>
  void for_each_shown(const Loaded& loaded, Visit&& visit) const;
  void mark_regions(const Loaded& loaded, SeenObject& object) const;
  void choose_users();
  void send_stop(std::int64_t now_ns, ViewerMessages& out);
  void update_stop_progress();
  [[nodiscard]] std::vector<std::string> missing_of_own_stop();

  session::Origin self_;
  ViewerSettings settings_;
  session::Roster roster_;
  session::SessionClock clock_;
  session::StopLatch stops_;
  std::int64_t now_ns_;  // of the last tick
  session::Heartbeat heartbeat_;
  session::PeriodicTimer clock_request_, stop_repeat_, targets_due_, meshes_due_, regions_due_, screen_due_;
  bool is_watched_ = true;
  std::uint64_t heartbeats_ = 0;
  bool name_taken_ = false;

  std::unique_ptr<hrtc_service::IntakeLink> intake_link_;
  std::unique_ptr<hrtc_service::Intake> intake_;
  std::unique_ptr<hrtc_service::Loader> loader_;
  std::vector<Loaded> loaded_;
  // Of one object, while it is refined.
  std::vector<spm::RegionId> targets_;
  std::vector<spm::Forest::Applied> shown_targets_;
  std::map<std::uint64_t, Camera> cameras_;          // by page
  std::map<std::uint32_t, Entries> screen_entries_;  // by object index: regions that only the screen needs

  std::map<std::uint64_t, SeenObject> objects_;                     // by object id
  std::map<std::uint64_t, SeenProbe> probes_;                       // by user id
  std::vector<std::uint64_t> refined_users_;                        // users near whose probes the mesh is refined
  std::map<std::uint64_t, std::map<std::string, double>> metrics_;  // by participant: value by figure
  struct Shown {
    session::ShownRegions regions;  // newest
    std::int64_t received_ns = 0;
    session::TimeWindow times;
  };
  std::map<std::pair<std::uint64_t, std::uint64_t>, Shown> shown_;  // by HRTC and object
  struct Loss {
    double share = 0;
    std::int64_t received_ns = 0;
  };
  std::map<std::uint64_t, Loss> losses_;  // by HRTC that reports them
  std::string shown_hrtc_;
  std::deque<Event> events_;
  std::int64_t page_events_began_ns_ = 0;  // begin of the second in which events of pages are counted
  std::uint32_t page_events_ = 0;          // in this second
  std::uint32_t scene_number_ = 1, metrics_number_ = 0;
  StopProgress stop_progress_;
  std::optional<session::EmergencyStop> own_stop_;  // not acknowledged by all
  bool is_own_stop_reset_ = false;                  // a reset has named it
  session::Recipients stop_recipients_;             // of it
  std::int64_t stop_requested_ns_ = 0;
  std::uint32_t own_stops_ = 0, next_number_ = 0;
};

}  // namespace tactus::viewer
