// A tip over a whole session in one thread: what it touches is what the finest mesh has there.

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

constexpr double kTip = 0.003;
constexpr std::uint64_t kSeed = 17;

spm::offline::BuiltModel organ(std::uint32_t faces) {
  return spm::offline::build_model(spm::offline::generate(spm::offline::Shape::kOrgan, faces, 3));
}

/// The model and the corners of its finest faces, for brute force.
struct Finest {
  explicit Finest(const spm::Model& model) {
    for (const auto& face : spm::finest_faces(model)) {
      std::array<float, 9> corners;
      for (int i = 0; i < 3; ++i) std::copy_n(model.positions[face[i]].begin(), 3, corners.begin() + 3 * i);
      triangles.push_back(corners);
    }
  }
  [[nodiscard]] double distance(const std::array<float, 9>& t, const Vec3d& p) const {
    const auto corner = [&](int i) { return Vec3d{t[3 * i], t[3 * i + 1], t[3 * i + 2]}; };
    return std::sqrt(spm::closest_point(p, corner(0), corner(1), corner(2)).squared_distance);
  }
  std::vector<std::array<float, 9>> triangles;
};

/// A tip that circles the organ half a millimetre deep, at 5 cm/s.
class Circling {
 public:
  explicit Circling(const Finest& finest) {
    constexpr int kStops = 600;
    for (int i = 0; i < kStops; ++i) {
      const double angle = 2 * M_PI * i / kStops;
      const Vec3d ray{std::cos(angle), std::sin(angle), 0.3 * std::sin(3 * angle)};
      // In from outside, each time by as far as is free, until the tip touches; then half a millimetre further.
      double radius = 0.2;
      for (double free = 1; free > 1e-6;) {
        double nearest = 1;
        for (const auto& triangle : finest.triangles)
          nearest = std::min(nearest, finest.distance(triangle, radius * ray));
        free = nearest - kTip;
        radius -= free / ray.norm();
      }
      stops_.push_back((radius - 0.0005 / ray.norm()) * ray);
    }
  }
  [[nodiscard]] const std::vector<Vec3d>& stops() const { return stops_; }

 private:
  std::vector<Vec3d> stops_;
};

class OrganSession : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    built_ = new spm::offline::BuiltModel{organ(12000)};
    finest_ = new Finest{built_->model()};
    path_ = new Circling{*finest_};
  }
  static void TearDownTestSuite() {
    delete path_;
    delete finest_;
    delete built_;
  }
  /// Position at `cycle`, 5 cm/s along the stops.
  static Vec3d position(double cycle) {
    static const std::vector<double> lengths = [] {
      std::vector<double> sums{0};
      for (std::size_t i = 1; i < path_->stops().size(); ++i)
        sums.push_back(sums.back() + (path_->stops()[i] - path_->stops()[i - 1]).norm());
      return sums;
    }();
    const double at = std::fmod(cycle * 0.05e-3, lengths.back());
    const auto next = std::upper_bound(lengths.begin(), lengths.end(), at) - lengths.begin();
    const double share = (at - lengths[next - 1]) / (lengths[next] - lengths[next - 1]);
    return path_->stops()[next - 1] * (1 - share) + path_->stops()[next] * share;
  }
  static spm::offline::BuiltModel* built_;
  static Finest* finest_;
  static Circling* path_;
};
spm::offline::BuiltModel* OrganSession::built_ = nullptr;
Finest* OrganSession::finest_ = nullptr;
Circling* OrganSession::path_ = nullptr;

TEST_F(OrganSession, ExactContactsAreThoseOfTheFinestMeshWithAPoolOfAQuarter) {
  const spm::Model model = built_->model();
  spm::PoolSettings quarter = spm::PoolSettings::for_slots(model.summary.parts / 4 + 600);
  quarter.compressed_blocks = model.summary.records / 2;
  LocalSession session{{model}, 1, quarter};
  std::uint64_t contact = 0, exact = 0, audited = 0;
  for (int cycle = 0; cycle < 12000; ++cycle) {
    const Vec3d at = position(cycle);
    session.step(at, (position(cycle + 1) - at) * 1000);
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
      if (finest_->distance(triangle, centre) <= logged.radius) expected.push_back(trace::triangle_key(triangle));
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

TEST_F(OrganSession, WhatIsSpareIsTakenBackWithoutBeingSentAgain) {
  constexpr int kThere = 3000;  // cycles
  const auto to_and_fro = [&](LocalSession& session, int from, int to) {
    for (int cycle = from; cycle != to; cycle += from < to ? 1 : -1)
      session.step(position(cycle), (position(cycle + 1) - position(cycle)) * (from < to ? 1000 : -1000));
  };
  LocalSession large{{built_->model()}, 1, spm::PoolSettings::for_slots(1 << 15)};
  to_and_fro(large, 0, kThere);
  to_and_fro(large, kThere, 0);
  const std::uint32_t enough = large.loader().figures().compressed_peak;

  spm::PoolSettings settings = spm::PoolSettings::for_slots(1 << 15);
  settings.compressed_blocks = enough + enough / 20;
  LocalSession session{{built_->model()}, 1, settings};
  to_and_fro(session, 0, kThere);
  const hrtc_service::LoaderFigures there = session.loader().figures();
  to_and_fro(session, kThere, 0);
  const hrtc_service::LoaderFigures back = session.loader().figures();

  EXPECT_GT(there.regions_evictable, 0u) << "a sixteenth of the store is kept ready";
  EXPECT_EQ(back.regions_evicted, 0u) << "no room was needed";
  EXPECT_EQ(back.regions_reloaded, 0u);
  EXPECT_EQ(back.records_returned, 0u);
}

TEST_F(OrganSession, ASmallBudgetLeavesContactsFlaggedAndNeverWrong) {
  LocalSession session{{built_->model()}, 1, spm::PoolSettings::for_slots(1 << 15)};
  std::uint64_t inexact = 0;
  for (int cycle = 0; cycle < 3000; ++cycle) {
    const Vec3d at = position(cycle);
    const auto& probe = session.step(at, (position(cycle + 1) - at) * 1000, 200).probes[0];
    if ((probe.status & session::kInContact) != 0 && (probe.status & session::kExact) == 0) {
      ++inexact;
      ASSERT_GT(probe.error_bound, 0);
    }
  }
  EXPECT_GT(inexact, 0u);
}

TEST_F(OrganSession, ATipThatJumpsOntoAnObjectIsNotReportedAsExactBeforeTheLoaderHasSeenIt) {
  const Vec3d away{1, 1, 1};
  int part_shown = 0, shown = 0;
  for (int cycles = 1; cycles < 60; ++cycles) {
    LocalSession session{{built_->model()}, 1, spm::PoolSettings::for_slots(1 << 14)};
    for (int cycle = 0; cycle < cycles; ++cycle) session.step(away, Vec3d::Zero(), 2000);
    const hrtc_service::ProbeOutput& probe = session.step(position(0), Vec3d::Zero(), 2000).probes[0];
    if (session.cycle().objects().empty()) continue;
    ++(session.cycle().objects().front()->forest->is_base_shown() ? shown : part_shown);
    ASSERT_EQ(probe.status & session::kExact, 0u) << "after " << cycles << " cycles";
    ASSERT_GT(probe.error_bound, 0) << "after " << cycles << " cycles";
  }
  EXPECT_GT(part_shown, 0);
  EXPECT_GT(shown, 0);
}

TEST_F(OrganSession, APoseThatIsNoNumberIsNotReportedAsExact) {
  LocalSession session{{built_->model()}, 1, spm::PoolSettings::for_slots(1 << 14)};
  for (int cycle = 0; cycle < 50; ++cycle) session.step(position(0), Vec3d::Zero());
  const Vec3d nowhere = Vec3d::Constant(std::numeric_limits<double>::quiet_NaN());
  const hrtc_service::ProbeOutput& probe = session.step(nowhere, Vec3d::Zero()).probes[0];
  EXPECT_EQ(probe.status & session::kExact, 0u);
  EXPECT_GT(probe.error_bound, 0);
}

TEST(NearObjects, HoldForTheObjectsSoughtAsFarAsTheTipMayHaveMoved) {
  constexpr std::uint64_t kAll = ~std::uint64_t{0};
  const hrtc_service::NearObjects near{0b001, 0b011, {1, 0, 0}, 0.05};
  EXPECT_EQ(near.at({1.04, 0, 0}), kAll & ~std::uint64_t{0b010}) << "others may have come since";
  EXPECT_EQ(near.at({1.06, 0, 0}), kAll);
  EXPECT_EQ(near.at({std::nan(""), 0, 0}), 0u);
  EXPECT_EQ(hrtc_service::NearObjects{}.at({0, 0, 0}), kAll) << "before the loader has looked";
}

TEST_F(OrganSession, TheSameInputsGiveTheSameForcesToTheBit) {
  const auto run = [&] {
    LocalSession session{{built_->model()}, 1, spm::PoolSettings::for_slots(1 << 14)};
    std::vector<double> forces;
    for (int cycle = 0; cycle < 2000; ++cycle) {
      const Vec3d at = position(cycle);
      const auto& probe = session.step(at, (position(cycle + 1) - at) * 1000, 4000).probes[0];
      forces.insert(forces.end(), probe.force.begin(), probe.force.end());
    }
    return forces;
  };
  EXPECT_EQ(run(), run());
}

TEST_F(OrganSession, WhatAClockStoppedIsTheSameToTheBitWithWhatWasGrantedAsItsBudget) {
  constexpr int kCycles = 2000;
  struct Seen {
    hrtc_service::Plain3 force;
    std::uint64_t mesh;
    std::uint32_t status;
    bool operator==(const Seen& o) const { return force == o.force && mesh == o.mesh && status == o.status; }
  };
  std::vector<std::uint32_t> granted;
  int stopped = 0;
  const auto run = [&](bool by_clock) {
    LocalSession session{{built_->model()}, 1, spm::PoolSettings::for_slots(1 << 14)};
    std::mt19937_64 random{kSeed};
    std::vector<Seen> seen;
    for (int cycle = 0; cycle < kCycles; ++cycle) {
      const Vec3d at = position(4 * cycle);  // at 20 cm/s
      session.prepare(at, (position(4 * (cycle + 1)) - at) * 1000);
      hrtc_service::RefineLimit limit;  // anything from one portion to all there is to do
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
      seen.push_back({probe.force, objects.empty() ? 0 : objects.front()->forest->mesh_hash(), probe.status});
    }
    return seen;
  };
  const std::vector<Seen> recorded = run(true);
  EXPECT_GT(stopped, 20) << "or the clock has no part in this";
  EXPECT_LT(stopped, kCycles - 20);
  const std::vector<Seen> replayed = run(false);
  for (int cycle = 0; cycle < kCycles; ++cycle) ASSERT_TRUE(replayed[cycle] == recorded[cycle]) << "cycle " << cycle;
}

TEST_F(OrganSession, AStylusLiesOnTheFinestMeshAlongAllOfItAndIsTurnedByIt) {
  const spm::offline::TriangleMesh stylus = spm::offline::stylus();
  const spm::MeshProbe probe{stylus.positions, stylus.faces};
  hrtc_service::LoaderSettings loader;
  loader.tool = &probe;
  const spm::Model model = built_->model();
  LocalSession session{{model}, 1, spm::PoolSettings::for_slots(model.summary.parts), 2, loader};
  spm::PlacedProbe placed{probe};
  std::array<spm::MeshContact, 8> meeting;
  int contact = 0, exact = 0, turned = 0;
  for (int cycle = 0; cycle < 1500; ++cycle) {
    // Down to 3 mm deep, its shaft half along the surface.
    const Vec3d out = position(cycle).normalized();
    const Vec3d at = position(cycle) + out * std::max(-0.0025, 0.03 - 1e-4 * cycle);
    session.prepare(at, Vec3d::Zero());
    session.inputs()[0].device.orientation =
        spm::rotation_between(Vec3d::UnitZ(), out + 1.5 * out.unitOrthogonal());
    const hrtc_service::ProbeOutput& probed = session.run_cycle(20'000).probes[0];
    ASSERT_TRUE(hrtc_service::vec(probed.force).allFinite() && hrtc_service::vec(probed.torque).allFinite());
    if ((probed.status & session::kInContact) == 0) continue;
    ++contact;
    exact += (probed.status & session::kExact) != 0 ? 1 : 0;
    turned += hrtc_service::vec(probed.torque).norm() > 1e-3 ? 1 : 0;
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    pose.linear() = hrtc_service::quaternion(probed.orientation).toRotationMatrix();
    pose.translation() = hrtc_service::vec(probed.proxy);
    placed.set_pose(pose);
    const spm::AbTree& shown = session.cycle().objects().front()->forest->tree();
    ASSERT_EQ(placed.find_contacts(shown, meeting.data(), 8).contacts, 0u) << cycle;
  }
  EXPECT_GT(contact, 800);
  EXPECT_GE(exact, contact * 99 / 100);
  EXPECT_GT(turned, 100);
}

TEST_F(OrganSession, TargetsAboveTheSettingAreDroppedAndTheStatusSaysSo) {
  const spm::offline::TriangleMesh stylus = spm::offline::stylus();
  const spm::MeshProbe probe{stylus.positions, stylus.faces};
  hrtc_service::LoaderSettings loader;
  loader.tool = &probe;
  const spm::Model model = built_->model();
  const auto run = [&](std::uint32_t targets) {
    LocalSession session{{model}, 1, spm::PoolSettings::for_slots(model.summary.parts), 2, loader, {}, 0, targets};
    int dropped = 0, exact = 0;
    for (int cycle = 0; cycle < 1500; ++cycle) {
      const Vec3d out = position(cycle).normalized();
      session.prepare(position(cycle) - 0.001 * out, Vec3d::Zero());
      session.inputs()[0].device.orientation =
          spm::rotation_between(Vec3d::UnitZ(), out + 3 * out.unitOrthogonal());
      const hrtc_service::CycleResult& result = session.run_cycle(20'000);
      const bool said = (result.probes[0].status & session::kTargetsDropped) != 0;
      EXPECT_EQ(said, result.targets_dropped) << cycle;
      dropped += said ? 1 : 0;
      exact += (result.probes[0].status & session::kExact) != 0 ? 1 : 0;
    }
    return std::pair{dropped, exact};
  };
  const auto [dropped, exact] = run(hrtc_service::CycleSettings{}.targets);
  EXPECT_EQ(dropped, 0);
  EXPECT_GT(exact, 1000);
  const auto [dropped_of_few, exact_of_few] = run(1);
  EXPECT_GT(dropped_of_few, 500);
  EXPECT_LT(exact_of_few, exact - 500);
}

TEST_F(OrganSession, TouchingLeavesTheMeshAsItIs) {
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

TEST_F(OrganSession, ASurfaceThatRefinesUnderATipKeepsTheProxyOutsideAndTheForceSteady) {
  int moved = 0;
  for (std::size_t stop = 0; stop < path_->stops().size(); stop += 50) {
    SCOPED_TRACE("stop " + std::to_string(stop));
    LocalSession session{{built_->model()}, 1, spm::PoolSettings::for_slots(1 << 14)};
    const Vec3d goal = path_->stops()[stop];
    const Vec3d away = goal.normalized();
    const auto approach = [&](int cycle) -> Vec3d { return goal + away * std::max(0.0, 0.09 - 0.0001 * cycle); };
    for (int cycle = 0; cycle < 40; ++cycle) session.step(approach(0), Vec3d::Zero());  // the base mesh arrives
    session.connected = false;
    hrtc_service::ProbeOutput probe;
    for (int cycle = 0; cycle < 1200; ++cycle) probe = session.step(approach(cycle), -away * 0.1).probes[0];
    ASSERT_EQ(probe.status & session::kExact, 0u) << "the base mesh is all there is";
    session.connected = true;
    probe = session.step(goal, Vec3d::Zero()).probes[0];
    for (int cycle = 0; cycle < 1500; ++cycle) {
      const Vec3d before = hrtc_service::vec(probe.force);
      probe = session.step(goal, Vec3d::Zero()).probes[0];
      moved += (probe.status & session::kSurfaceMoved) != 0 ? 1 : 0;
      ASSERT_LE((hrtc_service::vec(probe.force) - before).norm(), 0.05) << "a hand at rest feels no step";
    }

    constexpr std::uint32_t kTouching = session::kInContact | session::kExact;
    EXPECT_EQ(probe.status & kTouching, kTouching);
    const Vec3d proxy = hrtc_service::vec(probe.proxy);
    double nearest = 1;
    for (const auto& triangle : finest_->triangles) nearest = std::min(nearest, finest_->distance(triangle, proxy));
    EXPECT_NEAR(nearest, kTip, 2e-5);
    EXPECT_GT((proxy - goal).dot(away), 0) << "further out than the device, which is half a millimetre in";
    EXPECT_NEAR((proxy - goal).norm(), 0.0005, 0.0003);
  }
  EXPECT_GT(moved, 10);
}

TEST_F(OrganSession, APoolTenTimesTooSmallIsCoarserAndFlaggedAndNeverSaidToBeExactWhereItIsNot) {
  const spm::Model model = built_->model();
  const spm::offline::Certificate needed = spm::offline::certify(model, kTip, 0.05);
  const std::uint32_t base = std::max(model.summary.base_vertices, (model.summary.base_faces + 1) / 2);
  LocalSession session{{model}, 1, spm::PoolSettings::for_slots(base + needed.parts / 10)};
  std::uint64_t contact = 0, exact = 0;
  for (int cycle = 0; cycle < 4000; ++cycle) {
    const Vec3d at = position(cycle);
    const auto& probe = session.step(at, (position(cycle + 1) - at) * 1000).probes[0];
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
  EXPECT_LE(session.loader().figures().slots_peak, base + needed.parts / 10);
  for (const hrtc_service::TouchObject* object : session.cycle().objects())
    EXPECT_THAT(object->forest->violations(), ::testing::IsEmpty());
}

TEST_F(OrganSession, NoSecondOfTouchTakesMoreWorkThanTheCertificateSays) {
  const spm::Model model = built_->model();
  const spm::offline::Certificate certificate = spm::offline::certify(model, kTip, 0.05);
  LocalSession session{{model}, 1, spm::PoolSettings::for_slots(1 << 15)};
  for (int cycle = 0; cycle < 1000; ++cycle) session.step(position(0), Vec3d::Zero());
  constexpr int kSecond = 1000;
  std::uint64_t max_units = 0;
  for (int second = 0; second < 8; ++second) {
    std::uint64_t units = 0;
    for (int cycle = second * kSecond; cycle < (second + 1) * kSecond; ++cycle) {
      const Vec3d at = position(cycle);
      const hrtc_service::CycleCosts& costs = session.step(at, (position(cycle + 1) - at) * 1000).costs;
      units += costs.visits * spm::Budget::kVisit + costs.changes * spm::Budget::kChange;
    }
    max_units = std::max(max_units, units);
  }
  EXPECT_LE(static_cast<double>(max_units), certificate.work_units * certificate.steps_per_second());
  EXPECT_GT(static_cast<double>(max_units), 0.02 * certificate.work_units * certificate.steps_per_second());
}

TEST_F(OrganSession, AnObjectWhoseDirectoryDoesNotFitIsRefusedAndTheOthersAreNot) {
  const spm::Model model = built_->model();
  const auto small_built = organ(2000);
  const spm::Model small = small_built.model();
  const spm::PoolSettings pool = spm::PoolSettings::for_slots(1 << 14);
  hrtc_service::LoaderSettings settings;
  settings.directory_bytes = spm::directory_bytes(model.summary, pool) + 100;
  LocalSession session{{model, small}, 1, pool, 2, settings};
  for (int cycle = 0; cycle < 200; ++cycle) session.step(Vec3d{1, 1, 1}, Vec3d::Zero());

  EXPECT_EQ(session.loader().objects().size(), 1u);
  EXPECT_EQ(session.loader().figures().objects_refused, 1u);
  EXPECT_THAT(session.events, ::testing::Contains(::testing::AllOf(::testing::HasSubstr("object1: refused"),
                                                                   ::testing::HasSubstr("raise --memory"))));
}

TEST_F(OrganSession, AnObjectWhoseBaseMeshDoesNotFitIsRefusedAndLeavesItsRoomToOthers) {
  const spm::Model model = built_->model();
  const spm::PoolSettings pool = spm::PoolSettings::for_slots(model.summary.base_vertices / 4);
  LocalSession session{{model}, 1, pool};
  for (int cycle = 0; cycle < 200; ++cycle) session.step(Vec3d{1, 1, 1}, Vec3d::Zero());

  EXPECT_EQ(session.loader().objects().size(), 0u);
  EXPECT_EQ(session.loader().figures().objects_refused, 1u);
  EXPECT_THAT(session.events, ::testing::Contains(::testing::AllOf(::testing::HasSubstr("object0: refused"),
                                                                   ::testing::HasSubstr("raise --memory or --pool"))));
}

TEST_F(OrganSession, WhatIsLoadedStaysTouchableWhenTheHostFallsSilent) {
  LocalSession session{{built_->model()}, 1, spm::PoolSettings::for_slots(1 << 14)};
  const Vec3d at = position(0);
  for (int cycle = 0; cycle < 500; ++cycle) session.step(at, Vec3d::Zero());
  session.connected = false;
  for (int cycle = 0; cycle < 1500; ++cycle) {
    const auto& probe = session.step(at, Vec3d::Zero()).probes[0];
    ASSERT_EQ(probe.status & (session::kInContact | session::kExact), session::kInContact | session::kExact);
    ASSERT_GT(Eigen::Map<const Vec3d>(probe.force.data()).norm(), 0.1);
  }
  EXPECT_EQ(session.loader().serving_host(session.entry(0).object_id), 0u) << "the host is gone for the HRTC";
}

}  // namespace
}  // namespace tactus
