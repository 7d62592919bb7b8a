/// Triangles as they come from a file or a generator, before anything is known about them.
#pragma once

#include <array>
#include <cstdint>
#include <stdexcept>
#include <vector>

namespace tactus::spm::offline {

/// A model, file or option that cannot be used: says what, where, what was found and what was expected.
class ModelError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

using Triangle = std::array<std::uint32_t, 3>;

/// Corners are indices into `positions`, counter-clockwise seen from outside. File units, model frame.
struct TriangleMesh {
  std::vector<std::array<float, 3>> positions;
  std::vector<Triangle> faces;
};

}  // namespace tactus::spm::offline
