#include "spm/checksum.hpp"

#include <array>

namespace tactus::spm {

std::vector<std::uint32_t> record_checksums(const Model& model) {
  ModelCorners corners = base_corners(model);
  std::vector<std::uint32_t> checksums(model.summary.records);
  for (const RecordId r : ids<RecordId>(model.summary.records)) {
    VertexRing<VertexId> ring;
    ring.add(model.first_part(r).parent);
    apply_record(model, r, corners, [&ring](VertexId v) { ring.add(v); });
    checksums[index(r)] = checksum_of(model.vertex_of(r), ring, [](VertexId v) { return v; });
  }
  return checksums;
}

std::uint32_t region_checksum(const Model& model, RegionId region, const std::vector<std::uint32_t>& records) {
  std::uint32_t sum = 0;
  for (const Interval& interval : model.intervals_of(region)) {
    for (std::uint32_t r = interval.first; r < interval.first + interval.count; ++r) sum += records[r];
  }
  return sum;
}

std::vector<std::uint32_t> region_checksums(const Model& model) {
  const std::vector<std::uint32_t> records = record_checksums(model);
  std::vector<std::uint32_t> sums(records.size() + 1, 0);  // of the records below each number
  for (std::size_t r = 0; r < records.size(); ++r) sums[r + 1] = sums[r] + records[r];
  std::vector<std::uint32_t> checksums(model.summary.regions);
  for (std::uint32_t region = 0; region < checksums.size(); ++region)
    for (const Interval& interval : model.intervals_of(RegionId{region}))
      checksums[region] += sums[interval.first + interval.count] - sums[interval.first];
  return checksums;
}

}  // namespace tactus::spm
