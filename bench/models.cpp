#include "bench/models.hpp"

#include <algorithm>
#include <cmath>

#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "spm/offline/import.hpp"
#include "spm/offline/model_file.hpp"

namespace tactus::bench {

namespace {

constexpr double kLength = 0.1;  // m
constexpr std::uint64_t kSeed = 1;

}  // namespace

LoadedModel load_model(const std::string& path, std::uint32_t faces) {
  using namespace spm::offline;
  LoadedModel loaded;
  if (!path.empty() && is_model_file(path)) {
    const auto decoded = std::make_shared<const spm::OwnedModel>(MappedModel{path}.decode());
    loaded.name = path;
    loaded.model = decoded->model();
    loaded.owner = decoded;
  } else {
    BuildOptions options;
    options.size = kLength;
    const auto built = std::make_shared<const BuiltModel>(
        build_model(path.empty() ? generate(Shape::kOrgan, faces, kSeed) : import_mesh(path), options));
    loaded.name = path.empty() ? "organ, " + std::to_string(faces) + " faces, seed " + std::to_string(kSeed) : path;
    loaded.model = built->model();
    loaded.owner = built;
  }
  loaded.finest = finest_faces(loaded.model);
  return loaded;
}

void scale_to_edge(LoadedModel& subject, double mean_edge) {
  double sum = 0;  // of the edges, in file units
  for (const std::array<std::uint32_t, 3>& face : subject.finest)
    for (std::size_t corner = 0; corner < 3; ++corner) {
      const auto& a = subject.model.positions[face[corner]];
      const auto& b = subject.model.positions[face[(corner + 1) % 3]];
      sum += std::hypot(double{a[0]} - b[0], double{a[1]} - b[1], double{a[2]} - b[2]);
    }
  subject.model.summary.metres_per_unit = mean_edge * 3 * static_cast<double>(subject.finest.size()) / sum;
}

double model_length(const spm::ModelSummary& summary) { return spm::longest_side(summary) * summary.metres_per_unit; }

}  // namespace tactus::bench
