// Measures the time of building a model from a mesh in memory, stage by stage. Import or generation of the mesh is
// measured separately. Encoding and writing of the .spm file are not measured.
#include "spm/offline/build.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <optional>
#include <string>
#include <utility>

#include "bench/bench_main.hpp"
#include "bench/figures.hpp"
#include "spm/offline/certificate.hpp"
#include "spm/offline/generate.hpp"
#include "spm/offline/import.hpp"
#include "spm/offline/parallel.hpp"
#include "spm/offline/stage_times.hpp"
#include "spm/triangle.hpp"

namespace tactus::bench {
namespace {

using namespace spm::offline;

constexpr std::uint64_t kSeed = 1;
constexpr double kLength = 0.1;                  // m
constexpr double kTipRadius = 3e-3;              // m
constexpr double kTipSpeed = 0.05;               // m/s
constexpr std::uint32_t kLargeFaces = 20000000;  // min size whose bound is on the time instead of the rate
constexpr std::uint32_t kMinRateFaces = 500000;  // min size with a bound on the rate; the serial stages dominate below

struct Settings {
  std::string model;
  std::uint32_t faces = 1000000;
  std::uint32_t base_faces = spm::offline::SimplifyOptions{}.base_faces;
  double pairs = 0;              // mm, max distance of the vertices of a contracted pair
  std::uint32_t tile_faces = 0;  // 0: no comparison with tiles
  unsigned threads = 2;
  std::uint32_t repeats = 3;
  bool quick = false;
};

/// Distance of the finest mesh from the base mesh.
struct Deviation {
  double rms = 0;            // file units
  std::size_t vertices = 0;  // sampled finest vertices
};

/// Returns the rms distance of 20,000 to 40,000 finest vertices from the base mesh, or of all if there are fewer.
Deviation deviation_from_base(const spm::Model& model) {
  constexpr std::size_t kSamples = 20000;
  const std::size_t step = std::max<std::size_t>(1, model.positions.size() / kSamples);
  const std::size_t count = (model.positions.size() + step - 1) / step;
  const auto point = [&model](spm::VertexId v) {
    const std::array<float, 3>& p = model.positions[index(v)];
    return spm::Vec3d{p[0], p[1], p[2]};
  };
  std::vector<double> squared(count, std::numeric_limits<double>::infinity());
  parallel_for(count, 0, [&](std::size_t i, unsigned) {
    const spm::Vec3d vertex = point(spm::VertexId{static_cast<std::uint32_t>(i * step)});
    for (const spm::BaseFace& face : model.base_faces) {
      const double distance =
          spm::closest_point(vertex, point(face.corners[0]), point(face.corners[1]), point(face.corners[2]))
              .squared_distance;
      squared[i] = std::min(squared[i], distance);
    }
  });
  double sum = 0;
  for (const double d : squared) sum += d;
  return {std::sqrt(sum / static_cast<double>(count)), count};
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

/// Lengths of closed lists, on which loading time depends.
struct Lists {
  Samples records, intervals;  // one sample a region
};
Lists lists_of(const spm::Model& model) {
  Lists lists;
  for (const spm::Region& region : model.regions) {
    lists.records.add(region.record_count);
    lists.intervals.add(region.interval_count);
  }
  return lists;
}

void report_lists(Report& report, const spm::Model& model) {
  const Lists lists = lists_of(model);
  const Population regions{"regions", model.summary.regions};
  report.add_value("records of a closed list, mean", regions, "", lists.records.mean());
  report.add_value("records of a closed list, p99", regions, "", lists.records.percentile(0.99));
  report.add_value("intervals of a closed list, mean", regions, "", lists.intervals.mean());
  report.add_value("base faces", {"model", 1}, "", model.summary.base_faces);
}

/// What tiles may cost, because the vertices of several tiles stay until three rounds are over.
struct TileFigures {
  double mean_records = 0, p99_records = 0, slots = 0;
};
TileFigures tile_figures(const spm::Model& model) {
  const double unit = model.summary.metres_per_unit;
  const Lists lists = lists_of(model);
  return {lists.records.mean(), lists.records.percentile(0.99),
          static_cast<double>(certify(model, kTipRadius / unit, kTipSpeed / unit).parts)};
}

/// Adds the figures of the model with tiles, divided by those of the model without.
void report_tiles(Report& report, const TileFigures& without, const TileFigures& with, std::uint32_t tile_faces) {
  const Population models{"two models", 2};
  const std::string divided = ", with tiles of " + std::to_string(tile_faces) + " faces divided by without";
  report.add_value("slots that a tip needs at most", {"model", 1}, "", without.slots);
  report.add_at_most("records of a closed list, mean" + divided, models, "times",
                     with.mean_records / without.mean_records, 1.05);
  report.add_at_most("records of a closed list, p99" + divided, models, "times", with.p99_records / without.p99_records,
                     1.25);
  report.add_at_most("slots that a tip needs at most" + divided, models, "times", with.slots / without.slots, 1.2);
}

Report run(const Settings& settings) {
  StageTimes source_times;
  source_times.begin("import");
  std::fprintf(stderr, "%s\n", settings.model.empty() ? "generating the organ" : "reading the model");
  TriangleMesh mesh =
      settings.model.empty() ? generate(Shape::kOrgan, settings.faces, kSeed) : import_mesh(settings.model);
  source_times.end();
  const bool is_large = mesh.faces.size() >= kLargeFaces;
  const std::string name = settings.model.empty()
                               ? "organ, " + std::to_string(settings.faces) + " faces, seed " + std::to_string(kSeed)
                               : settings.model;
  BuildOptions options;
  options.size = kLength;
  options.threads = settings.threads;
  options.simplify.base_faces = settings.base_faces;
  options.pair_distance = 1e-3 * settings.pairs;

  std::optional<TileFigures> with_tiles;
  if (settings.tile_faces > 0) {
    std::fprintf(stderr, "building with tiles\n");
    BuildOptions tiled = options;
    tiled.simplify.tile_faces = settings.tile_faces;
    with_tiles = tile_figures(build(mesh, tiled).model.model());
  }
  // A large mesh is built once. The last build takes ownership of the mesh and frees it early.
  const std::uint32_t repeats = is_large ? 1 : settings.repeats;
  Built fastest;
  for (std::uint32_t i = 0; i < repeats; ++i) {
    std::fprintf(stderr, "building, %u of %u\n", i + 1, repeats);
    Built built = i + 1 == repeats ? build(std::exchange(mesh, {}), options) : build(mesh, options);
    if (i > 0 && built.model.summary.digest != fastest.model.summary.digest) {
      throw std::runtime_error("two builds of one mesh gave different models");
    }
    if (i == 0 || built.times.sum().seconds < fastest.times.sum().seconds) fastest = std::move(built);
  }
  const double peak = peak_resident_bytes();

  const spm::Model model = fastest.model.model();
  char pairs[64] = "";
  if (settings.pairs > 0) std::snprintf(pairs, sizeof pairs, ", pairs within %g mm", settings.pairs);
  Report report{{name, model.summary.digest, model.summary.faces,
                 std::to_string(settings.threads) + " threads, fastest of " + std::to_string(repeats) +
                     " builds, base of " + std::to_string(settings.base_faces) + " faces" + pairs}};
  report.add_value(settings.model.empty() ? "generate, wall time" : "import, wall time", {"run", 1}, "s",
                   source_times.sum().seconds);
  for (const StageTimes::Stage& stage : fastest.times.stages()) {
    report.add_value(stage.name + ", wall time", {"fastest build", 1}, "s", stage.seconds);
    report.add_value(stage.name + ", CPU time of all threads", {"fastest build", 1}, "s", stage.cpu_seconds);
  }
  const StageTimes::Stage sum = fastest.times.sum();
  const double rate = model.summary.faces / sum.seconds;
  report.add_value("build, wall time", {"fastest build", 1}, "s", sum.seconds);
  report.add_value("build, CPU time of all threads", {"fastest build", 1}, "s", sum.cpu_seconds);
  report.add_value("faces / wall time", {"fastest build", 1}, "1/s", rate);
  report.add_value("faces / CPU time of all threads", {"fastest build", 1}, "1/s",
                   model.summary.faces / sum.cpu_seconds);
  const Population import_and_builds{"import and builds", 1 + std::size_t{repeats}};
  report.add_value("resident memory, max", import_and_builds, "GiB", peak / (1 << 30));
  report_lists(report, model);
  if (with_tiles) report_tiles(report, tile_figures(model), *with_tiles, settings.tile_faces);
  const std::string distance = "rms distance from the base mesh at 10 cm";
  const Deviation deviation = deviation_from_base(model);
  const Population sampled{"sampled finest vertices", deviation.vertices};
  const double rms = 1e3 * model.summary.metres_per_unit * deviation.rms;
  report.add_value(distance, sampled, "mm", rms);

  if (is_large) {
    report.add_at_most("build, wall time", {"build", 1}, "s", sum.seconds, 90);
    report.add_at_most("resident memory, max", import_and_builds, "GiB", peak / (1 << 30), 6);
  } else if (model.summary.faces >= kMinRateFaces) {
    report.add_at_least("faces / wall time", {"fastest build", 1}, "1/s", rate, 1e6);
  }
  if (settings.pairs > 0) {
    report.add_at_most("base faces, with pairs", {"model", 1}, "", model.summary.base_faces, 1000);
    report.add_at_most(distance + ", with pairs", sampled, "mm", rms, 1);
  }
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{"build", "Time of building a model, stage by stage",
                         "one build of 200,000 faces, without a bound on speed, for CI"};
  app.add_option("--model", settings.model, "mesh file of any kind (default: a generated organ)")
      ->check(CLI::ExistingFile);
  app.add_option("--faces", settings.faces, "faces of the generated organ")->check(CLI::Range(1000u, 200000000u));
  app.add_option("--base-faces", settings.base_faces, "faces of the base mesh at which simplification aims");
  app.add_option("--pairs", settings.pairs,
                 "contract vertices within this distance, mm, at a model length of 10 cm; adds bounds on the base mesh")
      ->check(tactus::wire::finite_range(0.0, 100.0));
  app.add_option("--tile-faces", settings.tile_faces,
                 "also build with tiles of this number of faces, a power of two, and compare")
      ->check(CLI::Range(0u, 1u << 27));
  app.add_option("--threads", settings.threads, "number of threads that build")->check(CLI::Range(1u, 256u));
  app.add_option("--repeats", settings.repeats, "builds, of which the fastest counts; 1 from 20 million faces on")
      ->check(CLI::Range(1u, 100u));
  return tactus::bench::bench_main(app, argc, argv, [&] {
    if (app.quick) {
      settings.faces = std::min(settings.faces, 200000u);
      settings.repeats = 1;
      if (settings.tile_faces == 0) settings.tile_faces = 1u << 16;
    }
    return tactus::bench::run(settings);
  });
}
