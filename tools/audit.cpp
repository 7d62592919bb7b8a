#include "tools/audit.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>

#include "spm/offline/clean.hpp"
#include "spm/offline/import.hpp"
#include "spm/offline/model_file.hpp"
#include "spm/region_grid.hpp"

namespace tactus::tools {
namespace {

using Entry = ContactLog::Entry;

/// Returns `count` elements of `from`, evenly spread and beginning with the first.
template <class T>
std::vector<T> evenly(const std::vector<T>& from, std::size_t count) {
  std::vector<T> chosen;
  chosen.reserve(count);
  for (std::size_t i = 0; i < count; ++i) chosen.push_back(from[i * from.size() / count]);
  return chosen;
}

void add_records(const spm::Model& model, spm::RegionId region, std::vector<bool>& needed) {
  for (const spm::Interval& run : model.intervals_of(region)) std::fill_n(needed.begin() + run.first, run.count, true);
}

std::vector<Corners> corners_of(std::span<const std::array<float, 3>> positions,
                                const std::vector<std::array<std::uint32_t, 3>>& faces) {
  std::vector<Corners> triangles;
  triangles.reserve(faces.size());
  for (const auto& face : faces) {
    Corners& triangle = triangles.emplace_back();
    for (int i = 0; i < 3; ++i) std::copy_n(positions[face[i]].begin(), 3, triangle.begin() + 3 * i);
  }
  return triangles;
}

/// Audits one object of the log against the original.
class ObjectAuditor {
 public:
  ObjectAuditor(const ContactLog& log, const trace::LoggedObject& object, const Original& original,
                const SurfaceGrid& grid, SecondOpinion& second)
      : log_{log}, original_{original}, grid_{grid}, second_{second}, scale_{object.scale} {
    result_.name = object.name;
    result_.index = object.index;
    for (const Entry& entry : log.entries)
      if (entry.object == object.index) entries_.push_back(&entry);
    result_.entries = entries_.size();
  }

  ObjectAudit run(const AuditOptions& options) {
    survey();
    std::vector<bool> near_change;
    for (const Entry* entry : candidates_) near_change.push_back(entry->since_change <= kNearChange);
    for (const std::size_t i : choose_entries(near_change, options.cycles)) {
      check(*candidates_[i]);
      result_.audited_near_change += near_change[i] ? 1 : 0;
    }
    if (original_.model) count_records(*original_.model);
    return std::move(result_);
  }

 private:
  struct Truth {
    std::uint64_t key;
    double distance;
    bool operator<(const Truth& other) const noexcept { return key < other.key; }
  };

  /// Finds the entries in contact with the original, the first contact of each probe, and the candidates for an audit.
  void survey() {
    std::map<std::uint32_t, FirstTouch> touches;
    for (const Entry* entry : entries_) {
      const bool touching = grid_.touches(entry->centre, entry->radius);
      if (touching) {
        touched_.push_back(entry);
        FirstTouch& touch =
            touches.try_emplace(entry->probe, FirstTouch{entry->probe, entry->time_ns, {}}).first->second;
        if (entry->exact && !touch.exact_ns) touch.exact_ns = entry->time_ns;
        result_.exact_contact += entry->exact ? 1 : 0;
      }
      if (!entry->exact || (!touching && entry->contact_count == 0)) continue;
      if (entry->truncated) {
        ++result_.truncated;
      } else {
        candidates_.push_back(entry);
      }
    }
    result_.contact = touched_.size();
    for (const auto& [probe, touch] : touches) result_.touches.push_back(touch);
  }

  void check(const Entry& entry) {
    const double tolerance = kTangencyTolerance / scale_;
    grid_.within(entry.centre, entry.radius + tolerance, near_);
    truth_.clear();
    for (const SurfaceGrid::Near& near : near_)
      truth_.push_back({trace::triangle_key(original_.triangles[near.triangle]), near.distance});
    std::sort(truth_.begin(), truth_.end());
    const auto first = log_.contacts.begin() + static_cast<std::ptrdiff_t>(entry.first_contact);
    logged_.assign(first, first + entry.contact_count);
    std::sort(logged_.begin(), logged_.end(),
              [](const trace::LoggedContact& a, const trace::LoggedContact& b) { return a.triangle < b.triangle; });

    Mismatch found{entry.time_ns, entry.probe, {}, {}, {}};
    auto logged = logged_.begin();
    for (auto truth = truth_.begin(); truth != truth_.end();) {
      const Truth& triangle = *truth;
      const auto same = std::find_if(truth, truth_.end(), [&](const Truth& t) { return t.key != triangle.key; });
      const auto copies = same - truth;
      truth = same;
      for (; logged != logged_.end() && logged->triangle < triangle.key; ++logged)
        found.extra.push_back(logged->triangle);
      ++result_.triangles;
      const bool tangent = std::abs(triangle.distance - entry.radius) < tolerance;
      result_.tangent += tangent ? 1 : 0;
      std::ptrdiff_t times = 0;
      for (; logged != logged_.end() && logged->triangle == triangle.key; ++logged) {
        if (++times > copies) found.extra.push_back(logged->triangle);
        const double depth = entry.radius - triangle.distance;
        const bool agrees = std::abs(static_cast<double>(logged->depth) - depth) <= tolerance;
        if (!tangent && !agrees) found.depths.push_back({triangle.key, logged->depth * scale_, depth * scale_});
      }
      if (times == 0 && !tangent) found.missing.push_back(triangle.key);
    }
    for (; logged != logged_.end(); ++logged) found.extra.push_back(logged->triangle);

    ++result_.audited;
    add_second_opinion(entry);
    if (found.missing.empty() && found.extra.empty() && found.depths.empty()) return;
    ++result_.mismatched;
    if (result_.mismatches.size() < ObjectAudit::kMaxListed) result_.mismatches.push_back(std::move(found));
  }

  /// Compares the entry with FCL. `near_` must hold the triangles near the entry's sphere.
  void add_second_opinion(const Entry& entry) {
    SecondOpinions& opinions = result_.second;
    const SecondOpinion::Answer answer =
        second_.compare(entry.centre, entry.radius, kTangencyTolerance / scale_, near_);
    ++opinions.requested;
    opinions.tangent += answer.tangent;
    if (answer.agrees()) return;
    if (++opinions.disagreed > SecondOpinions::kMaxListed) return;
    Disagreement& first = opinions.first.emplace_back();
    first.time_ns = entry.time_ns;
    first.probe = entry.probe;
    const auto key_of = [&](std::uint32_t triangle) { return trace::triangle_key(original_.triangles[triangle]); };
    std::transform(answer.only_audit.begin(), answer.only_audit.end(), std::back_inserter(first.only_audit), key_of);
    std::transform(answer.only_fcl.begin(), answer.only_fcl.end(), std::back_inserter(first.only_fcl), key_of);
    if (!answer.distance) return;
    Disagreement::Distance& distance = first.distance.emplace();
    if (answer.distance->ours) distance.audit = *answer.distance->ours * scale_;
    distance.fcl = answer.distance->fcl * scale_;
  }

  void count_records(const spm::Model& model) {
    const spm::RegionGrid regions{model.summary.grid, model.regions};
    std::vector<bool> visited(model.regions.size()), needed(model.summary.records);
    for (const Entry* entry : touched_) {
      const spm::Vec3d centre{entry->centre[0], entry->centre[1], entry->centre[2]};
      const auto add_cell = [&](spm::RegionId region, double) {
        if (visited[spm::index(region)]) return;
        visited[spm::index(region)] = true;
        add_records(model, region, needed);
      };
      if (regions.for_each_intersecting(centre, entry->radius, add_cell)) continue;
      for (std::uint32_t i = 0; i < regions.size(); ++i)  // the sphere is too wide for the grid search
        if (regions.box(spm::RegionId{i}).squared_distance(centre) <= entry->radius * entry->radius)
          add_cell(spm::RegionId{i}, 0);
    }
    RecordsUse& use = result_.records.emplace();
    use.needed = static_cast<std::uint64_t>(std::count(needed.begin(), needed.end(), true));
    use.of_model = model.summary.records;
    for (const trace::LoggedTotals& totals : log_.totals)
      if (totals.object == result_.index) {
        use.received = totals.records_received;
        use.returned = std::min(totals.records_received_again, totals.records_received);
      }
  }

  const ContactLog& log_;
  const Original& original_;
  const SurfaceGrid& grid_;
  SecondOpinion& second_;
  double scale_;
  ObjectAudit result_;
  std::vector<const Entry*> entries_, touched_, candidates_;
  std::vector<SurfaceGrid::Near> near_;
  std::vector<Truth> truth_;
  std::vector<trace::LoggedContact> logged_;
};

}  // namespace

bool AuditReport::clean() const noexcept {
  return std::all_of(objects.begin(), objects.end(),
                     [](const ObjectAudit& object) { return object.mismatched == 0 && object.second.disagreed == 0; });
}

ContactLog read_log(const std::filesystem::path& path) {
  ContactLog log;
  trace::ContactLogReader reader{path};
  for (;;) {
    switch (reader.next()) {
      case trace::ContactLogReader::Entry::kEnd:
        log.is_truncated = reader.is_truncated();
        return log;
      case trace::ContactLogReader::Entry::kObject:
        if (!(std::isfinite(reader.object.scale) && reader.object.scale > 0))
          throw AuditError(path.string() + ": object '" + reader.object.name + "' has the scale " +
                           std::to_string(reader.object.scale) + "; expected more than 0 metres per unit");
        log.objects.push_back(reader.object);
        break;
      case trace::ContactLogReader::Entry::kQuery: {
        const trace::LoggedQuery& query = reader.query;
        const bool finite =
            std::all_of(query.centre.begin(), query.centre.end(), [](double x) { return std::isfinite(x); });
        if (!finite || !(std::isfinite(query.radius) && query.radius > 0))
          throw AuditError(path.string() + ": entry " + std::to_string(log.entries.size()) +
                           " has a sphere of radius " + std::to_string(query.radius) +
                           (finite ? "" : " with a centre that is not finite") +
                           "; expected a finite centre and a radius above 0");
        log.entries.push_back({query.time_ns, query.centre, query.radius, log.contacts.size(), query.contact_count,
                               query.object, query.probe, query.since_change, query.exact, query.truncated});
        log.contacts.insert(log.contacts.end(), query.contacts.begin(), query.contacts.begin() + query.contact_count);
        break;
      }
      case trace::ContactLogReader::Entry::kTotals:
        log.totals.push_back(reader.totals);
        break;
    }
  }
}

std::vector<std::size_t> choose_entries(const std::vector<bool>& near_change, std::size_t max) {
  std::vector<std::size_t> close, others;
  for (std::size_t i = 0; i < near_change.size(); ++i) (near_change[i] ? close : others).push_back(i);
  const std::size_t left_by_others = max - std::min(max, others.size());
  const std::size_t from_close = std::min(close.size(), std::max(max * 2 / 5, left_by_others));
  const std::size_t from_others = std::min(others.size(), max - from_close);
  std::vector<std::size_t> chosen = evenly(close, from_close);
  const std::vector<std::size_t> chosen_others = evenly(others, from_others);
  chosen.insert(chosen.end(), chosen_others.begin(), chosen_others.end());
  std::sort(chosen.begin(), chosen.end());
  return chosen;
}

AuditReport audit(const ContactLog& log, const Original& original, SecondOpinion& second, const AuditOptions& options) {
  AuditReport report;
  report.original = original.name;
  report.original_triangles = original.triangles.size();
  report.is_truncated = log.is_truncated;
  const auto has = [](const auto& all, std::uint32_t index, auto member) {
    return std::any_of(all.begin(), all.end(), [&](const auto& one) { return one.*member == index; });
  };
  for (const trace::LoggedObject& object : log.objects) {
    report.logged_objects.push_back(object.name);
    report.is_unfinished = report.is_unfinished || !has(log.totals, object.index, &trace::LoggedTotals::object);
  }
  double reach = 0;
  for (const Entry& entry : log.entries) {
    reach = std::max(reach, entry.radius);
    if (!has(log.objects, entry.object, &trace::LoggedObject::index)) ++report.undeclared;
  }

  const auto is_named = [&](const trace::LoggedObject& object) { return object.name == original.name; };
  const bool named = std::any_of(log.objects.begin(), log.objects.end(), is_named);
  const SurfaceGrid grid{original.triangles, reach > 0 ? reach : 1};
  for (const trace::LoggedObject& object : log.objects) {
    const bool matches = original.model ? object.digest == original.model->summary.digest
                         : named        ? is_named(object)
                                        : log.objects.size() == 1;
    if (matches) report.objects.push_back(ObjectAuditor{log, object, original, grid, second}.run(options));
  }
  return report;
}

AuditReport audit_files(const std::filesystem::path& log_path, const std::filesystem::path& model_path,
                        const std::filesystem::path& spm_path, const AuditOptions& options) {
  const ContactLog log = read_log(log_path);
  const bool is_spm = spm::offline::is_model_file(model_path);
  if (is_spm && !spm_path.empty())
    throw AuditError(model_path.string() + ": is an .spm file; expected a mesh, because --spm names " +
                     spm_path.string());
  const bool has_spm = is_spm || !spm_path.empty();
  spm::OwnedModel decoded;
  if (has_spm) decoded = spm::offline::MappedModel{is_spm ? model_path : spm_path}.decode();
  Original original{model_path.stem().string(), {}, {}};
  if (has_spm) original.model = decoded.model();
  if (is_spm) {
    original.triangles = corners_of(decoded.positions, spm::finest_faces(decoded.model()));
  } else {
    spm::offline::TriangleMesh mesh = spm::offline::import_mesh(model_path, spm::offline::LossPolicy::kAllow);
    spm::offline::clean(mesh);
    original.triangles = corners_of(mesh.positions, mesh.faces);
  }
  if (original.triangles.empty())
    throw AuditError(model_path.string() + ": no surface is left after cleaning; expected at least one face");
  SecondOpinion second{original.triangles};
  AuditReport report = audit(log, original, second, options);
  report.log = log_path.stem().string();
  return report;
}

}  // namespace tactus::tools
