// A tip or tool touches the organ in a session in one thread. Exact contacts must equal those of the finest mesh.

#include "tests/support/local_session.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "spm/directory.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/certificate.hpp"
#include "spm/offline/generate.hpp"
#include "spm/rotation.hpp"

namespace tactus {
namespace {

using spm::Vec3d;
using test_support::LocalSession;

constexpr double kTipRadius = 0.003;  // m
constexpr std::uint64_t kSessionSeed = 17;

spm::offline::BuiltModel organ(std::uint32_t faces) {
  return spm::offline::build_model(spm::offline::generate(spm::offline::Shape::kOrgan, faces, 3));
}

/// The finest triangles of a model, for brute force.
struct Finest {
  explicit Finest(const spm::Model& model) {
    for (const auto& face : spm::finest_faces(model)) {
      std::array<float, 9> corners;
      for (int i = 0; i < 3; ++i) std::copy_n(model.positions[face[i]].begin(), 3, corners.begin() + 3 * i);
      triangles.push_back(corners);
    }
  }
  [[nodiscard]] static double distance(const std::array<float, 9>& triangle, const Vec3d& point) {
    const auto corner = [&](int i) { return Vec3d{triangle[3 * i], triangle[3 * i + 1], triangle[3 * i + 2]}; };
    return std::sqrt(spm::closest_point(point, corner(0), corner(1), corner(2)).squared_distance);
  }
  /// Returns the distance of a point to the nearest triangle, at most 1 m.
  [[nodiscard]] double distance(const Vec3d& point) const {
    double nearest = 1;
    for (const auto& triangle : triangles) nearest = std::min(nearest, distance(triangle, point));
    return nearest;
  }
  std::vector<std::array<float, 9>> triangles;
};

/// A closed path of a tip around the organ, half a millimetre deep.
class CircularPath {
 public:
  explicit CircularPath(const Finest& finest) {
    constexpr int kPoints = 600;
    for (int i = 0; i < kPoints; ++i) {
      const double angle = 2 * M_PI * i / kPoints;
      const Vec3d ray{std::cos(angle), std::sin(angle), 0.3 * std::sin(3 * angle)};
      // Moves the tip inwards by its distance to the mesh until it touches, and then half a millimetre further.
      double radius = 0.2;
      for (double distance = 1; distance > 1e-6;) {
        distance = finest.distance(radius * ray) - kTipRadius;
        radius -= distance / ray.norm();
      }
      points_.push_back((radius - 0.0005 / ray.norm()) * ray);
    }
  }
  [[nodiscard]] const std::vector<Vec3d>& points() const { return points_; }

 private:
  std::vector<Vec3d> points_;
};

class OrganSession : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    built_ = new spm::offline::BuiltModel{organ(12000)};
    finest_ = new Finest{built_->model()};
    path_ = new CircularPath{*finest_};
  }
  static void TearDownTestSuite() {
    delete path_;
    delete finest_;
    delete built_;
  }
  /// Returns the position of the tip at `cycle`. It moves along the path at 5 cm/s.
  static Vec3d position(double cycle) {
    static const std::vector<double> lengths = [] {
      std::vector<double> sums{0};
      for (std::size_t i = 1; i < path_->points().size(); ++i)
        sums.push_back(sums.back() + (path_->points()[i] - path_->points()[i - 1]).norm());
      return sums;
    }();
    const double length = std::fmod(cycle * 0.05e-3, lengths.back());
    const auto next = std::upper_bound(lengths.begin(), lengths.end(), length) - lengths.begin();
    const double share = (length - lengths[next - 1]) / (lengths[next] - lengths[next - 1]);
    return path_->points()[next - 1] * (1 - share) + path_->points()[next] * share;
  }
  /// Returns the velocity, m/s, of a tip that moves along the path at `cycles` times 5 cm/s.
  static Vec3d velocity(double cycle, int cycles = 1) { return (position(cycle + cycles) - position(cycle)) * 1000; }
  static spm::offline::BuiltModel* built_;
  static Finest* finest_;
  static CircularPath* path_;
};
spm::offline::BuiltModel* OrganSession::built_ = nullptr;
Finest* OrganSession::finest_ = nullptr;
CircularPath* OrganSession::path_ = nullptr;

TEST_F(OrganSession, ExactContactsAreThoseOfTheFinestMeshWithAPoolForAQuarterOfTheModel) {
  const spm::Model model = built_->model();
  spm::PoolSettings quarter = spm::PoolSettings::for_slots(model.summary.parts / 4 + 600);
  quarter.compressed_blocks = model.summary.records / 2;
  LocalSession session{{model}, 1, quarter};
  std::uint64_t contact = 0, exact = 0, audited = 0;
  for (int cycle = 0; cycle < 12000; ++cycle) {
    session.step(position(cycle), velocity(cycle));
    trace::LoggedQuery logged;
    if (!session.take_log(logged)) continue;
    ++contact;
    if (!logged.exact) continue;
    ++exact;

    if (cycle % 7 != 0 && logged.since_change > 3) continue;
    ++audited;
    std::vector<std::uint64_t> expected, found;
    const Vec3d centre{logged.centre[0], logged.centre[1], logged.centre[2]};
    for (const auto& triangle : finest_->triangles)
      if (Finest::distance(triangle, centre) <= logged.radius) expected.push_back(trace::triangle_key(triangle));
    for (std::uint32_t i = 0; i < logged.contact_count; ++i) found.push_back(logged.contacts[i].triangle);
    std::sort(expected.begin(), expected.end());
    std::sort(found.begin(), found.end());
    ASSERT_EQ(found, expected) << "cycle " << cycle << " since change " << logged.since_change;
  }
  const hrtc_service::LoaderFigures figures = session.loader().figures();
  EXPECT_GT(audited, 1000u);
  EXPECT_GT(static_cast<double>(exact), 0.99 * static_cast<double>(contact));
  EXPECT_GT(figures.regions_coarsened, figures.regions_evicted);
  EXPECT_GT(figures.regions_evicted, 0u);
  EXPECT_GT(figures.regions_reloaded, 0u);
  EXPECT_LE(figures.slots_peak, quarter.slots);
  EXPECT_LE(figures.compressed_peak, quarter.compressed_blocks);
  for (const hrtc_service::TouchObject* object : session.cycle().objects())
    EXPECT_THAT(object->forest->violations(), ::testing::IsEmpty());
}

TEST_F(OrganSession, AnEvictionCandidateIsUsedAgainWithoutATransmission) {
  constexpr int kTurn = 3000;  // cycle at which the tip turns back
  const auto move_tip = [&](LocalSession& session, int from, int to) {
    const int direction = from < to ? 1 : -1;
    for (int cycle = from; cycle != to; cycle += direction) session.step(position(cycle), direction * velocity(cycle));
  };
  LocalSession large{{built_->model()}, 1, spm::PoolSettings::for_slots(1 << 15)};
  move_tip(large, 0, kTurn);
  move_tip(large, kTurn, 0);
  const std::uint32_t needed_blocks = large.loader().figures().compressed_peak;

  spm::PoolSettings settings = spm::PoolSettings::for_slots(1 << 15);
  settings.compressed_blocks = needed_blocks + needed_blocks / 20;
  LocalSession session{{built_->model()}, 1, settings};
  move_tip(session, 0, kTurn);
  const hrtc_service::LoaderFigures at_turn = session.loader().figures();
  move_tip(session, kTurn, 0);
  const hrtc_service::LoaderFigures at_end = session.loader().figures();

  EXPECT_GT(at_turn.regions_evictable, 0u) << "a sixteenth of the cache can be freed at once";
  EXPECT_EQ(at_end.regions_evicted, 0u) << "all regions fit into the cache";
  EXPECT_EQ(at_end.regions_reloaded, 0u);
  EXPECT_EQ(at_end.records_received_again, 0u);
}

TEST_F(OrganSession, ASmallBudgetLeavesInexactContactsThatHaveAnErrorBound) {
  LocalSession session{{built_->model()}, 1, spm::PoolSettings::for_slots(1 << 15)};
  std::uint64_t inexact = 0;
  for (int cycle = 0; cycle < 3000; ++cycle) {
    const auto& probe = session.step(position(cycle), velocity(cycle), 200).probes[0];
    if ((probe.status & session::kInContact) != 0 && (probe.status & session::kExact) == 0) {
      ++inexact;
      ASSERT_GT(probe.error_bound, 0);
    }
  }
  EXPECT_GT(inexact, 0u);
}

TEST_F(OrganSession, ATipThatJumpsOntoAnObjectIsNotExactBeforeTheLoaderKnowsItsPosition) {
  const Vec3d far_away{1, 1, 1};
  int base_incomplete = 0, base_complete = 0;
  for (int cycles = 1; cycles < 60; ++cycles) {
    LocalSession session{{built_->model()}, 1, spm::PoolSettings::for_slots(1 << 14)};
    for (int cycle = 0; cycle < cycles; ++cycle) session.step(far_away, Vec3d::Zero(), 2000);
    const hrtc_service::ProbeOutput& probe = session.step(position(0), Vec3d::Zero(), 2000).probes[0];
    if (session.cycle().objects().empty()) continue;
    ++(session.cycle().objects().front()->forest->is_base_shown() ? base_complete : base_incomplete);
    ASSERT_EQ(probe.status & session::kExact, 0u) << "after " << cycles << " cycles";
    ASSERT_GT(probe.error_bound, 0) << "after " << cycles << " cycles";
  }
  EXPECT_GT(base_incomplete, 0);
  EXPECT_GT(base_complete, 0);
}

TEST_F(OrganSession, AnInvalidPoseGivesNoExactContact) {
  LocalSession session{{built_->model()}, 1, spm::PoolSettings::for_slots(1 << 14)};
  for (int cycle = 0; cycle < 50; ++cycle) session.step(position(0), Vec3d::Zero());
  const Vec3d invalid = Vec3d::Constant(std::numeric_limits<double>::quiet_NaN());
  const hrtc_service::ProbeOutput& probe = session.step(invalid, Vec3d::Zero()).probes[0];
  EXPECT_EQ(probe.status & session::kExact, 0u);
  EXPECT_GT(probe.error_bound, 0);
}

TEST(NearObjects, AreTheFoundAndTheNewObjectsUntilTheTipHasMovedTooFar) {
  constexpr std::uint64_t kAll = ~std::uint64_t{0};
  const hrtc_service::NearObjects near{0b001, 0b011, {1, 0, 0}, 0.05};
  EXPECT_EQ(near.at({1.04, 0, 0}), kAll & ~std::uint64_t{0b010}) << "objects outside the search may have arrived since";
  EXPECT_EQ(near.at({1.06, 0, 0}), kAll);
  EXPECT_EQ(near.at({std::nan(""), 0, 0}), 0u);
  EXPECT_EQ(hrtc_service::NearObjects{}.at({0, 0, 0}), kAll) << "before the first search";
}

TEST_F(OrganSession, TheSameInputsGiveTheSameForcesToTheBit) {
  const auto run = [&] {
    LocalSession session{{built_->model()}, 1, spm::PoolSettings::for_slots(1 << 14)};
    std::vector<double> forces;
    for (int cycle = 0; cycle < 2000; ++cycle) {
      const auto& probe = session.step(position(cycle), velocity(cycle), 4000).probes[0];
      forces.insert(forces.end(), probe.force.begin(), probe.force.end());
    }
    return forces;
  };
  EXPECT_EQ(run(), run());
}

TEST_F(OrganSession, RefinementThatAClockLimitsIsReproducedToTheBitByTheGrantedBudgets) {
  constexpr int kCycles = 2000;
  struct CycleRecord {
    hrtc_service::Plain3 force;
    std::uint64_t mesh;
    std::uint32_t status;
    bool operator==(const CycleRecord& other) const {
      return force == other.force && mesh == other.mesh && status == other.status;
    }
  };
  std::vector<std::uint32_t> granted;
  int stopped = 0;
  const auto run = [&](bool by_clock) {
    LocalSession session{{built_->model()}, 1, spm::PoolSettings::for_slots(1 << 14)};
    std::mt19937_64 random{kSessionSeed};
    std::vector<CycleRecord> records;
    for (int cycle = 0; cycle < kCycles; ++cycle) {
      session.prepare(position(4 * cycle), velocity(4 * cycle, 4));  // 20 cm/s
      hrtc_service::RefineLimit limit;                               // random: one portion, more, or no limit
      if (random() % 3 != 0) limit.max_end = 1000.0 * static_cast<double>(random() % 8);
      const hrtc_service::ProbeOutput probe = session.touch().probes[0];
      if (by_clock) {
        const auto& result = session.cycle().refine(spm::Budget{1u << 20}, limit);
        granted.push_back(result.costs.granted);
        stopped += result.budget_spent ? 1 : 0;
      } else {
        session.cycle().refine(spm::Budget{granted[cycle]});
      }
      const auto& objects = session.cycle().objects();
      records.push_back({probe.force, objects.empty() ? 0 : objects.front()->forest->mesh_hash(), probe.status});
    }
    return records;
  };
  const std::vector<CycleRecord> recorded = run(true);
  EXPECT_GT(stopped, 20) << "the clock must have an effect";
  EXPECT_LT(stopped, kCycles - 20);
  const std::vector<CycleRecord> replayed = run(false);
  for (int cycle = 0; cycle < kCycles; ++cycle) ASSERT_TRUE(replayed[cycle] == recorded[cycle]) << "cycle " << cycle;
}

TEST_F(OrganSession, AStylusIsRotatedByTheShownMeshAndDoesNotIntersectIt) {
  const spm::offline::TriangleMesh stylus = spm::offline::stylus();
  const spm::MeshProbe probe{stylus.positions, stylus.faces};
  hrtc_service::LoaderSettings loader;
  loader.tool = &probe;
  const spm::Model model = built_->model();
  LocalSession session{{model}, 1, spm::PoolSettings::for_slots(model.summary.parts), 2, loader};
  spm::PlacedProbe placed{probe};
  std::array<spm::MeshContact, 8> intersections;
  int contact = 0, exact = 0, with_torque = 0;
  for (int cycle = 0; cycle < 1500; ++cycle) {
    // The device moves to a depth of 3 mm. The shaft is oblique to the surface.
    const Vec3d outwards = position(cycle).normalized();
    session.prepare(position(cycle) + outwards * std::max(-0.0025, 0.03 - 1e-4 * cycle), Vec3d::Zero());
    session.inputs()[0].device.orientation =
        spm::rotation_between(Vec3d::UnitZ(), outwards + 1.5 * outwards.unitOrthogonal());
    const hrtc_service::ProbeOutput& output = session.run_cycle(20'000).probes[0];
    ASSERT_TRUE(hrtc_service::vec(output.force).allFinite() && hrtc_service::vec(output.torque).allFinite());
    if ((output.status & session::kInContact) == 0) continue;
    ++contact;
    exact += (output.status & session::kExact) != 0 ? 1 : 0;
    with_torque += hrtc_service::vec(output.torque).norm() > 1e-3 ? 1 : 0;
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    pose.linear() = hrtc_service::quaternion(output.orientation).toRotationMatrix();
    pose.translation() = hrtc_service::vec(output.proxy);
    placed.set_pose(pose);
    const spm::AbTree& shown = session.cycle().objects().front()->forest->tree();
    ASSERT_EQ(placed.find_contacts(shown, intersections.data(), intersections.size()).contacts, 0u) << cycle;
  }
  EXPECT_GT(contact, 800);
  EXPECT_GE(exact, contact * 99 / 100);
  EXPECT_GT(with_torque, 100);
}

TEST_F(OrganSession, TargetsAboveTheSettingAreDroppedAndTheStatusBitIsSet) {
  const spm::offline::TriangleMesh stylus = spm::offline::stylus();
  const spm::MeshProbe probe{stylus.positions, stylus.faces};
  hrtc_service::LoaderSettings loader;
  loader.tool = &probe;
  const spm::Model model = built_->model();
  const auto run = [&](std::uint32_t targets) {
    LocalSession session{{model}, 1, spm::PoolSettings::for_slots(model.summary.parts), 2, loader, {}, 0, targets};
    int dropped = 0, exact = 0;
    for (int cycle = 0; cycle < 1500; ++cycle) {
      const Vec3d outwards = position(cycle).normalized();
      session.prepare(position(cycle) - 0.001 * outwards, Vec3d::Zero());
      session.inputs()[0].device.orientation =
          spm::rotation_between(Vec3d::UnitZ(), outwards + 3 * outwards.unitOrthogonal());
      const hrtc_service::CycleResult& result = session.run_cycle(20'000);
      const bool has_status_bit = (result.probes[0].status & session::kTargetsDropped) != 0;
      EXPECT_EQ(has_status_bit, result.targets_dropped) << cycle;
      dropped += has_status_bit ? 1 : 0;
      exact += (result.probes[0].status & session::kExact) != 0 ? 1 : 0;
    }
    return std::pair{dropped, exact};
  };
  const auto [dropped, exact] = run(hrtc_service::CycleSettings{}.targets);
  EXPECT_EQ(dropped, 0);
  EXPECT_GT(exact, 1000);
  const auto [dropped_with_one, exact_with_one] = run(1);
  EXPECT_GT(dropped_with_one, 500);
  EXPECT_LT(exact_with_one, exact - 500);
}

TEST(ContactQuery, ReturnsAtMost2048ContactsAndSetsTheStatusBitIfThereAreMore) {
  constexpr double kScale = 0.02;  // the sphere, of 0.1 m in its file, lies within the tip
  for (const std::uint32_t faces : {2048u, 2050u}) {
    const spm::offline::BuiltModel built =
        spm::offline::build_model(spm::offline::generate(spm::offline::Shape::kSphere, faces));
    ASSERT_EQ(built.summary.faces, faces);
    LocalSession session{{built.model()}, kScale, spm::PoolSettings::for_slots(1 << 14)};
    for (int cycle = 0; cycle < 1000; ++cycle) session.step(Vec3d::Zero(), Vec3d::Zero());
    const hrtc_service::ProbeOutput& probe = session.step(Vec3d::Zero(), Vec3d::Zero()).probes[0];
    ASSERT_NE(probe.status & session::kExact, 0u) << "some regions are not refined";
    EXPECT_EQ(probe.contacts, 2048u);
    EXPECT_EQ((probe.status & session::kContactsTruncated) != 0, faces > 2048) << faces << " faces";
  }
}

TEST_F(OrganSession, TouchDoesNotChangeTheMesh) {
  LocalSession session{{built_->model()}, 1, spm::PoolSettings::for_slots(1 << 14)};
  const auto hash = [&] {
    const auto& objects = session.cycle().objects();
    return objects.empty() ? 0 : objects.front()->forest->mesh_hash();
  };
  int refined = 0;
  for (int cycle = 0; cycle < 1000; ++cycle) {
    session.prepare(position(cycle), Vec3d::Zero());
    const std::uint64_t before = hash();
    (void)session.touch();
    ASSERT_EQ(hash(), before) << "cycle " << cycle;
    session.cycle().refine(spm::Budget{1000});
    refined += hash() != before ? 1 : 0;
  }
  EXPECT_GT(refined, 20);
}

TEST_F(OrganSession, RefinementUnderATipKeepsTheProxyOutsideAndTheForceWithoutSteps) {
  int moved = 0;
  for (std::size_t point = 0; point < path_->points().size(); point += 50) {
    SCOPED_TRACE("point " + std::to_string(point));
    LocalSession session{{built_->model()}, 1, spm::PoolSettings::for_slots(1 << 14)};
    const Vec3d target = path_->points()[point];
    const Vec3d outwards = target.normalized();
    const auto approach = [&](int cycle) -> Vec3d { return target + outwards * std::max(0.0, 0.09 - 0.0001 * cycle); };
    for (int cycle = 0; cycle < 40; ++cycle) session.step(approach(0), Vec3d::Zero());  // the base mesh arrives
    session.connected = false;
    hrtc_service::ProbeOutput probe;
    for (int cycle = 0; cycle < 1200; ++cycle) probe = session.step(approach(cycle), -outwards * 0.1).probes[0];
    ASSERT_EQ(probe.status & session::kExact, 0u) << "only the base mesh has arrived";
    session.connected = true;
    probe = session.step(target, Vec3d::Zero()).probes[0];
    for (int cycle = 0; cycle < 1500; ++cycle) {
      const Vec3d before = hrtc_service::vec(probe.force);
      probe = session.step(target, Vec3d::Zero()).probes[0];
      moved += (probe.status & session::kSurfaceMoved) != 0 ? 1 : 0;
      ASSERT_LE((hrtc_service::vec(probe.force) - before).norm(), 0.05)
          << "the device does not move, so the force must not step";
    }

    constexpr std::uint32_t kExactContact = session::kInContact | session::kExact;
    EXPECT_EQ(probe.status & kExactContact, kExactContact);
    const Vec3d proxy = hrtc_service::vec(probe.proxy);
    EXPECT_NEAR(finest_->distance(proxy), kTipRadius, 2e-5);
    EXPECT_GT((proxy - target).dot(outwards), 0) << "the device is half a millimetre inside, the proxy is not";
    EXPECT_NEAR((proxy - target).norm(), 0.0005, 0.0003);
  }
  EXPECT_GT(moved, 10);
}

TEST_F(OrganSession, APoolThatIsTenTimesTooSmallLeavesInexactContactsThatHaveAnErrorBound) {
  const spm::Model model = built_->model();
  const spm::offline::Certificate certificate = spm::offline::certify(model, kTipRadius, 0.05);
  const std::uint32_t base = std::max(model.summary.base_vertices, (model.summary.base_faces + 1) / 2);
  LocalSession session{{model}, 1, spm::PoolSettings::for_slots(base + certificate.parts / 10)};
  std::uint64_t contact = 0, exact = 0;
  for (int cycle = 0; cycle < 4000; ++cycle) {
    const auto& probe = session.step(position(cycle), velocity(cycle)).probes[0];
    if ((probe.status & session::kInContact) == 0) continue;
    ++contact;
    if ((probe.status & session::kExact) != 0) {
      ++exact;
      continue;
    }
    ASSERT_GT(probe.error_bound, 0);
    ASSERT_LE(probe.error_bound, model.summary.deviation * 1.001);
  }
  EXPECT_GT(contact, 2000u);
  EXPECT_LT(static_cast<double>(exact), 0.9 * static_cast<double>(contact));
  EXPECT_LE(session.loader().figures().slots_peak, base + certificate.parts / 10);
  for (const hrtc_service::TouchObject* object : session.cycle().objects())
    EXPECT_THAT(object->forest->violations(), ::testing::IsEmpty());
}

TEST_F(OrganSession, NoSecondOfContactTakesMoreWorkThanTheCertificate) {
  const spm::Model model = built_->model();
  const spm::offline::Certificate certificate = spm::offline::certify(model, kTipRadius, 0.05);
  LocalSession session{{model}, 1, spm::PoolSettings::for_slots(1 << 15)};
  for (int cycle = 0; cycle < 1000; ++cycle) session.step(position(0), Vec3d::Zero());
  constexpr int kSecond = 1000;
  std::uint64_t max_units = 0;
  for (int second = 0; second < 8; ++second) {
    std::uint64_t units = 0;
    for (int cycle = second * kSecond; cycle < (second + 1) * kSecond; ++cycle) {
      const hrtc_service::CycleCosts& costs = session.step(position(cycle), velocity(cycle)).costs;
      units += costs.visits * spm::Budget::kVisit + costs.changes * spm::Budget::kChange;
    }
    max_units = std::max(max_units, units);
  }
  EXPECT_LE(static_cast<double>(max_units), certificate.work_units * certificate.steps_per_second());
  EXPECT_GT(static_cast<double>(max_units), 0.02 * certificate.work_units * certificate.steps_per_second());
}

TEST_F(OrganSession, AnObjectWhoseDirectoryDoesNotFitIsRefusedAndOthersAreLoaded) {
  const spm::Model model = built_->model();
  const auto small_built = organ(2000);
  const spm::Model small = small_built.model();
  const spm::PoolSettings pool = spm::PoolSettings::for_slots(1 << 14);
  hrtc_service::LoaderSettings settings;
  settings.directory_bytes = spm::directory_bytes(model.summary, pool, model.regions) + 100;
  LocalSession session{{model, small}, 1, pool, 2, settings};
  for (int cycle = 0; cycle < 200; ++cycle) session.step(Vec3d{1, 1, 1}, Vec3d::Zero());

  EXPECT_EQ(session.loader().objects().size(), 1u);
  EXPECT_EQ(session.loader().figures().objects_refused, 1u);
  EXPECT_THAT(session.events, ::testing::Contains(::testing::AllOf(::testing::HasSubstr("object1: refused"),
                                                                   ::testing::HasSubstr("raise --memory"))));
}

TEST_F(OrganSession, AnObjectWhoseBaseMeshDoesNotFitIsRefused) {
  const spm::Model model = built_->model();
  const spm::PoolSettings pool = spm::PoolSettings::for_slots(model.summary.base_vertices / 4);
  LocalSession session{{model}, 1, pool};
  for (int cycle = 0; cycle < 200; ++cycle) session.step(Vec3d{1, 1, 1}, Vec3d::Zero());

  EXPECT_EQ(session.loader().objects().size(), 0u);
  EXPECT_EQ(session.loader().figures().objects_refused, 1u);
  EXPECT_THAT(session.events, ::testing::Contains(::testing::AllOf(::testing::HasSubstr("object0: refused"),
                                                                   ::testing::HasSubstr("raise --memory or --pool"))));
}

TEST_F(OrganSession, LoadedRegionsStayInExactContactWhenTheHostIsDisconnected) {
  LocalSession session{{built_->model()}, 1, spm::PoolSettings::for_slots(1 << 14)};
  for (int cycle = 0; cycle < 500; ++cycle) session.step(position(0), Vec3d::Zero());
  session.connected = false;
  for (int cycle = 0; cycle < 1500; ++cycle) {
    const auto& probe = session.step(position(0), Vec3d::Zero()).probes[0];
    ASSERT_EQ(probe.status & (session::kInContact | session::kExact), session::kInContact | session::kExact);
    ASSERT_GT(Eigen::Map<const Vec3d>(probe.force.data()).norm(), 0.1);
  }
  EXPECT_EQ(session.loader().serving_host(session.entry(0).object_id), 0u) << "the HRTC has removed the host";
}

// The gateway dies while a hand presses, and another begins with the same link.
TEST_F(OrganSession, AnotherGatewayContinuesWithoutAChangeOfTheForce) {
  const spm::Model model = built_->model();
  LocalSession session{{model}, 1, spm::PoolSettings::for_slots(1 << 15)};
  for (int cycle = 0; cycle < 2000; ++cycle) session.step(position(cycle), velocity(cycle));
  const Vec3d pressed = position(2000);
  for (int cycle = 0; cycle < 500; ++cycle) session.step(pressed, Vec3d::Zero());
  const auto force = session.step(pressed, Vec3d::Zero()).probes[0].force;
  const std::uint64_t loaded = session.loader().figures().regions_loaded;
  ASSERT_GT(loaded, 0u);
  const std::uint32_t slots = session.loader().figures().slots_used;

  session.restart_gateway();
  ASSERT_EQ(session.loader().figures().regions_loaded, 0u);
  for (int cycle = 0; cycle < 1000; ++cycle) {
    const hrtc_service::ProbeOutput& probe = session.step(pressed, Vec3d::Zero()).probes[0];
    ASSERT_EQ(probe.force, force) << "cycle " << cycle;
    ASSERT_NE(probe.status & session::kExact, 0u) << "cycle " << cycle;
  }
  EXPECT_EQ(session.loader().figures().regions_loaded, loaded);
  EXPECT_EQ(session.loader().figures().regions_received, 0u) << "what the servo has is not sent again";
  EXPECT_EQ(session.loader().figures().slots_used, slots);
  EXPECT_EQ(session.cycle().objects().size(), 1u);

  std::uint64_t exact = 0, contact = 0;
  for (int cycle = 2000; cycle < 8000; ++cycle) {
    const std::uint32_t status = session.step(position(cycle), velocity(cycle)).probes[0].status;
    contact += (status & session::kInContact) != 0 ? 1 : 0;
    exact += (status & session::kExact) != 0 ? 1 : 0;
  }
  EXPECT_GT(contact, 5000u);
  EXPECT_GT(static_cast<double>(exact), 0.99 * static_cast<double>(contact));
  EXPECT_GT(session.loader().figures().regions_received, 0u);
  EXPECT_EQ(session.loader().figures().refused_other, 0u);
  EXPECT_THAT(session.core().intake().objects().cache().violations(), ::testing::IsEmpty());
}

TEST_F(OrganSession, ForcesReturnUnderAnotherGatewayWhenARosterEntryOfAHostHasArrived) {
  LocalSession session{{built_->model()}, 1, spm::PoolSettings::for_slots(1 << 15)};
  const auto force_after = [&](int cycles) {
    for (int cycle = 0; cycle < cycles; ++cycle) {
      session.prepare(position(0), Vec3d::Zero());
      (void)session.touch_with_bodies();
      (void)session.core().servo().refine(spm::Budget{1u << 20});
    }
    return hrtc_service::vec(session.core().servo().outputs()[0].force).norm();
  };
  const double before = force_after(500);
  ASSERT_GT(before, 0.1);
  session.has_gateway = false;
  ASSERT_EQ(force_after(5600), 0) << "5 s of patience, and half a second in which the force decreases";
  session.connected = false;
  session.restart_gateway();
  session.has_gateway = true;
  const std::uint64_t heartbeats = session.core().link().heartbeats();
  for (int cycle = 0; cycle < 1000; ++cycle) ASSERT_EQ(force_after(1), 0) << "cycle " << cycle;
  EXPECT_GT(session.core().link().heartbeats(), heartbeats) << "the supervisor sees that the gateway runs";
  session.connected = true;
  EXPECT_GT(force_after(500), 0.9 * before);
}

TEST_F(OrganSession, NumbersOfReceivedPosesContinueAfterAGatewayThatHasReceivedNone) {
  LocalSession session{{built_->model()}, 1, spm::PoolSettings::for_slots(1 << 15), 2, {}, {}, 0.8};
  session::ObjectPose pose;
  pose.origin = {kSession, kHost, 1, 0};
  pose.object_id = session.entry(0).object_id;
  pose.fencing = 1;
  pose.pose = session.entry(0).pose;
  const auto run = [&](int poses) {
    for (int cycle = 0; cycle < 500; ++cycle) session.step(position(0), Vec3d::Zero());
    for (int i = 0; i < poses; ++i) {
      ++pose.sequence;
      session.gateway().on_pose(pose, session.now_ns(), session.now_ns());
    }
    return hrtc_service::MailboxReader{session.core().link().bodies.granted}.latest().bodies[0].received.number;
  };
  const std::uint64_t before = run(3);
  ASSERT_GT(before, 1u);
  session.restart_gateway();
  ASSERT_EQ(run(0), 0u) << "this gateway has received none";
  session.restart_gateway();
  EXPECT_GT(run(1), before);
}

TEST_F(OrganSession, AnObjectThatHasChangedForAnotherGatewayIsReplaced) {
  LocalSession session{{built_->model()}, 1, spm::PoolSettings::for_slots(1 << 15)};
  for (int cycle = 0; cycle < 500; ++cycle) session.step(position(0), Vec3d::Zero());
  ASSERT_EQ(session.cycle().objects().size(), 1u);
  const auto stiffness = [&] { return session.cycle().objects()[0]->material.stiffness; };
  const double before = stiffness();
  session.connected = false;
  session.restart_gateway();
  session::CatalogueEntry entry = session.entry(0);
  entry.material.stiffness = 2 * before;
  session.connected = true;
  session.membership().on_catalogue(entry);
  for (int cycle = 0; cycle < 1500; ++cycle) {
    session.step(position(0), Vec3d::Zero());
    ASSERT_LE(session.cycle().objects().size(), 1u) << "both at a time";
  }
  ASSERT_EQ(session.cycle().objects().size(), 1u);
  EXPECT_EQ(stiffness(), 2 * before);
}

TEST_F(OrganSession, AnObjectThatNoHostOffersToAnotherGatewayIsWithdrawn) {
  hrtc_service::LoaderSettings settings;
  settings.kept_patience_ns = 500'000'000;
  LocalSession session{{built_->model()}, 1, spm::PoolSettings::for_slots(1 << 15), 2, settings};
  for (int cycle = 0; cycle < 500; ++cycle) session.step(position(0), Vec3d::Zero());
  session.connected = false;
  session.restart_gateway();
  for (int cycle = 0; cycle < 400; ++cycle) session.step(position(0), Vec3d::Zero());
  EXPECT_EQ(session.cycle().objects().size(), 1u);
  for (int cycle = 0; cycle < 500; ++cycle) session.step(position(0), Vec3d::Zero());
  EXPECT_EQ(session.cycle().objects().size(), 0u);
  EXPECT_EQ(session.core().intake().objects().cache().slots_used(), 0u);

  session.connected = true;
  session.membership().on_catalogue(session.entry(0));
  for (int cycle = 0; cycle < 1500; ++cycle) session.step(position(0), Vec3d::Zero());
  EXPECT_EQ(session.cycle().objects().size(), 1u) << "when its host offers it again";
}

}  // namespace
}  // namespace tactus
