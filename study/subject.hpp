/// The object that the users of a study touch: a model in the forms that host and ground truth need.
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
  std::string name;    ///< of the object, as in scenarios
  std::string source;  ///< file or generator
  std::unique_ptr<const spm::offline::BuiltModel> built;
  spm::Model model;
  std::unique_ptr<const spm::codec::EncodedModel> encoded;
  std::vector<std::array<std::uint32_t, 3>> finest;  ///< by FaceId
};

/// `source`: a model file of any kind but `.spm`, or one of spm::offline::shape_names(), then with `faces` faces.
/// `size`: of its longest side, m. Throws spm::ModelError.
[[nodiscard]] Subject make_subject(const std::string& name, const std::string& source, std::uint32_t faces,
                                   double size);

}  // namespace tactus::study
