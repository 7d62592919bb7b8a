/// An object that the users of a study touch, in the forms that the host and the ground truth need.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "spm/codec/model_codec.hpp"
#include "spm/offline/build.hpp"

namespace tactus::study {

struct Subject {
  std::string name;    ///< name of the object in scenarios
  std::string source;  ///< name of the file, or of the generated shape with its number of faces
  std::unique_ptr<const spm::offline::BuiltModel> built;
  spm::Model model;
  std::unique_ptr<const spm::codec::EncodedModel> encoded;
  std::vector<std::array<std::uint32_t, 3>> finest;  ///< faces of the finest mesh, by FaceId
};

/// Builds the model. `source` is a mesh file, or one of spm::offline::shape_names(), which is generated with `faces`
/// faces. `size` is the longest side, m. Throws spm::ModelError.
[[nodiscard]] Subject make_subject(const std::string& name, const std::string& source, std::uint32_t faces,
                                   double size);
/// Builds the model of `mesh`, with at most `threads` threads (0: one per processor). Throws spm::ModelError.
[[nodiscard]] Subject make_subject(const std::string& name, const std::string& source, spm::offline::TriangleMesh mesh,
                                   double size, unsigned threads);

}  // namespace tactus::study
