/// Computes a certificate before a session: the most regions, records and memory that one probe can ever need of a
/// model.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <optional>
#include <vector>

#include "spm/model.hpp"

namespace tactus::spm::offline {

/// Upper bounds over all positions and straight motions of a sphere. Space is divided into cubes of edge `step`. The
/// regions of a cube are those whose occupied subcells the sphere can intersect while its centre is in the cube. The
/// bounds of work assume that exactly the regions of the current cube are refined. A step is a motion of the centre
/// from one cube into a cube with which it shares a face.
struct Certificate {
  double radius;  ///< radius of the sphere, file units
  double speed;   ///< maximum speed of the sphere, file units/s

  // Maxima over all cubes.
  std::uint32_t regions;  ///< number of regions of a cube
  std::uint32_t records;  ///< number of records in the union of their lists
  std::uint32_t parts;    ///< number of slots that these records take, without the base mesh
  std::uint32_t blocks;   ///< number of list blocks that these regions take
  std::uint32_t nodes;    ///< number of tree nodes above these records and the base mesh; bounds every query
  std::array<double, 3> worst_position;  ///< centre of the cube with the most parts, model frame

  double step;  ///< edge of a cube, file units
  // Maxima over all steps.
  std::uint32_t entering_records;        ///< number of records that the new cube needs and the old one does not
  std::uint32_t work_units;              ///< work of the step, in units of Budget (spm/forest.hpp)
  std::uint32_t faces;                   ///< number of faces that the step adds, removes or deforms
  std::vector<RegionId> regions_before;  ///< refined regions before the step with the most work
  std::vector<RegionId> regions_after;   ///< refined regions after this step
  /// A region message: the region and the records that the HRTC lacks.
  struct RegionMessage {
    RegionId region;
    std::vector<Interval> missing;
  };
  std::vector<RegionMessage> messages;  ///< the messages that a host sends for the step with the most entering records
  /// The maximum number of steps of a straight motion in a second.
  [[nodiscard]] double steps_per_second() const noexcept { return std::sqrt(3.0) * speed / step; }
};

/// Computes the certificate of a sound model. Takes some seconds for 10^5 regions; allocates.
[[nodiscard]] Certificate certify(const Model& model, double radius, double speed);

/// The number of slots that a pool needs for the base mesh and for the regions of any cube; none if it is above
/// kMaxSlots.
[[nodiscard]] std::optional<std::uint32_t> slots_needed(const ModelSummary& summary,
                                                        const Certificate& certificate) noexcept;
/// The minimum memory for models (memory_shares in spm/directory.hpp) of an HRTC that has only this object, in bytes;
/// none if no pool has enough slots.
[[nodiscard]] std::optional<std::uint64_t> memory_needed(const ModelSummary& summary,
                                                         const Certificate& certificate) noexcept;

/// The maximum number of nodes that AbTree::refit recomputes for `faces` changed faces.
[[nodiscard]] std::uint64_t max_marked(std::uint64_t faces, std::uint64_t finest_faces);

struct TreeSize {
  std::uint32_t levels;
  std::uint64_t nodes;  ///< number of inner nodes
};
/// The size of a tree with `leaves` leaves in which each inner node has up to `width` children.
[[nodiscard]] TreeSize tree_size(std::uint64_t leaves, std::uint32_t width);

}  // namespace tactus::spm::offline
