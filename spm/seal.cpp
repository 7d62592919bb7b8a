#include "spm/seal.hpp"

#include <array>

namespace tactus::spm {

std::vector<std::uint32_t> record_seals(const Model& model) {
  std::vector<std::array<std::uint32_t, 3>> corners(model.summary.faces);
  for (const BaseFace& face : model.base_faces) corners[face.face] = face.corners;
  std::vector<std::uint32_t> seals(model.summary.records);
  for (std::uint32_t r = 0; r < model.summary.records; ++r) {
    const std::uint32_t u = model.summary.base_vertices + r;
    VertexRing ring;
    ring.add(model.parts[r].parent);
    for (std::uint32_t p = r; p != kNone; p = model.parts[p].next) {
      const RecordPart& part = model.parts[p];
      for (int i = 0; i < part.deformed_count; ++i) {
        const std::uint32_t corner = part.deformed[i].corner();
        std::array<std::uint32_t, 3>& face = corners[part.deformed[i].face()];
        ring.add(face[(corner + 1) % 3]);
        ring.add(face[(corner + 2) % 3]);
        face[corner] = u;
      }
      for (int i = 0; i < part.born_count; ++i) {
        const BornCorners at = born_corners(part.born[i].order());
        std::array<std::uint32_t, 3>& face = corners[part.born[i].face()];
        face[static_cast<std::size_t>(at.u)] = u;
        face[static_cast<std::size_t>(at.t)] = part.parent;
        face[static_cast<std::size_t>(at.x)] = part.born_x[i];
        ring.add(part.born_x[i]);
      }
    }
    seals[r] = seal_of(u, ring, [](std::uint32_t v) { return v; });
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
