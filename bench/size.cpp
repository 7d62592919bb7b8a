// Measures the bytes of a model's parts, and the speed at which its records are encoded and decoded.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <vector>

#include "bench/bench_main.hpp"
#include "bench/figures.hpp"
#include "spm/codec/model_codec.hpp"
#include "spm/codec/region_codec.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "spm/offline/import.hpp"

namespace tactus::bench {
namespace {

using spm::codec::Bytes;
using spm::codec::Field;

constexpr std::uint32_t kBunnyFaces = 70000;
constexpr unsigned kGridBits = 16;

struct Settings {
  std::string model;
  std::uint32_t faces = 1000000;
  std::uint32_t repeats = 5;
  bool quick = false;
};

/// Returns the CPU time of this thread, s.
double cpu_seconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

/// Returns the min CPU time of `repeats` calls of `work`, s.
template <class Work>
double min_seconds(std::uint32_t repeats, Work work) {
  double min = 1e300;
  for (std::uint32_t i = 0; i < repeats; ++i) {
    const double start = cpu_seconds();
    work();
    min = std::min(min, cpu_seconds() - start);
  }
  return min;
}

void measure(Report& report, const std::string& name, const spm::Model& model, const Settings& settings) {
  const double vertices = model.summary.vertices;
  const Population all_vertices{"vertices, " + name, model.summary.vertices};
  const bool compact = model.summary.position_step > 0;
  const double encode =
      min_seconds(std::min(settings.repeats, 2u), [&] { const spm::codec::EncodedModel made{model}; });
  const spm::codec::EncodedModel encoded{model};
  const spm::codec::CompressedModel& compressed = encoded.compressed();

  const auto field_bits = bits_by_field(model, compressed.tables());
  const auto bytes_of = [&](std::initializer_list<Field> fields) {
    double bits = 0;
    for (const Field field : fields) bits += static_cast<double>(field_bits[static_cast<std::size_t>(field)]);
    return bits / 8;
  };
  const auto add_part = [&](const char* part, double bytes) {
    report.add_value(part, all_vertices, "B/vertex", bytes / vertices);
  };
  const spm::codec::ModelSpans& bytes = compressed.spans();
  add_part("positions", bytes_of({Field::kTangentialResidual, Field::kTangentialResidualOfInner, Field::kNormalResidual,
                                  Field::kNormalResidualOfInner}));
  add_part("topology", bytes_of({Field::kShape, Field::kShapeOfInner, Field::kCorner}) +
                           static_cast<double>(field_bits.back()) / 8);
  add_part("ids", bytes_of({Field::kAnchor, Field::kAnchorFirst, Field::kDeformed, Field::kBornFirst,
                            Field::kBornFirstOfInner, Field::kBornNext, Field::kBornNextOfInner}));
  add_part("radii", bytes_of({Field::kRadius}));
  add_part("closed lists of regions", static_cast<double>(bytes.lists.size()));
  add_part("base mesh, cells, tables", static_cast<double>(bytes.base.size() + bytes.regions.size()));
  add_part("sizes, for random access", static_cast<double>(bytes.sizes.size()));

  std::vector<Bytes> messages;
  std::uint64_t records = 0;
  for (std::uint32_t r = 0; r < model.summary.regions; ++r) {
    messages.push_back(*encode_region(compressed, spm::RegionId{r}, model.intervals_of(spm::RegionId{r})));
    records += model.regions[r].record_count;
  }
  const double decode = min_seconds(settings.repeats, [&] {
    for (const Bytes& message : messages) {
      const auto data = decode_region(message, model.summary, compressed.tables());
      if (!data) throw std::runtime_error(data.error().text);
    }
  });
  const Population decoded{"decoded records, " + name, records},
      records_of_model{"records, " + name, model.summary.records};
  report.add_value("decoded records per CPU time", decoded, "records/s", static_cast<double>(records) / decode);
  report.add_value("encoded records per CPU time", records_of_model, "records/s", model.summary.records / encode);

  const double whole_model =
      static_cast<double>(bytes.base.size() + bytes.codes.size() + bytes.lists.size() + bytes.sizes.size()) / vertices;
  report.add_at_most("whole model", all_vertices, "B/vertex", whole_model, compact ? 8 : 16);
  if (settings.quick) return;
  report.add_at_least("decoded records per CPU time", decoded, "records/s", static_cast<double>(records) / decode,
                      10e6);
  report.add_at_least("encoded records per CPU time", records_of_model, "records/s", model.summary.records / encode,
                      2e6);
}

Report run(const Settings& settings) {
  Report report{{settings.model.empty() ? "generated organs" : settings.model, 0, 0,
                 "lossless and compact, grid of " + std::to_string(kGridBits) + " bits; min of " +
                     std::to_string(settings.repeats) + " CPU times of one thread"}};
  const auto measure_profiles = [&](const std::string& name, const spm::offline::TriangleMesh& mesh) {
    for (const unsigned grid_bits : {0u, kGridBits}) {
      spm::offline::BuildOptions options;
      options.grid_bits = grid_bits;
      const spm::offline::BuiltModel built = build_model(mesh, options);
      measure(report, name + (grid_bits > 0 ? ", compact" : ", lossless"), built.model(), settings);
    }
  };
  if (!settings.model.empty()) {
    measure_profiles(std::filesystem::path{settings.model}.filename().string(),
                     spm::offline::import_mesh(settings.model));
  } else {
    for (const std::uint32_t faces : {kBunnyFaces, settings.faces}) {
      measure_profiles("organ " + std::to_string(faces), generate(spm::offline::Shape::kOrgan, faces, 1));
      if (settings.quick) break;
    }
  }
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{"size", "Measures the bytes of a model's parts and the speed of the codec",
                         "the smaller organ alone, without bounds on speed, for CI"};
  app.add_option("--model", settings.model, "mesh file of any kind (default: generated organs)")
      ->check(CLI::ExistingFile);
  app.add_option("--faces", settings.faces, "faces of the larger generated organ")
      ->check(CLI::Range(1000u, 200000000u))
      ->capture_default_str();
  app.add_option("--repeats", settings.repeats, "runs, of which the min time counts")->check(CLI::Range(1u, 100u));
  return tactus::bench::bench_main(app, argc, argv, [&] {
    settings.quick = app.quick;
    if (app.quick) settings.repeats = 1;
    return tactus::bench::run(settings);
  });
}
