/// The model that a benchmark runs on: a file of any kind, or a generated one.
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
  std::shared_ptr<const void> owner;  ///< keeps what `model` borrows
  spm::Model model;
  std::vector<std::array<std::uint32_t, 3>> finest;  ///< by FaceId
};

/// `path` is an `.spm` file, any model file, or empty for a generated organ of `faces` faces. Whatever has no unit of
/// its own becomes 0.1 m long. Throws ModelError.
[[nodiscard]] LoadedModel load_model(const std::string& path, std::uint32_t faces);

/// The dragon's mean edge when it is 10 cm long; finer is below what a hand resolves.
constexpr double kHandEdge = 0.0002;  ///< m
/// Gives the model the size at which the mean edge of its finest mesh is `metres`.
void scale_to_edge(LoadedModel& subject, double metres);
/// Longest side of the bounds, m.
[[nodiscard]] double longest_side(const spm::ModelSummary& summary);

}  // namespace tactus::bench
