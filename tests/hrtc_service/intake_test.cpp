// Tests the intake of a servo with wrong and damaged messages of the gateway.

#include "hrtc_service/servo/intake.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <random>
#include <span>

#include "hrtc_service/intake_sender.hpp"
#include "hrtc_service/servo/body_intake.hpp"
#include "hrtc_service/servo/servo.hpp"
#include "spm/checksum.hpp"
#include "spm/codec/load_region.hpp"
#include "spm/codec/model_codec.hpp"
#include "spm/directory.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "tests/support/constants.hpp"

namespace tactus::hrtc_service {
namespace {

using spm::AcceptResult;
using spm::RegionId;
using testing::IsEmpty;

constexpr std::uint64_t kSeed = 20261126;

class IntakeTest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    built_ = new spm::offline::BuiltModel{
        spm::offline::build_model(spm::offline::generate(spm::offline::Shape::kSphere, 4000))};
    encoded_ = new spm::codec::EncodedModel{built_->model()};
  }
  static void TearDownTestSuite() {
    delete encoded_;
    delete built_;
  }
  IntakeTest() { start(); }

  /// Replaces the servo and its memory by new ones. `max_force`: of each device, N.
  void start(double max_force = haptics::DeviceSpec{}.max_force) {
    servo_.reset();
    intake_.reset();
    link_ = std::make_unique<ServoLink>();
    intake_ = std::make_unique<Intake>(pool_, link_->intake);
    ServoSettings settings;
    settings.specs.fill({max_force});
    body_intake_ = std::make_unique<BodyIntake>(intake_->objects(), link_->bodies);
    servo_ = std::make_unique<Servo>(settings, *link_, *intake_, body_intake_->orders());
    sender_ = std::make_unique<IntakeSender>(link_->intake, pool_);
  }
  [[nodiscard]] static const spm::codec::CompressedModel& model() { return encoded_->compressed(); }
  [[nodiscard]] static IntakeObject object() {
    IntakeObject object;
    object.id = 7;
    object.name = {'b', 'a', 'l', 'l'};
    object.max_pages = 64;
    return object;
  }
  [[nodiscard]] spm::RegionData region(std::uint32_t number) const {
    return *spm::codec::region_data(model(), RegionId{number}, spm::Cache{empty_pool()}, spm::ObjectIndex{0});
  }
  void add_region(std::uint32_t object, const spm::RegionData& data) {
    sender_->add_region(object, data, spm::list_summary(model().regions()[index(data.region)]));
  }
  [[nodiscard]] static spm::Pool& empty_pool() {
    static spm::Pool pool{spm::PoolSettings::for_slots(16)};
    return pool;
  }
  /// Lets the intake process all messages, and returns the results of its answers.
  std::vector<AcceptResult> exchange() {
    sender_->flush();
    intake_->tick();
    std::vector<AcceptResult> results;
    for (IntakeAnswer answer; sender_->take(answer);) results.push_back(answer.result);
    return results;
  }
  /// Runs a cycle of the servo, and returns the force.
  double run_cycle() {
    inputs_[0].active = true;
    inputs_[0].device.position = tip_;
    inputs_[0].device.velocity = velocity_;
    inputs_[0].device.time_ns = now_ns_;
    const Servo::Outputs& outputs = servo_->touch(inputs_, now_ns_);
    servo_->publish(now_ns_, now_ns_ + 1'000'000);
    (void)servo_->refine(spm::Budget{1u << 16});
    now_ns_ += 1'000'000;
    return vec(outputs[0].force).norm();
  }
  [[nodiscard]] const spm::Cache& cache() const { return intake_->objects().cache(); }

  static spm::offline::BuiltModel* built_;
  static spm::codec::EncodedModel* encoded_;
  const spm::PoolSettings pool_ = spm::PoolSettings::for_slots(8192);
  std::unique_ptr<ServoLink> link_;
  std::unique_ptr<Intake> intake_;
  std::unique_ptr<BodyIntake> body_intake_;
  std::unique_ptr<Servo> servo_;
  std::unique_ptr<IntakeSender> sender_;
  Servo::Inputs inputs_;
  Vec3d velocity_ = Vec3d::Zero();
  Vec3d tip_{model().summary().bounds_max[0] + 0.002, 0, 0};  // m, 1 mm in the surface
  std::int64_t now_ns_ = 1'000'000'000;
};
spm::offline::BuiltModel* IntakeTest::built_ = nullptr;
spm::codec::EncodedModel* IntakeTest::encoded_ = nullptr;

TEST_F(IntakeTest, AnObjectAndItsRegionsReachTheServo) {
  sender_->add_object(3, object(), model().base());
  for (std::uint32_t number = 0; number < model().summary().regions; ++number) add_region(3, region(number));
  std::vector<AcceptResult> results;
  while (results.size() < model().summary().regions + 1)
    for (const AcceptResult result : exchange()) results.push_back(result);
  EXPECT_THAT(results, testing::Each(AcceptResult::kAccepted));
  for (int cycle = 0; cycle < 300; ++cycle) (void)run_cycle();

  ASSERT_EQ(servo_->cycle().objects().size(), 1u);
  EXPECT_EQ(servo_->cycle().objects()[0]->name, "ball");
  EXPECT_GT(run_cycle(), 0.1);
  EXPECT_EQ(sender_->free_space().slots, cache().slots_free());
  EXPECT_EQ(sender_->free_space().blocks, cache().blocks_free());
}

TEST_F(IntakeTest, OrdersForObjectsAndRegionsThatAreNotThereChangeNothing) {
  add_region(3, region(0));
  sender_->retire(3, RegionId{0});
  sender_->withdraw(3);
  sender_->withdraw(64);
  (void)exchange();
  EXPECT_TRUE(intake_->is_broken()) << "no object has the index 64";
  start();

  sender_->add_object(3, object(), model().base());
  sender_->add_object(3, object(), model().base());  // the index is in use
  sender_->retire(3, RegionId{0});                   // not loaded
  sender_->retire(3, RegionId{~0u});
  add_region(3, region(0));
  add_region(3, region(0));
  sender_->retire(3, RegionId{0});
  sender_->retire(3, RegionId{0});  // already retired
  EXPECT_THAT(exchange(),
              testing::ElementsAre(AcceptResult::kAccepted, AcceptResult::kMalformed, AcceptResult::kAccepted,
                                   AcceptResult::kAccepted, AcceptResult::kAccepted, AcceptResult::kLoaded,
                                   AcceptResult::kAccepted, AcceptResult::kAccepted));
  for (int cycle = 0; cycle < 100; ++cycle) (void)run_cycle();
  sender_->withdraw(3);
  sender_->withdraw(3);
  sender_->retire(3, RegionId{1});
  for (int cycle = 0; cycle < 100; ++cycle) {
    (void)exchange();
    (void)run_cycle();
  }
  EXPECT_EQ(cache().slots_used(), 0u) << "the withdrawn object is free";
  EXPECT_THAT(cache().violations(), IsEmpty());
}

TEST_F(IntakeTest, AWrongObjectIsRefused) {
  const auto result_of = [this](const IntakeObject& message, const spm::BaseMesh& base) {
    sender_->add_object(0, message, base);
    const std::vector<AcceptResult> results = exchange();
    return results.size() == 1 ? results[0] : AcceptResult::kAccepted;
  };
  IntakeObject wrong = object();
  wrong.name.fill('x');
  EXPECT_EQ(result_of(wrong, model().base()), AcceptResult::kMalformed) << "the name has no end";
  wrong = object();
  wrong.scale = 0;
  EXPECT_EQ(result_of(wrong, model().base()), AcceptResult::kMalformed);
  wrong = object();
  wrong.material.stiffness = std::numeric_limits<double>::infinity();
  EXPECT_EQ(result_of(wrong, model().base()), AcceptResult::kMalformed);
  wrong = object();
  wrong.pose.orientation = {0, 0, 0, 2};
  EXPECT_EQ(result_of(wrong, model().base()), AcceptResult::kMalformed);
  wrong = object();
  wrong.body = {1, {1, 1, -1}, 0.5, 0};
  EXPECT_EQ(result_of(wrong, model().base()), AcceptResult::kMalformed);
  spm::BaseMesh base = model().base();
  base.faces[0].corners[0] = spm::VertexId{base.summary.base_vertices};
  EXPECT_EQ(result_of(object(), base), AcceptResult::kMalformed) << "a corner that does not exist";
  base = model().base();
  ++base.summary.base_faces;
  EXPECT_EQ(result_of(object(), base), AcceptResult::kMalformed) << "a face is missing";
  EXPECT_EQ(cache().slots_used(), 0u);
}

// The checksum of a region comes from the gateway, too. Without record R0, which R1 needs, the pool would free R0 first.
TEST_F(IntakeTest, AListWithoutARecordThatAnotherOneNeedsIsRefused) {
  const spm::Model whole = built_->model();
  const std::vector<std::uint32_t> checksums = spm::record_checksums(whole);
  const auto parent_is_record = [&](std::uint32_t record) {
    return index(whole.first_part(spm::RecordId{record}).parent) >= whole.summary.base_vertices;
  };
  const spm::RegionData honest = region(0);
  std::uint32_t last = honest.list.back().first + honest.list.back().count - 1;
  while (!parent_is_record(last)) --last;
  sender_->add_object(0, object(), model().base());
  add_region(0, honest);
  spm::RegionData open;
  open.region = RegionId{1};
  open.list = {{last, 1}};
  sender_->add_region(0, open, {1, checksums[last]});
  EXPECT_THAT(exchange(),
              testing::ElementsAre(AcceptResult::kAccepted, AcceptResult::kAccepted, AcceptResult::kMalformed));
  EXPECT_THAT(cache().violations(), IsEmpty());
}

TEST_F(IntakeTest, ARecordWhoseParentDoesNotExistIsRefused) {
  sender_->add_object(0, object(), model().base());
  spm::RegionData wrong = region(0);
  for (const std::uint32_t beyond : {0u, 1u << 30, 0x7fffffffu - model().summary().base_vertices}) {
    wrong.parts[0].parent = spm::VertexId{model().summary().vertices + beyond};
    add_region(0, wrong);
  }
  EXPECT_THAT(exchange(), testing::ElementsAre(AcceptResult::kAccepted, AcceptResult::kMalformed,
                                               AcceptResult::kMalformed, AcceptResult::kMalformed));
}

TEST_F(IntakeTest, ObjectsWhoseDirectoriesDoNotFitAreRefused) {
  const std::uint64_t one = spm::directory_bytes(model().summary(), pool_, object().max_pages);
  Intake small{pool_, link_->intake, one + one / 2};
  sender_->add_object(0, object(), model().base());
  sender_->add_object(1, object(), model().base());
  sender_->flush();
  small.tick();
  std::vector<AcceptResult> results;
  for (IntakeAnswer answer; sender_->take(answer);) results.push_back(answer.result);
  EXPECT_THAT(results, testing::ElementsAre(AcceptResult::kAccepted, AcceptResult::kPoolFull));
}

TEST_F(IntakeTest, AfterAnInvalidHeaderLaterMessagesAreIgnored) {
  sender_->add_object(0, object(), model().base());
  (void)exchange();
  RingWriter writer{link_->intake.messages};
  const IntakeHeader header{IntakeKind::kRegion, 0, ~std::uint64_t{0}};
  (void)writer.push(std::as_bytes(std::span{&header, 1}));
  intake_->tick();
  EXPECT_TRUE(intake_->is_broken());
  for (int cycle = 0; cycle < 200; ++cycle) (void)run_cycle();
  EXPECT_EQ(servo_->cycle().objects().size(), 1u) << "loaded objects remain";
}

/// Two gateways, one after the other.
class AttachTest : public IntakeTest {
 protected:
  AttachTest() {
    sender_->add_object(3, object(), model().base());
    for (std::uint32_t number = 0; number < 3; ++number) add_region(3, region(number));
    EXPECT_THAT(exchange(), testing::Each(AcceptResult::kAccepted));
    for (int cycle = 0; cycle < 100; ++cycle) (void)run_cycle();
  }
  /// Begins with another gateway. Returns what it learns of the servo.
  AttachAnswer attach() {
    sender_ = std::make_unique<IntakeSender>(link_->intake, pool_);
    intake_->tick();
    AttachAnswer answer;
    EXPECT_TRUE(sender_->take_attach_answer(answer));
    return answer;
  }
};

TEST_F(AttachTest, TheServoKeepsObjectsAndRegionsAndDropsTheRestOfAMessage) {
  sender_->retire(3, RegionId{2});
  (void)exchange();
  RingWriter writer{link_->intake.messages};
  const IntakeHeader half{IntakeKind::kObject, 5, 1000};
  (void)writer.push(std::as_bytes(std::span{&half, 1}));
  intake_->tick();

  sender_ = std::make_unique<IntakeSender>(link_->intake, pool_);
  sender_->add_object(3, object(), model().base());
  EXPECT_FALSE(sender_->flush()) << "before the answer to the attach";
  EXPECT_EQ(sender_->free_space().slots, 0u);
  intake_->tick();
  AttachAnswer answer;
  ASSERT_TRUE(sender_->take_attach_answer(answer));
  EXPECT_FALSE(sender_->take_attach_answer(answer)) << "only once";
  for (std::uint32_t i = 0; i < kMaxObjects; ++i) EXPECT_EQ(answer.objects[i].exists, i == 3) << i;
  EXPECT_EQ(answer.objects[3].id, object().id);
  EXPECT_EQ(answer.objects[3].digest, model().summary().digest);
  EXPECT_FALSE(answer.objects[3].is_withdrawn);

  EXPECT_THAT(exchange(), testing::ElementsAre(AcceptResult::kLoaded, AcceptResult::kLoaded, AcceptResult::kLoaded))
      << "the object and the two regions that are not retired";
  EXPECT_EQ(sender_->free_space().slots, cache().slots_free());
  add_region(3, region(5));
  add_region(3, region(0));
  sender_->add_object(3, object(), model().base());
  EXPECT_THAT(exchange(),
              testing::ElementsAre(AcceptResult::kAccepted, AcceptResult::kLoaded, AcceptResult::kMalformed))
      << "the index is in use again";
  EXPECT_EQ(servo_->cycle().objects().size(), 1u);
  EXPECT_THAT(cache().violations(), IsEmpty());
}

TEST_F(AttachTest, AnObjectThatHasChangedMustBeWithdrawnFirst) {
  (void)attach();
  IntakeObject changed = object();
  changed.scale = 2;
  sender_->add_object(3, changed, model().base());
  EXPECT_THAT(exchange(), testing::ElementsAre(AcceptResult::kMalformed));
  sender_->withdraw(3);
  for (int cycle = 0; cycle < 100; ++cycle) {
    (void)exchange();
    (void)run_cycle();
  }
  EXPECT_EQ(cache().slots_used(), 0u);
  sender_->add_object(3, changed, model().base());
  EXPECT_THAT(exchange(), testing::ElementsAre(AcceptResult::kAccepted));
}

TEST_F(AttachTest, AnswersForTheEarlierGatewayAreNotTaken) {
  add_region(3, region(7));
  sender_->flush();
  intake_->tick();  // its answer waits
  const AttachAnswer answer = attach();
  EXPECT_EQ(answer.free.slots, cache().slots_free());
  EXPECT_THAT(exchange(), IsEmpty());
}

TEST_F(AttachTest, AnInvalidHeaderOfTheEarlierGatewayIsForgotten) {
  RingWriter writer{link_->intake.messages};
  const IntakeHeader wrong{IntakeKind::kRegion, 0, ~std::uint64_t{0}};
  (void)writer.push(std::as_bytes(std::span{&wrong, 1}));
  intake_->tick();
  ASSERT_TRUE(intake_->is_broken());
  (void)attach();
  EXPECT_FALSE(intake_->is_broken());
  add_region(3, region(5));
  EXPECT_THAT(exchange(), testing::ElementsAre(AcceptResult::kAccepted));
}

/// A movable object in the servo, and the gateway's orders for it.
class BodyIntakeTest : public IntakeTest {
 protected:
  static constexpr std::uint32_t kBody = 2;  // index of the object

  BodyIntakeTest() {
    tip_ = {1, 0, 0};
    IntakeObject movable = object();
    movable.body = {0.5, {1e-3, 1e-3, 1e-3}, 0.5, -1};
    sender_->add_object(kBody, movable, model().base());
    sender_->add_object(kBody + 1, object(), model().base());
    (void)exchange();
    for (int cycle = 0; cycle < 100; ++cycle) (void)run_cycle();
    grants_.count = 1;
    grants_.bodies[0] = grant_at({0, 0, 0.1});
  }
  [[nodiscard]] GrantedBody grant_at(const Vec3d& position) {
    GrantedBody grant;
    grant.object = kBody;
    grant.received.state.position = position;
    grant.received.session_ns = now_ns_;
    grants_.pose_number = grant.received.number = ++poses_;
    return grant;
  }
  /// Posts the grants, and runs enough cycles for the body to reach the received pose. Returns the report of the body.
  BodyReport report() {
    grants_.clock.local_ns = grants_.clock.session_ns = now_ns_;
    MailboxWriter{link_->bodies.granted}.post(grants_);
    for (int cycle = 0; cycle < 200; ++cycle) {
      body_intake_->tick();
      (void)run_cycle();
    }
    BodyReports reports;
    EXPECT_TRUE(MailboxReader{link_->bodies.reports}.take(reports));
    EXPECT_EQ(reports.count, 1u);
    return reports.bodies[0];
  }

  GrantedBodies grants_;
  std::uint64_t poses_ = 0;
};

TEST_F(BodyIntakeTest, WrongGrantsChangeNothing) {
  EXPECT_NEAR(report().state.position.z(), 0.1, 1e-6);
  const auto expect_unchanged = [this](const char* what) {
    EXPECT_NEAR(report().state.position.z(), 0.1, 1e-6) << what;
    EXPECT_EQ(report().coupling_fencing, 0u) << what;
    grants_.count = 1;
    grants_.bodies[0] = grant_at({0, 0, 0.2});
  };
  grants_.bodies[0] = grant_at({0, 0, 0.2});
  grants_.bodies[0].received.state.position.x() = std::numeric_limits<double>::quiet_NaN();
  expect_unchanged("a position that is not a number");
  grants_.bodies[0].received.state.orientation = {0, 0, 0, 0};
  expect_unchanged("no rotation");
  grants_.bodies[0].coupling = {1, haptics::kMaxCopies + 1, 0, kMinChannelDelayNs};
  expect_unchanged("too many copies");
  grants_.bodies[0].coupling = {1, 2, 2, kMinChannelDelayNs};
  expect_unchanged("a copy that does not exist");
  grants_.bodies[0].coupling = {1, 2, 0, kMaxChannelDelayNs + 1};
  expect_unchanged("a delay that is too long");
  grants_.bodies[0].object = kMaxObjects;
  expect_unchanged("an index that no object can have");
  grants_.bodies[0].received.number = 1'000'000;
  expect_unchanged("a later number than that of the newest pose");
  grants_.bodies[0].object = kBody + 1;
  expect_unchanged("an object that cannot move");
  grants_.count = 0;
  expect_unchanged("no body");
  grants_.count = ~0u;
  EXPECT_NEAR(report().state.position.z(), 0.2, 1e-4) << "the first ones count";
}

TEST_F(BodyIntakeTest, CouplingsOfOldGrantsAreFreedAndNewOnesTakeTheirPlace) {
  for (std::uint64_t fencing = 1; fencing < 6; ++fencing) {
    grants_.bodies[0].coupling = {fencing, 2, static_cast<std::uint32_t>(fencing % 2), kMinChannelDelayNs};
    EXPECT_EQ(report().coupling_fencing, fencing);
    EXPECT_EQ(body_intake_->couplings(), 1u);
  }
  grants_.bodies[0].coupling = {};
  EXPECT_EQ(report().coupling_fencing, 0u);
  EXPECT_EQ(body_intake_->couplings(), 0u);
}

// A gateway could use up the memory of the servo.
TEST_F(BodyIntakeTest, ABodyHasFewCouplingsWhileTheServoFreesNone) {
  grants_.clock.local_ns = grants_.clock.session_ns = now_ns_;
  grants_.count = kMaxBodies;
  for (std::uint64_t fencing = 1; fencing <= 1000; ++fencing) {
    for (std::uint32_t i = 0; i < kMaxBodies; ++i) {
      grants_.bodies[i] = grant_at({0, 0, 0.1});
      grants_.bodies[i].coupling = {kMaxBodies * fencing + i, 2, 0, kMinChannelDelayNs};
    }
    MailboxWriter{link_->bodies.granted}.post(grants_);
    body_intake_->tick();
    ASSERT_LE(body_intake_->couplings(), std::min<std::uint64_t>(fencing, BodyIntake::kMaxCouplings))
        << "an object counts once in a post";
  }
  EXPECT_EQ(body_intake_->couplings(), BodyIntake::kMaxCouplings);
  grants_.count = 1;
  EXPECT_EQ(report().coupling_fencing, 0u) << "the body had too many couplings";
  EXPECT_EQ(body_intake_->couplings(), 0u);
  EXPECT_EQ(report().coupling_fencing, kMaxBodies * 1000) << "it gets one when they are free";
}

TEST_F(BodyIntakeTest, ACouplingExistsUntilTheServoHasReturnedItsObject) {
  grants_.bodies[0].coupling = {1, 2, 0, kMinChannelDelayNs};
  (void)report();
  // The servo takes neither the orders with the second coupling nor those without the object before it is withdrawn.
  grants_.bodies[0].coupling.fencing = 2;
  MailboxWriter{link_->bodies.granted}.post(grants_);
  body_intake_->tick();
  sender_->withdraw(kBody);
  sender_->flush();
  intake_->tick();
  grants_.count = 0;
  MailboxWriter{link_->bodies.granted}.post(grants_);
  body_intake_->tick();
  (void)run_cycle();
  body_intake_->tick();
  EXPECT_EQ(body_intake_->couplings(), 2u);
  for (int cycle = 0; cycle < 100; ++cycle) {
    (void)run_cycle();
    intake_->tick();
    body_intake_->tick();
  }
  EXPECT_EQ(body_intake_->couplings(), 0u);
}

// The intake may return an object and add another one with its index in one pass.
TEST_F(BodyIntakeTest, AnObjectDoesNotGetTheCouplingOfAnEarlierOneWithItsIndex) {
  grants_.bodies[0].coupling = {1, 2, 0, kMinChannelDelayNs};
  EXPECT_EQ(report().coupling_fencing, 1u);
  sender_->withdraw(kBody);
  sender_->flush();
  intake_->tick();
  for (int cycle = 0; cycle < 100; ++cycle) (void)run_cycle();
  IntakeObject movable = object();
  movable.body = {0.5, {1e-3, 1e-3, 1e-3}, 0.5, -1};
  sender_->add_object(kBody, movable, model().base());
  (void)exchange();
  ASSERT_NE(intake_->objects().find(kBody), nullptr) << "the earlier object has not departed";
  grants_.count = 0;
  MailboxWriter{link_->bodies.granted}.post(grants_);
  body_intake_->tick();
  EXPECT_EQ(body_intake_->couplings(), 0u);
  BodyOrders orders;
  ASSERT_TRUE(body_intake_->orders().orders.take(orders));
  for (std::uint32_t i = 0; i < orders.count; ++i) EXPECT_EQ(orders.bodies[i].coupling, nullptr);
}

// The spring on the body also damps motion along its surface, which adds to the force on the hand.
TEST_F(BodyIntakeTest, TheForceOnAHandThatSlidesAlongABodyIsWithinTheLimitOfItsDevice) {
  start(1);  // N
  IntakeObject rough = object();
  rough.material.damping = 100;
  rough.body = {50, {1, 1, 1}, 0.5, -1};
  sender_->add_object(kBody, rough, model().base());
  (void)exchange();
  const double radius = model().summary().bounds_max[0];
  double largest = 0;
  for (int cycle = 0; cycle < 1000; ++cycle) {
    tip_ = {radius + 0.004 - 1e-5 * std::min(cycle, 400), 0, 2e-4 * std::max(0, cycle - 500)};
    velocity_ = {0, 0, cycle < 500 ? 0 : 0.2};
    largest = std::max(largest, run_cycle());
  }
  EXPECT_GT(largest, 0.5);
  EXPECT_LE(largest, 1 + 1e-9);
}

// Flips bits of messages on their way, and writes random positions of the ring. The mesh that the servo touches must
// remain valid, and the force within the device's limit.
TEST_F(IntakeTest, DamagedMessagesNeitherBreakTheMeshNorTheForce) {
  std::mt19937_64 random{kSeed};
  const auto below = [&](std::uint64_t limit) { return static_cast<std::uint32_t>(random() % limit); };
  const double max_force = CycleSettings{}.force.max_force;
  SharedRing<std::byte, IntakeLink::kMessageBytes>* messages = &link_->intake.messages;
  int broken = 0, accepted = 0, refused = 0;
  for (int step = 0; step < 6000; ++step) {
    SCOPED_TRACE("step " + std::to_string(step) + ", seed " + std::to_string(kSeed));
    if (step % 20 == 0 || intake_->is_broken()) {
      broken += intake_->is_broken() ? 1 : 0;
      start();
      messages = &link_->intake.messages;
      sender_->add_object(below(4), object(), model().base());
    }
    const std::uint32_t index = below(4);
    switch (below(8)) {
      case 0:
        sender_->withdraw(index);
        break;
      case 1:
        sender_->retire(index, RegionId{below(model().summary().regions)});
        break;
      default:
        for (std::uint32_t each = 0; each < 4; ++each) add_region(each, region(below(model().summary().regions)));
    }
    sender_->flush();
    const std::uint64_t first = messages->popped, count = messages->pushed - first;
    const std::uint32_t flips = count == 0 || below(3) == 0 ? 0 : below(4);
    for (std::uint32_t flip = 0; flip < flips; ++flip)
      messages->entries[(first + below(count)) % IntakeLink::kMessageBytes] ^= std::byte{1} << below(8);
    if (below(500) == 0) messages->pushed = random();
    intake_->tick();
    for (IntakeAnswer answer; sender_->take(answer);) ++(answer.result == AcceptResult::kAccepted ? accepted : refused);
    for (int cycle = 0; cycle < 3; ++cycle) ASSERT_LE(run_cycle(), max_force * (1 + 1e-9));
    if (step % 50 == 0) {
      ASSERT_THAT(cache().violations(), IsEmpty());
      for (const TouchObject* touched : servo_->cycle().objects())
        ASSERT_THAT(touched->forest->violations(), IsEmpty());
    }
  }
  EXPECT_GT(broken, 10);
  EXPECT_GT(accepted, 1000);
  EXPECT_GT(refused, 1000);
}

}  // namespace
}  // namespace tactus::hrtc_service
