#include "bench/models.hpp"

#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "spm/offline/import.hpp"
#include "spm/offline/model_file.hpp"

namespace tactus::bench {

namespace {

constexpr double kSize = 0.1;  // m
constexpr std::uint64_t kSeed = 1;

}  // namespace

LoadedModel load_model(const std::string& path, std::uint32_t faces) {
  using namespace spm::offline;
  LoadedModel loaded;
  if (!path.empty() && is_model_file(path)) {
    const auto mapped = std::make_shared<const MappedModel>(path);
    loaded.name = path;
    loaded.model = mapped->model();
    loaded.owner = mapped;
  } else {
    BuildOptions options;
    options.size = kSize;
    const auto built = std::make_shared<const BuiltModel>(
        build_model(path.empty() ? generate(Shape::kOrgan, faces, kSeed) : import_mesh(path), options));
    loaded.name = path.empty() ? "organ, " + std::to_string(faces) + " faces, seed " + std::to_string(kSeed) : path;
    loaded.model = built->model();
    loaded.owner = built;
  }
  loaded.finest = finest_faces(loaded.model);
  return loaded;
}

}  // namespace tactus::bench
