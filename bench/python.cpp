// Compares the Python package with the same work in C++: builds, and batches of queries. An interpreter in this process
// runs the package, so both take turns on the same data.
#include <pybind11/embed.h>
#include <pybind11/numpy.h>

#include <cmath>
#include <cstdio>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "bench/bench_main.hpp"
#include "bench/stopwatch.hpp"
#include "spm/codec/compressed_source.hpp"
#include "spm/codec/model_codec.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"

namespace tactus::bench {
namespace {

namespace py = pybind11;
using spm::Vec3d;

constexpr std::uint32_t kBatch = 1000;
constexpr double kRadius = 0.003;  // m
constexpr double kBound = 1.05;

struct Settings {
  std::uint32_t faces = 200'000, builds = 15, rounds = 500;
};

struct Times {
  Samples cpp, python;  // of each round
};

/// Calls both in turns, and changes their order in every round.
template <class Cpp, class Python>
Times take_turns(std::uint32_t rounds, const std::string& unit, Cpp cpp, Python python) {
  const double scale = unit == "s" ? 1e-6 : 1;
  Times times;
  Stopwatch watch;
  const auto run = [&](auto& work, Samples& samples) {
    watch.lap();
    work();
    samples.add(scale * watch.lap());
  };
  for (std::uint32_t i = 0; i < rounds; ++i) {
    if (i % 2 == 0) run(cpp, times.cpp);
    run(python, times.python);
    if (i % 2 == 1) run(cpp, times.cpp);
  }
  return times;
}

void add_rows(Report& report, const std::string& what, const std::string& population, const std::string& unit,
              const Times& times) {
  const Population rounds{population, times.cpp.size()};
  report.add_value(what + ", C++, median", rounds, unit, times.cpp.percentile(0.5));
  report.add_value(what + ", Python, median", rounds, unit, times.python.percentile(0.5));
  report.add_at_most(what + ": median of Python divided by that of C++", rounds, "times",
                     times.python.percentile(0.5) / times.cpp.percentile(0.5), kBound);
}

/// A contact as a script receives it.
struct Row {
  Vec3d point;
  std::uint32_t face;
  bool finest;
};

/// Contacts and nearest points of C++, as a program would store them.
class Queries {
 public:
  Queries(const spm::LocalRefinement& refinement, const std::vector<std::array<double, 3>>& centres)
      : refinement_{refinement}, centres_{centres} {}

  std::size_t find_contacts() {
    std::vector<Row> rows;
    std::vector<std::int64_t> ends{0};
    for (const auto& [x, y, z] : centres_) {
      const std::uint32_t found = refinement_.find_contacts({x, y, z}, kRadius, contacts_.data(), kCapacity);
      if (found > kCapacity) throw std::runtime_error("too many contacts");
      for (std::uint32_t i = 0; i < found; ++i)
        rows.push_back({contacts_[i].point, spm::index(contacts_[i].face), contacts_[i].is_finest()});
      ends.push_back(static_cast<std::int64_t>(rows.size()));
    }
    return rows.size();
  }
  std::size_t find_nearest() {
    std::vector<spm::NearestFace> rows(centres_.size());
    std::size_t found = 0;
    for (std::size_t i = 0; i < rows.size(); ++i)
      found += refinement_.forest().tree().nearest({centres_[i][0], centres_[i][1], centres_[i][2]}, kRadius, rows[i]);
    return found;
  }

 private:
  static constexpr std::uint32_t kCapacity = 1 << 14;
  const spm::LocalRefinement& refinement_;
  const std::vector<std::array<double, 3>>& centres_;
  std::vector<spm::Contact> contacts_ = std::vector<spm::Contact>(kCapacity);
};

Report run(const Settings& settings) {
  const py::scoped_interpreter interpreter;
  py::module_::import("sys").attr("path").attr("insert")(0, TACTUS_PYTHON_DIR);
  const py::module_ tactus = py::module_::import("tactus");
  std::fprintf(stderr, "building\n");
  const auto mesh = spm::offline::generate(spm::offline::Shape::kOrgan, settings.faces);
  const py::object python_mesh = tactus.attr("Mesh").attr("generate")("organ", settings.faces);
  spm::offline::BuiltModel built;
  py::object model;
  const Times builds = take_turns(
      settings.builds, "s", [&] { built = spm::offline::build_model(mesh); },
      [&] { model = tactus.attr("build")(python_mesh); });
  if (model.attr("summary").attr("digest").cast<std::uint64_t>() != built.summary.digest)
    throw std::runtime_error("Python and C++ built different models");

  const spm::codec::EncodedModel encoded{built.model()};
  spm::codec::CompressedSource source{encoded.compressed()};
  spm::LocalRefinement refinement{source, spm::ProbeShape{kRadius}};
  const py::object python_refinement = tactus.attr("LocalRefinement")(model, kRadius);
  const std::array<float, 3>& vertex = built.positions[settings.faces / 4];
  const Vec3d middle{vertex[0], vertex[1], vertex[2]};
  for (int frame = 0; frame < 20; ++frame) {
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    pose.translation() = middle;
    refinement.approach(pose, 1e-3 * frame, true);
    (void)refinement.refine(spm::Budget{1u << 20});
    python_refinement.attr("approach")(py::make_tuple(middle.x(), middle.y(), middle.z()), 1e-3 * frame, true);
    python_refinement.attr("refine")(1u << 20);
  }
  std::mt19937_64 random{1};
  std::uniform_real_distribution<double> offset{-kRadius, kRadius};
  std::vector<std::array<double, 3>> centres(kBatch);
  for (std::array<double, 3>& centre : centres)
    centre = {middle.x() + offset(random), middle.y() + offset(random), middle.z() + offset(random)};
  const py::array_t<double> array{{centres.size(), std::size_t{3}}, centres.front().data()};

  Queries queries{refinement, centres};
  std::size_t cpp_contacts = 0, python_contacts = 0, cpp_nearest = 0;
  const py::object find_contacts = python_refinement.attr("find_contacts");
  const Times contacts = take_turns(
      settings.rounds, "us", [&] { cpp_contacts = queries.find_contacts(); },
      [&] { python_contacts = py::len(py::tuple{find_contacts(array)}[0]); });
  if (cpp_contacts != python_contacts) throw std::runtime_error("Python and C++ found different contacts");
  const py::object find_nearest = python_refinement.attr("nearest");
  const Times nearest = take_turns(
      settings.rounds, "us", [&] { cpp_nearest = queries.find_nearest(); },
      [&] { (void)find_nearest(array, kRadius); });

  Report report{{"organ, " + std::to_string(settings.faces) + " faces, seed 1", built.summary.digest, settings.faces,
                 "batches of " + std::to_string(kBatch) + " spheres of 3 mm, " + std::to_string(cpp_contacts / kBatch) +
                     " contacts each, " + std::to_string(cpp_nearest) + " with a triangle within the radius"}};
  add_rows(report, "build", "builds", "s", builds);
  add_rows(report, "1,000 queries of contacts", "batches", "us", contacts);
  add_rows(report, "1,000 queries of the nearest point", "batches", "us", nearest);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{"python", "Times builds and batches of queries of the Python package, and of C++",
                         "uses fewer rounds"};
  app.add_option("--faces", settings.faces, "faces of the generated organ")->check(CLI::Range(1000u, 10'000'000u));
  return tactus::bench::bench_main(app, argc, argv, [&] {
    if (app.quick) settings.builds = 9, settings.rounds = 200;
    return tactus::bench::run(settings);
  });
}
