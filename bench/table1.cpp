// Compares the models and base meshes of the paper's Table 1 with those that this project builds.
//
// The paper's models are a sphere of 4,096 faces, the cow, and a Stanford bunny of 37,576 faces. Without --cow and
// --bunny, generated organs of the same sizes replace the cow and the bunny.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "bench/bench_main.hpp"
#include "bench/figures.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/certificate.hpp"
#include "spm/offline/generate.hpp"
#include "spm/offline/import.hpp"

namespace tactus::bench {
namespace {

using spm::offline::TriangleMesh;

struct Settings {
  std::string cow, bunny;
  bool quick = false;
};

/// Values of the paper's table.
struct PaperRow {
  const char* name;
  std::uint32_t vertices, faces, base_vertices, base_faces;
};
constexpr PaperRow kSphere{"sphere", 2050, 4096, 27, 50};
constexpr PaperRow kCow{"cow", 2904, 5804, 355, 706};
constexpr PaperRow kBunny{"bunny", 20000, 37576, 1406, 500};
constexpr std::uint32_t kCowHeight = 12;

/// Topology of a mesh, computed from its faces.
struct Topology {
  std::uint32_t vertices = 0;      // used by a face
  std::uint32_t border_edges = 0;  // edges with one face
  std::int64_t euler = 0;          // Euler characteristic: vertices - edges + faces
};

Topology topology(const std::vector<std::array<std::uint32_t, 3>>& faces) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> edges;
  std::vector<std::uint32_t> used;
  for (const auto& f : faces)
    for (std::size_t i = 0; i < 3; ++i) {
      ++edges[std::minmax(f[i], f[(i + 1) % 3])];
      used.push_back(f[i]);
    }
  std::sort(used.begin(), used.end());
  Topology t;
  t.vertices = static_cast<std::uint32_t>(std::unique(used.begin(), used.end()) - used.begin());
  for (const auto& edge : edges) t.border_edges += edge.second == 1 ? 1 : 0;
  t.euler =
      std::int64_t{t.vertices} - static_cast<std::int64_t>(edges.size()) + static_cast<std::int64_t>(faces.size());
  return t;
}

/// Returns the number of vertices in a file. The importer splits the vertices of an .obj file by face and drops unused
/// ones. Therefore this function counts them in the file.
std::uint32_t vertices_in(const std::string& file, const TriangleMesh& imported) {
  const bool obj = file.size() > 4 && file.compare(file.size() - 4, 4, ".obj") == 0;
  if (!obj) return static_cast<std::uint32_t>(imported.positions.size());
  std::ifstream in{file};
  std::uint32_t count = 0;
  for (std::string line; std::getline(in, line);) count += line.rfind("v ", 0) == 0 ? 1 : 0;
  return count;
}

std::uint32_t binary_tree_height(std::uint32_t leaves) {
  std::uint32_t height = 0;
  while ((std::uint64_t{1} << height) < leaves) ++height;
  return height;
}

/// One model of the table, with the results of this project.
struct ModelRow {
  PaperRow paper;
  std::string source;
  std::uint32_t file_vertices = 0;
  spm::ModelSummary summary{};
  Topology finest, base;
};

ModelRow build(const PaperRow& paper, TriangleMesh mesh, const std::string& file) {
  const std::string source = file.empty() ? "generated" : file;
  ModelRow row{paper, source, vertices_in(file, mesh), {}, {}, {}};
  spm::offline::BuildOptions options;
  options.size = 0.1;
  options.simplify.base_faces = paper.base_faces;
  const spm::offline::BuiltModel built = spm::offline::build_model(std::move(mesh), options);
  row.summary = built.summary;
  const spm::Model model = built.model();
  row.finest = topology(spm::finest_faces(model));
  row.base = topology(spm::base_triangles(model));
  return row;
}

void add_rows(Report& report, const ModelRow& row) {
  const Population paper{std::string{row.paper.name} + ", paper", 1},
      built{std::string{row.paper.name} + ", built here", 1};
  const spm::ModelSummary& s = row.summary;
  const auto add_both = [&](const char* name, std::uint32_t paper_value, std::uint32_t built_value) {
    report.add_value(name, paper, "", paper_value);
    report.add_value(name, built, "", built_value);
  };
  add_both("vertices in the file", row.paper.vertices, row.file_vertices);
  report.add_value("vertices used by a face", built, "", s.vertices);
  add_both("faces", row.paper.faces, s.faces);
  add_both("base vertices", row.paper.base_vertices, s.base_vertices);
  add_both("base faces", row.paper.base_faces, s.base_faces);
  add_both("vertex splits", row.paper.vertices - row.paper.base_vertices, s.records);
  report.add_value("height of a tree with 8 children a node", built, "", spm::offline::tree_size(s.faces, 8).levels);
  report.add_value("height of a binary tree", built, "", binary_tree_height(s.faces));
  report.add_at_most(std::string{row.paper.name} + ": vertices - base vertices - vertex splits", built, "",
                     std::abs(double(s.vertices) - s.base_vertices - s.records), 0);
}

/// Explains why the base mesh of the paper's bunny has 1,406 vertices for 500 faces. V = F / 2 + B / 2 + X, with B
/// border edges and Euler characteristic X, holds for every surface whose edges have one face or two.
void explain_bunny(Report& report, const ModelRow& row) {
  const std::uint32_t unused = row.file_vertices - row.summary.vertices;
  const auto border_edges_of = [&](double vertices, double faces) {
    return 2 * (vertices - faces / 2 - static_cast<double>(row.finest.euler));
  };
  const double base_used = double(kBunny.base_vertices) - unused, used = double(kBunny.vertices) - unused;
  char text[512];
  std::snprintf(
      text, sizeof text,
      "The bunny's 1,406 base vertices: a base mesh of 500 faces needs about 250. This file has %u vertices that no "
      "face uses. Without them, the paper's\nbunny has %.0f vertices for its 37,576 faces and thus a border of "
      "%.0f edges (this file: %u). Its base mesh has %.0f vertices and thus\na border of %.0f edges (here: %u). "
      "The paper therefore counted the unused vertices. This project drops them on import.",
      unused, used, border_edges_of(used, kBunny.faces), row.finest.border_edges, base_used,
      border_edges_of(base_used, kBunny.base_faces), row.base.border_edges);
  report.add_note(text);
  report.add_value("base vertices plus unused vertices", {"bunny, built here", 1}, "",
                   row.summary.base_vertices + unused);
  report.add_at_most(
      "bunny: base vertices plus unused vertices, difference from the paper's 1,406", {"bunny, built here", 1}, "%",
      100 * std::abs(double(row.summary.base_vertices) + unused - kBunny.base_vertices) / kBunny.base_vertices, 5);
}

void explain_cow(Report& report, const ModelRow& row) {
  const std::uint32_t pairs = (row.summary.faces + 1) / 2;
  char text[320];
  std::snprintf(
      text, sizeof text,
      "The cow's tree height of %u: %u faces with one face a leaf need a binary tree of height %u (2^12 = 4,096 leaves "
      "are too few). With two\nfaces a leaf, there are %u leaves, and height %u is enough. This project: 8 children a "
      "node, one face a leaf, height %u.",
      kCowHeight, row.summary.faces, binary_tree_height(row.summary.faces), pairs, binary_tree_height(pairs),
      spm::offline::tree_size(row.summary.faces, 8).levels);
  report.add_note(text);
  report.add_at_most("cow: height of a binary tree with two faces a leaf, difference from the paper's 12",
                     {"cow, built here", 1}, "", std::abs(double(binary_tree_height(pairs)) - kCowHeight), 0);
}

Report run(const Settings& settings) {
  using namespace spm::offline;
  const auto model = [](const PaperRow& paper, const std::string& file) {
    return build(paper, file.empty() ? generate(Shape::kOrgan, paper.faces, 1) : import_mesh(file), file);
  };
  const ModelRow sphere = build(kSphere, generate(Shape::kSphere, kSphere.faces), "");
  const ModelRow cow = model(kCow, settings.cow);
  const ModelRow bunny = model(kBunny, settings.bunny);
  Report report{{"sphere: " + sphere.source + "; cow: " + cow.source + "; bunny: " + bunny.source, bunny.summary.digest,
                 bunny.summary.faces, "base meshes of the paper's size"}};
  for (const ModelRow* row : {&sphere, &cow, &bunny}) add_rows(report, *row);
  report.add_at_most("sphere: base vertices", {"sphere, built here", 1}, "", sphere.summary.base_vertices,
                     kSphere.base_vertices);
  explain_cow(report, cow);
  if (!settings.bunny.empty()) explain_bunny(report, bunny);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{"table1", "Compares the models of the paper's Table 1 with those that this project builds",
                         "changes nothing"};
  app.add_option("--cow", settings.cow, "file of the cow (default: a generated organ of the same size)")
      ->check(CLI::ExistingFile);
  app.add_option("--bunny", settings.bunny, "file of a Stanford bunny (default: a generated organ of the same size)")
      ->check(CLI::ExistingFile);
  return tactus::bench::bench_main(app, argc, argv, [&] { return tactus::bench::run(settings); });
}
