/// Writes the active mesh as a coloured PLY file: contact and predicted regions, as in the paper's figure 9.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "hrtc_service/haptic_thread.hpp"
#include "hrtc_service/loader.hpp"
#include "hrtc_service/servo.hpp"
#include "spm/region_grid.hpp"

namespace tactus::hrtc_service {

/// Checks that `directory` is, or can become, a directory with write access; leaves no file. Throws std::runtime_error
/// with the value found and the value expected.
void expect_snapshot_directory(const std::filesystem::path& directory);

/// Colours: red where a tip is (contact regions), yellow where one is expected (predicted regions), green elsewhere at
/// full resolution, grey where coarse, the darker the larger the face. Model frame, file units. Written atomically;
/// throws std::runtime_error naming the file when it cannot be.
void write_snapshot(const std::filesystem::path& file, const std::vector<SnapshotFace>& faces,
                    const spm::RegionGrid& grid, const std::vector<std::uint32_t>& contact_regions,
                    const std::vector<std::uint32_t>& predicted_regions);

/// Takes a few snapshots, two seconds apart, while a tip touches at full resolution. Service thread.
class SnapshotTaker {
 public:
  static constexpr int kMax = 5;

  /// For the HRTC of this name. `loader` must outlive it.
  SnapshotTaker(std::filesystem::path directory, std::string name, const Loader& loader);

  /// Takes the newest reports. Some calls write a snapshot, which takes milliseconds. Throws as write_snapshot.
  void tick(std::int64_t now_ns, bool touches_exactly, const std::array<ProbeSight, kMaxProbes>& sights,
            const Servo& servo, HapticOrders& orders);

 private:
  void write(const Servo& servo, std::uint32_t number) const;

  std::filesystem::path directory_;
  std::string name_;
  const Loader& loader_;
  std::int64_t contact_since_ns_ = 0;
  int taken_ = 0;
  bool requested_ = false;                            // one is being copied
  std::array<std::uint64_t, kMaxObjects> digests_{};  // of what was there when it was requested, by object index
  std::array<std::vector<std::uint32_t>, kMaxObjects> contacts_, predictions_;
};

}  // namespace tactus::hrtc_service
