/// Loads or generates the model that a benchmark uses.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "spm/model.hpp"

namespace tactus::bench {

/// A whole model and its finest mesh.
struct LoadedModel {
  std::string name;
  std::shared_ptr<const void> owner;  ///< owns the memory to which `model` refers
  spm::Model model;
  std::vector<std::array<std::uint32_t, 3>> finest;  ///< corners of the faces, by FaceId
};

/// Loads the .spm file `path`, or builds a model of the mesh file `path`. If `path` is empty, generates an organ of
/// `faces` faces. The longest side of a mesh and of the organ becomes 0.1 m. Throws ModelError.
[[nodiscard]] LoadedModel load_model(const std::string& path, std::uint32_t faces);

/// Mean edge of the Stanford dragon when it is 10 cm long. A hand does not resolve finer details.
constexpr double kHandEdge = 0.0002;  ///< m
/// Scales the model so that the mean edge of its finest mesh is `mean_edge` metres long.
void scale_to_edge(LoadedModel& subject, double mean_edge);
/// Returns the longest side of the model's bounds, m.
[[nodiscard]] double model_length(const spm::ModelSummary& summary);

}  // namespace tactus::bench
