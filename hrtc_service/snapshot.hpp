/// The shown mesh as a coloured PLY: the paper's figures 5, 9a and 9b.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "hrtc_service/haptic_thread.hpp"
#include "spm/region_grid.hpp"

namespace tactus::hrtc_service {

/// Leaves nothing. Throws std::runtime_error with what was found and what was expected when `directory` neither is nor
/// can be made a directory into which files can be written.
void expect_snapshot_directory(const std::filesystem::path& directory);

/// Colours: red where a tip is (contact regions), yellow where one is expected (predicted regions), green elsewhere at
/// full resolution, grey where coarse, the darker the larger the face. Model frame, file units. Written atomically;
/// throws std::runtime_error naming the file when it cannot be.
void write_snapshot(const std::filesystem::path& file, const std::vector<SnapshotFace>& faces,
                    const spm::RegionGrid& grid, const std::vector<std::uint32_t>& contact_regions,
                    const std::vector<std::uint32_t>& predicted_regions);

}  // namespace tactus::hrtc_service
