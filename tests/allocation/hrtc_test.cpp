// Tests that cycles of the haptic thread do not allocate, and that objects and pools use the documented memory.

#include <gtest/gtest.h>
#include <malloc.h>

#include <cmath>
#include <memory>
#include <optional>
#include <vector>

#include "hrtc_service/servo/flight_recorder.hpp"
#include "hrtc_service/servo/probe_devices.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "study/shared_session.hpp"
#include "tests/support/allocation_counter.hpp"
#include "tests/support/local_session.hpp"

namespace tactus {
namespace {

using spm::Vec3d;

double heap_bytes() {
  const struct mallinfo2 info = mallinfo2();
  return static_cast<double>(info.uordblks + info.hblkhd);
}

TEST(Allocation, TheCounterCountsAllocationsAndReleasesByNewMallocAndEigen) {
  std::uint64_t by_new, by_malloc, by_eigen;
  {
    const test_support::AllocationCounter counter;
    ::operator delete(::operator new(64));
    by_new = counter.count();
  }
  {
    const test_support::AllocationCounter counter;
    void* volatile block = std::malloc(16);
    std::free(block);
    by_malloc = counter.count();
  }
  {
    const test_support::AllocationCounter counter;
    volatile double sink = Eigen::VectorXd::Random(100).eval().sum();
    static_cast<void>(sink);
    by_eigen = counter.count();
  }
  EXPECT_EQ(by_new, 2u);
  EXPECT_EQ(by_malloc, 2u);
  EXPECT_GE(by_eigen, 2u);
}

TEST(Allocation, APoolUsesTheBytesOfItsSettings) {
  for (const std::uint32_t slots : {3000u, 65536u, 70000u}) {
    const auto settings = spm::PoolSettings::for_slots(slots);
    const double before = heap_bytes();
    spm::Pool pool{settings};
    const spm::NodePool nodes{settings.tree_nodes};
    const spm::CandidateCaches caches;
    const spm::Cache cache{pool};
    const spm::codec::CompressedCache compressed_cache{settings.compressed_blocks};
    const auto expected = static_cast<double>(settings.bytes());
    EXPECT_NEAR(heap_bytes() - before, expected, 0.002 * expected) << slots;
  }
}

TEST(Allocation, AnObjectUsesTheBytesOfItsDirectory) {
  const spm::offline::BuiltModel built =
      spm::offline::build_model(spm::offline::generate(spm::offline::Shape::kOrgan, 300000));
  const spm::Model model = built.model();
  const spm::BaseMesh base = spm::base_mesh_of(model);
  spm::Pool pool{spm::PoolSettings::for_slots(4096)};
  spm::NodePool nodes{pool.settings.tree_nodes};
  spm::Cache cache{pool};
  const double before = heap_bytes();
  spm::Cache::Admitted admitted = cache.admit(base);
  const spm::Forest forest{pool,
                           nodes,
                           admitted.object,
                           model.summary,
                           spm::RegionGrid{model.summary.grid, model.regions},
                           std::move(admitted.base)};
  const double used = heap_bytes() - before;
  std::uint64_t pages = 0, count = 0;
  for (std::span<const spm::Region> left{model.regions}; !left.empty(); ++count) {
    const std::size_t regions = spm::RegionPage::leading(left);
    pages += spm::RegionPage::bytes(left.first(regions));
    left = left.subspan(regions);
  }
  const auto expected = static_cast<double>(spm::Cache::directory_bytes(model.summary) +
                                            spm::Forest::directory_bytes(model.summary, pool.settings) + pages +
                                            spm::RegionGrid::bytes(static_cast<std::uint32_t>(count)));
  EXPECT_LT(used, expected + 4096);
  EXPECT_GT(used, 0.8 * expected);
}

TEST(Allocation, SixtySecondsOfRefinementAndCoarseningAllocateNothing) {
  const spm::offline::BuiltModel built =
      spm::offline::build_model(spm::offline::generate(spm::offline::Shape::kSphere, 20000));
  const spm::Model model = built.model();
  const double radius = (model.summary.bounds_max[0] - model.summary.bounds_min[0]) / 2;
  test_support::LocalSession session{{model}, 1, spm::PoolSettings::for_slots(model.summary.parts / 2)};
  hrtc_service::FlightRecorder recorder{1000};
  session.cycle().set_observer(&recorder);
  hrtc_service::FlightRecord record;
  std::uint64_t contact_cycles = 0, changes = 0, allocations = 0, recorded = 0;
  const auto position = [&](int cycle) -> Vec3d {
    const double angle = cycle * 0.05e-3 / radius;
    return (radius + 0.0025) *
           Vec3d{std::cos(angle), std::sin(angle) * std::cos(angle / 7), std::sin(angle) * std::sin(angle / 7)};
  };
  hrtc_service::MailboxReader<hrtc_service::ShownReport> shown_reports{session.core().link().shown_reports};
  hrtc_service::ShownReport shown;
  std::uint64_t reports = 0;
  for (int cycle = 0; cycle < 60000; ++cycle) {
    const Vec3d tip = position(cycle);
    session.prepare(tip, (position(cycle + 1) - tip) * 1000);
    if (cycle % 10 == 0) session.core().link().request_shown(0);
    const hrtc_service::CycleResult& result = [&]() -> const hrtc_service::CycleResult& {
      const test_support::AllocationCounter counter;
      const hrtc_service::CycleResult& cycle_result = session.run_cycle(4000);
      allocations += counter.count();
      return cycle_result;
    }();
    if (shown_reports.take(shown)) {
      ++reports;
      ASSERT_EQ(shown.mesh_hash, session.cycle().objects()[0]->forest->mesh_hash());
    }
    recorded += recorder.next(record) ? 1 : 0;
    contact_cycles += (result.probes[0].status & session::kInContact) != 0 ? 1 : 0;
    changes += result.costs.changes;
  }
  EXPECT_EQ(allocations, 0u);
  EXPECT_GT(reports, 5000u);
  EXPECT_GT(contact_cycles, 50000u);
  EXPECT_GT(changes, 10000u);
  EXPECT_EQ(recorded, 60000u);
}

TEST(Allocation, WithdrawingAndOfferingObjectsAgainAllocatesNothing) {
  const spm::offline::BuiltModel built =
      spm::offline::build_model(spm::offline::generate(spm::offline::Shape::kSphere, 6000));
  const spm::Model model = built.model();
  const double scale = 0.1 / (model.summary.bounds_max[0] - model.summary.bounds_min[0]);
  test_support::LocalSession session{
      {model, model, model}, scale, spm::PoolSettings::for_slots(2 * model.summary.parts), 2, {}, {}, 0.5};
  hrtc_service::FlightRecorder recorder{1000};
  session.cycle().set_observer(&recorder);
  hrtc_service::FlightRecord record;
  std::uint64_t allocations = 0, removed = 0;
  session.membership().on_object_gone = [&](const hrtc_service::Loader::ObjectInfo&) { ++removed; };
  for (int cycle = 0; cycle < 20000; ++cycle) {
    if (cycle % 2000 == 1000)
      for (const std::size_t object : {0u, 2u}) session.set_withdrawn(object, true);
    if (cycle % 2000 == 1500)
      for (const std::size_t object : {0u, 2u}) session.set_withdrawn(object, false);
    const double height = 0.05 + 0.0015;
    session.prepare({2 + height, 0, 0}, Vec3d::Zero());
    session.inputs()[1] = session.inputs()[0];
    session.inputs()[1].device.position = {0, height, 0};
    const test_support::AllocationCounter counter;
    (void)session.touch_with_bodies();
    session.core().servo().refine(spm::Budget{4000});
    allocations += counter.count();
    (void)recorder.next(record);
  }
  EXPECT_EQ(allocations, 0u);
  EXPECT_EQ(removed, 20u);
}

/// Counts the allocations in the cycles of all haptic threads.
class Allocations final : public study::CycleObserver {
 public:
  void on_begin() override { guard_.emplace(); }
  void on_end() override {
    count += guard_->count();
    guard_.reset();
    ++cycles;
  }
  std::uint64_t count = 0, cycles = 0;

 private:
  std::optional<test_support::AllocationCounter> guard_;
};

// Ann grabs a crate. Bob, at another HRTC, takes it over in the air and puts it down. A third user pushes it.
TEST(Allocation, HoldsAndBodiesAllocateNothingWhileACrateIsGrabbedHandedOverReleasedAndPushed) {
  const study::Subject crate = study::make_subject("crate", "box", 1200, 0.1);
  Allocations allocations;
  study::SharedSessionSettings settings;
  settings.link = netem::parse_link("P0:delay=5");
  settings.mass = 0.5;
  settings.observer = &allocations;
  study::SharedSession session{crate, settings};
  const client_sim::Scenario scenario = client_sim::load_scenario("grab");
  session.add_hrtc();
  session.add_hrtc();
  const std::size_t ann = session.add_user(0, scenario.users[0]), bob = session.add_user(1, scenario.users[1]);
  Vec3d hand{0.3, 0, 0.05};
  const std::size_t pusher = session.add_hand(0, hand);
  bool held_by_both = false, coupled = false, pushed = false;
  for (int ms = 0; ms < 18'000; ++ms) {
    if (session.done() && hand.x() > 0) session.move_hand(pusher, hand -= Vec3d{1e-4, 0, 0});
    session.step();
    const hrtc_service::BodyReport *a = session.body(0), *b = session.body(1);
    if (a == nullptr || b == nullptr) continue;
    held_by_both = held_by_both || (a->is_touched && b->is_touched);
    coupled = coupled || a->copies > 0;
    pushed = pushed || (session.probe(pusher).status & session::kInContact) != 0;
  }
  EXPECT_EQ(allocations.count, 0u);
  EXPECT_GE(allocations.cycles, 36'000u);
  EXPECT_EQ(session.operator_of(ann).tally().grabs, 1u);
  EXPECT_EQ(session.operator_of(bob).tally().grabs, 1u);
  EXPECT_TRUE(held_by_both && coupled && pushed) << held_by_both << coupled << pushed;
}

TEST(Allocation, ChangesOfUsersAndTheirDevicesAllocateNothing) {
  hrtc_service::DeviceLink link;
  hrtc_service::ProbeDevices devices{link, {}, haptics::DeviceFrame{}};
  std::array<hrtc_service::ProbeInput, hrtc_service::kMaxProbes> inputs;
  std::array<hrtc_service::ProbeOutput, hrtc_service::kMaxProbes> outputs{};
  hrtc_service::MailboxWriter orders_out{link.orders};
  std::uint64_t allocations = 0, active = 0;
  for (std::int64_t cycle = 0; cycle < 1000; ++cycle) {
    hrtc_service::ProbeOrders orders{};
    for (std::uint32_t i = 0; i < hrtc_service::kMaxProbes; ++i) {
      orders[i].source = static_cast<hrtc_service::PoseSource>((cycle / 10 + i) % 3);
      orders[i].user = static_cast<std::uint64_t>(cycle / 20);
      hrtc_service::UserPath path{orders[i].user, {}};
      path.path.waypoints[path.path.count++] = {cycle * 1'000'000, {0.1, 0, 0}};
      hrtc_service::MailboxWriter{link.paths[i]}.post(path);
      hrtc_service::MailboxWriter{link.poses[i]}.post({orders[i].user, {}});
    }
    orders_out.post(orders);
    const test_support::AllocationCounter counter;
    devices.read(cycle * 1'000'000, inputs);
    devices.write(outputs);
    allocations += counter.count();
    for (const hrtc_service::ProbeInput& input : inputs) active += input.active ? 1 : 0;
  }
  EXPECT_EQ(allocations, 0u);
  EXPECT_GT(active, 4000u);
}

}  // namespace
}  // namespace tactus
