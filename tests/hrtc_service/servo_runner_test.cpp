#include "hrtc_service/servo/servo_runner.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <mutex>

#include "haptics/simulated_device.hpp"
#include "host_service/host_core.hpp"
#include "hrtc_service/hrtc_core.hpp"
#include "hrtc_service/membership.hpp"
#include "realtime/process.hpp"
#include "spm/codec/model_codec.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "study/membership_exchange.hpp"
#include "tests/support/constants.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::hrtc_service {
namespace {

/// A servo with its threads, and a gateway in the thread of the test. A hand at the servo presses on a sphere.
class ServoRunnerTest : public testing::Test {
 protected:
  ~ServoRunnerTest() override { (void)servo_.stop(); }

  [[nodiscard]] ServoOptions options() {
    ServoOptions options;
    options.participant = "desk";
    options.pool = pool_;
    options.servo.snapshot_nodes = pool_.tree_nodes;
    options.haptic.priority = 0;
    options.local = {&hand_};
    options.flight.folder = folder_.path();
    options.flight.file = folder_.path() / "end.mcap";
    options.save_requests = &saves_;
    options.servo.emergency_stop_signals = &stops_;
    return options;
  }
  void start() {
    servo_.on_event = [this](session::Severity, const std::string& text) {
      const std::lock_guard lock{mutex_};
      events_.push_back(text);
    };
    servo_.start();
  }
  [[nodiscard]] std::vector<std::string> events() {
    const std::lock_guard lock{mutex_};
    return events_;
  }
  /// Runs gateway and host until `is_met`. The timeout of ctest limits the wait.
  template <class Condition>
  void run_until(Condition&& is_met) {
    while (!is_met()) {
      const std::int64_t now_ns = realtime::monotonic_ns();
      gateway_.tick(now_ns, membership_.clock());
      membership_.tick(now_ns);
      study::exchange_membership(host_, membership_, now_ns);
      while (auto demand = gateway_.demand(now_ns)) host_.on_demand(*demand, now_ns);
      while (auto chunk = host_.next_chunk(now_ns)) gateway_.on_chunk(chunk->chunk, now_ns);
      std::this_thread::yield();
    }
  }
  [[nodiscard]] bool touches_exactly() const {
    constexpr std::uint32_t kTouching = session::kInContact | session::kExact;
    return (gateway_.reports().probes[0].status & kTouching) == kTouching;
  }

  const spm::offline::BuiltModel built_ =
      spm::offline::build_model(spm::offline::generate(spm::offline::Shape::kSphere, 8000));
  const spm::Model model_ = built_.model();
  const spm::codec::EncodedModel encoded_{model_};
  const double radius_ = (model_.summary.bounds_max[0] - model_.summary.bounds_min[0]) / 2;
  const spm::PoolSettings pool_ = spm::PoolSettings::for_slots(model_.summary.parts + 600);
  const test_support::TemporaryFolder folder_;
  std::atomic<std::uint32_t> saves_{0}, stops_{0};
  haptics::SimulatedDevice hand_{{.start = {radius_ + 0.001, 0, 0}}};  // a tip has a radius of 3 mm
  std::mutex mutex_;
  std::vector<std::string> events_;  // guarded by `mutex_`
  ServoLink link_;
  ServoRunner servo_{options(), link_, nullptr};
  const session::Origin origin_{kSession, kHrtc, 1, 0};
  Gateway gateway_{pool_, origin_, {}, link_};
  host_service::HostCore host_{session::Origin{kSession, kHost, 1, 0},
                               host_service::host_of("sphere", encoded_.compressed()), realtime::monotonic_ns()};
  Membership membership_{origin_, {"hrtc", "session"}, gateway_, realtime::monotonic_ns()};
};

TEST_F(ServoRunnerTest, LoadsAndTouchesTheObjectsOfTheGatewayAndSendsTracesAndSnapshots) {
  start();
  run_until([&] { return touches_exactly(); });
  RingReader traces{link_.traces};
  EXPECT_GT(traces.waiting(), 0u);
  for (int round = 0; round < 2; ++round) {
    link_.request_snapshot();
    RingReader parts{link_.snapshot_parts};
    std::uint32_t faces = 0;
    SnapshotPart part{0, {}};
    run_until([&] {
      while (part.object != spm::kNone && parts.pop(part)) faces += part.object == 0 ? 1 : 0;
      return part.object == spm::kNone;
    });
    EXPECT_GT(faces, 10u);
  }
}

TEST_F(ServoRunnerTest, SavesFlightRecordingsForTheGatewayForASignalAndAtTheEnd) {
  start();
  run_until([&] { return touches_exactly(); });
  FlightRequest request;
  std::string{"a fault"}.copy(request.reason.data(), request.reason.size() - 1);
  ASSERT_TRUE(RingWriter{link_.flight_requests}.push(request));
  ++saves_;
  const auto recordings = [&] {
    std::size_t count = 0;
    for (const auto& file : std::filesystem::directory_iterator{folder_.path()})
      count += file.path().filename() != "end.mcap" && file.path().extension() == ".mcap" ? 1 : 0;
    return count;
  };
  run_until([&] { return recordings() == 1; });
  EXPECT_TRUE(servo_.stop());
  EXPECT_GT(std::filesystem::file_size(folder_.path() / "end.mcap"), 1000u);
  EXPECT_THAT(events(), testing::Contains(testing::HasSubstr("flight recorder: the last 30 s")));
}

TEST_F(ServoRunnerTest, ReportsAnInvalidMessageOnceAndGoesOn) {
  start();
  run_until([&] { return touches_exactly() && gateway_.send_waiting(); });
  const std::vector<std::byte> noise(1000, std::byte{0xff});
  (void)RingWriter{link_.intake.messages}.push(std::span{noise});
  const auto reports = [&] {
    const std::vector<std::string> lines = events();
    return std::count_if(lines.begin(), lines.end(), [](const std::string& line) {
      return line.find("the gateway sent an invalid message") != std::string::npos;
    });
  };
  while (reports() == 0) std::this_thread::yield();
  const std::uint64_t cycle = gateway_.reports().cycle;
  run_until([&] { return gateway_.reports().cycle > cycle + 20; });
  EXPECT_TRUE(touches_exactly());
  EXPECT_EQ(reports(), 1);
}

// Whatever a gateway writes into the link, the servo goes on, ends when it should, and obeys a local stop.
TEST_F(ServoRunnerTest, AnyBitsInTheLinkStopNeitherTheServoNorALocalStop) {
  start();
  run_until([&] { return touches_exactly(); });
  link_.reports.posted = 3;
  for (auto& slot : link_.reports.slots)
    for (auto& word : slot.words) word = std::uint64_t{1} << 62;
  link_.flight_requests.pushed = std::uint64_t{1} << 62;
  link_.near_objects.posted = std::uint64_t{1} << 62;
  link_.devices.orders.posted = std::uint64_t{1} << 62;
  link_.bodies.copies.pushed = std::uint64_t{1} << 62;
  for (int request = 0; request < 1000; ++request) link_.request_snapshot();
  link_.set_local_stops_issued(link_.local_stops() + 1);
  ++stops_;
  MailboxReader reports{link_.reports};
  const auto is_stopped = [](const ProbeOutput& probe) {
    return (probe.status & session::kFault) != 0 && probe.force == Plain3{};
  };
  while (!is_stopped(reports.latest().probes[0])) std::this_thread::yield();
  EXPECT_TRUE(servo_.stop());
}

}  // namespace
}  // namespace tactus::hrtc_service
