#include "spm/offline/digest.hpp"

#include <xxhash.h>

namespace tactus::spm::offline {
namespace {

/// Calls `use(data, bytes)` for each array of the model, in a fixed order.
template <class Use>
void for_each_array(const Model& model, Use use) {
  const auto bytes_of = [&use](auto span) { use(span.data(), span.size() * sizeof(*span.data())); };
  bytes_of(model.positions);
  bytes_of(model.base_radii);
  bytes_of(model.base_faces);
  bytes_of(model.parts);
  bytes_of(model.regions);
  bytes_of(model.intervals);
}

}  // namespace

std::uint64_t digest_of(const Model& model) {
  XXH3_state_t* state = XXH3_createState();
  XXH3_64bits_reset(state);
  ModelSummary summary = model.summary;
  summary.digest = 0;
  XXH3_64bits_update(state, &summary, sizeof summary);
  for_each_array(model, [&](const void* data, std::size_t size) { XXH3_64bits_update(state, data, size); });
  const std::uint64_t digest = XXH3_64bits_digest(state);
  XXH3_freeState(state);
  return digest;
}

}  // namespace tactus::spm::offline
