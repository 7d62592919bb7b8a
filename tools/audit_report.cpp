#include "tools/audit_report.hpp"

#include <cstdio>
#include <nlohmann/json.hpp>

#include "session/printable.hpp"
#include "tools/hex.hpp"

namespace tactus::tools {
namespace {

using nlohmann::ordered_json;

template <class... Values>
std::string formatted(const char* format, Values... values) {
  char text[256];
  std::snprintf(text, sizeof text, format, values...);
  return text;
}

double share(std::uint64_t part, std::uint64_t whole) {
  return whole == 0 ? 0 : static_cast<double>(part) / static_cast<double>(whole);
}

std::optional<double> milliseconds(const FirstTouch& touch) {
  if (!touch.exact_ns) return std::nullopt;
  return static_cast<double>(*touch.exact_ns - touch.touch_ns) * 1e-6;
}

ordered_json keys_json(const std::vector<std::uint64_t>& keys) {
  ordered_json json = ordered_json::array();
  for (const std::uint64_t key : keys) json.push_back(hex(key));
  return json;
}

ordered_json mismatch_json(const Mismatch& mismatch) {
  ordered_json depths = ordered_json::array();
  for (const Mismatch::Depth& depth : mismatch.depths)
    depths.push_back({{"triangle", hex(depth.triangle)}, {"logged_m", depth.logged}, {"expected_m", depth.expected}});
  return {{"time_ns", mismatch.time_ns},
          {"probe", mismatch.probe},
          {"missing", keys_json(mismatch.missing)},
          {"extra", keys_json(mismatch.extra)},
          {"depths", depths}};
}

ordered_json second_json(const SecondOpinions& second) {
  ordered_json first = ordered_json::array();
  for (const Disagreement& one : second.first) {
    ordered_json json{{"time_ns", one.time_ns},
                      {"probe", one.probe},
                      {"only_audit", keys_json(one.only_audit)},
                      {"only_fcl", keys_json(one.only_fcl)}};
    if (one.distance) {
      json["distance"] = {{"audit_m", nullptr}, {"fcl_m", one.distance->fcl}};
      if (one.distance->audit) json["distance"]["audit_m"] = *one.distance->audit;
    }
    first.push_back(std::move(json));
  }
  return {{"requested", second.requested},
          {"tolerance_m", kTangencyTolerance},
          {"tangent", second.tangent},
          {"disagreed", second.disagreed},
          {"first_disagreements", first}};
}

ordered_json records_json(const RecordsUse& use) {
  ordered_json json{{"needed", use.needed}, {"of_model", use.of_model}};
  if (!use.received) return json;
  json["received"] = *use.received;
  json["returned"] = *use.returned;
  json["received_per_needed"] = share(*use.received, use.needed);
  json["first_received_per_needed"] = share(*use.received - *use.returned, use.needed);
  json["received_of_model"] = share(*use.received, use.of_model);
  return json;
}

ordered_json object_json(const ObjectAudit& object) {
  ordered_json probes = ordered_json::array();
  for (const FirstTouch& touch : object.touches) {
    ordered_json probe{{"probe", touch.probe}, {"touch_ns", touch.touch_ns}, {"exact_after_ms", nullptr}};
    if (const auto after = milliseconds(touch)) probe["exact_after_ms"] = *after;
    probes.push_back(std::move(probe));
  }
  ordered_json mismatches = ordered_json::array();
  for (const Mismatch& mismatch : object.mismatches) mismatches.push_back(mismatch_json(mismatch));
  ordered_json json{{"name", object.name},
                    {"index", object.index},
                    {"entries", object.entries},
                    {"contact", object.contact},
                    {"exact_contact", object.exact_contact},
                    {"exact_share", share(object.exact_contact, object.contact)},
                    {"truncated", object.truncated},
                    {"audited", object.audited},
                    {"audited_near_change", object.audited_near_change},
                    {"triangles", object.triangles},
                    {"tangent", object.tangent},
                    {"mismatched", object.mismatched},
                    {"first_mismatches", mismatches},
                    {"fcl", second_json(object.second)},
                    {"probes", probes}};
  if (object.records) json["records"] = records_json(*object.records);
  return json;
}

std::string row(const char* name, std::uint64_t value, const std::string& more = {}) {
  return formatted("  %-32s %llu", name, static_cast<unsigned long long>(value)) + more + "\n";
}

/// Returns a line with the first keys; empty without keys.
std::string keys_text(const char* what, const std::vector<std::uint64_t>& keys) {
  constexpr std::size_t kShown = 3;
  if (keys.empty()) return {};
  std::string text = std::string{"      "} + what;
  for (std::size_t i = 0; i < keys.size() && i < kShown; ++i) text += " " + hex(keys[i]);
  return text + (keys.size() > kShown ? " and " + std::to_string(keys.size() - kShown) + " more\n" : "\n");
}

std::string entry_text(std::int64_t time_ns, std::uint32_t probe) {
  return formatted("    at %.6f s, probe %u\n", static_cast<double>(time_ns) * 1e-9, probe);
}

std::string mismatch_text(const Mismatch& mismatch) {
  std::string text = entry_text(mismatch.time_ns, mismatch.probe) + keys_text("missing", mismatch.missing) +
                     keys_text("extra", mismatch.extra);
  if (!mismatch.depths.empty()) {
    const Mismatch::Depth& first = mismatch.depths.front();
    text += formatted("      %zu wrong depths; of triangle ", mismatch.depths.size()) + hex(first.triangle) +
            formatted(": logged %.6g m, expected %.6g m\n", first.logged, first.expected);
  }
  return text;
}

std::string disagreement_text(const Disagreement& one) {
  std::string text = entry_text(one.time_ns, one.probe) + keys_text("touched by the audit alone", one.only_audit) +
                     keys_text("touched by FCL alone", one.only_fcl);
  if (one.distance) {
    text += "      distance of the nearest triangle: FCL " + formatted("%.9g m, audit ", one.distance->fcl) +
            (one.distance->audit ? formatted("%.9g m", *one.distance->audit) : "more than the radius") + "\n";
  }
  return text;
}

std::string records_text(const RecordsUse& use) {
  std::string text = row("records that the paths needed", use.needed, " of " + std::to_string(use.of_model));
  if (!use.received) return text + "  records received                 not in the log: its HRTC was killed\n";
  return text +
         row("records received", *use.received,
             formatted(", %.3f times the needed records, %.2f %% of the model", share(*use.received, use.needed),
                       100 * share(*use.received, use.of_model))) +
         row("  received again after eviction", *use.returned);
}

std::string object_text(const ObjectAudit& object) {
  std::string text = "object '" + session::printable(object.name) + "' of the log\n";
  text += row("cycles logged near the object", object.entries);
  if (object.entries == 0) return text + "  not touched: no entry to audit\n";
  text += row("cycles in contact", object.contact,
              formatted(", %.3f %% of them exact", 100 * share(object.exact_contact, object.contact)));
  if (object.truncated > 0) text += row("not audited, too many contacts", object.truncated);
  text += row("cycles audited", object.audited,
              ", " + std::to_string(object.audited_near_change) + " within " + std::to_string(kNearChange) +
                  " cycles of a region change");
  text += row("triangles compared", object.triangles, ", " + std::to_string(object.tangent) + " ignored as tangent");
  for (const FirstTouch& touch : object.touches) {
    const auto after = milliseconds(touch);
    text += formatted("  probe %-26u ", touch.probe) +
            (after ? formatted("first exact contact %.1f ms after the first touch", *after) : "no exact contact") +
            "\n";
  }
  if (object.records) text += records_text(*object.records);
  text += row("mismatches", object.mismatched);
  for (const Mismatch& mismatch : object.mismatches) text += mismatch_text(mismatch);
  if (object.mismatched > object.mismatches.size())
    text += "    and " + std::to_string(object.mismatched - object.mismatches.size()) + " more cycles\n";
  const SecondOpinions& second = object.second;
  text += row("disagreements with FCL", second.disagreed,
              formatted(", compared in %llu cycles", static_cast<unsigned long long>(second.requested)));
  if (second.tangent > 0)
    text += row("  triangles ignored as tangent", second.tangent, formatted(", within %g m", kTangencyTolerance));
  for (const Disagreement& one : second.first) text += disagreement_text(one);
  if (second.disagreed > second.first.size())
    text += "    and " + std::to_string(second.disagreed - second.first.size()) + " more cycles\n";
  return text;
}

}  // namespace

ordered_json audit_json(const AuditReport& report) {
  ordered_json objects = ordered_json::array();
  for (const ObjectAudit& object : report.objects) objects.push_back(object_json(object));
  return {{"log", report.log},
          {"original", report.original},
          {"original_triangles", report.original_triangles},
          {"clean", report.clean()},
          {"logged_objects", report.logged_objects},
          {"log_is_truncated", report.is_truncated},
          {"log_is_unfinished", report.is_unfinished},
          {"undeclared", report.undeclared},
          {"objects", objects}};
}

std::string audit_text(const AuditReport& report) {
  std::string text = "audit of " + session::printable(report.log) + " against " + session::printable(report.original) +
                     ", " + std::to_string(report.original_triangles) + " triangles\n";
  if (report.is_truncated) {
    text += "the log ends within an entry, perhaps because its HRTC was killed; the entries before are audited\n";
  } else if (report.is_unfinished) {
    text += "the log ends without totals, perhaps because its HRTC was killed\n";
  }
  if (report.undeclared > 0)
    text += std::to_string(report.undeclared) + " entries of objects that the log does not name: not audited\n";
  for (const ObjectAudit& object : report.objects) text += object_text(object);
  if (!report.objects.empty()) return text;
  text += "no object of the log matches the original: 0 cycles audited. The log has";
  if (report.logged_objects.empty()) return text + " no objects\n";
  text += "\n";
  for (const std::string& name : report.logged_objects) text += "  '" + session::printable(name) + "'\n";
  return text;
}

}  // namespace tactus::tools
