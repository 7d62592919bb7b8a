/// What an HRTC's pool holds of a model, against the model itself.
#pragma once

#include <cstring>
#include <string>
#include <vector>

#include "spm/model.hpp"
#include "spm/pool.hpp"

namespace tactus::test_support {

/// Where the records in the pool differ from the model's, to the bit; empty when every record of the model is there,
/// the same. The pool holds one object, and nothing has been released.
inline std::string loaded_difference(const spm::Model& model, const spm::Pool& pool) {
  using spm::kNone;
  const std::uint32_t base = model.summary.base_vertices;
  spm::IdVector<spm::Slot, bool> continues{pool.parts.size()};
  for (const spm::Slot slot : pool.parts.ids()) {
    if (index(pool.vertices[slot].id) >= base && pool.parts[slot].next != kNone)
      continues[pool.parts[slot].next] = true;
  }
  std::uint32_t found = 0;
  for (const spm::Slot head : pool.parts.ids()) {
    const std::uint32_t u = index(pool.vertices[head].id);
    if (u < base || continues[head]) continue;
    ++found;
    const std::string where = "record " + std::to_string(u - base);
    spm::Slot slot = head;
    for (spm::PartIndex p{u - base}; p != kNone; p = model.parts[p].next) {
      const spm::RecordPart& stated = model.parts[p];
      const spm::LoadedPart& held = pool.parts[slot];
      if (std::memcmp(&pool.vertices[slot].position, &model.positions[u], sizeof model.positions[u]) != 0) {
        return where + ": position";
      }
      if (pool.vertices[slot].id != spm::VertexId{u} || pool.radius[slot] != spm::radius_of(stated.radius))
        return where + ": radius";
      if (pool.vertices[held.parent].id != stated.parent) return where + ": parent";
      if (held.born_count != stated.born_count || held.deformed_count != stated.deformed_count)
        return where + ": counts";
      for (int i = 0; i < held.born_count; ++i) {
        if (held.born[i].bits != stated.born[i].bits) return where + ": born face";
        if (pool.vertices[held.born_x[i]].id != stated.born_x[i]) return where + ": third corner";
      }
      for (int i = 0; i < held.deformed_count; ++i) {
        const spm::LoadedPart::DeformedRef ref = held.deformed[i];
        if (spm::DeformedRef::make(pool.faces[ref.face()].face, ref.corner(), ref.last()).bits !=
            stated.deformed[i].bits) {
          return where + ": deformed face";
        }
      }
      if ((held.next == kNone) != (stated.next == kNone)) return where + ": parts";
      if (held.next != kNone) slot = held.next;
    }
  }
  if (found == model.summary.records) return {};
  return std::to_string(found) + " records of " + std::to_string(model.summary.records);
}

}  // namespace tactus::test_support
