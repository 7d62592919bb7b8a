// Objects that their hosts withdraw: nothing of them stays, and hands feel no step.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <malloc.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <random>

#include "host_service/host_core.hpp"
#include "hrtc_service/contact_journal.hpp"
#include "hrtc_service/hrtc_core.hpp"
#include "hrtc_service/membership.hpp"
#include "spm/codec/model_codec.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::hrtc_service {
namespace {

constexpr std::int64_t kMs = 1'000'000;
constexpr double kTip = 0.003, kRadius = 0.05;  // m, of the tip and of all balls
constexpr double kDeep = 0.0015;                // m, the tip in a sphere

/// A sphere of the given number of faces.
class Sphere {
 public:
  explicit Sphere(std::uint32_t faces)
      : built_{spm::offline::build_model(spm::offline::generate(spm::offline::Shape::kSphere, faces))},
        encoded_{built_.model()} {}
  [[nodiscard]] const spm::codec::CompressedModel& model() const { return encoded_.compressed(); }
  [[nodiscard]] double scale() const {
    const spm::ModelSummary& summary = model().summary();
    return 2 * kRadius / (summary.bounds_max[0] - summary.bounds_min[0]);
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

/// An HRTC with one tip, and hosts of one sphere each, without delay between them.
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
    membership_->on_object_gone = [this](const Loader::ObjectInfo& object) { gone_.push_back(object); };
    inputs_[0].active = true;
    tip({1, 1, 1});
  }

  Host& host(const std::string& name, const std::string& object, const Sphere& sphere, const spm::Vec3d& at,
             double mass = 0) {
    host_service::HostCoreSettings settings = host_service::host_of(object, sphere.model());
    settings.name = name;
    host_service::ObjectConfig& config = settings.objects.front().config;
    config.pose.emplace().position = {at.x(), at.y(), at.z()};
    config.scale = sphere.scale();
    if (mass > 0) config.body = {mass, {}, 0.5, -kRadius};  // it stands
    const session::Origin origin{session::id_of("session"), session::id_of(name), ++incarnations_, 0};
    hosts_.push_back(
        std::make_unique<Host>(Host{std::make_unique<host_service::HostCore>(origin, settings, now_), origin}));
    return *hosts_.back();
  }
  /// As a host does that ends.
  void leave(Host& host) {
    withdraw(host);
    session::RosterEntry last = host.core->roster_entry(now_);
    last.leaving = true;
    membership_->on_roster(last, now_);
    host.connected = false;
  }
  void withdraw(Host& host) {
    for (session::CatalogueEntry entry : host.core->catalogue()) {
      entry.withdrawn = true;
      membership_->on_catalogue(entry);
    }
  }

  void tip(const spm::Vec3d& at) { inputs_[0].device.position = at; }
  /// One cycle; the network and the service work in every second one.
  const ProbeOutput& step(std::uint32_t units = 1u << 20) {
    now_ += kMs;
    if (++cycles_ % 2 == 0) serve();
    inputs_[0].device.time_ns = now_;
    (void)core_->servo().touch(inputs_, now_);
    core_->servo().publish(now_, now_ + kMs);
    (void)core_->servo().refine(spm::Budget{units});
    return core_->servo().outputs()[0];
  }
  void serve() {
    Gateway& gateway = core_->gateway();
    for (const std::unique_ptr<Host>& host : hosts_) {
      if (!host->connected) continue;
      const host_service::HostMessages& messages = host->core->tick(now_);
      if (messages.roster) membership_->on_roster(*messages.roster, now_);
      if (messages.catalogue)
        for (const session::CatalogueEntry& entry : host->core->catalogue()) membership_->on_catalogue(entry);
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
      while (auto out = host->core->next_chunk(now_)) gateway.on_chunk(out->chunk, now_);
    }
  }
  /// Until it holds, at most so many cycles.
  template <class Holds>
  [[nodiscard]] bool run_until(Holds&& holds, int cycles = 3000, std::uint32_t units = 1u << 20) {
    for (int cycle = 0; cycle < cycles; ++cycle) {
      step(units);
      if (holds()) return true;
    }
    return false;
  }
  void run(int cycles) {
    for (int cycle = 0; cycle < cycles; ++cycle) step();
  }
  /// Exact contact with full force.
  [[nodiscard]] bool touches() const {
    constexpr std::uint32_t kWanted = session::kInContact | session::kExact;
    const ProbeOutput& probe = core_->servo().outputs()[0];
    return (probe.status & (kWanted | session::kForceRamped)) == kWanted && force() > 0.2;
  }
  [[nodiscard]] double force() const { return vec(core_->servo().outputs()[0].force).norm(); }
  [[nodiscard]] static spm::Vec3d deep_in(const spm::Vec3d& sphere) {
    return sphere + spm::Vec3d{kRadius + kTip - kDeep, 0, 0};
  }
  /// What is in use of the memory that objects share.
  struct Level {
    std::uint32_t slots, blocks, compressed, nodes;
    std::uint64_t directories;
    std::size_t objects, streams, delivered;
    bool operator==(const Level& other) const {
      return slots == other.slots && blocks == other.blocks && compressed == other.compressed && nodes == other.nodes &&
             directories == other.directories && objects == other.objects && streams == other.streams &&
             delivered == other.delivered;
    }
  };
  [[nodiscard]] Level level() const {
    const Loader& loader = core_->gateway().loader();
    const LoaderFigures figures = loader.figures();
    const session::DeliveryClient::Sizes sizes = loader.delivery_sizes();
    return {figures.slots_used,
            loader.list_blocks_used(),
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
  std::vector<Loader::ObjectInfo> gone_;
};

TEST_F(WithdrawalTest, AnObjectThatIsWithdrawnUnderATipFadesAndFreesAllThatItTook) {
  const Level before = level();
  Host& only = host("host", "sphere", large_sphere(), {0, 0, 0});
  tip(deep_in({0, 0, 0}));
  ASSERT_TRUE(run_until([&] { return touches(); }));
  run(300);
  ASSERT_FALSE(level() == before);
  double last = force();
  const double at_first = last;
  leave(only);
  int cycles = 0;
  bool faded = false;
  for (; cycles < 1000 && !(level() == before); ++cycles) {
    const ProbeOutput& probe = step();
    EXPECT_NEAR(force(), last, 1.01e-3 * haptics::kSurfaceRamp) << cycles;
    EXPECT_EQ(probe.status & (session::kFault | session::kHoldRefused), 0u);
    faded = faded || (probe.status & session::kForceRamped) != 0;
    last = force();
    if (cycles > 2) {
      EXPECT_EQ(probe.status & session::kInContact, 0u);
      EXPECT_EQ(probe.object, spm::kNone);
    }
    const CycleCosts& costs = core_->servo().cycle().result().costs;
    EXPECT_LE(costs.changes, 32u) << "of a cycle's time a share only";
  }
  EXPECT_TRUE(level() == before) << "after " << cycles << " cycles " << level().slots << " slots, " << level().nodes
                                 << " nodes, " << level().compressed << " blocks";
  EXPECT_TRUE(faded);
  EXPECT_GT(at_first, 0.5);
  run(static_cast<int>(1000 * at_first / haptics::kSurfaceRamp) + 5);
  EXPECT_EQ(force(), 0);
  ASSERT_EQ(gone_.size(), 1u);
  EXPECT_GT(gone_.front().regions_received, 0u);
  EXPECT_EQ(gone_.front().regions_received, gone_.front().regions_released);
}

TEST_F(WithdrawalTest, AThousandObjectsThatComeAndGoLeaveNothing) {
  const Level before = level();
  std::vector<std::uint32_t> indices(kMaxObjects, 0);
  std::uint64_t heap = 0, gone = 0;
  membership_->on_object_gone = [&](const Loader::ObjectInfo&) { ++gone; };
  for (int number = 0; number < 1000; ++number) {
    Host& one = host("host", "sphere " + std::to_string(number), small_sphere(), {0, 0, 0});
    tip(deep_in({0, 0, 0}));
    ASSERT_TRUE(run_until([&] { return touches(); })) << number;
    ++indices[core_->servo().outputs()[0].object];
    leave(one);
    ASSERT_TRUE(run_until([&] { return level() == before && force() == 0; })) << number;
    hosts_.clear();
    const struct mallinfo2 info = mallinfo2();
    if (number == 200) heap = info.uordblks;
    if (number == 999) {
      EXPECT_LT(info.uordblks, heap + (1u << 17));
    }
  }
  EXPECT_EQ(gone, 1000u);
  EXPECT_THAT(indices, testing::Each(testing::Ge(15u))) << "an index comes again as late as it can";
}

TEST_F(WithdrawalTest, AWithdrawalDuringARefinementFreesAllThatItTook) {
  const Level before = level();
  std::mt19937 random{7};
  int partly = 0;
  for (int round = 0; round < 60; ++round) {
    SCOPED_TRACE(round);
    Host& one = host("host", "sphere", large_sphere(), {0, 0, 0});
    tip(deep_in({0, 0, 0}));
    const auto units = static_cast<std::uint32_t>(17 + random() % 600);
    const auto cycles = static_cast<int>(random() % 400);
    for (int cycle = 0; cycle < cycles; ++cycle) {
      const double angle = 0.02 * cycle;
      tip((kRadius + kTip - kDeep) * spm::Vec3d{std::cos(angle), std::sin(angle), 0});
      step(units);
    }
    partly += core_->servo().cycle().result().budget_spent ? 1 : 0;
    leave(one);
    ASSERT_TRUE(run_until([&] { return level() == before; }, 20'000, units));
    hosts_.clear();
  }
  EXPECT_GT(partly, 20);
}

TEST_F(WithdrawalTest, TheSameNameWithAnotherModelIsShownOnceTheFirstIsGone) {
  Host& first = host("first", "sphere", large_sphere(), {0, 0, 0});
  tip(deep_in({0, 0, 0}));
  ASSERT_TRUE(run_until([&] { return touches(); }));
  const std::uint32_t index = core_->servo().outputs()[0].object;
  host("second", "sphere", small_sphere(), {0, 0, 0});
  run(1000);
  EXPECT_EQ(core_->servo().cycle().objects().front()->digest, large_sphere().model().summary().digest);
  leave(first);
  ASSERT_TRUE(run_until([&] { return !gone_.empty() && touches(); }));
  ASSERT_EQ(core_->servo().cycle().objects().size(), 1u);
  EXPECT_EQ(core_->servo().cycle().objects().front()->digest, small_sphere().model().summary().digest);
  EXPECT_NE(core_->servo().outputs()[0].object, index);
}

TEST_F(WithdrawalTest, AnObjectThatItsHostOffersAgainBeforeItIsGoneComesBack) {
  Host& only = host("host", "sphere", large_sphere(), {0, 0, 0});
  tip(deep_in({0, 0, 0}));
  ASSERT_TRUE(run_until([&] { return touches(); }));
  withdraw(only);
  for (const session::CatalogueEntry& entry : only.core->catalogue()) membership_->on_catalogue(entry);
  EXPECT_TRUE(run_until([&] { return !gone_.empty() && touches(); }));
}

TEST_F(WithdrawalTest, AnObjectOfADeadHostStaysUntilTheHostIsBackAndWithdrawsIt) {
  Host& dead = host("host", "sphere", large_sphere(), {0, 0, 0});
  tip(deep_in({0, 0, 0}));
  ASSERT_TRUE(run_until([&] { return touches(); }));
  dead.connected = false;
  for (int cycle = 0; cycle < 15'000; ++cycle) {
    step();
    ASSERT_TRUE(touches()) << cycle;
  }
  EXPECT_EQ(core_->gateway().loader().delivery_sizes().offers, 0u) << "its offers are forgotten, the object is not";
  Host& back = host("host", "sphere", large_sphere(), {0, 0, 0});
  run(500);
  EXPECT_TRUE(touches());
  EXPECT_TRUE(gone_.empty());
  leave(back);
  EXPECT_TRUE(run_until([&] { return !gone_.empty(); }));
}

TEST_F(WithdrawalTest, AnObjectStaysAsLongAsAnotherHostOffersIt) {
  Host& one = host("one", "sphere", large_sphere(), {0, 0, 0});
  Host& two = host("two", "sphere", large_sphere(), {0, 0, 0});
  tip(deep_in({0, 0, 0}));
  ASSERT_TRUE(run_until([&] { return touches(); }));
  run(300);
  leave(one);
  for (int cycle = 0; cycle < 500; ++cycle) {
    step();
    ASSERT_TRUE(touches()) << cycle;
  }
  leave(two);
  EXPECT_TRUE(run_until([&] { return !gone_.empty(); }));
}

TEST_F(WithdrawalTest, ASecondProgramOfTheHostsNameWithdrawsOnlyWhatItOffered) {
  host("host", "sphere", large_sphere(), {0, 0, 0});
  tip(deep_in({0, 0, 0}));
  ASSERT_TRUE(run_until([&] { return touches(); }));
  Host& second = host("host", "sphere", large_sphere(), {0, 0, 0});
  run(300);
  leave(second);
  for (int cycle = 0; cycle < 1500; ++cycle) {
    step();
    ASSERT_TRUE(touches()) << cycle;
  }
  EXPECT_TRUE(gone_.empty());
}

TEST_F(WithdrawalTest, AHostThatLeavesWithdrawsWhatItsCatalogueOnlyOffered) {
  Host& only = host("host", "sphere", large_sphere(), {0, 0, 0});
  tip(deep_in({0, 0, 0}));
  ASSERT_TRUE(run_until([&] { return touches(); }));
  session::RosterEntry last = only.core->roster_entry(now_);
  last.leaving = true;
  membership_->on_roster(last, now_);
  only.connected = false;
  EXPECT_TRUE(run_until([&] { return !gone_.empty(); }));
}

TEST_F(WithdrawalTest, AnotherObjectIsTouchedAndRefinedMeanwhile) {
  Host& going = host("going", "going", large_sphere(), {0, 0, 0});
  host("staying", "staying", large_sphere(), {0.2, 0, 0});
  const spm::Vec3d other{0.2, 0, 0};
  tip(deep_in({0, 0, 0}));
  ASSERT_TRUE(run_until([&] { return touches(); }));
  inputs_[1] = inputs_[0];
  inputs_[1].device.position = deep_in(other);
  run(500);
  leave(going);
  tip({1, 1, 1});
  bool left = false;
  for (int cycle = 0; cycle < 1000; ++cycle) {
    const double angle = 1e-3 * cycle;
    inputs_[1].device.position = other + (kRadius + kTip - kDeep) * spm::Vec3d{std::cos(angle), std::sin(angle), 0};
    inputs_[1].device.time_ns = now_;
    step();
    const ProbeOutput& probe = core_->servo().outputs()[1];
    ASSERT_NE(probe.status & session::kInContact, 0u) << cycle;
    ASSERT_NE(probe.status & session::kExact, 0u) << cycle;
    left = left || !gone_.empty();
  }
  EXPECT_TRUE(left);
}

TEST_F(WithdrawalTest, AHandLetsGoOfWhatIsWithdrawnAndItsForceFades) {
  Host& only = host("host", "crate", large_sphere(), {0, 0, 0}, 0.5);
  tip(deep_in({0, 0, 0}));
  ASSERT_TRUE(run_until([&] { return (core_->servo().outputs()[0].status & session::kInContact) != 0; }));
  inputs_[0].device.buttons = haptics::kGrabButton;
  ASSERT_TRUE(run_until([&] { return (core_->servo().outputs()[0].status & session::kHolding) != 0; }));
  double angle = 0;
  const auto pull = [&] {  // away, and turned
    angle = std::min(angle + 0.001, 0.15);
    tip(inputs_[0].device.position + spm::Vec3d{0, 0, angle < 0.15 ? 2e-5 : 0});
    inputs_[0].device.orientation = Eigen::Quaterniond{Eigen::AngleAxisd{angle, spm::Vec3d::UnitX()}};
  };
  for (int cycle = 0; cycle < 200; ++cycle) {
    pull();
    step();
  }
  ASSERT_EQ(core_->gateway().ownership().bodies().size(), 1u);
  spm::Vec3d last = vec(core_->servo().outputs()[0].force), last_torque = vec(core_->servo().outputs()[0].torque);
  EXPECT_GT(last.norm() + last_torque.norm(), 0.05);
  leave(only);
  for (int cycle = 0; cycle < 600; ++cycle) {
    const ProbeOutput& probe = step();
    EXPECT_LE((vec(probe.force) - last).norm(), 1.01e-3 * haptics::kSurfaceRamp) << cycle;
    EXPECT_LE((vec(probe.torque) - last_torque).norm(), 1.01e-3 * haptics::kTorqueRamp) << cycle;
    last = vec(probe.force);
    last_torque = vec(probe.torque);
    if (cycle > 2) {
      EXPECT_EQ(probe.status & (session::kHolding | session::kFault), 0u) << cycle;
    }
  }
  EXPECT_EQ(last.norm() + last_torque.norm(), 0);
  ASSERT_EQ(gone_.size(), 1u);
  EXPECT_TRUE(core_->gateway().ownership().bodies().empty());

  // It can be held again when it is there again, once the hand has opened.
  host("host", "crate", large_sphere(), {0, 0, 0}, 0.5);
  tip(deep_in({0, 0, 0}));
  inputs_[0].device.orientation.setIdentity();
  ASSERT_TRUE(run_until([&] { return (core_->servo().outputs()[0].status & session::kInContact) != 0; }));
  run(50);
  EXPECT_NE(core_->servo().outputs()[0].status & session::kHoldRefused, 0u) << "the hand is still closed";
  inputs_[0].device.buttons = 0;
  run(50);
  inputs_[0].device.buttons = haptics::kGrabButton;
  EXPECT_TRUE(run_until([&] { return (core_->servo().outputs()[0].status & session::kHolding) != 0; }));
}

TEST_F(WithdrawalTest, AnObjectThatFoundNoRoomComesWhenAnotherIsGone) {
  spm::PoolSettings pool =
      spm::PoolSettings::for_slots(spm::Cache::slots_for_base(large_sphere().model().base()) + 200);
  start(pool);
  Host& first = host("first", "first", large_sphere(), {0, 0, 0});
  ASSERT_TRUE(run_until([&] { return core_->servo().cycle().objects().size() == 1; }));
  host("second", "second", large_sphere(), {0.2, 0, 0});
  ASSERT_TRUE(run_until([&] { return core_->gateway().loader().figures().objects_refused == 1; }));
  leave(first);
  EXPECT_TRUE(run_until([&] {
    const std::vector<TouchObject*>& objects = core_->servo().cycle().objects();
    return objects.size() == 1 && objects.front()->name == "second";
  }));
}

TEST_F(WithdrawalTest, TheContactLogNamesTheRightObjectWhenAnIndexComesAgain) {
  const test_support::TemporaryFolder folder;
  const std::filesystem::path file = folder.path() / "contacts";
  constexpr int kObjects = static_cast<int>(kMaxObjects) + 3;
  {
    ContactJournal journal{file, core_->link().log};
    core_->gateway().on_object = [&](const TouchObject& object) { journal.add(object); };
    membership_->on_object_gone = [&](const Loader::ObjectInfo& object) {
      gone_.push_back(object);
      journal.close(object);
    };
    for (int number = 0; number < kObjects; ++number) {
      // A tip at a different place touches each object, so that an entry identifies its object.
      Host& one = host("host", "sphere " + std::to_string(number), number % 2 == 0 ? small_sphere() : large_sphere(),
                       {0, 0, 0});
      tip(deep_in({0, 0, 0}));
      ASSERT_TRUE(run_until([&] { return touches(); }));
      leave(one);
      ASSERT_TRUE(run_until([&] { return gone_.size() == static_cast<std::size_t>(number) + 1; }));
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
      ASSERT_EQ(reader.query.object, objects.size() - 1) << "of the only one that is there";
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
