// The haptic thread beside the loader's, as in a real HRTC but without DDS: what passes between them, for TSan to
// watch, and which system calls the haptic thread makes meanwhile.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/syscall.h>

#include <chrono>
#include <cmath>
#include <set>
#include <thread>

#include "haptics/simulated_device.hpp"
#include "host_service/host_core.hpp"
#include "hrtc_service/flight_replay.hpp"
#include "hrtc_service/flight_saver.hpp"
#include "hrtc_service/haptic_thread.hpp"
#include "hrtc_service/hrtc_core.hpp"
#include "hrtc_service/realtime.hpp"
#include "spm/codec/model_codec.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "study/membership_exchange.hpp"
#include "tests/support/system_calls.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus {
namespace {

using hrtc_service::kMaxProbes;
using spm::Vec3d;

constexpr std::uint64_t kHost = 10, kHrtc = 20, kSession = 30;

/// A simulated hand that lets its thread make no system call but sleeping, from its first cycle on.
class FilteredHand final : public haptics::Device {
 public:
  explicit FilteredHand(const haptics::HandSettings& hand) : hand_{hand} {}
  [[nodiscard]] haptics::SimulatedDevice& hand() noexcept { return hand_; }

  [[nodiscard]] const haptics::DeviceSpec& spec() const noexcept override { return hand_.spec(); }
  [[nodiscard]] haptics::DeviceState read(std::int64_t now_ns) noexcept override {
    if (!filtered_ && !test_support::kSanitized) test_support::SystemCalls::allow_only(SYS_clock_nanosleep);
    filtered_ = true;
    return hand_.read(now_ns);
  }
  void write(const Vec3d& force) noexcept override { hand_.write(force); }
  [[nodiscard]] haptics::DeviceHealth health() const noexcept override { return hand_.health(); }

 private:
  haptics::SimulatedDevice hand_;
  bool filtered_ = false;  // the haptic thread's
};

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
TEST(Threads, TheFilterRecordsWhatItDoesNotAllow) {
  test_support::SystemCalls::clear();
  std::thread{[] {
    test_support::SystemCalls::allow_only(SYS_clock_nanosleep);
    wire::sleep_until(hrtc_service::monotonic_ns() + 1000);
    (void)syscall(SYS_gettid);
  }}.join();
  const std::map<long, std::uint64_t> tried = test_support::SystemCalls::tried();  // a thread's end adds to them
  EXPECT_THAT(tried, testing::Contains(testing::Pair(SYS_gettid, 1)));
  EXPECT_THAT(tried, testing::Not(testing::Contains(testing::Key(SYS_clock_nanosleep))));
}
#endif

TEST(Threads, AHandFeelsWhatALoaderBringsAndEvictsMeanwhile) {
  const spm::offline::BuiltModel built =
      spm::offline::build_model(spm::offline::generate(spm::offline::Shape::kSphere, 8000));
  const spm::Model model = built.model();
  const double radius = (model.summary.bounds_max[0] - model.summary.bounds_min[0]) / 2;
  const spm::PoolSettings settings = spm::PoolSettings::for_slots(model.summary.parts / 4 + 600);
  hrtc_service::HrtcCoreSettings core_settings;
  core_settings.pool = settings;
  core_settings.logs_queries = true;
  core_settings.servo.snapshot_nodes = settings.tree_nodes;
  const test_support::TemporaryFolder folder;
  hrtc_service::FlightOptions flight_options;
  flight_options.folder = folder.path();
  flight_options.file = folder.path() / "end.mcap";
  hrtc_service::FlightSaver flight{flight_options,
                                   hrtc_service::flight_start("desk", core_settings.servo.cycle, settings, {}), 1};
  core_settings.servo.recorder = &flight.recorder();
  hrtc_service::HrtcCore core{session::Origin{kSession, kHrtc, 1, 0}, core_settings};
  hrtc_service::Gateway& gateway = core.gateway();
  const hrtc_service::Loader& loader = gateway.loader();
  hrtc_service::HapticSettings haptic_settings;
  haptic_settings.priority = 0;
  hrtc_service::HapticThread haptic{haptic_settings, core.servo()};
  const spm::codec::EncodedModel encoded{model};
  host_service::HostCore host{session::Origin{kSession, kHost, 1, 0},
                              host_service::host_of("sphere", encoded.compressed()), hrtc_service::monotonic_ns()};
  hrtc_service::Membership membership{
      session::Origin{kSession, kHrtc, 1, 0}, {"hrtc", "session"}, gateway, hrtc_service::monotonic_ns()};

  haptics::HandSettings hand;
  hand.start = {radius + 0.02, 0, 0};
  FilteredHand device{hand};
  hrtc_service::HapticCommands commands;
  commands.devices[0] = &device;
  haptic.commands().post(commands);
  flight.start();
  test_support::SystemCalls::clear();
  (void)haptic.start();

  const std::int64_t start = hrtc_service::monotonic_ns();
  std::uint64_t contact = 0, exact = 0, logged = 0;
  std::set<std::uint64_t> hashes;
  trace::LoggedQuery query;
  // Until the hand has felt the finest surface long enough and regions have come and gone; the watchdog is ctest's.
  while (exact < 200 || loader.figures().regions_coarsened < 3 || core.servo().snapshots_done() == 0) {
    const std::int64_t now = hrtc_service::monotonic_ns();
    // Round and round the equator, pressed 2 mm in, at some 10 cm/s.
    const double angle = static_cast<double>(now - start) * 1e-9 * 0.1 / radius;
    haptics::HandPath path;
    path.waypoints[path.count++] = {
        now,
        {(radius + 0.001) * std::cos(angle), (radius + 0.001) * std::sin(angle), 0.2 * radius * std::sin(3 * angle)}};
    device.hand().paths().post(path);
    if (contact == 100) {
      commands.snapshots = 1;
      haptic.commands().post(commands);
    }
    gateway.tick(now, membership.clock());
    membership.tick(now);
    study::exchange_membership(host, membership, now);
    if (gateway.has_new_reports()) {
      const std::uint32_t status = gateway.reports().probes[0].status;
      const bool touching = (status & session::kInContact) != 0;
      contact += touching ? 1 : 0;
      exact += touching && (status & session::kExact) != 0 ? 1 : 0;
    }
    while (auto demand = gateway.demand(now)) host.on_demand(*demand, now);
    while (auto chunk = host.next_chunk(now)) gateway.on_chunk(chunk->chunk, now);
    hrtc_service::CycleTrace trace;
    while (haptic.traces().pop(trace)) {
    }
    while (core.link().log.pop(query)) {
      ++logged;
      hashes.insert(query.mesh_hash);
    }
    std::this_thread::yield();
  }
  haptic.stop();
  EXPECT_THAT(test_support::SystemCalls::tried(), testing::IsEmpty());
  EXPECT_TRUE(flight.stop());
  const hrtc_service::FlightReport replayed = hrtc_service::replay_flight(
      flight_options.file, {[&](std::uint64_t) { return &encoded.compressed(); }, {}, false});

  EXPECT_EQ(replayed.different_cycles, 0u) << replayed.first_difference;
  EXPECT_GT(replayed.in_contact, 100u);
  EXPECT_GT(logged, exact);
  EXPECT_GT(hashes.size(), 2u);
  EXPECT_FALSE(core.servo().snapshot(0).empty());
}

}  // namespace
}  // namespace tactus
