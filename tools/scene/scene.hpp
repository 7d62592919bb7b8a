/// Makes the messages that Foxglove and Lichtblick draw from the samples of a session.
///
///     catalogue, base --> /scene/objects   a GLB of the base mesh of each object, or the box of its bounds
///     object poses    --> /tf              from the frame "world" to the frame of each object
///     probe states    --> /scene/probes    device, proxy, force and name of each user
///     roster, stops, resets, faults, end --> /events
///
/// A player that jumps to a time draws the newest message of each topic before that time. So each message of
/// /scene/objects, /scene/probes and /tf is complete: it has all objects or all probes.
///
/// No DDS, thread, clock or file: samples and times are arguments, messages are results. One thread at a time.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "session/messages.hpp"
#include "session/ownership.hpp"
#include "session/roster.hpp"
#include "session/stop_latch.hpp"
#include "tools/scene/base_meshes.hpp"
#include "trace/foxglove.hpp"

namespace tactus::scene {

/// Time of the arrival of a sample or of a frame, on two clocks.
struct Moment {
  std::int64_t monotonic_ns = 0;
  std::uint64_t since_1970_ns = 0;
};

/// The messages of a frame. A topic without news has no message.
struct Frame {
  std::optional<trace::foxglove::SceneUpdate> objects;
  std::optional<trace::foxglove::SceneUpdate> probes;
  std::optional<trace::foxglove::FrameTransforms> transforms;
  std::vector<trace::foxglove::Log> events;
};

class Scene {
 public:
  static constexpr std::int64_t kFramePeriodNs = 33'333'333;
  /// Min time between two messages with all objects, because these contain their meshes.
  static constexpr std::int64_t kObjectsPeriodNs = 1'000'000'000;
  /// Max time between two messages with all transforms. Players interpolate between two transforms, so a body that
  /// rested for a long time would seem to move slowly before its first motion.
  static constexpr std::int64_t kTransformsPeriodNs = 1'000'000'000;
  /// A probe is not drawn if its newest state is older than this.
  static constexpr std::int64_t kMaxStateAgeNs = 1'000'000'000;
  /// Max bytes of the base meshes that a scene stores, and of those in one message. Objects with others are drawn as
  /// boxes. Readers of recordings accept messages up to 1 GiB.
  static constexpr std::size_t kMaxMeshBytes = 256u << 20;
  /// Length of the arrow of a force, m/N.
  static constexpr double kMetresPerNewton = 0.01;

  /// `self`: the recorder. Samples are those of its session. `max_mesh_bytes`: smaller in tests.
  explicit Scene(const session::Origin& self, std::size_t max_mesh_bytes = kMaxMeshBytes);

  void add(const session::RosterEntry& entry, Moment now);
  void add(const session::CatalogueEntry& entry, Moment now);
  void add(const session::BulkChunk& chunk, Moment now);
  void add(const session::ProbeState& state, Moment now);
  void add(const session::ObjectPose& pose, Moment now);
  void add(const session::EmergencyStop& stop, Moment now);
  void add(const session::ForceReset& reset, Moment now);
  void add(const session::Control& control, Moment now);
  void add(const session::SessionEnd& end, Moment now);

  /// Returns what has changed since the previous frame. Call it every kFramePeriodNs.
  [[nodiscard]] Frame frame(Moment now);

 private:
  using Glb = std::shared_ptr<const std::vector<std::uint8_t>>;
  struct Object {
    session::CatalogueEntry entry;
    std::set<std::uint64_t> hosts;  // that offer the object
    session::Pose pose;             // newest
    session::PoseAdmission admission;
  };
  struct Probe {
    session::ProbeState state;
    std::int64_t received_ns = 0;
  };

  void log(trace::foxglove::LogLevel level, std::string text, const session::Origin& sender, Moment now);
  void process(const session::RosterEvent& event, Moment now);
  void remove_host(std::uint64_t object, std::uint64_t host, Moment now);
  [[nodiscard]] std::string user_name(std::uint64_t user) const;
  [[nodiscard]] trace::foxglove::SceneUpdate objects_message(Moment now);
  [[nodiscard]] trace::foxglove::SceneUpdate probes_message(Moment now);
  [[nodiscard]] trace::foxglove::FrameTransforms transforms_message(Moment now) const;

  session::Roster roster_;
  session::StopLatch stops_;
  BaseMeshes base_meshes_;
  std::map<std::uint64_t, Glb> glbs_;  // by digest of the model
  std::size_t max_mesh_bytes_;
  std::size_t mesh_bytes_ = 0;                                                 // of `glbs_`
  std::map<std::uint64_t, Object> objects_;                                    // by object id
  std::map<std::uint64_t, Probe> probes_;                                      // by user id
  std::map<std::uint64_t, std::pair<std::uint64_t, std::uint32_t>> controls_;  // newest by sender: incarnation, number
  std::set<std::pair<std::uint64_t, std::uint64_t>> ends_;                     // participant, incarnation
  std::set<std::string> drawn_objects_, drawn_probes_;                         // ids of entities
  bool objects_changed_ = false, probes_changed_ = false, poses_changed_ = false;
  std::optional<std::int64_t> objects_written_ns_, transforms_written_ns_;
  std::vector<trace::foxglove::Log> events_;  // since the previous frame
};

}  // namespace tactus::scene
