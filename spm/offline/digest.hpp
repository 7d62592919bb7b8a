/// The digest of a model, which identifies it in a session.
#pragma once

#include <cstdint>

#include "spm/model.hpp"

namespace tactus::spm::offline {

/// XXH3-64 over the summary (with digest 0) and all arrays. O(model).
[[nodiscard]] std::uint64_t digest_of(const Model& model);

}  // namespace tactus::spm::offline
