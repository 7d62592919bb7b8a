/// Writes the active mesh as a PLY file in which colours show contact and predicted regions, as in the paper's
/// figure 9.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "hrtc_service/loader.hpp"
#include "hrtc_service/servo/servo_link.hpp"
#include "spm/region_grid.hpp"

namespace tactus::hrtc_service {

/// Checks that `directory` is, or can become, a directory with write access. Leaves no file. Throws std::runtime_error
/// with the value found and the value expected.
void expect_snapshot_directory(const std::filesystem::path& directory);

/// Writes faces at full resolution in red (contact regions), yellow (predicted regions) or green (all others). Coarse
/// faces are grey, and the darker the larger they are. Model frame, file units. Writes atomically. Throws
/// std::runtime_error naming the file.
void write_snapshot(const std::filesystem::path& file, const std::vector<SnapshotFace>& faces,
                    const spm::RegionGrid& grid, const std::vector<std::uint32_t>& contact_regions,
                    const std::vector<std::uint32_t>& predicted_regions);

/// Takes up to kMaxSnapshots snapshots, each after two seconds of exact contact; the first after half a second. Service
/// thread.
class SnapshotTaker {
 public:
  static constexpr int kMaxSnapshots = 5;

  /// `name`: name of the HRTC. `loader` and `link` must outlive the object.
  SnapshotTaker(std::filesystem::path directory, std::string name, const Loader& loader, ServoLink& link);

  /// Requests a snapshot when it is due, or writes the requested one when the servo has copied it. `touches_exactly`: a
  /// probe is in exact contact. Throws as `write_snapshot`.
  void tick(std::int64_t now_ns, bool touches_exactly, const std::array<ReportedProbe, kMaxProbes>& probes);

 private:
  [[nodiscard]] bool take_parts();
  void write();

  std::filesystem::path directory_;
  std::string name_;
  const Loader& loader_;
  ServoLink& link_;
  RingReader<SnapshotPart, ServoLink::kSnapshotParts> parts_;
  std::int64_t contact_began_ns_ = 0;
  int snapshots_taken_ = 0;
  bool is_requested_ = false;                                 // the servo is copying a snapshot
  std::array<std::vector<SnapshotFace>, kMaxObjects> faces_;  // that have arrived, by object index
  // Of the objects at the request, by object index.
  std::array<std::uint64_t, kMaxObjects> digests_{};
  std::array<std::vector<std::uint32_t>, kMaxObjects> contacts_, predictions_;
};

}  // namespace tactus::hrtc_service
