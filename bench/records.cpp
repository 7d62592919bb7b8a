// Measures how large records and closed lists would be in other progressive meshes.
//
// Compares half-edge collapses, which this project uses, with two others. An edge collapse also moves the remaining
// vertex. The longest-edge bisection divides the triangles of a height grid. Reports for each: faces that a record adds
// and deforms, records on which it depends, levels, and lengths of closed lists.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <stdexcept>
#include <string>
#include <vector>

#include "bench/bench_main.hpp"
#include "bench/figures.hpp"
#include "bench/models.hpp"
#include "spm/offline/closure.hpp"
#include "spm/offline/face_order.hpp"
#include "spm/offline/partition.hpp"
#include "spm/offline/region_lists.hpp"
#include "spm/offline/simplify.hpp"

namespace tactus::bench {
namespace {

using namespace spm::offline;
using spm::kNone;

struct Settings {
  std::string model;
  std::uint32_t faces = 70000;
  bool quick = false;
};

/// The faces around each vertex. Collapses and splits update them.
class Stars {
 public:
  Stars(std::size_t vertices, const std::vector<Triangle>& corners, const std::vector<std::uint32_t>& faces)
      : star_(vertices) {
    for (const std::uint32_t face : faces)
      for (const std::uint32_t v : corners[face]) star_[v].push_back(face);
  }
  [[nodiscard]] const std::vector<std::uint32_t>& of(std::uint32_t v) const { return star_[v]; }
  void add(std::uint32_t v, std::uint32_t face) { star_[v].push_back(face); }
  void remove(std::uint32_t v, std::uint32_t face) {
    star_[v].erase(std::find(star_[v].begin(), star_[v].end(), face));
  }

 private:
  std::vector<std::vector<std::uint32_t>> star_;
};

/// Returns the numbers below `count`.
std::vector<std::uint32_t> numbers_below(std::size_t count) {
  std::vector<std::uint32_t> numbers(count);
  for (std::uint32_t i = 0; i < count; ++i) numbers[i] = i;
  return numbers;
}

/// Dependencies of records that split the parent vertex t into t and u, and also move t. Such a record deforms every
/// face around t.
struct EdgeCollapses {
  Dependencies dependencies;
  std::uint64_t deformed_faces = 0;
};
/// Computes them from half-edge collapses, whose records deform only the faces that pass from t to u. Of `half_edge`,
/// the dependencies of these records, only the numbers and `removed_by` are used.
EdgeCollapses with_moving_vertices(Collapses collapses, const Dependencies& half_edge, std::size_t vertices) {
  EdgeCollapses result{half_edge, 0};
  Dependencies& out = result.dependencies;
  std::vector<Triangle>& corners = collapses.corners;
  Stars stars{vertices, corners, collapses.base};
  std::vector<std::uint32_t> last_record(corners.size(), kNone);  // by face: the last record that changed it
  std::vector<std::vector<std::uint32_t>> needs(half_edge.size());
  for (std::size_t s = collapses.segments.size(); s-- > 0;) {
    const Segment& segment = collapses.segments[s];
    for (std::uint32_t i = segment.size(); i-- > 0;) {
      const Collapse &c = segment.sequence[i], &end = segment.sequence[i + 1];
      const std::uint32_t id = half_edge.segment[s] + i;
      std::vector<std::uint32_t>& direct = needs[id];
      const auto need = [&](std::uint32_t record) {
        if (record != kNone) direct.push_back(record);
      };
      need(out.removed_by[c.t]);
      result.deformed_faces += stars.of(c.t).size();
      for (const std::uint32_t face : stars.of(c.t)) {
        need(last_record[face]);
        for (const std::uint32_t v : corners[face]) need(out.removed_by[v]);
        last_record[face] = id;
      }
      for (std::uint32_t k = c.first_moved; k < end.first_moved; ++k) {
        const std::uint32_t face = segment.moved[k].face();
        std::replace(corners[face].begin(), corners[face].end(), c.t, c.u);
        stars.remove(c.t, face);
        stars.add(c.u, face);
      }
      for (std::uint32_t k = c.first_dying; k < end.first_dying; ++k) {
        const std::uint32_t face = index(segment.removed_faces[k].face());
        Triangle& born = corners[face] =
            spm::born_face(segment.removed_faces[k].order(), c.u, c.t, segment.removed_third_corners[k]);
        need(out.removed_by[segment.removed_third_corners[k]]);
        for (const std::uint32_t v : born) stars.add(v, face);
        last_record[face] = id;
      }
      std::sort(direct.begin(), direct.end());
      direct.erase(std::unique(direct.begin(), direct.end()), direct.end());
      std::uint32_t level = 1;
      for (const std::uint32_t j : direct) level = std::max(level, 1u + out.level[j]);
      if (level > 0xffff) throw std::runtime_error("more than 65535 levels");
      out.level[id] = static_cast<std::uint16_t>(level);
      out.max_level = std::max(out.max_level, level);
    }
  }
  out.needs.clear();
  for (std::size_t id = 0; id < needs.size(); ++id) {
    out.first[id] = static_cast<std::uint32_t>(out.needs.size());
    out.needs.insert(out.needs.end(), needs[id].begin(), needs[id].end());
  }
  out.first[needs.size()] = static_cast<std::uint32_t>(out.needs.size());
  return result;
}

/// A grid of 2^k + 1 heights a side, and the collapses that undo its longest-edge bisection. Each collapse moves a
/// vertex to one end of the edge that the vertex divides, so a record adds at most two faces and deforms at most two.
struct Bisection {
  TriangleMesh mesh;
  Collapses collapses;
};
Bisection bisection(std::uint32_t k) {
  const std::uint32_t side = (1u << k) + 1;
  Bisection result;
  const auto at = [&](std::uint32_t x, std::uint32_t y) { return y * side + x; };
  for (std::uint32_t y = 0; y < side; ++y)
    for (std::uint32_t x = 0; x < side; ++x) {
      const double u = double(x) / (side - 1), v = double(y) / (side - 1);
      const double height = 0.1 * std::sin(9 * u + 4 * v) + 0.03 * std::sin(31 * v - 17 * u) + 0.01 * std::sin(97 * u);
      result.mesh.positions.push_back({static_cast<float>(u), static_cast<float>(v), static_cast<float>(height)});
    }
  for (std::uint32_t y = 0; y + 1 < side; ++y)
    for (std::uint32_t x = 0; x + 1 < side; ++x) {
      const std::uint32_t a = at(x, y), b = at(x + 1, y), c = at(x + 1, y + 1), d = at(x, y + 1);
      if ((x + y) % 2 == 0) {  // the diagonal goes from a to c
        result.mesh.faces.push_back({a, b, c});
        result.mesh.faces.push_back({a, c, d});
      } else {
        result.mesh.faces.push_back({a, b, d});
        result.mesh.faces.push_back({b, c, d});
      }
    }
  std::vector<Triangle> ordered;
  for (const std::uint32_t face : face_order(result.mesh)) ordered.push_back(result.mesh.faces[face]);
  result.mesh.faces = ordered;

  std::vector<Triangle>& corners = result.collapses.corners;
  corners = result.mesh.faces;
  Stars stars{result.mesh.positions.size(), corners, numbers_below(corners.size())};
  std::vector<bool> touched(corners.size(), false), removed(corners.size(), false);
  Segment segment;
  const auto collapse = [&](std::uint32_t u, std::uint32_t t) {
    segment.sequence.push_back({u, t, static_cast<std::uint32_t>(segment.removed_faces.size()),
                                static_cast<std::uint32_t>(segment.moved.size())});
    for (const std::uint32_t face : std::vector<std::uint32_t>{stars.of(u)}) {
      Triangle& triangle = corners[face];
      const auto u_at = static_cast<std::uint32_t>(std::find(triangle.begin(), triangle.end(), u) - triangle.begin());
      if (std::find(triangle.begin(), triangle.end(), t) != triangle.end()) {
        const bool t_next = triangle[(u_at + 1) % 3] == t;
        segment.removed_faces.push_back(spm::BornRef::make(spm::FaceId{face}, t_next ? 0 : 1, !touched[face]));
        segment.removed_third_corners.push_back(triangle[(u_at + (t_next ? 2 : 1)) % 3]);
        for (const std::uint32_t v : Triangle{triangle}) stars.remove(v, face);
        removed[face] = true;
      } else {
        segment.moved.emplace_back(face, !touched[face]);
        triangle[u_at] = t;
        stars.remove(u, face);
        stars.add(t, face);
      }
      touched[face] = true;
    }
  };
  for (std::uint32_t step = 1; step < side - 1; step *= 2) {
    for (std::uint32_t y = 0; y < side; y += step)  // midpoints of edges
      for (std::uint32_t x = 0; x < side; x += step) {
        if (x / step % 2 == 1 && y / step % 2 == 0) collapse(at(x, y), at(x - step, y));
        if (x / step % 2 == 0 && y / step % 2 == 1) collapse(at(x, y), at(x, y - step));
      }
    for (std::uint32_t y = step; y < side; y += 2 * step)  // centres of squares, to an end of the next coarser diagonal
      for (std::uint32_t x = step; x < side; x += 2 * step) {
        const bool falling = (x + y) / step / 2 % 2 == 0;
        collapse(at(x, y), falling ? at(x + step, y - step) : at(x - step, y - step));
      }
  }
  segment.sequence.push_back({kNone, kNone, static_cast<std::uint32_t>(segment.removed_faces.size()),
                              static_cast<std::uint32_t>(segment.moved.size())});
  result.collapses.segments.push_back(std::move(segment));
  result.collapses.rounds = {0, 1};
  for (std::uint32_t face = 0; face < corners.size(); ++face) {
    if (removed[face]) continue;
    result.collapses.base.push_back(face);
    result.collapses.base_finest.push_back(!touched[face]);
  }
  return result;
}

/// One kind of progressive mesh.
struct Kind {
  const char* name;
  double extra_bytes;           // bytes of a record minus bytes of a record of this project
  double total_deformed_faces;  // over all records
};

/// Computes the closed lists of the regions and adds the rows of one kind of progressive mesh.
void add_rows(const Kind& kind, const TriangleMesh& mesh, const Partition& cells, const Collapses& collapses,
              const Dependencies& dependencies, Report& report) {
  const RegionLists lists{mesh, cells, dependencies, 0, [](double) {}};
  double borne = 0, added_vertices = 0;
  for (const Segment& segment : collapses.segments) borne += static_cast<double>(segment.removed_faces.size());
  Samples lengths, ratios;
  for (std::size_t cell = 0; cell < lists.size(); ++cell) {
    lengths.add(static_cast<double>(lists.of(cell).size()));
    added_vertices = 0;
    std::vector<std::uint32_t> vertices;
    const Cell& at = cells.cells[cell];
    for (std::uint32_t f = at.first_face; f < at.first_face + at.face_count; ++f)
      for (const std::uint32_t v : mesh.faces[cells.faces[f]])
        if (dependencies.removed_by[v] != kNone) vertices.push_back(v);
    std::sort(vertices.begin(), vertices.end());
    added_vertices = static_cast<double>(std::unique(vertices.begin(), vertices.end()) - vertices.begin());
    if (added_vertices > 0) ratios.add(static_cast<double>(lists.of(cell).size()) / added_vertices);
  }
  const double records = dependencies.size();
  const Population all{std::string{"records, "} + kind.name, dependencies.size()};
  const std::string regions = std::string{"regions, "} + kind.name;
  report.add_value("records", all, "", records);
  report.add_value("bytes of a record minus bytes of a record of this project", all, "B", kind.extra_bytes);
  report.add_value("born faces of a record", all, "", borne / records);
  report.add_value("deformed faces of a record", all, "", kind.total_deformed_faces / records);
  report.add_value("records on which a record depends directly", all, "",
                   static_cast<double>(dependencies.needs.size()) / records);
  report.add_value("levels", all, "", dependencies.max_level);
  report.add_percentiles("length of the closed list of a region", regions, "records", lengths);
  report.add_percentiles("length of the closed list of a region divided by the vertices of its faces that records add",
                         regions, "times", ratios);
}

double deformed_faces_of(const Collapses& collapses) {
  double moved = 0;
  for (const Segment& segment : collapses.segments) moved += static_cast<double>(segment.moved.size());
  return moved;
}

Report run(const Settings& settings) {
  std::fprintf(stderr, "building the model\n");
  const LoadedModel subject = load_model(settings.model, settings.faces);
  TriangleMesh mesh;
  mesh.positions.assign(subject.model.positions.begin(), subject.model.positions.end());
  mesh.faces = subject.finest;
  Report report{{subject.name, subject.model.summary.digest, subject.model.summary.faces,
                 "regions of about 400 finest faces; base of 500 faces, of the bisection 2"}};

  std::fprintf(stderr, "collapsing\n");
  Collapses collapses = simplify(mesh, SimplifyOptions{});
  const Collapses collapses_before = collapses;  // `dependencies` sets the corners to the finest mesh
  const Dependencies half_edge = dependencies(collapses, mesh.positions.size());
  const Partition cells = partition(mesh, PartitionOptions{});
  add_rows({"half-edge collapse", 0, deformed_faces_of(collapses)}, mesh, cells, collapses, half_edge, report);
  std::fprintf(stderr, "computing edge collapses\n");
  const EdgeCollapses edge_collapses = with_moving_vertices(collapses_before, half_edge, mesh.positions.size());
  add_rows({"edge collapse that moves both vertices",
            // 24 bytes for the old and the new position of t, and 4 for each face that remains at t.
            24 + 4 * (static_cast<double>(edge_collapses.deformed_faces) - deformed_faces_of(collapses_before)) /
                     half_edge.size(),
            static_cast<double>(edge_collapses.deformed_faces)},
           mesh, cells, collapses, edge_collapses.dependencies, report);

  std::fprintf(stderr, "bisecting\n");
  std::uint32_t k = 4;
  while (2u << 2 * (k + 1) <= settings.faces && k < 12) ++k;
  Bisection grid = bisection(k);
  const std::vector<Triangle> finest = grid.mesh.faces;
  const Dependencies bisected = dependencies(grid.collapses, grid.mesh.positions.size());
  std::size_t different_faces = 0, larger_records = 0;
  // The corners of a face that a collapse has removed are rotated.
  const auto from_smallest = [](Triangle corners) {
    std::rotate(corners.begin(), std::min_element(corners.begin(), corners.end()), corners.end());
    return corners;
  };
  for (std::size_t face = 0; face < finest.size(); ++face)
    different_faces += from_smallest(grid.collapses.corners[face]) != from_smallest(finest[face]) ? 1 : 0;
  const Segment& segment = grid.collapses.segments.front();
  for (std::uint32_t i = 0; i < segment.size(); ++i)
    larger_records += segment.sequence[i + 1].first_moved - segment.sequence[i].first_moved > 2 ? 1 : 0;
  const Partition grid_cells = partition(grid.mesh, PartitionOptions{});
  add_rows({"bisection of a grid", 0, deformed_faces_of(grid.collapses)}, grid.mesh, grid_cells, grid.collapses,
           bisected, report);
  std::fprintf(stderr, "collapsing the grid\n");
  Collapses grid_collapses = simplify(grid.mesh, SimplifyOptions{});
  const Dependencies grid_dependencies = dependencies(grid_collapses, grid.mesh.positions.size());
  add_rows({"half-edge collapse of the grid", 0, deformed_faces_of(grid_collapses)}, grid.mesh, grid_cells,
           grid_collapses, grid_dependencies, report);
  report.add_value("faces of the grid", {"grid", 1}, "", static_cast<double>(finest.size()));
  report.add_at_most("faces that differ after all collapses were undone", {"faces of the grid", finest.size()}, "",
                     static_cast<double>(different_faces), 0);
  report.add_at_most("records that deform more than two faces", {"records of the grid", segment.size()}, "",
                     static_cast<double>(larger_records), 0);
  report.add_at_most("base faces of the grid", {"grid", 1}, "", static_cast<double>(grid.collapses.base.size()), 2);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{
      "records", "Compares records and closed lists of other progressive meshes with those of half-edge collapses",
      "at most 8192 faces of organ and grid, for CI"};
  app.add_option("--model", settings.model, "mesh file of any format, or .spm model (default: a generated organ)")
      ->check(CLI::ExistingFile);
  app.add_option("--faces", settings.faces, "faces of the generated organ; max number of faces of the grid")
      ->check(CLI::Range(1000u, 10000000u));
  return tactus::bench::bench_main(app, argc, argv, [&] {
    if (app.quick) settings.faces = std::min(settings.faces, 8192u);
    return tactus::bench::run(settings);
  });
}
