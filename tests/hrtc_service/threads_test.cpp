// The haptic thread of an HRTC runs while another thread does the work of the gateway, without DDS. TSan checks the
// data that the threads exchange. A seccomp filter records the system calls of the haptic thread.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <sys/syscall.h>

#include <cmath>
#include <csignal>
#include <cstdlib>
#include <set>
#include <thread>

#include "haptics/simulated_device.hpp"
#include "host_service/host_core.hpp"
#include "hrtc_service/flight_replay.hpp"
#include "hrtc_service/hrtc_core.hpp"
#include "hrtc_service/servo/flight_saver.hpp"
#include "hrtc_service/servo/haptic_thread.hpp"
#include "realtime/periodic_clock.hpp"
#include "spm/codec/model_codec.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "study/membership_exchange.hpp"
#include "tests/support/constants.hpp"
#include "tests/support/sanitizer.hpp"
#include "tests/support/system_calls.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus {
namespace {

using spm::Vec3d;

/// A simulated hand. From the first cycle, a filter records the system calls of the haptic thread, except the sleep.
class SystemCallRecordingHand final : public haptics::Device {
 public:
  explicit SystemCallRecordingHand(const haptics::HandSettings& hand) : hand_{hand} {}
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
  bool filtered_ = false;  // only the haptic thread uses this
};

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
TEST(SystemCallFilter, RecordsTheCallsThatItDoesNotAllow) {
  test_support::SystemCalls::clear();
  std::thread{[] {
    test_support::SystemCalls::allow_only(SYS_clock_nanosleep);
    realtime::sleep_until(realtime::monotonic_ns() + 1000);
    (void)syscall(SYS_gettid);
  }}.join();
  const std::map<long, std::uint64_t> tried = test_support::SystemCalls::attempts();  // the thread's end may add calls
  EXPECT_THAT(tried, testing::Contains(testing::Pair(SYS_gettid, 1)));
  EXPECT_THAT(tried, testing::Not(testing::Contains(testing::Key(SYS_clock_nanosleep))));
}

TEST(SystemCallFilter, RecordsTheCallsOfAFreeThatReturnsMemoryToTheSystem) {
  constexpr std::size_t kBytes = 64 << 20;  // more than malloc keeps
  void* const memory = std::malloc(kBytes);
  test_support::SystemCalls::clear();
  std::thread{[memory] {
    test_support::SystemCalls::allow_only(SYS_clock_nanosleep);
    std::free(memory);
    (void)madvise(nullptr, 0, MADV_NORMAL);
    (void)pthread_sigmask(SIG_BLOCK, nullptr, nullptr);
  }}.join();
  const std::map<long, std::uint64_t> tried = test_support::SystemCalls::attempts();
  for (const long call : {SYS_munmap, SYS_madvise, SYS_rt_sigprocmask})
    EXPECT_THAT(tried, testing::Contains(testing::Key(call)));
}
#endif

/// A session with a sphere, and a hand that strokes it.
class Threads : public ::testing::Test {
 protected:
  static constexpr session::Origin kHrtcOrigin{kSession, kHrtc, 1, 0};

  /// Moves the hand on a wave along the equator, 1 to 2 mm deep, at 10 to 12 cm/s.
  void move_hand(std::int64_t now_ns) {
    const double angle = static_cast<double>(now_ns - start_ns_) * 1e-9 * 0.1 / radius_;
    const double tip_distance = radius_ + 0.001;
    haptics::HandPath path;
    path.waypoints[path.count++] = {
        now_ns, {tip_distance * std::cos(angle), tip_distance * std::sin(angle), 0.2 * radius_ * std::sin(3 * angle)}};
    device_.hand().paths().post(path);
  }
  /// Does the work of the gateway's thread and of the host.
  void exchange(std::int64_t now_ns) {
    hrtc_service::Gateway& gateway = core_.gateway();
    gateway.tick(now_ns, membership_.clock());
    membership_.tick(now_ns);
    study::exchange_membership(host_, membership_, now_ns);
    while (auto demand = gateway.demand(now_ns)) host_.on_demand(*demand, now_ns);
    while (auto chunk = host_.next_chunk(now_ns)) gateway.on_chunk(chunk->chunk, now_ns);
    core_.tick_intake();
  }
  void count_contacts() {
    if (!core_.gateway().has_new_reports()) return;
    const std::uint32_t status = core_.gateway().reports().probes[0].status;
    if ((status & session::kInContact) == 0) return;
    ++contact_reports_;
    exact_reports_ += (status & session::kExact) != 0 ? 1 : 0;
  }
  /// Empties the rings that the haptic thread fills.
  void drain_rings() {
    for (hrtc_service::CycleTrace trace; traces_.pop(trace);) {
    }
    for (trace::LoggedQuery query; queries_.pop(query);) {
      ++logged_queries_;
      mesh_hashes_.insert(query.mesh_hash);
    }
  }
  [[nodiscard]] hrtc_service::FlightOptions flight_options() const {
    hrtc_service::FlightOptions options;
    options.folder = folder_.path();
    options.file = folder_.path() / "end.mcap";
    return options;
  }
  [[nodiscard]] hrtc_service::HrtcCoreSettings core_settings() {
    hrtc_service::HrtcCoreSettings settings;
    settings.pool = pool_;
    settings.logs_queries = true;
    settings.servo.snapshot_nodes = pool_.tree_nodes;
    settings.servo.recorder = &flight_.recorder();
    return settings;
  }
  [[nodiscard]] static hrtc_service::HapticSettings haptic_settings() {
    hrtc_service::HapticSettings settings;
    settings.priority = 0;
    return settings;
  }
  [[nodiscard]] haptics::HandSettings hand_settings() const {
    haptics::HandSettings settings;
    settings.start = {radius_ + 0.02, 0, 0};
    return settings;
  }

  const spm::offline::BuiltModel built_ =
      spm::offline::build_model(spm::offline::generate(spm::offline::Shape::kSphere, 8000));
  const spm::Model model_ = built_.model();
  const spm::codec::EncodedModel encoded_{model_};
  const double radius_ = (model_.summary.bounds_max[0] - model_.summary.bounds_min[0]) / 2;
  // The pool holds a quarter of the model, so that regions are loaded and retired.
  const spm::PoolSettings pool_ = spm::PoolSettings::for_slots(model_.summary.parts / 4 + 600);
  const test_support::TemporaryFolder folder_;
  hrtc_service::FlightSaver flight_{flight_options(),
                                    hrtc_service::flight_start("desk", hrtc_service::CycleSettings{}, pool_, {}), 1};
  hrtc_service::HrtcCore core_{kHrtcOrigin, core_settings()};
  SystemCallRecordingHand device_{hand_settings()};
  hrtc_service::HapticThread haptic_{haptic_settings(), core_.servo(), core_.link(), {&device_}};
  const std::int64_t start_ns_ = realtime::monotonic_ns();
  host_service::HostCore host_{session::Origin{kSession, kHost, 1, 0},
                               host_service::host_of("sphere", encoded_.compressed()), start_ns_};
  hrtc_service::Membership membership_{kHrtcOrigin, {"hrtc", "session"}, core_.gateway(), start_ns_};
  std::uint64_t contact_reports_ = 0, exact_reports_ = 0, logged_queries_ = 0;
  std::set<std::uint64_t> mesh_hashes_;
  hrtc_service::RingReader<trace::LoggedQuery, hrtc_service::ContactQuery::kLogEntries> queries_{core_.log()};
  hrtc_service::RingReader<hrtc_service::CycleTrace, hrtc_service::ServoLink::kTraces> traces_{core_.link().traces};
};

TEST_F(Threads, TheHapticThreadMakesNoSystemCallWhileTheLoaderLoadsAndEvictsRegions) {
  flight_.start();
  test_support::SystemCalls::clear();
  (void)haptic_.start();

  bool is_snapshot_requested = false;
  // Waits for enough exact contacts, coarsened regions and a snapshot. The timeout of ctest limits the wait.
  while (exact_reports_ < 200 || core_.gateway().loader().figures().regions_coarsened < 3 ||
         core_.servo().snapshots_done() == 0) {
    const std::int64_t now_ns = realtime::monotonic_ns();
    move_hand(now_ns);
    if (contact_reports_ >= 100 && !std::exchange(is_snapshot_requested, true)) core_.link().request_snapshot();
    exchange(now_ns);
    count_contacts();
    drain_rings();
    std::this_thread::yield();
  }
  std::map<long, std::uint64_t> tried = test_support::SystemCalls::attempts();  // before the end of the thread
  haptic_.stop();
  tried.erase(SYS_clock_gettime);  // after cycles that other programs have delayed (Overload)
  EXPECT_THAT(tried, testing::IsEmpty());
  EXPECT_TRUE(flight_.stop());
  const hrtc_service::FlightReport replayed = hrtc_service::replay_flight(
      flight_options().file, {[&](std::uint64_t) { return &encoded_.compressed(); }, {}, false});

  EXPECT_EQ(replayed.different_cycles, 0u) << replayed.first_difference;
  EXPECT_GT(replayed.in_contact, 100u);
  EXPECT_GT(logged_queries_, exact_reports_);
  EXPECT_GT(mesh_hashes_.size(), 2u);
  EXPECT_FALSE(core_.servo().snapshot(0).empty());
}

}  // namespace
}  // namespace tactus
