/// Writes and reads the file of a flight recorder: all calls to an HRTC's cycle, and the resulting forces.
///
/// The file is an MCAP file with one channel for each struct of FlightMessage. The structs are encoded as CDR.
/// idl/flight.idl describes the members and states units and frames. The file contains this text. Messages are in the
/// order of the calls. The time of a message is that of its cycle, in ns since 1970. A replay of the calls computes the
/// same forces to the bit (hrtc_service/flight_replay.hpp).
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <stdexcept>
#include <string>
#include <variant>
#include <vector>

#include "trace/mcap.hpp"

namespace tactus::trace {

/// Scale, rotation row by row, translation.
using PlacementNumbers = std::array<double, 13>;

struct FlightLimits {
  double max_force = 0, max_stiffness = 0, damping = 0, workspace_radius = 0, max_torque = 0,
         max_rotational_stiffness = 0;
  template <class Self, class Visit>
  static void fields(Self& self, Visit&& visit) {
    visit(self.max_force), visit(self.max_stiffness), visit(self.damping), visit(self.workspace_radius);
    visit(self.max_torque), visit(self.max_rotational_stiffness);
  }
};

struct FlightStart {
  std::string build, participant, reason;
  std::uint64_t first_cycle = 0;
  double period = 0, tip_radius = 0, refine_margin = 0, retain_margin = 0, refine_ahead = 0;
  double max_force = 0, max_slew = 0, soft_start = 0, recovery = 0, max_fresh_age = 0, zero_force_age = 0,
         max_speed = 0;
  double max_torque = 0, max_torque_slew = 0, max_angular_velocity = 0;
  std::vector<FlightLimits> devices;  ///< limits of the devices, by probe
  std::vector<float> tool_vertices;
  std::vector<std::uint32_t> tool_triangles;
  std::uint32_t slots = 0, tree_nodes = 0, list_blocks = 0, targets = 0;
  template <class Self, class Visit>
  static void fields(Self& self, Visit&& visit) {
    visit(self.build), visit(self.participant), visit(self.reason), visit(self.first_cycle);
    visit(self.period), visit(self.tip_radius), visit(self.refine_margin), visit(self.retain_margin);
    visit(self.refine_ahead), visit(self.max_force), visit(self.max_slew), visit(self.soft_start);
    visit(self.recovery), visit(self.max_fresh_age), visit(self.zero_force_age), visit(self.max_speed),
        visit(self.max_torque);
    visit(self.max_torque_slew), visit(self.max_angular_velocity), visit(self.devices), visit(self.tool_vertices),
        visit(self.tool_triangles);
    visit(self.slots), visit(self.tree_nodes), visit(self.list_blocks), visit(self.targets);
  }
};

struct FlightObject {
  std::uint32_t object = 0;
  std::uint64_t id = 0, digest = 0;
  std::string name;
  PlacementNumbers placement{};
  double stiffness = 0, damping = 0, static_friction = 0, dynamic_friction = 0;
  bool movable = false;
  template <class Self, class Visit>
  static void fields(Self& self, Visit&& visit) {
    visit(self.object), visit(self.id), visit(self.digest), visit(self.name), visit(self.placement);
    visit(self.stiffness), visit(self.damping), visit(self.static_friction), visit(self.dynamic_friction);
    visit(self.movable);
  }
};

struct FlightRegion {
  std::uint32_t region = 0, applied = 0;
  bool retiring = false, retained = false;
  template <class Self, class Visit>
  static void fields(Self& self, Visit&& visit) {
    visit(self.region), visit(self.applied), visit(self.retiring), visit(self.retained);
  }
};

struct FlightObjectState {
  std::uint32_t object = 0, base_faces = 0;
  std::uint64_t mesh_hash = 0;
  std::vector<std::uint32_t> loaded_pages, loaded_regions;
  std::vector<FlightRegion> in_use;
  template <class Self, class Visit>
  static void fields(Self& self, Visit&& visit) {
    visit(self.object), visit(self.base_faces), visit(self.mesh_hash), visit(self.loaded_pages),
        visit(self.loaded_regions), visit(self.in_use);
  }
};

/// State of all objects and probes at the end of a cycle, from which a replay can start.
struct FlightState {
  std::uint64_t cycle = 0, lost = 0;
  std::vector<FlightObjectState> objects;
  std::vector<std::uint8_t> carried;
  template <class Self, class Visit>
  static void fields(Self& self, Visit&& visit) {
    visit(self.cycle), visit(self.lost), visit(self.objects), visit(self.carried);
  }
};

// The haptic thread records the structs below, so they are trivially copyable.

struct FlightEvent {
  enum class Kind : std::uint32_t {
    kStopped,
    kReset,
    kObjectArrived,
    kRegionArrived,
    kRegionRetired,
    kRegionDeparted,
    kObjectWithdrawn,
    kObjectDeparted,
    kPageArrived,
    kPageDropped,
    kPageDeparted
  };
  std::uint64_t cycle = 0;
  Kind kind = Kind::kStopped;
  std::uint32_t object = 0, region = 0, fault = 0;
  template <class Self, class Visit>
  static void fields(Self& self, Visit&& visit) {
    visit(self.cycle), visit(self.kind), visit(self.object), visit(self.region), visit(self.fault);
  }
};

struct FlightMove {
  std::uint64_t cycle = 0;
  std::uint32_t object = 0;
  PlacementNumbers placement{};
  template <class Self, class Visit>
  static void fields(Self& self, Visit&& visit) {
    visit(self.cycle), visit(self.object), visit(self.placement);
  }
};

struct FlightProbe {
  std::uint64_t cycle = 0;
  std::int64_t pose_time_ns = 0;
  std::array<double, 3> position{}, velocity{};
  std::array<double, 4> orientation{};
  double transit = 0, round_trip = 0, pose_age = 0;
  std::uint64_t near_found = 0, near_searched = 0;
  std::array<double, 3> near_centre{};
  double near_valid_radius = 0;
  std::array<double, 3> force{}, torque{}, proxy{};
  std::array<double, 4> proxy_orientation{};
  std::uint32_t probe = 0, buttons = 0, pose_sequence = 0, failed = 0;
  std::uint32_t touched_object = 0, status = 0, contacts = 0;
  template <class Self, class Visit>
  static void fields(Self& self, Visit&& visit) {
    visit(self.cycle), visit(self.pose_time_ns), visit(self.position), visit(self.velocity), visit(self.orientation);
    visit(self.transit), visit(self.round_trip), visit(self.pose_age), visit(self.near_found),
        visit(self.near_searched);
    visit(self.near_centre), visit(self.near_valid_radius), visit(self.force), visit(self.torque), visit(self.proxy),
        visit(self.proxy_orientation), visit(self.probe);
    visit(self.buttons), visit(self.pose_sequence), visit(self.failed), visit(self.touched_object);
    visit(self.status), visit(self.contacts);
  }
};

struct FlightTouch {
  std::uint64_t cycle = 0;
  std::int64_t time_ns = 0;
  std::uint32_t float_control = 0;
  template <class Self, class Visit>
  static void fields(Self& self, Visit&& visit) {
    visit(self.cycle), visit(self.time_ns), visit(self.float_control);
  }
};

struct FlightRefine {
  std::uint64_t cycle = 0, mesh_hash = 0;
  std::uint32_t granted = 0, budget_spent = 0, nodes_full = 0, caches_emptied = 0;
  template <class Self, class Visit>
  static void fields(Self& self, Visit&& visit) {
    visit(self.cycle), visit(self.mesh_hash), visit(self.granted), visit(self.budget_spent), visit(self.nodes_full),
        visit(self.caches_emptied);
  }
};

using FlightMessage = std::variant<FlightStart, FlightObject, FlightState, FlightEvent, FlightMove, FlightProbe,
                                   FlightTouch, FlightRefine>;

/// Thrown for a file that is no flight recording, is damaged, or has other types than this program. Comments in the IDL
/// text of the file may differ. The message names file, topic and message, the value found and the value expected.
class FlightError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Writes a flight recording. All functions allocate and may block: not for the haptic thread.
class FlightFileWriter {
 public:
  /// Replaces the file. The constructor, `write` and `close` throw McapError that names the file if it cannot be
  /// written.
  explicit FlightFileWriter(std::filesystem::path file);
  ~FlightFileWriter();

  /// Sets the time of the next messages, ns since 1970.
  void set_time(std::uint64_t since_1970_ns) noexcept;
  void write(const FlightMessage& message);
  void close();
  /// Number of messages written.
  [[nodiscard]] std::uint64_t messages() const noexcept;
  /// Number of bytes written to the file.
  [[nodiscard]] std::uint64_t bytes() const noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

class FlightFileReader {
 public:
  /// Throws McapError that names the file if it cannot be read or is no MCAP file.
  explicit FlightFileReader(const std::filesystem::path& file);
  ~FlightFileReader();

  /// Reads the next message. Returns false at the end of the file. Throws McapError if the MCAP file is damaged, and
  /// FlightError if the message is not of a flight recording.
  [[nodiscard]] bool next(FlightMessage& message);
  /// True if `next` has found the end of a truncated file.
  [[nodiscard]] bool is_truncated() const noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tactus::trace
