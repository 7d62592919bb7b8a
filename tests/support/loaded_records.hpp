/// Compares the records in an HRTC's pool with the records of the model.
#pragma once

#include <cstring>
#include <string>
#include <vector>

#include "spm/model.hpp"
#include "spm/pool.hpp"

namespace tactus::test_support {

/// Returns an empty string if the pool contains every record of the model, bit for bit. Otherwise describes the first
/// record that differs, or the number of loaded records if some are missing. Requires a pool with one object, from
/// which no record has been released.
inline std::string loaded_difference(const spm::Model& model, const spm::Pool& pool) {
  using spm::kNone;
  const std::uint32_t base = model.summary.base_vertices;
  spm::IdVector<spm::Slot, bool> is_later_part{pool.parts.size()};
  for (const spm::Slot slot : pool.parts.ids()) {
    if (index(pool.vertices[slot].id) >= base && pool.parts[slot].next != kNone)
      is_later_part[pool.parts[slot].next] = true;
  }
  std::uint32_t loaded_count = 0;
  for (const spm::Slot head : pool.parts.ids()) {
    const std::uint32_t vertex = index(pool.vertices[head].id);
    if (vertex < base || is_later_part[head]) continue;
    ++loaded_count;
    const std::string record_name = "record " + std::to_string(vertex - base);
    spm::Slot slot = head;
    for (spm::PartIndex part{vertex - base}; part != kNone; part = model.parts[part].next) {
      const spm::RecordPart& expected = model.parts[part];
      const spm::LoadedPart& loaded = pool.parts[slot];
      if (std::memcmp(&pool.vertices[slot].position, &model.positions[vertex], sizeof model.positions[vertex]) != 0) {
        return record_name + ": position";
      }
      if (pool.vertices[slot].id != spm::VertexId{vertex} || loaded.radius != expected.radius)
        return record_name + ": radius";
      if (pool.vertices[loaded.parent].id != expected.parent) return record_name + ": parent";
      if (loaded.born_count != expected.born_count || loaded.deformed_count != expected.deformed_count)
        return record_name + ": counts";
      for (int i = 0; i < loaded.born_count; ++i) {
        if (loaded.born[i].bits != expected.born[i].bits) return record_name + ": born face";
        if (pool.vertices[loaded.born_x[i]].id != expected.born_x[i]) return record_name + ": third corner";
      }
      for (std::uint32_t i = 0; i < loaded.deformed_count; ++i) {
        const spm::LoadedPart::DeformedRef ref = loaded.deformed(i);
        if (spm::DeformedRef::make(pool.face_of(ref.face()), ref.corner(), ref.is_finest()) != expected.deformed(i))
          return record_name + ": deformed face";
      }
      if ((loaded.next == kNone) != (expected.next == kNone)) return record_name + ": parts";
      if (loaded.next != kNone) slot = loaded.next;
    }
  }
  if (loaded_count == model.summary.records) return {};
  return "found " + std::to_string(loaded_count) + " records, expected " + std::to_string(model.summary.records);
}

}  // namespace tactus::test_support
