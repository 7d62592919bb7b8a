// How fast a model is built: simplification, closure and encoding, stage by stage, import or generation apart.
#include "spm/offline/build.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <string>

#include "bench/bench_main.hpp"
#include "bench/figures.hpp"
#include "spm/offline/generate.hpp"
#include "spm/offline/import.hpp"
#include "spm/offline/parallel.hpp"
#include "spm/offline/stage_times.hpp"
#include "spm/triangle.hpp"

namespace tactus::bench {
namespace {

using namespace spm::offline;

constexpr std::uint64_t kSeed = 1;
constexpr double kSize = 0.1;                    // m
constexpr std::uint32_t kLargeFaces = 20000000;  // from here on the bound is on the whole, not on the rate
constexpr std::uint32_t kSmallFaces = 500000;    // below, what does not run on all cores weighs too much for a rate

struct Settings {
  std::string model;
  std::uint32_t faces = 1000000;
  std::uint32_t base_faces = spm::offline::SimplifyOptions{}.base_faces;
  double pairs = 0;  // mm
  unsigned threads = 2;
  std::uint32_t repeats = 3;
  bool quick = false;
};

/// Root mean square distance of the finest vertices from the base mesh, in file units; of every so many vertices.
double rms_from_base(const spm::Model& model) {
  constexpr std::size_t kSamples = 20000;
  const std::size_t step = std::max<std::size_t>(1, model.positions.size() / kSamples);
  const std::size_t count = (model.positions.size() + step - 1) / step;
  const auto point = [&model](spm::VertexId v) {
    const std::array<float, 3>& p = model.positions[index(v)];
    return spm::Vec3d{p[0], p[1], p[2]};
  };
  std::vector<double> squared(count, std::numeric_limits<double>::infinity());
  parallel_for(count, 0, [&](std::size_t i, unsigned) {
    const spm::Vec3d at = point(spm::VertexId{static_cast<std::uint32_t>(i * step)});
    for (const spm::BaseFace& face : model.base_faces) {
      const double distance =
          spm::closest_point(at, point(face.corners[0]), point(face.corners[1]), point(face.corners[2]))
              .squared_distance;
      squared[i] = std::min(squared[i], distance);
    }
  });
  double sum = 0;
  for (const double d : squared) sum += d;
  return std::sqrt(sum / static_cast<double>(count));
}

struct Built {
  BuiltModel model;
  StageTimes times;
};

Built build(TriangleMesh mesh, const BuildOptions& options) {
  Built built;
  built.model =
      build_model(std::move(mesh), options, [&](std::string_view stage, double) { built.times.begin(stage); });
  built.times.end();
  return built;
}

/// Records and runs of a region's list, on average: what the run time pays.
void report_lists(Report& report, const spm::Model& model) {
  double records = 0, runs = 0;
  for (const spm::Region& region : model.regions) {
    records += region.record_count;
    runs += region.interval_count;
  }
  report.figure("records of a list, mean", "regions", "", records / model.summary.regions);
  report.figure("runs of a list, mean", "regions", "", runs / model.summary.regions);
  report.figure("base faces", "model", "", model.summary.base_faces);
}

Report run(const Settings& settings) {
  StageTimes before;
  before.begin("import");
  std::fprintf(stderr, "%s\n", settings.model.empty() ? "generating the organ" : "reading the model");
  TriangleMesh mesh =
      settings.model.empty() ? generate(Shape::kOrgan, settings.faces, kSeed) : import_mesh(settings.model);
  before.end();
  const bool large = mesh.faces.size() >= kLargeFaces;
  const std::string name = settings.model.empty()
                               ? "organ, " + std::to_string(settings.faces) + " faces, seed " + std::to_string(kSeed)
                               : settings.model;
  BuildOptions options;
  options.size = kSize;
  options.threads = settings.threads;
  options.simplify.base_faces = settings.base_faces;
  options.pair_distance = 1e-3 * settings.pairs;

  // What is large enough is not repeated, and its mesh is given away to be freed early.
  const std::uint32_t repeats = large ? 1 : settings.repeats;
  Built best;
  for (std::uint32_t i = 0; i < repeats; ++i) {
    std::fprintf(stderr, "building, %u of %u\n", i + 1, repeats);
    Built built = i + 1 == repeats ? build(std::move(mesh), options) : build(mesh, options);
    if (i > 0 && built.model.summary.digest != best.model.summary.digest) {
      throw std::runtime_error("the same mesh gave two models");
    }
    if (i == 0 || built.times.sum().seconds < best.times.sum().seconds) best = std::move(built);
  }
  const double peak = peak_resident_bytes();

  const spm::Model model = best.model.model();
  char pairs[64] = "";
  if (settings.pairs > 0) std::snprintf(pairs, sizeof pairs, ", pairs within %g mm", settings.pairs);
  Report report{{name, model.summary.digest, model.summary.faces,
                 std::to_string(settings.threads) + " threads, best of " + std::to_string(repeats) + ", base of " +
                     std::to_string(settings.base_faces) + " faces" + pairs}};
  report.figure(settings.model.empty() ? "generate" : "import", "once", "s", before.sum().seconds);
  for (const StageTimes::Stage& stage : best.times.stages()) {
    report.figure(stage.name, "wall", "s", stage.seconds);
    report.figure(stage.name, "all threads", "s", stage.cpu_seconds);
  }
  const StageTimes::Stage sum = best.times.sum();
  const double rate = model.summary.faces / sum.seconds;
  report.figure("build", "wall", "s", sum.seconds);
  report.figure("build", "all threads", "s", sum.cpu_seconds);
  report.figure("faces a second", "wall", "", rate);
  report.figure("faces a second", "a core busy throughout", "", model.summary.faces / sum.cpu_seconds);
  report.figure("most memory resident", "import and build", "GiB", peak / (1 << 30));
  report_lists(report, model);
  const double rms = 1e3 * model.summary.metres_per_unit * rms_from_base(model);
  report.figure("finest vertices from the base mesh, rms", "10 cm", "mm", rms);

  if (large) {
    report.at_most("build", "wall", "s", sum.seconds, 90);
    report.at_most("most memory resident", "import and build", "GiB", peak / (1 << 30), 6);
  } else if (model.summary.faces >= kSmallFaces) {
    report.at_least("faces a second", "wall", "", rate, 1e6);
  }
  if (settings.pairs > 0) {
    report.at_most("base faces", "with pairs", "", model.summary.base_faces, 1000);
    report.at_most("finest vertices from the base mesh, rms", "10 cm, with pairs", "mm", rms, 1);
  }
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{"build", "How fast a model is built, stage by stage",
                         "one build of 200,000 faces, without a bound on speed, for CI"};
  app.add_option("--model", settings.model, "mesh file of any kind (default: a generated organ)")
      ->check(CLI::ExistingFile);
  app.add_option("--faces", settings.faces, "faces of the generated organ")->check(CLI::Range(1000u, 200000000u));
  app.add_option("--base-faces", settings.base_faces, "that simplification aims at");
  app.add_option("--pairs", settings.pairs,
                 "mm at a size of 10 cm: contract vertices nearer than this; bounds the base mesh")
      ->check(CLI::Range(0.0, 100.0));
  app.add_option("--threads", settings.threads, "that build")->check(CLI::Range(1u, 256u));
  app.add_option("--repeats", settings.repeats, "of which the best counts; once from 20 million faces on")
      ->check(CLI::Range(1u, 100u));
  return tactus::bench::bench_main(app, argc, argv, [&] {
    if (app.quick) {
      settings.faces = std::min(settings.faces, 200000u);
      settings.repeats = 1;
    }
    return tactus::bench::run(settings);
  });
}
