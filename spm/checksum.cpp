#include "spm/checksum.hpp"

#include <array>

namespace tactus::spm {

std::vector<std::uint32_t> record_checksums(const Model& model) {
  std::vector<std::array<std::uint32_t, 3>> corners = base_corners(model);
  std::vector<std::uint32_t> checksums(model.summary.records);
  for (std::uint32_t r = 0; r < model.summary.records; ++r) {
    VertexRing ring;
    ring.add(model.parts[r].parent);
    apply_record(model, r, corners, [&ring](std::uint32_t v) { ring.add(v); });
    checksums[r] = checksum_of(model.summary.base_vertices + r, ring, [](std::uint32_t v) { return v; });
  }
  return checksums;
}

std::uint32_t region_checksum(const Model& model, RegionId region, const std::vector<std::uint32_t>& records) {
  std::uint32_t sum = 0;
  for (const Interval& run : model.intervals_of(region)) {
    for (std::uint32_t r = run.first; r < run.first + run.count; ++r) sum += records[r];
  }
  return sum;
}

std::vector<std::uint32_t> region_checksums(const Model& model) {
  const std::vector<std::uint32_t> records = record_checksums(model);
  std::vector<std::uint32_t> checksums(model.summary.regions);
  for (std::uint32_t region = 0; region < checksums.size(); ++region) {
    checksums[region] = region_checksum(model, RegionId{region}, records);
  }
  return checksums;
}

}  // namespace tactus::spm
