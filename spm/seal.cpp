#include "spm/seal.hpp"

#include <array>

namespace tactus::spm {

std::vector<std::uint32_t> record_seals(const Model& model) {
  std::vector<std::array<std::uint32_t, 3>> corners = base_corners(model);
  std::vector<std::uint32_t> seals(model.summary.records);
  for (std::uint32_t r = 0; r < model.summary.records; ++r) {
    VertexRing ring;
    ring.add(model.parts[r].parent);
    apply_record(model, r, corners, [&ring](std::uint32_t v) { ring.add(v); });
    seals[r] = seal_of(model.summary.base_vertices + r, ring, [](std::uint32_t v) { return v; });
  }
  return seals;
}

std::uint32_t region_seal(const Model& model, RegionId region, const std::vector<std::uint32_t>& records) {
  std::uint32_t sum = 0;
  for (const Run& run : model.runs_of(region)) {
    for (std::uint32_t r = run.first; r < run.first + run.count; ++r) sum += records[r];
  }
  return sum;
}

std::vector<std::uint32_t> region_seals(const Model& model) {
  const std::vector<std::uint32_t> records = record_seals(model);
  std::vector<std::uint32_t> seals(model.summary.regions);
  for (std::uint32_t region = 0; region < seals.size(); ++region) {
    seals[region] = region_seal(model, RegionId{region}, records);
  }
  return seals;
}

}  // namespace tactus::spm
