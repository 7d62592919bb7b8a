#include "tools/audit.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "spm/offline/model_file.hpp"
#include "spm/offline/write_mesh.hpp"
#include "spm/triangle.hpp"
#include "tests/support/constants.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tools/audit_report.hpp"
#include "tools/mesh_tool.hpp"

namespace tactus::tools {
namespace {

using spm::offline::BuiltModel;
using spm::offline::TriangleMesh;
using test_support::read_bytes;
using test_support::write_bytes;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using trace::LoggedObject;
using trace::LoggedQuery;
using trace::LoggedTotals;

constexpr double kScale = 2;                                // metres per unit
constexpr double kTolerance = kTangencyTolerance / kScale;  // in units
constexpr double kRadius = 0.004;                           // units

Corners corners_of(const TriangleMesh& mesh, std::size_t face) {
  Corners corners;
  for (int i = 0; i < 9; ++i) corners[i] = mesh.positions[mesh.faces[face][i / 3]][i % 3];
  return corners;
}

double distance(const Point& p, const Corners& t) {
  const auto corner = [&](int i) { return spm::Vec3d{t[3 * i], t[3 * i + 1], t[3 * i + 2]}; };
  return std::sqrt(spm::closest_point({p[0], p[1], p[2]}, corner(0), corner(1), corner(2)).squared_distance);
}

/// The log entry of a correct HRTC, from a test of all triangles.
LoggedQuery true_query(const TriangleMesh& mesh, const Point& centre, double radius = kRadius) {
  LoggedQuery query;
  query.centre = centre;
  query.radius = radius;
  query.exact = true;
  query.since_change = 1000;
  for (std::size_t face = 0; face < mesh.faces.size(); ++face) {
    const Corners corners = corners_of(mesh, face);
    const double to_face = distance(centre, corners);
    if (to_face <= radius)
      query.contacts.at(query.contact_count++) = {trace::triangle_key(corners), static_cast<float>(radius - to_face)};
  }
  return query;
}

struct AuditOutcome {
  int code;
  std::string out, errors;
};

class Audit : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    mesh_ = new TriangleMesh{spm::offline::generate(spm::offline::Shape::kOrgan, 2000, 7)};
    correct_log_ = new std::vector<LoggedQuery>;
    for (int i = 0; i < kEntries; ++i) {  // straight lines between vertices, with and without contact
      const auto vertex = [](int line) { return mesh_->positions[line * 97 % mesh_->positions.size()]; };
      const auto start = vertex(i / 20), end = vertex(i / 20 + 1);
      const double fraction = i % 20 / 20.0;
      Point centre;
      for (int axis = 0; axis < 3; ++axis) centre[axis] = (1 - fraction) * start[axis] + fraction * end[axis];
      correct_log_->push_back(true_query(*mesh_, centre));
      correct_log_->back().time_ns = i * kMs;
      correct_log_->back().since_change = static_cast<std::uint32_t>(i % 50);
    }
  }
  static void TearDownTestSuite() {
    delete correct_log_;
    delete mesh_;
  }
  void SetUp() override { write_mesh(path("organ.ply"), *mesh_); }

  std::string path(const std::string& name) const { return (folder_.path() / name).string(); }

  void write_log(const std::vector<LoggedQuery>& queries, const std::string& name = "a.hlog",
                 const std::vector<LoggedObject>& objects = {{0, 77, kScale, "organ"}},
                 const std::vector<LoggedTotals>& totals = {{0, 500, 100, 5, 1}}) const {
    trace::ContactLogWriter writer{path(name)};
    for (const LoggedObject& object : objects) writer.write(object);
    for (const LoggedQuery& query : queries) writer.write(query);
    for (const LoggedTotals& total : totals) writer.write(total);
  }

  ObjectAudit audited(const std::vector<LoggedQuery>& queries, std::uint32_t cycles = 10000) const {
    write_log(queries);
    const AuditReport report = audit_files(path("a.hlog"), path("organ.ply"), {}, {cycles});
    return report.objects.at(0);
  }

  AuditOutcome run(std::vector<std::string> arguments) const {
    arguments.insert(arguments.begin(), {"tactus-mesh", "audit"});
    std::vector<const char*> argv;
    for (const std::string& argument : arguments) argv.push_back(argument.c_str());
    std::ostringstream out, errors;
    const int code = run_mesh_tool(static_cast<int>(argv.size()), argv.data(), {out, errors, false});
    return {code, out.str(), errors.str()};
  }

  /// The index of the first entry with a contact deeper than 1e-4 units, and the index of that contact.
  static std::pair<std::size_t, std::uint32_t> deep_contact() {
    for (std::size_t i = 0; i < correct_log_->size(); ++i)
      for (std::uint32_t c = 0; c < (*correct_log_)[i].contact_count; ++c)
        if ((*correct_log_)[i].contacts[c].depth > 1e-4f) return {i, c};
    throw std::logic_error{"no entry has a deep contact"};
  }

  static constexpr int kEntries = 600;
  static TriangleMesh* mesh_;
  static std::vector<LoggedQuery>* correct_log_;
  test_support::TemporaryFolder folder_;
};
TriangleMesh* Audit::mesh_ = nullptr;
std::vector<LoggedQuery>* Audit::correct_log_ = nullptr;

TEST_F(Audit, AcceptsACorrectLog) {
  std::uint64_t contact = 0, triangles = 0;
  for (const LoggedQuery& query : *correct_log_) {
    contact += query.contact_count > 0 ? 1 : 0;
    triangles += query.contact_count;
  }
  ASSERT_GT(contact, 100u);
  ASSERT_LT(contact, static_cast<std::uint64_t>(kEntries));

  const ObjectAudit object = audited(*correct_log_);
  EXPECT_EQ(object.mismatched, 0u);
  EXPECT_EQ(object.entries, static_cast<std::uint64_t>(kEntries));
  EXPECT_EQ(object.contact, contact);
  EXPECT_EQ(object.exact_contact, contact);
  EXPECT_EQ(object.audited, contact);
  EXPECT_GE(object.triangles, triangles);
  const AuditOutcome outcome = run({path("a.hlog"), path("organ.ply")});
  EXPECT_EQ(outcome.code, kDone);
  EXPECT_THAT(outcome.out, AllOf(HasSubstr("mismatches                       0"), Not(HasSubstr("killed"))));
}

TEST_F(Audit, CatchesOneMissingContact) {
  const auto [entry, contact] = deep_contact();
  std::vector<LoggedQuery> queries = *correct_log_;
  LoggedQuery& wrong = queries[entry];
  const std::uint64_t key = wrong.contacts[contact].triangle;
  wrong.contacts[contact] = wrong.contacts[--wrong.contact_count];

  const ObjectAudit object = audited(queries);
  ASSERT_EQ(object.mismatched, 1u);
  EXPECT_EQ(object.mismatches[0].time_ns, wrong.time_ns);
  EXPECT_EQ(object.mismatches[0].missing, std::vector<std::uint64_t>{key});
  EXPECT_TRUE(object.mismatches[0].extra.empty());
  const AuditOutcome outcome = run({path("a.hlog"), path("organ.ply")});
  EXPECT_EQ(outcome.code, kCheckFailed);
  EXPECT_THAT(outcome.out, HasSubstr("      missing "));
}

TEST_F(Audit, CatchesOneExtraContact) {
  std::vector<LoggedQuery> queries = *correct_log_;
  LoggedQuery& wrong = queries[deep_contact().first];
  std::size_t distant_face = 0;
  while (distance(wrong.centre, corners_of(*mesh_, distant_face)) <= 2 * kRadius) ++distant_face;
  const std::uint64_t key = trace::triangle_key(corners_of(*mesh_, distant_face));
  wrong.contacts[wrong.contact_count++] = {key, 0.001f};

  const ObjectAudit object = audited(queries);
  ASSERT_EQ(object.mismatched, 1u);
  EXPECT_EQ(object.mismatches[0].extra, std::vector<std::uint64_t>{key});
  EXPECT_TRUE(object.mismatches[0].missing.empty());
  EXPECT_EQ(run({path("a.hlog"), path("organ.ply")}).code, kCheckFailed);
}

TEST_F(Audit, CatchesADuplicatedFlippedOrInventedTriangle) {
  std::vector<LoggedQuery> queries = *correct_log_;
  const auto [entry, contact] = deep_contact();
  LoggedQuery& duplicated = queries[entry];
  duplicated.contacts[duplicated.contact_count++] = duplicated.contacts[contact];
  EXPECT_EQ(audited(queries).mismatched, 1u);

  queries = *correct_log_;
  for (std::size_t face = 0; face < mesh_->faces.size(); ++face) {
    Corners corners = corners_of(*mesh_, face);
    if (trace::triangle_key(corners) != queries[entry].contacts[contact].triangle) continue;
    std::swap_ranges(corners.begin(), corners.begin() + 3, corners.begin() + 3);
    queries[entry].contacts[contact].triangle = trace::triangle_key(corners);
    break;
  }
  EXPECT_EQ(audited(queries).mismatched, 1u);

  queries = *correct_log_;
  std::size_t without_contact = 0;
  while (queries[without_contact].contact_count > 0) ++without_contact;
  LoggedQuery& invented = queries[without_contact];
  invented.contacts[invented.contact_count++] = queries[entry].contacts[contact];
  EXPECT_EQ(audited(queries).mismatched, 1u);
}

TEST_F(Audit, CatchesADepthWhoseErrorExceedsTheTolerance) {
  const auto [entry, contact] = deep_contact();
  const auto mismatched_by = [&, e = entry, c = contact](double metres) {
    std::vector<LoggedQuery> queries = *correct_log_;
    queries[e].contacts[c].depth = static_cast<float>(queries[e].contacts[c].depth + metres / kScale);
    return audited(queries).mismatched;
  };
  EXPECT_EQ(mismatched_by(0.9e-6), 0u);
  EXPECT_EQ(mismatched_by(-0.9e-6), 0u);
  EXPECT_EQ(mismatched_by(1.1e-6), 1u);
  EXPECT_EQ(mismatched_by(-1.1e-6), 1u);
  EXPECT_EQ(mismatched_by(std::numeric_limits<double>::quiet_NaN()), 1u);
  const AuditOutcome outcome = run({path("a.hlog"), path("organ.ply")});
  EXPECT_EQ(outcome.code, kCheckFailed);
  EXPECT_THAT(outcome.out, HasSubstr("1 wrong depths"));
}

TEST_F(Audit, SkipsInexactAndTruncatedEntries) {
  const auto [entry, contact] = deep_contact();
  std::vector<LoggedQuery> queries = *correct_log_;
  queries[entry].contact_count = 0;
  queries[entry].exact = false;
  const ObjectAudit coarse = audited(queries);
  EXPECT_EQ(coarse.mismatched, 0u);
  EXPECT_EQ(coarse.exact_contact, coarse.contact - 1);

  queries[entry].exact = true;
  queries[entry].truncated = true;
  const ObjectAudit cut = audited(queries);
  EXPECT_EQ(cut.mismatched, 0u);
  EXPECT_EQ(cut.truncated, 1u);
  EXPECT_EQ(cut.audited, cut.contact - 1);
}

TEST_F(Audit, IgnoresAndCountsTangentTriangles) {
  const TriangleMesh one{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {{0, 1, 2}}};
  write_mesh(path("one.ply"), one);
  const std::uint64_t key = trace::triangle_key(corners_of(one, 0));
  // The audit of one entry, whose radius is the distance of the triangle minus `tolerances` times the tolerance.
  // `logged`: the entry contains the triangle.
  const auto result = [&](double tolerances, bool logged) {
    LoggedQuery query = true_query(one, {0.25, 0.25, 0.5}, 0.5 - tolerances * kTolerance);
    query.contact_count = logged ? 1 : 0;
    if (logged) query.contacts[0] = {key, static_cast<float>(-tolerances * kTolerance)};
    write_log({query}, "t.hlog", {{0, 0, kScale, "one"}});
    return audit_files(path("t.hlog"), path("one.ply"), {}, {}).objects.at(0);
  };
  for (const double tolerances : {0.5, -0.5}) {
    EXPECT_EQ(result(tolerances, true).mismatched, 0u);
    EXPECT_EQ(result(tolerances, true).tangent, 1u);
    EXPECT_EQ(result(tolerances, false).mismatched, 0u);
  }
  EXPECT_EQ(result(1.5, true).mismatched, 1u);
  EXPECT_EQ(result(-1.5, false).mismatched, 1u);
  EXPECT_EQ(result(-1.5, true).mismatched, 0u);
  EXPECT_EQ(result(-1.5, true).tangent, 0u);
}

TEST_F(Audit, ChoosesEntriesEvenlyAndTwoFifthsOfThemNearAChange) {
  std::vector<bool> near_change(1000);
  for (std::size_t i = 0; i < 1000; ++i) near_change[i] = i >= 500;
  const std::vector<std::size_t> chosen = choose_entries(near_change, 100);
  ASSERT_EQ(chosen.size(), 100u);
  const auto count = [&](std::size_t low, std::size_t high) {
    return std::count_if(chosen.begin(), chosen.end(), [&](std::size_t i) { return i >= low && i < high; });
  };
  EXPECT_EQ(count(0, 250), 30);
  EXPECT_EQ(count(250, 500), 30);
  EXPECT_EQ(count(500, 750), 20);
  EXPECT_EQ(count(750, 1000), 20);
  EXPECT_TRUE(std::adjacent_find(chosen.begin(), chosen.end(), std::greater_equal<>{}) == chosen.end());
}

TEST_F(Audit, ChoosesMoreOfOneKindIfTheOtherHasTooFewEntries) {
  const auto chosen = [](std::size_t close, std::size_t others, std::size_t max) {
    std::vector<bool> near_change(close, true);
    near_change.resize(close + others, false);
    const std::vector<std::size_t> indices = choose_entries(near_change, max);
    const auto near = std::count_if(indices.begin(), indices.end(), [&](std::size_t i) { return i < close; });
    return std::pair{static_cast<std::size_t>(near), indices.size()};
  };
  EXPECT_EQ(chosen(10, 500, 100), (std::pair<std::size_t, std::size_t>{10, 100}));
  EXPECT_EQ(chosen(500, 10, 100), (std::pair<std::size_t, std::size_t>{90, 100}));
  EXPECT_EQ(chosen(30, 20, 100), (std::pair<std::size_t, std::size_t>{30, 50}));
  EXPECT_EQ(chosen(0, 0, 100), (std::pair<std::size_t, std::size_t>{0, 0}));
  EXPECT_EQ(chosen(30, 20, 0), (std::pair<std::size_t, std::size_t>{0, 0}));
}

TEST_F(Audit, AuditsAtMostTheRequestedCycles) {
  const ObjectAudit object = audited(*correct_log_, 50);
  EXPECT_EQ(object.audited, 50u);
  EXPECT_EQ(object.audited_near_change, 20u);
}

TEST_F(Audit, MeasuresTheTimeOfEachProbeFromTheTouchOfTheOriginalToExactContact) {
  const LoggedQuery touching = (*correct_log_)[deep_contact().first];
  LoggedQuery away = touching;
  away.centre = {1, 1, 1};
  away.contact_count = 0;
  std::vector<LoggedQuery> queries;
  const auto add = [&](const LoggedQuery& query, std::int64_t ms, std::uint32_t probe, bool exact) {
    queries.push_back(query);
    queries.back().time_ns = ms * kMs;
    queries.back().probe = probe;
    queries.back().exact = exact;
  };
  add(away, 1, 0, true);
  add(touching, 5, 0, false);
  queries.back().contact_count = 0;  // no region is loaded, but the probe touches the original
  add(touching, 6, 2, false);
  add(away, 10, 0, true);
  add(touching, 17, 0, true);
  add(touching, 18, 0, true);

  const ObjectAudit object = audited(queries);
  ASSERT_EQ(object.touches.size(), 2u);
  EXPECT_EQ(object.touches[0].probe, 0u);
  EXPECT_EQ(object.touches[0].touch_ns, 5 * kMs);
  EXPECT_EQ(object.touches[0].exact_ns, 17 * kMs);
  EXPECT_EQ(object.touches[1].probe, 2u);
  EXPECT_EQ(object.touches[1].exact_ns, std::nullopt);
  EXPECT_THAT(run({path("a.hlog"), path("organ.ply")}).out,
              AllOf(HasSubstr("contact 12.0 ms after"), HasSubstr("no exact contact")));
}

TEST_F(Audit, ReadsATruncatedLogAndReportsIt) {
  write_log(*correct_log_, "whole.hlog", {{0, 77, kScale, "organ"}}, {});
  const std::string bytes = read_bytes(path("whole.hlog"));
  write_bytes(path("torn.hlog"), bytes.substr(0, bytes.size() - 20));
  const AuditReport torn = audit_files(path("torn.hlog"), path("organ.ply"), {}, {});
  EXPECT_TRUE(torn.is_truncated);
  EXPECT_EQ(torn.objects.at(0).entries, static_cast<std::uint64_t>(kEntries - 1));
  EXPECT_EQ(torn.objects.at(0).mismatched, 0u);
  EXPECT_THAT(run({path("torn.hlog"), path("organ.ply")}).out, HasSubstr("ends within an entry"));

  const AuditReport whole = audit_files(path("whole.hlog"), path("organ.ply"), {}, {});
  EXPECT_FALSE(whole.is_truncated);
  EXPECT_TRUE(whole.is_unfinished);
  EXPECT_THAT(run({path("whole.hlog"), path("organ.ply")}).out, HasSubstr("without totals"));
}

TEST_F(Audit, CountsTheRecordsThatTheContactsNeeded) {
  const BuiltModel built = spm::offline::build_model(*mesh_);
  spm::offline::write_model(path("organ.spm"), built.model(), {"organ.ply", built.cleaned});
  std::vector<LoggedQuery> queries(correct_log_->begin(), correct_log_->begin() + 60);
  queries[0].exact = false;  // inexact contacts need records too
  write_log(queries, "a.hlog", {{0, built.summary.digest, kScale, "organ"}});

  std::set<std::uint32_t> needed;
  for (const LoggedQuery& query : queries) {
    if (query.contact_count == 0) continue;
    for (const spm::Region& region : built.regions) {
      double squared = 0;
      const double edge = built.summary.grid.cell_size / (1 << region.depth);
      for (int axis = 0; axis < 3; ++axis) {
        const double low = built.summary.grid.origin[axis] + region.cell[axis] * edge;
        squared += std::pow(std::max({low - query.centre[axis], query.centre[axis] - low - edge, 0.0}), 2);
      }
      if (squared > query.radius * query.radius) continue;
      for (std::uint32_t i = 0; i < region.interval_count; ++i) {
        const auto& interval = built.intervals[region.first_interval + i];
        for (std::uint32_t k = 0; k < interval.count; ++k) needed.insert(interval.first + k);
      }
    }
  }
  ASSERT_GT(needed.size(), 10u);
  ASSERT_LT(needed.size(), built.summary.records);

  const auto json = nlohmann::json::parse(
      run({path("a.hlog"), path("organ.ply"), "--spm", path("organ.spm"), "--json"}).out)["objects"][0]["records"];
  EXPECT_EQ(json["needed"], needed.size());
  EXPECT_EQ(json["received"], 500);
  EXPECT_EQ(json["returned"], 100);
  EXPECT_DOUBLE_EQ(json["received_per_needed"], 500.0 / static_cast<double>(needed.size()));
  EXPECT_DOUBLE_EQ(json["first_received_per_needed"], 400.0 / static_cast<double>(needed.size()));
  EXPECT_DOUBLE_EQ(json["received_of_model"], 500.0 / built.summary.records);
}

TEST_F(Audit, MatchesObjectsByDigestThenByNameThenIfTheLogHasOnlyOne) {
  const BuiltModel built = spm::offline::build_model(*mesh_);
  spm::offline::write_model(path("renamed.spm"), built.model(), {"organ.ply", built.cleaned});
  std::vector<LoggedQuery> queries = *correct_log_;
  for (LoggedQuery& query : queries) query.object = 1;
  const LoggedObject other{0, 5, 1, "organ"}, touched{1, built.summary.digest, kScale, "heart"};
  write_log(queries, "both.hlog", {other, touched});
  const auto objects = [&](const std::string& log, const std::string& model, const std::string& spm) {
    return audit_files(path(log), path(model), spm.empty() ? spm : path(spm), {}).objects;
  };
  const auto by_digest = objects("both.hlog", "renamed.spm", "");
  ASSERT_EQ(by_digest.size(), 1u);
  EXPECT_EQ(by_digest[0].name, "heart");
  EXPECT_GT(by_digest[0].audited, 100u);
  EXPECT_EQ(by_digest[0].mismatched, 0u);
  EXPECT_EQ(objects("both.hlog", "organ.ply", "renamed.spm").at(0).name, "heart");
  EXPECT_EQ(objects("both.hlog", "organ.ply", "").at(0).name, "organ");

  const AuditOutcome untouched = run({path("both.hlog"), path("organ.ply")});
  EXPECT_EQ(untouched.code, kDone);
  EXPECT_THAT(untouched.out, AllOf(HasSubstr("object 'organ'"), HasSubstr("not touched")));

  write_mesh(path("spleen.ply"), *mesh_);
  write_log(queries, "one.hlog", {touched});
  EXPECT_EQ(objects("one.hlog", "spleen.ply", "").at(0).name, "heart");
  const AuditOutcome absent = run({path("both.hlog"), path("spleen.ply")});
  EXPECT_EQ(absent.code, kDone);
  EXPECT_THAT(absent.out, AllOf(HasSubstr("0 cycles audited"), HasSubstr("  'organ'\n  'heart'\n")));
}

TEST_F(Audit, WritesJsonIntoAFileAndTextToTheOutput) {
  write_log(*correct_log_);
  const AuditOutcome outcome = run({path("a.hlog"), path("organ.ply"), "--cycles", "30", "--json", path("a.json")});
  EXPECT_EQ(outcome.code, kDone);
  EXPECT_THAT(outcome.out, HasSubstr("cycles audited"));
  const auto json = nlohmann::json::parse(read_bytes(path("a.json")));
  EXPECT_TRUE(json["clean"]);
  EXPECT_EQ(json["objects"][0]["audited"], 30);
}

TEST_F(Audit, FclAgreesOnEveryAuditedCycle) {
  write_log(*correct_log_);
  const AuditOutcome outcome = run({path("a.hlog"), path("organ.ply"), "--json"});
  EXPECT_EQ(outcome.code, kDone);
  const auto object = nlohmann::json::parse(outcome.out)["objects"][0];
  EXPECT_GT(object["audited"], 100);
  EXPECT_EQ(object["fcl"]["requested"], object["audited"]);
  EXPECT_EQ(object["fcl"]["disagreed"], 0);
  EXPECT_EQ(object["fcl"]["tolerance_m"], kTangencyTolerance);
  EXPECT_THAT(run({path("a.hlog"), path("organ.ply")}).out,
              HasSubstr("disagreements with FCL           0, compared in "));
}

TEST_F(Audit, FailsIfFclDisagreesAlthoughTheLogIsCorrect) {
  write_log(*correct_log_);
  const ContactLog log = read_log(path("a.hlog"));
  Original original{"organ", {}, {}};
  for (std::size_t face = 0; face < mesh_->faces.size(); ++face) original.triangles.push_back(corners_of(*mesh_, face));
  const auto report_with = [&](const std::vector<Corners>& seen_by_fcl) {
    SecondOpinion second{seen_by_fcl};
    return audit(log, original, second, {});
  };
  EXPECT_TRUE(report_with(original.triangles).clean());

  // FCL sees one triangle of a deep contact at another position.
  const auto [entry, contact] = deep_contact();
  std::vector<Corners> moved = original.triangles;
  std::uint64_t key = (*correct_log_)[entry].contacts[contact].triangle;
  for (Corners& triangle : moved)
    if (trace::triangle_key(triangle) == key)
      for (float& coordinate : triangle) coordinate += 5;
  const AuditReport report = report_with(moved);
  const ObjectAudit& object = report.objects.at(0);
  EXPECT_EQ(object.mismatched, 0u) << "FCL does not decide a mismatch";
  ASSERT_GE(object.second.disagreed, 1u);
  EXPECT_EQ(object.second.first.at(0).only_audit, std::vector<std::uint64_t>{key});
  EXPECT_FALSE(report.clean());
  EXPECT_THAT(audit_text(report), HasSubstr("touched by the audit alone"));
  EXPECT_FALSE(audit_json(report)["clean"]);
}

TEST(AuditText, ContainsNoControlCharacterOfAName) {
  AuditReport report;
  report.logged_objects = {"organ\nmismatches 0\x1b]52;"};
  EXPECT_THAT(audit_text(report), HasSubstr("  'organ?mismatches 0?]52;'\n"));
  report.objects.emplace_back().name = report.logged_objects.front();
  EXPECT_THAT(audit_text(report), HasSubstr("object 'organ?mismatches 0?]52;' of the log\n"));
}

TEST(SecondOpinion, DisagreesOnMissingAndExtraTrianglesAndOnDistancesBeyondTheTolerance) {
  const std::vector<Corners> square{{0, 0, 0, 1, 0, 0, 0, 1, 0}, {1, 0, 0, 1, 1, 0, 0, 1, 0}};
  SecondOpinion second{square};
  const Point centre{0.25, 0.25, 0.1};  // above the first triangle
  const double to_second = std::sqrt(0.25 * 0.25 * 2 + 0.01);
  using Triangles = std::vector<std::uint32_t>;

  EXPECT_TRUE(second.compare(centre, 0.2, 1e-6, {{0, 0.1}}).agrees());
  EXPECT_TRUE(second.compare(centre, 0.5, 1e-6, {{0, 0.1}, {1, to_second}}).agrees());
  EXPECT_EQ(second.compare(centre, 0.5, 1e-6, {{0, 0.1}}).only_fcl, Triangles{1});
  EXPECT_EQ(second.compare(centre, 0.2, 1e-6, {{0, 0.1}, {1, 0.15}}).only_audit, Triangles{1});
  EXPECT_TRUE(second.compare(centre, 0.2, 1e-6, {{0, 0.1 + 0.9e-6}}).agrees());
  const auto wrong_distance = second.compare(centre, 0.2, 1e-6, {{0, 0.1 + 1.1e-6}}).distance;
  ASSERT_TRUE(wrong_distance.has_value());
  EXPECT_NEAR(wrong_distance->fcl, 0.1, 1e-9);
  const auto only_fcl = second.compare(centre, 0.2, 1e-6, {}).distance;
  ASSERT_TRUE(only_fcl.has_value());
  EXPECT_FALSE(only_fcl->ours.has_value());
}

TEST(SecondOpinion, IgnoresTrianglesWithinTheToleranceOfTangency) {
  const std::vector<Corners> one{{0, 0, 0, 1, 0, 0, 0, 1, 0}};
  SecondOpinion second{one};
  const Point centre{0.25, 0.25, 0.1};
  const auto inside = second.compare(centre, 0.1 + 0.5e-6, 1e-6, {});
  EXPECT_TRUE(inside.agrees());
  EXPECT_EQ(inside.tangent, 1u);
  EXPECT_FALSE(second.compare(centre, 0.1 + 1.5e-6, 1e-6, {}).agrees());
}

TEST_F(Audit, RefusesWrongInputWithAMessageThatNamesIt) {
  write_log(*correct_log_);
  const std::string good = read_bytes(path("a.hlog"));
  std::string newer_version = good;
  newer_version[8] = 9;
  write_bytes(path("newer.hlog"), newer_version);
  write_bytes(path("empty.hlog"), "");
  std::string unknown_tag = good;
  unknown_tag[12] = 77;
  write_bytes(path("tag.hlog"), unknown_tag);
  write_bytes(path("points.obj"), "v 0 0 0\nv 1 1 1\n");
  write_bytes(path("flat.obj"), "v 0 0 0\nv 1 1 1\nv 2 2 2\nf 1 2 3\n");
  write_bytes(path("bad.spm"), "tactSPM\nnot really");
  LoggedQuery query = correct_log_->front();
  query.radius = std::numeric_limits<double>::quiet_NaN();
  write_log({query}, "radius.hlog");
  query = correct_log_->front();
  query.centre[1] = std::numeric_limits<double>::infinity();
  write_log({query}, "centre.hlog");
  write_log({}, "scale.hlog", {{0, 0, 0, "organ"}});

  const std::string log = path("a.hlog"), organ = path("organ.ply");
  const std::vector<std::pair<std::vector<std::string>, std::string>> cases{
      {{log}, "MODEL"},
      {{path("missing.hlog"), organ}, "missing.hlog: No such file"},
      {{organ, organ}, "organ.ply: not a contact log"},
      {{path("empty.hlog"), organ}, "empty.hlog: not a contact log"},
      {{path("newer.hlog"), organ}, "contact log of version 9, expected 1"},
      {{path("tag.hlog"), organ}, "found entry tag 77"},
      {{path("radius.hlog"), organ}, "radius.hlog: entry 0 has a sphere of radius"},
      {{path("centre.hlog"), organ}, "centre that is not finite"},
      {{path("scale.hlog"), organ}, "scale.hlog: object 'organ' has the scale 0"},
      {{log, path("missing.ply")}, "missing.ply"},
      {{log, path("points.obj")}, "points.obj"},
      {{log, path("flat.obj")}, "flat.obj"},
      {{log, path("bad.spm")}, "bad.spm"},
      {{log, organ, "--spm", path("missing.spm")}, "missing.spm"},
      {{log, organ, "--spm", organ}, "organ.ply: not an .spm file"},
      {{log, organ, "--cycles", "many"}, "many"},
      {{log, organ, "--json", path("no/a.json")}, "no/a.json: cannot be written"},
  };
  for (const auto& [arguments, message] : cases) {
    const AuditOutcome outcome = run(arguments);
    EXPECT_EQ(outcome.code, kBadInput) << message;
    EXPECT_THAT(outcome.errors, HasSubstr(message));
    EXPECT_EQ(outcome.out, "") << message;
  }
}

}  // namespace
}  // namespace tactus::tools
