// Usage: build_files FOLDER. Writes four generated models as .spm files. compilers_test.sh compares the files of two
// compilers.

#include <cstdio>
#include <exception>
#include <filesystem>

#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "spm/offline/model_file.hpp"

namespace {

using namespace tactus::spm::offline;

void write_all(const std::filesystem::path& folder) {
  std::filesystem::create_directories(folder);
  const auto write = [&](const char* name, const TriangleMesh& mesh, const BuildOptions& options) {
    const BuiltModel built = build_model(mesh, options);
    write_model(folder / name, built.model(), {name, built.cleaned});
  };
  BuildOptions options;
  write("organ.spm", generate(Shape::kOrgan, 40000, 7), options);
  options.grid_bits = 16;
  write("compact.spm", generate(Shape::kOrgan, 40000, 7), options);
  options.simplify.block_faces = 2000;
  write("blocks.spm", generate(Shape::kTerrain, 20000, 3), options);
  options.grid_bits = 0;
  options.simplify.base_faces = 4;
  options.pair_distance = 0.05;
  write("pairs.spm", generate(Shape::kTorus, 10000), options);
}

}  // namespace

int main(int argc, char** argv) {
  try {
    if (argc == 2) write_all(argv[1]);
    return argc == 2 ? 0 : 2;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "build_files: %s\n", error.what());
    return 2;
  }
}
