/// TriangleMesh: the triangles of a file or a generator.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <vector>

namespace tactus::spm::offline {

/// Thrown for an unusable model, file or option. The message names the model, file or option, the value found and the
/// value expected.
class ModelError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};
[[noreturn]] inline void fail(const std::filesystem::path& path, const std::string& what) {
  throw ModelError{path.string() + ": " + what};
}

/// Number of faces from which on the builder refuses a mesh. It sums the dependencies of all records in 32 bits; a
/// record has about five.
inline constexpr std::uint32_t kMaxBuiltFaces = 1u << 28;

using Triangle = std::array<std::uint32_t, 3>;

/// Corners are indices into `positions`, counter-clockwise seen from outside. File units, model frame.
struct TriangleMesh {
  std::vector<std::array<float, 3>> positions;
  std::vector<Triangle> faces;
};

}  // namespace tactus::spm::offline
