// Hosts withdraw objects while users touch them: all memory must be freed, and no force may step.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <malloc.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <random>

#include "host_service/host_core.hpp"
#include "hrtc_service/contact_logger.hpp"
#include "hrtc_service/hrtc_core.hpp"
#include "hrtc_service/membership.hpp"
#include "spm/codec/model_codec.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "tests/support/constants.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::hrtc_service {
namespace {

constexpr double kTipRadius = 0.003, kSphereRadius = 0.05;  // m
constexpr double kPenetration = 0.0015;                     // m, of the tip into a sphere

/// The model of a sphere.
class Sphere {
 public:
  explicit Sphere(std::uint32_t faces)
      : built_{spm::offline::build_model(spm::offline::generate(spm::offline::Shape::kSphere, faces))},
        encoded_{built_.model()} {}
  [[nodiscard]] const spm::codec::CompressedModel& model() const { return encoded_.compressed(); }
  [[nodiscard]] double scale() const {
    const spm::ModelSummary& summary = model().summary();
    return 2 * kSphereRadius / (summary.bounds_max[0] - summary.bounds_min[0]);
  }

 private:
  spm::offline::BuiltModel built_;
  spm::codec::EncodedModel encoded_;
};

const Sphere& small_sphere() {
  static const Sphere kSphere{600};
  return kSphere;
}
const Sphere& large_sphere() {
  static const Sphere kSphere{12000};
  return kSphere;
}

/// An HRTC with one tip, and hosts that offer one sphere each. Samples arrive without delay.
class WithdrawalTest : public testing::Test {
 protected:
  struct Host {
    std::unique_ptr<host_service::HostCore> core;
    session::Origin origin;
    bool connected = true;
  };

  WithdrawalTest() { start(spm::PoolSettings::for_slots(1 << 14)); }

  void start(const spm::PoolSettings& pool) {
    const session::Origin self{session::id_of("session"), session::id_of("hrtc"), 1, 0};
    HrtcCoreSettings settings;
    settings.pool = pool;
    settings.servo.cycle.force.soft_start = 0.01;
    for (haptics::DeviceSpec& spec : settings.servo.specs) spec.max_torque = 1;
    settings.logs_queries = true;
    membership_.reset();
    core_ = std::make_unique<HrtcCore>(self, settings);
    membership_ = std::make_unique<Membership>(self, MembershipSettings{"hrtc", "session"}, core_->gateway(), now_);
    membership_->on_object_gone = [this](const Loader::ObjectInfo& object) { removed_.push_back(object); };
    inputs_[0].active = true;
    move_tip({1, 1, 1});
  }

  /// `position`: centre of the sphere, m. `mass`: kg; 0: the object is static.
  Host& add_host(const std::string& name, const std::string& object, const Sphere& sphere, const spm::Vec3d& position,
                 double mass = 0) {
    host_service::HostCoreSettings settings = host_service::host_of(object, sphere.model());
    settings.name = name;
    host_service::ObjectConfig& config = settings.objects.front().config;
    config.pose.emplace().position = {position.x(), position.y(), position.z()};
    config.scale = sphere.scale();
    if (mass > 0) config.body = {mass, {}, 0.5, -kSphereRadius};  // the sphere stands on the ground
    const session::Origin origin{session::id_of("session"), session::id_of(name), ++incarnations_, 0};
    hosts_.push_back(
        std::make_unique<Host>(Host{std::make_unique<host_service::HostCore>(origin, settings, now_), origin}));
    return *hosts_.back();
  }
  /// Ends the host: it withdraws its objects and publishes its leave message.
  void leave(Host& host) {
    withdraw(host);
    publish_leave_message(host);
  }
  void publish_leave_message(Host& host) {
    session::RosterEntry leave_message = host.core->roster_entry(now_);
    leave_message.leaving = true;
    membership_->on_roster(leave_message, now_);
    host.connected = false;
  }
  void withdraw(Host& host) {
    for (session::CatalogueEntry entry : host.core->catalogue()) {
      entry.withdrawn = true;
      membership_->on_catalogue(entry);
    }
  }

  void move_tip(const spm::Vec3d& position) { inputs_[0].device.position = position; }
  /// Runs one cycle. Samples are exchanged in every second cycle. `units`: refinement budget.
  const ProbeOutput& step(std::uint32_t units = 1u << 20) {
    now_ += kMs;
    if (++cycles_ % 2 == 0) exchange();
    inputs_[0].device.time_ns = now_;
    (void)core_->servo().touch(inputs_, now_);
    core_->servo().publish(now_, now_ + kMs);
    (void)core_->servo().refine(spm::Budget{units});
    return core_->servo().outputs()[0];
  }
  void exchange() {
    Gateway& gateway = core_->gateway();
    for (const std::unique_ptr<Host>& host : hosts_) {
      if (!host->connected) continue;
      const host_service::HostMessages& messages = host->core->tick(now_);
      if (messages.roster) membership_->on_roster(*messages.roster, now_);
      if (messages.catalogue)
        for (session::CatalogueEntry entry : host->core->catalogue()) {
          if (change_entry_) change_entry_(entry);
          membership_->on_catalogue(entry);
        }
      for (const session::ObjectGrant& grant : messages.grants) gateway.on_grant(grant, now_);
    }
    gateway.tick(now_, membership_->clock());
    membership_->tick(now_);
    const std::optional<session::RosterEntry> entry = membership_->output.roster;
    membership_->output.clear();
    std::vector<session::Demand> demands;
    while (auto demand = gateway.demand(now_)) demands.push_back(*demand);
    for (const std::unique_ptr<Host>& host : hosts_) {
      if (!host->connected) continue;
      if (entry) host->core->on_roster(*entry, now_);
      for (const session::Demand& demand : demands) host->core->on_demand(demand, now_);
      for (const session::ObjectClaim& claim : gateway.claims()) host->core->on_claim(claim, now_);
      while (auto outgoing = host->core->next_chunk(now_)) gateway.on_chunk(outgoing->chunk, now_);
    }
    core_->tick_intake();
  }
  /// Runs until `condition` holds, at most `cycles`. Returns whether it holds.
  template <class Condition>
  [[nodiscard]] bool run_until(Condition&& condition, int cycles = 3000, std::uint32_t units = 1u << 20) {
    for (int cycle = 0; cycle < cycles; ++cycle) {
      step(units);
      if (condition()) return true;
    }
    return false;
  }
  void run(int cycles) {
    for (int cycle = 0; cycle < cycles; ++cycle) step();
  }
  /// Returns whether the tip is in exact contact and the force is no longer ramped.
  [[nodiscard]] bool touches() const {
    constexpr std::uint32_t kExactContact = session::kInContact | session::kExact;
    const ProbeOutput& probe = core_->servo().outputs()[0];
    return (probe.status & (kExactContact | session::kForceRamped)) == kExactContact && force() > 0.2;
  }
  [[nodiscard]] double force() const { return vec(core_->servo().outputs()[0].force).norm(); }
  /// Returns a position of a tip that presses on the sphere around `centre`. `angle`: rad about the z axis.
  [[nodiscard]] static spm::Vec3d pressed_on(const spm::Vec3d& centre, double angle = 0) {
    return centre + (kSphereRadius + kTipRadius - kPenetration) * spm::Vec3d{std::cos(angle), std::sin(angle), 0};
  }
  /// The use of the memory that all objects share.
  struct MemoryUse {
    std::uint32_t slots, blocks, compressed, nodes;
    std::uint64_t directories;
    std::size_t objects, streams, delivered;
    bool operator==(const MemoryUse& other) const {
      return slots == other.slots && blocks == other.blocks && compressed == other.compressed && nodes == other.nodes &&
             directories == other.directories && objects == other.objects && streams == other.streams &&
             delivered == other.delivered;
    }
  };
  [[nodiscard]] MemoryUse memory_use() const {
    const Loader& loader = core_->gateway().loader();
    const LoaderFigures figures = loader.figures();
    const session::DeliveryClient::Sizes sizes = loader.delivery_sizes();
    return {figures.slots_used,
            core_->pool().settings.list_blocks - core_->intake().objects().cache().blocks_free(),
            figures.compressed_used,
            core_->nodes().used_nodes(),
            loader.directory_bytes_used(),
            loader.objects().size() + loader.withdrawn_objects().size() + core_->servo().cycle().objects().size() +
                core_->servo().cycle().withdrawn_objects().size(),
            sizes.streams,
            sizes.objects};
  }

  std::int64_t now_ = 10'000 * kMs;
  std::uint64_t cycles_ = 0, incarnations_ = 0;
  std::unique_ptr<HrtcCore> core_;
  std::unique_ptr<Membership> membership_;
  std::vector<std::unique_ptr<Host>> hosts_;
  Servo::Inputs inputs_{};
  std::vector<Loader::ObjectInfo> removed_;
  std::function<void(session::CatalogueEntry&)> change_entry_;
};

TEST_F(WithdrawalTest, TheForceFadesAndAllMemoryIsFreedWhenATouchedObjectIsWithdrawn) {
  const MemoryUse before = memory_use();
  Host& host = add_host("host", "sphere", large_sphere(), {0, 0, 0});
  move_tip(pressed_on({0, 0, 0}));
  ASSERT_TRUE(run_until([&] { return touches(); }));
  run(300);
  ASSERT_FALSE(memory_use() == before);
  double previous_force = force();
  const double initial_force = previous_force;
  leave(host);
  int cycles = 0;
  bool faded = false;
  for (; cycles < 1000 && !(memory_use() == before); ++cycles) {
    const ProbeOutput& probe = step();
    EXPECT_NEAR(force(), previous_force, 1.01e-3 * haptics::kSurfaceRamp) << cycles;
    EXPECT_EQ(probe.status & (session::kFault | session::kHoldRefused), 0u);
    faded = faded || (probe.status & session::kForceRamped) != 0;
    previous_force = force();
    if (cycles > 2) {
      EXPECT_EQ(probe.status & session::kInContact, 0u);
      EXPECT_EQ(probe.object, spm::kNone);
    }
    const CycleCosts& costs = core_->servo().cycle().result().costs;
    EXPECT_LE(costs.changes, 32u) << "a withdrawal takes only a share of the time of each cycle";
  }
  const MemoryUse after = memory_use();
  EXPECT_TRUE(after == before) << "in use after " << cycles << " cycles: " << after.slots << " slots, " << after.nodes
                               << " nodes, " << after.compressed << " blocks";
  EXPECT_TRUE(faded);
  EXPECT_GT(initial_force, 0.5);
  run(static_cast<int>(1000 * initial_force / haptics::kSurfaceRamp) + 5);
  EXPECT_EQ(force(), 0);
  ASSERT_EQ(removed_.size(), 1u);
  EXPECT_GT(removed_.front().regions_received, 0u);
  EXPECT_EQ(removed_.front().regions_received, removed_.front().regions_released);
}

TEST_F(WithdrawalTest, AThousandOfferedAndWithdrawnObjectsLeaveNoMemoryInUse) {
  const MemoryUse before = memory_use();
  std::vector<std::uint32_t> indices(kMaxObjects, 0);
  std::uint64_t heap_bytes = 0, removals = 0;
  membership_->on_object_gone = [&](const Loader::ObjectInfo&) { ++removals; };
  for (int number = 0; number < 1000; ++number) {
    Host& host = add_host("host", "sphere " + std::to_string(number), small_sphere(), {0, 0, 0});
    move_tip(pressed_on({0, 0, 0}));
    ASSERT_TRUE(run_until([&] { return touches(); })) << number;
    ++indices[core_->servo().outputs()[0].object];
    leave(host);
    ASSERT_TRUE(run_until([&] { return memory_use() == before && force() == 0; })) << number;
    hosts_.clear();
    const struct mallinfo2 info = mallinfo2();
    if (number == 200) heap_bytes = info.uordblks;
    if (number == 999) {
      EXPECT_LT(info.uordblks, heap_bytes + (1u << 17));
    }
  }
  EXPECT_EQ(removals, 1000u);
  EXPECT_THAT(indices, testing::Each(testing::Ge(15u))) << "all indices are used in turn";
}

TEST_F(WithdrawalTest, ABaseMeshThatTheCatalogueDoesNotDescribeLeavesNoMemoryInUse) {
  const MemoryUse before = memory_use();
  const std::vector<std::function<void(spm::ModelSummary&)>> changes{
      [](spm::ModelSummary& summary) { summary.base_faces *= 2; },
      [](spm::ModelSummary& summary) { summary.base_faces *= 1000; },
      [](spm::ModelSummary& summary) { summary.faces = spm::kMaxFaces - 1; },
      [](spm::ModelSummary& summary) { summary.grid.cell_size *= 2; },
  };
  for (std::size_t change = 0; change < changes.size(); ++change) {
    change_entry_ = [&](session::CatalogueEntry& entry) { changes[change](entry.summary); };
    Host& host = add_host("host", "sphere " + std::to_string(change), small_sphere(), {0, 0, 0});
    move_tip(pressed_on({0, 0, 0}));
    EXPECT_FALSE(run_until([&] { return touches(); }, 1000)) << change;
    leave(host);
    EXPECT_TRUE(run_until([&] { return memory_use() == before; })) << change;
    hosts_.clear();
  }
}

TEST_F(WithdrawalTest, AWithdrawalDuringRefinementFreesTheMemoryOfTheObject) {
  const MemoryUse before = memory_use();
  std::mt19937 random{7};
  int interrupted = 0;
  for (int round = 0; round < 60; ++round) {
    SCOPED_TRACE(round);
    Host& host = add_host("host", "sphere", large_sphere(), {0, 0, 0});
    move_tip(pressed_on({0, 0, 0}));
    const auto units = static_cast<std::uint32_t>(17 + random() % 600);
    const auto cycles = static_cast<int>(random() % 400);
    for (int cycle = 0; cycle < cycles; ++cycle) {
      move_tip(pressed_on({0, 0, 0}, 0.02 * cycle));
      step(units);
    }
    interrupted += core_->servo().cycle().result().budget_spent ? 1 : 0;
    leave(host);
    ASSERT_TRUE(run_until([&] { return memory_use() == before; }, 20'000, units));
    hosts_.clear();
  }
  EXPECT_GT(interrupted, 20);
}

TEST_F(WithdrawalTest, AnotherModelOfTheSameNameIsShownAfterTheFirstIsRemoved) {
  Host& first = add_host("first", "sphere", large_sphere(), {0, 0, 0});
  move_tip(pressed_on({0, 0, 0}));
  ASSERT_TRUE(run_until([&] { return touches(); }));
  const std::uint32_t index = core_->servo().outputs()[0].object;
  std::vector<std::string> warnings;
  core_->gateway().on_event = [&](session::Severity severity, const std::string& text) {
    if (severity == session::Severity::kWarning) warnings.push_back(text);
  };
  add_host("second", "sphere", small_sphere(), {0, 0, 0});
  run(1000);
  EXPECT_THAT(warnings,
              testing::ElementsAre("object sphere: host 'second' serves another model of this name, which is "
                                   "ignored while host 'first' serves its model; rename one of the two objects"));
  EXPECT_EQ(core_->servo().cycle().objects().front()->digest, large_sphere().model().summary().digest);
  leave(first);
  ASSERT_TRUE(run_until([&] { return !removed_.empty() && touches(); }));
  ASSERT_EQ(core_->servo().cycle().objects().size(), 1u);
  EXPECT_EQ(core_->servo().cycle().objects().front()->digest, small_sphere().model().summary().digest);
  EXPECT_NE(core_->servo().outputs()[0].object, index);
}

TEST_F(WithdrawalTest, AnObjectThatIsOfferedAgainDuringItsRemovalIsLoadedAgain) {
  Host& host = add_host("host", "sphere", large_sphere(), {0, 0, 0});
  move_tip(pressed_on({0, 0, 0}));
  ASSERT_TRUE(run_until([&] { return touches(); }));
  withdraw(host);
  for (const session::CatalogueEntry& entry : host.core->catalogue()) membership_->on_catalogue(entry);
  EXPECT_TRUE(run_until([&] { return !removed_.empty() && touches(); }));
}

TEST_F(WithdrawalTest, AnObjectOfADeadHostStaysUntilTheRestartedHostWithdrawsIt) {
  Host& dead = add_host("host", "sphere", large_sphere(), {0, 0, 0});
  move_tip(pressed_on({0, 0, 0}));
  ASSERT_TRUE(run_until([&] { return touches(); }));
  dead.connected = false;
  for (int cycle = 0; cycle < 15'000; ++cycle) {
    step();
    ASSERT_TRUE(touches()) << cycle;
  }
  EXPECT_EQ(core_->gateway().loader().delivery_sizes().offers, 0u)
      << "the offers of the dead host are removed, its object is not";
  Host& restarted = add_host("host", "sphere", large_sphere(), {0, 0, 0});
  run(500);
  EXPECT_TRUE(touches());
  EXPECT_TRUE(removed_.empty());
  leave(restarted);
  EXPECT_TRUE(run_until([&] { return !removed_.empty(); }));
}

TEST_F(WithdrawalTest, AnObjectStaysWhileAnotherHostOffersIt) {
  Host& first = add_host("first", "sphere", large_sphere(), {0, 0, 0});
  Host& second = add_host("second", "sphere", large_sphere(), {0, 0, 0});
  move_tip(pressed_on({0, 0, 0}));
  ASSERT_TRUE(run_until([&] { return touches(); }));
  run(300);
  leave(first);
  for (int cycle = 0; cycle < 500; ++cycle) {
    step();
    ASSERT_TRUE(touches()) << cycle;
  }
  leave(second);
  EXPECT_TRUE(run_until([&] { return !removed_.empty(); }));
}

TEST_F(WithdrawalTest, ASecondHostOfTheSameNameWithdrawsOnlyItsOwnOffer) {
  add_host("host", "sphere", large_sphere(), {0, 0, 0});
  move_tip(pressed_on({0, 0, 0}));
  ASSERT_TRUE(run_until([&] { return touches(); }));
  Host& second = add_host("host", "sphere", large_sphere(), {0, 0, 0});
  run(300);
  leave(second);
  for (int cycle = 0; cycle < 1500; ++cycle) {
    step();
    ASSERT_TRUE(touches()) << cycle;
  }
  EXPECT_TRUE(removed_.empty());
}

TEST_F(WithdrawalTest, ALeaveMessageAloneWithdrawsTheObjectsOfItsHost) {
  Host& host = add_host("host", "sphere", large_sphere(), {0, 0, 0});
  move_tip(pressed_on({0, 0, 0}));
  ASSERT_TRUE(run_until([&] { return touches(); }));
  publish_leave_message(host);
  EXPECT_TRUE(run_until([&] { return !removed_.empty(); }));
}

TEST_F(WithdrawalTest, AnotherObjectStaysInExactContactDuringAWithdrawal) {
  Host& leaving = add_host("leaving", "leaving", large_sphere(), {0, 0, 0});
  add_host("staying", "staying", large_sphere(), {0.2, 0, 0});
  const spm::Vec3d staying{0.2, 0, 0};
  move_tip(pressed_on({0, 0, 0}));
  ASSERT_TRUE(run_until([&] { return touches(); }));
  inputs_[1] = inputs_[0];
  inputs_[1].device.position = pressed_on(staying);
  run(500);
  leave(leaving);
  move_tip({1, 1, 1});
  bool removed = false;
  for (int cycle = 0; cycle < 1000; ++cycle) {
    inputs_[1].device.position = pressed_on(staying, 1e-3 * cycle);
    inputs_[1].device.time_ns = now_;
    step();
    const ProbeOutput& probe = core_->servo().outputs()[1];
    ASSERT_NE(probe.status & session::kInContact, 0u) << cycle;
    ASSERT_NE(probe.status & session::kExact, 0u) << cycle;
    removed = removed || !removed_.empty();
  }
  EXPECT_TRUE(removed);
}

TEST_F(WithdrawalTest, AHandReleasesAWithdrawnObjectAndItsWrenchFades) {
  Host& host = add_host("host", "crate", large_sphere(), {0, 0, 0}, 0.5);
  move_tip(pressed_on({0, 0, 0}));
  ASSERT_TRUE(run_until([&] { return (core_->servo().outputs()[0].status & session::kInContact) != 0; }));
  inputs_[0].device.buttons = haptics::kGrabButton;
  ASSERT_TRUE(run_until([&] { return (core_->servo().outputs()[0].status & session::kHolding) != 0; }));
  double angle = 0;
  const auto pull_and_rotate = [&] {
    angle = std::min(angle + 0.001, 0.15);
    move_tip(inputs_[0].device.position + spm::Vec3d{0, 0, angle < 0.15 ? 2e-5 : 0});
    inputs_[0].device.orientation = Eigen::Quaterniond{Eigen::AngleAxisd{angle, spm::Vec3d::UnitX()}};
  };
  for (int cycle = 0; cycle < 200; ++cycle) {
    pull_and_rotate();
    step();
  }
  ASSERT_EQ(core_->gateway().ownership().bodies().size(), 1u);
  spm::Vec3d previous_force = vec(core_->servo().outputs()[0].force);
  spm::Vec3d previous_torque = vec(core_->servo().outputs()[0].torque);
  EXPECT_GT(previous_force.norm() + previous_torque.norm(), 0.05);
  leave(host);
  for (int cycle = 0; cycle < 600; ++cycle) {
    const ProbeOutput& probe = step();
    EXPECT_LE((vec(probe.force) - previous_force).norm(), 1.01e-3 * haptics::kSurfaceRamp) << cycle;
    EXPECT_LE((vec(probe.torque) - previous_torque).norm(), 1.01e-3 * haptics::kTorqueRamp) << cycle;
    previous_force = vec(probe.force);
    previous_torque = vec(probe.torque);
    if (cycle > 2) {
      EXPECT_EQ(probe.status & (session::kHolding | session::kFault), 0u) << cycle;
    }
  }
  EXPECT_EQ(previous_force.norm() + previous_torque.norm(), 0);
  ASSERT_EQ(removed_.size(), 1u);
  EXPECT_TRUE(core_->gateway().ownership().bodies().empty());

  // After the object is offered again, the hand can hold it, but only after the hand has opened.
  add_host("host", "crate", large_sphere(), {0, 0, 0}, 0.5);
  move_tip(pressed_on({0, 0, 0}));
  inputs_[0].device.orientation.setIdentity();
  ASSERT_TRUE(run_until([&] { return (core_->servo().outputs()[0].status & session::kInContact) != 0; }));
  run(50);
  EXPECT_NE(core_->servo().outputs()[0].status & session::kHoldRefused, 0u)
      << "the hand has not opened since the withdrawal";
  inputs_[0].device.buttons = 0;
  run(50);
  inputs_[0].device.buttons = haptics::kGrabButton;
  EXPECT_TRUE(run_until([&] { return (core_->servo().outputs()[0].status & session::kHolding) != 0; }));
}

TEST_F(WithdrawalTest, TheNinthMovableObjectStaysFixedAfterAnotherIsRemoved) {
  std::vector<std::string> events;
  core_->gateway().on_event = [&](session::Severity, const std::string& text) { events.push_back(text); };
  const spm::Vec3d ninth{0, 1, 0};
  for (int number = 0; number < 8; ++number)
    add_host("host " + std::to_string(number), "crate " + std::to_string(number), small_sphere(), {0.2 * number, 0, 0},
             0.5);
  ASSERT_TRUE(run_until([&] { return core_->servo().cycle().objects().size() == 8; }));
  add_host("host", "ninth", small_sphere(), ninth, 0.5);
  ASSERT_TRUE(run_until([&] { return core_->servo().cycle().objects().size() == 9; }));
  EXPECT_THAT(events, testing::Contains("object ninth stays fixed: an HRTC simulates at most 8 movable objects"));
  leave(*hosts_.front());
  ASSERT_TRUE(run_until([&] { return removed_.size() == 1; }));
  move_tip(pressed_on(ninth));
  ASSERT_TRUE(run_until([&] { return touches(); }));
  run(500);
  EXPECT_TRUE(touches()) << "a movable object would have moved away from the tip";
  BodyReports reports;
  ASSERT_TRUE(MailboxReader{core_->link().bodies.reports}.take(reports));
  EXPECT_EQ(reports.count, 7u);
  EXPECT_EQ(core_->gateway().ownership().bodies().size(), 7u);
}

TEST_F(WithdrawalTest, AnObjectThatDidNotFitIsLoadedAfterAnotherIsRemoved) {
  start(spm::PoolSettings::for_slots(spm::Cache::slots_for_base(large_sphere().model().summary()) + 200));
  Host& first = add_host("first", "first", large_sphere(), {0, 0, 0});
  ASSERT_TRUE(run_until([&] { return core_->servo().cycle().objects().size() == 1; }));
  add_host("second", "second", large_sphere(), {0.2, 0, 0});
  ASSERT_TRUE(run_until([&] { return core_->gateway().loader().figures().objects_refused == 1; }));
  leave(first);
  EXPECT_TRUE(run_until([&] {
    const std::vector<TouchObject*>& objects = core_->servo().cycle().objects();
    return objects.size() == 1 && objects.front()->name == "second";
  }));
}

TEST_F(WithdrawalTest, TheContactLogNamesTheRightObjectWhenAnIndexIsReused) {
  const test_support::TemporaryFolder folder;
  const std::filesystem::path file = folder.path() / "contacts";
  constexpr int kObjects = static_cast<int>(kMaxObjects) + 3;
  {
    ContactLogger logger{file, core_->log()};
    core_->gateway().on_object = [&](const ObjectDescription& object) { logger.add(object); };
    membership_->on_object_gone = [&](const Loader::ObjectInfo& object) {
      removed_.push_back(object);
      logger.close(object);
    };
    for (int number = 0; number < kObjects; ++number) {
      Host& host = add_host("host", "sphere " + std::to_string(number),
                            number % 2 == 0 ? small_sphere() : large_sphere(), {0, 0, 0});
      move_tip(pressed_on({0, 0, 0}));
      ASSERT_TRUE(run_until([&] { return touches(); }));
      leave(host);
      ASSERT_TRUE(run_until([&] { return removed_.size() == static_cast<std::size_t>(number) + 1; }));
      hosts_.clear();
    }
  }
  trace::ContactLogReader reader{file};
  std::vector<trace::LoggedObject> objects;
  int totals = 0, queries = 0;
  for (auto entry = reader.next(); entry != trace::ContactLogReader::Entry::kEnd; entry = reader.next()) {
    if (entry == trace::ContactLogReader::Entry::kObject) {
      ASSERT_EQ(reader.object.index, objects.size());
      objects.push_back(reader.object);
    } else if (entry == trace::ContactLogReader::Entry::kQuery) {
      ASSERT_EQ(reader.query.object, objects.size() - 1) << "only one object is present at a time";
      ++queries;
    } else {
      ASSERT_EQ(reader.totals.object, objects.size() - 1);
      EXPECT_GT(reader.totals.regions_received, 0u);
      ++totals;
    }
  }
  ASSERT_EQ(objects.size(), static_cast<std::size_t>(kObjects));
  EXPECT_EQ(totals, kObjects);
  EXPECT_GT(queries, 100);
  EXPECT_EQ(objects.back().name, "sphere " + std::to_string(kObjects - 1));
}

}  // namespace
}  // namespace tactus::hrtc_service
