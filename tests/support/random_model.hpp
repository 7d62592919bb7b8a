/// A random model that passes spm::violations, made by splitting at random instead of simplifying.
///
/// Its surface makes no geometric sense, but its records, closures and regions have the form of real ones, chains of
/// several parts included. For tests of what carries a model, not of what refines it. Same seed, same model.
#pragma once

#include <cstdint>

#include "spm/model.hpp"

namespace tactus::test_support {

/// `records` splits of an octahedron, cells of an even grid of `cells` per axis over it.
[[nodiscard]] spm::OwnedModel random_model(std::uint64_t seed, std::uint32_t records, std::uint32_t cells);

}  // namespace tactus::test_support
