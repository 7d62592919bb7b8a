/// Makes a random model that passes spm::violations, by random vertex splits instead of simplification.
///
/// The surface has no meaningful geometry. Records, closed lists and regions have the same structure as in real models,
/// and some records have several parts. Use random models to test code that encodes, stores, sends or refines models.
/// Do not use them to test the quality of coarse meshes. Equal arguments give equal models.
#pragma once

#include <cstdint>

#include "spm/model.hpp"

namespace tactus::test_support {

/// Returns a model of `records` vertex splits of an octahedron, with regions of cubic cells. `cells`: number of cells
/// along the longest axis of the bounds.
[[nodiscard]] spm::OwnedModel random_model(std::uint64_t seed, std::uint32_t records, std::uint32_t cells);

}  // namespace tactus::test_support
