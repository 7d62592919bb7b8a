// Shows local refinement without a session: a sphere slides over a model, and every millisecond the program refines the
// mesh near the sphere within a budget. The refinement has 16 MiB of memory.
//   local_refinement [MODEL]      MODEL: a .ply, .stl, .obj or .spm file; default: an organ of 200,000 faces
#include "spm/local_refinement.hpp"

#include <cmath>
#include <cstdio>
#include <exception>
#include <optional>
#include <vector>

#include "spm/codec/compressed_source.hpp"
#include "spm/codec/model_codec.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "spm/offline/model_file.hpp"

using namespace tactus::spm;

namespace {

/// A compressed model: an .spm file (made by `tactus mesh build`), or a model that this program builds, which takes
/// some 10 us per face.
struct Source {
  std::optional<offline::MappedModel> file;
  std::optional<codec::EncodedModel> built;

  explicit Source(const char* path) {
    if (path == nullptr)
      built.emplace(offline::build_model(offline::generate(offline::Shape::kOrgan, 200'000)).model());
    else if (offline::is_model_file(path))
      file.emplace(path);
    else
      built.emplace(offline::build_model_file(path).model());
  }
  [[nodiscard]] const codec::CompressedModel& model() const { return file ? file->compressed() : built->compressed(); }
};

int run(const char* path) {
  const Source source{path};
  const ModelSummary& summary = source.model().summary();
  const Vec3d low{summary.bounds_min[0], summary.bounds_min[1], summary.bounds_min[2]};
  const Vec3d high{summary.bounds_max[0], summary.bounds_max[1], summary.bounds_max[2]};
  const Vec3d middle = (low + high) / 2;
  const double size = (high - low).maxCoeff(), radius = 0.03 * size;
  codec::CompressedSource regions{source.model()};
  LocalRefinementSettings settings;
  settings.memory = 16u << 20;
  settings.margins = {radius / 6, radius * 2 / 3};
  LocalRefinement refinement{regions, ProbeShape{radius}, settings};

  constexpr int kCycles = 2000;  // of 1 ms each
  constexpr std::uint32_t kContacts = 1u << 14;
  std::vector<Contact> contacts(kContacts);
  int touching = 0, exact = 0;
  double distance = 0.7 * size;  // from the middle of the model to the sphere; decreases until the sphere touches it
  for (int cycle = 0; cycle < kCycles; ++cycle) {
    const double angle = 1e-3 * cycle;
    const Vec3d out{std::cos(angle), std::sin(angle) * std::cos(angle / 3), std::sin(angle) * std::sin(angle / 3)};
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    pose.translation() = middle + distance * out;

    refinement.approach(pose, 1e-3 * cycle, touching > 0);
    (void)refinement.refine(Budget{4000});
    const std::uint32_t found = refinement.find_contacts(pose.translation(), radius, contacts.data(),
                                                         static_cast<std::uint32_t>(contacts.size()));
    distance += (found > 0 ? 1e-4 : -1e-3) * size;
    if (found == 0) continue;
    ++touching;
    exact += refinement.is_exact() ? 1 : 0;
  }
  std::printf("%u faces, %d cycles, %d contact cycles, %d exact contact cycles\n", summary.faces, kCycles, touching,
              exact);
  return touching > 0 && exact > 0.9 * touching ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) try { return run(argc > 1 ? argv[1] : nullptr); } catch (const std::exception& error) {
  std::fprintf(stderr, "local_refinement: %s\n", error.what());
  return 2;
}
