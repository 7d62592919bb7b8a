#include "tools/mesh_report.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <utility>
#include <vector>

#include "session/printable.hpp"
#include "spm/codec/region_codec.hpp"
#include "spm/pool.hpp"
#include "tools/hex.hpp"

namespace tactus::tools {
namespace {

using nlohmann::ordered_json;
using spm::offline::CleanReport;

std::vector<std::pair<const char*, std::uint32_t>> dropped(const CleanReport& c) {
  return {{"welded_vertices", c.welded_vertices},
          {"non_finite_faces", c.non_finite_faces},
          {"repeated_corner_faces", c.repeated_corner_faces},
          {"zero_area_faces", c.zero_area_faces},
          {"duplicate_faces", c.duplicate_faces},
          {"unreferenced_vertices", c.unreferenced_vertices}};
}

constexpr double kPeriod = 0.001;  // s, of a cycle

struct Lists {
  std::uint64_t sum = 0;
  std::uint32_t longest = 0, max_faces = 0;
};

/// Returns the bytes of the messages with the new records of the certificate's worst step.
std::uint64_t bytes_of_worst_step(const spm::codec::CompressedModel& compressed,
                                  const spm::offline::Certificate& certificate) {
  std::uint64_t bytes = 0;
  for (const auto& [region, missing] : certificate.messages)
    bytes += spm::codec::encode_region(compressed, region, std::span<const spm::Interval>{missing})->size();
  return bytes;
}

Lists lists_of(const spm::Model& model) {
  Lists lists;
  for (const spm::Region& region : model.regions) {
    lists.sum += region.record_count;
    lists.longest = std::max(lists.longest, region.record_count);
    lists.max_faces = std::max(lists.max_faces, region.face_count);
  }
  return lists;
}

}  // namespace

ordered_json info_json(const spm::Model& model, const spm::offline::Provenance& provenance,
                       const spm::offline::Certificate& certificate, const spm::codec::CompressedModel* compressed) {
  const spm::ModelSummary& s = model.summary;
  const Lists lists = lists_of(model);
  const auto tree = [&s](std::uint32_t width) {
    const spm::offline::TreeSize size = spm::offline::tree_size(s.faces, width);
    return ordered_json{{"height", size.levels}, {"nodes", size.nodes + s.faces}};
  };
  const double steps = certificate.steps_per_second() * kPeriod;  // of the certificate, per cycle
  const auto faces_changing = static_cast<std::uint64_t>(std::ceil(certificate.faces * steps));
  const auto json_of = [](const auto& needed) { return needed ? ordered_json(*needed) : ordered_json(nullptr); };
  ordered_json drops;
  for (const auto& [name, count] : dropped(provenance.cleaned)) drops[name] = count;
  ordered_json json = {{"digest", hex(s.digest)},
                       {"source", provenance.source},
                       {"dropped", drops},
                       {"vertices", s.vertices},
                       {"faces", s.faces},
                       {"base_vertices", s.base_vertices},
                       {"base_faces", s.base_faces},
                       {"records", s.records},
                       {"parts", s.parts},
                       {"max_level", s.max_level},
                       {"deviation", s.deviation},
                       {"ab_tree", {{"eight_wide", tree(8)}, {"binary", tree(2)}}},
                       {"bounds_min", s.bounds_min},
                       {"bounds_max", s.bounds_max},
                       {"metres_per_unit", s.metres_per_unit},
                       {"position_step", s.position_step},
                       {"regions",
                        {{"count", s.regions},
                         {"cell_size", s.grid.cell_size},
                         {"most_faces", lists.max_faces},
                         {"records_mean", double(lists.sum) / s.regions},
                         {"records_max", lists.longest},
                         {"list_sum_per_record", s.records == 0 ? 0.0 : double(lists.sum) / s.records},
                         {"runs_mean", double(model.intervals.size()) / s.regions}}},
                       {"certificate",
                        {{"radius_m", certificate.radius * s.metres_per_unit},
                         {"regions", certificate.regions},
                         {"records", certificate.records},
                         {"slots", certificate.parts},
                         {"worst_at", certificate.worst_position},
                         {"pool_slots", json_of(spm::offline::slots_needed(s, certificate))},
                         {"memory_bytes", json_of(spm::offline::memory_needed(s, certificate))},
                         {"speed_m_s", certificate.speed * s.metres_per_unit},
                         {"step_m", certificate.step * s.metres_per_unit},
                         {"step_records", certificate.entering_records},
                         {"step_units", certificate.work_units},
                         {"step_faces", certificate.faces},
                         {"cycle_units", certificate.work_units * steps},
                         {"cycle_faces", certificate.faces * steps},
                         {"cycle_marked", spm::offline::max_marked(faces_changing, s.faces)},
                         {"tree_nodes", certificate.nodes},
                         {"records_per_second", certificate.entering_records * certificate.steps_per_second()}}}};
  if (compressed != nullptr) {
    const auto bytes = static_cast<double>(bytes_of_worst_step(*compressed, certificate));
    json["certificate"]["step_bytes"] = bytes;
    json["certificate"]["bytes_per_second"] = bytes * certificate.steps_per_second();
  }
  return json;
}

std::string info_text(const spm::Model& model, const spm::offline::Provenance& provenance,
                      const spm::offline::Certificate& certificate, const spm::codec::CompressedModel* compressed) {
  const spm::ModelSummary& s = model.summary;
  const ordered_json json = info_json(model, provenance, certificate, compressed);
  std::string text;
  const auto row = [&text](const std::string& name, const std::string& value) {
    text += name;
    text.append(std::max<std::size_t>(28, name.size() + 1) - name.size(), ' ');
    text += value + "\n";
  };
  const auto number = [](double value) {
    char digits[32];
    std::snprintf(digits, sizeof digits, "%.6g", value);
    return std::string{digits};
  };
  const auto millimetres = [&](double units) { return number(units * s.metres_per_unit * 1000) + " mm"; };
  row("source", session::printable(provenance.source));
  row("digest", hex(s.digest));
  row("vertices", std::to_string(s.vertices));
  row("faces", std::to_string(s.faces));
  row("base vertices", std::to_string(s.base_vertices));
  row("base faces", std::to_string(s.base_faces));
  row("vertex splits", std::to_string(s.records) + " in " + std::to_string(s.parts) + " parts, " +
                           std::to_string(s.max_level) + " levels");
  for (const auto& [width, name] : {std::pair{8u, "AB-tree, 8 wide"}, std::pair{2u, "AB-tree, binary"}}) {
    const spm::offline::TreeSize size = spm::offline::tree_size(s.faces, width);
    row(name, "height " + std::to_string(size.levels) + ", " + std::to_string(size.nodes + s.faces) + " nodes");
  }
  std::string size;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double side = double{s.bounds_max[axis]} - double{s.bounds_min[axis]};
    size += (axis > 0 ? " x " : "") + number(side * s.metres_per_unit * 1000);
  }
  row("size", size + " mm");
  row("deviation from the finest", "at most " + millimetres(s.deviation));
  row("coordinates", s.position_step > 0 ? "on a grid of " + millimetres(s.position_step) : "as imported, to the bit");
  const auto& regions = json["regions"];
  row("regions", std::to_string(s.regions) + ", cells of " + millimetres(s.grid.cell_size));
  row("records per region", "mean " + number(regions["records_mean"]) + ", max " +
                                std::to_string(regions["records_max"].get<std::uint32_t>()));
  row("faces per region", "max " + std::to_string(regions["most_faces"].get<std::uint32_t>()));
  row("list entries per record", number(regions["list_sum_per_record"]));
  row("probe radius", millimetres(certificate.radius));
  row("  overlapped regions", "at most " + std::to_string(certificate.regions));
  row("  needed records", "at most " + std::to_string(certificate.records) + ", in " +
                              std::to_string(certificate.parts) + " pool slots, and the base mesh");
  const auto& needs = json["certificate"];
  const bool is_possible = !needs["pool_slots"].is_null();
  row("  sufficient pool", is_possible ? std::to_string(needs["pool_slots"].get<std::uint32_t>()) + " slots"
                                       : "none, a pool has at most " + std::to_string(spm::kMaxSlots) + " slots");
  row("  sufficient memory",
      is_possible ? number(needs["memory_bytes"].get<double>() / (1 << 20)) + " MiB, all directories included"
                  : "none");
  row("probe speed", number(needs["speed_m_s"]) + " m/s");
  std::string step = "at most " + std::to_string(certificate.entering_records);
  std::string second = "at most " + number(needs["records_per_second"]);
  if (compressed != nullptr) {
    step += ", " + number(needs["step_bytes"].get<double>() / 1000) + " kB";
    second += ", " + number(needs["bytes_per_second"].get<double>() * 8e-6) + " Mbit";
  }
  row("  new records per " + millimetres(certificate.step), step);
  row("  new records per second", second);
  row("  refinement per cycle", "at most " + number(needs["cycle_units"]) + " units, mean over a second");
  row("  refit per cycle",
      "at most " + std::to_string(needs["cycle_marked"].get<std::uint64_t>()) + " nodes recomputed");
  row("  query", "at most " + std::to_string(certificate.nodes) + " nodes read");
  return text + dropped_text(provenance.cleaned);
}

ordered_json verification_json(const spm::offline::Verification& v) {
  return {{"exact", v.mismatches.empty()},
          {"faces", v.faces},
          {"regions", v.regions},
          {"faces_in_regions", v.faces_in_regions},
          {"mismatches", v.mismatches}};
}

std::string verification_text(const spm::offline::Verification& v) {
  if (v.mismatches.empty()) {
    return "exact: " + std::to_string(v.faces) + " faces to the bit, in the whole model and in each of " +
           std::to_string(v.regions) + " separate regions (" + std::to_string(v.faces_in_regions) +
           " faces compared)\n";
  }
  std::string text = "not exact:\n";
  for (const std::string& mismatch : v.mismatches) text += "  " + mismatch + "\n";
  return text;
}

std::string dropped_text(const CleanReport& cleaned) {
  std::string text;
  for (const auto& [name, count] : dropped(cleaned)) {
    if (count == 0) continue;
    std::string words = name;
    std::replace(words.begin(), words.end(), '_', ' ');
    // Some formats store a vertex for each corner of a face, so that this is no loss.
    if (words == "welded vertices")
      text += "joined at import: " + std::to_string(count) + " vertices at the position of another\n";
    else
      text += "dropped at import: " + std::to_string(count) + " " + words + "\n";
  }
  return text;
}

}  // namespace tactus::tools
