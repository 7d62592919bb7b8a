#include "hrtc_service/device/driver_process.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <limits>
#include <memory>
#include <mutex>
#include <sstream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "hrtc_service/device/driver_loop.hpp"
#include "realtime/process.hpp"
#include "realtime/realtime.hpp"
#include "tests/support/constants.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::hrtc_service {
namespace {

using haptics::DeviceHealth;
using haptics::DeviceState;
using haptics::Vec3d;
using realtime::monotonic_ns;
using testing::AllOf;
using testing::HasSubstr;

/// A write that the driver with defects has recorded.
struct Write {
  std::int64_t time_ns = 0;
  double force = 0;  // N
};

class DriverProcessTest : public testing::Test {
 protected:
  static constexpr std::int64_t kMaxNs = 20'000 * kMs;  // for an event, on a busy machine

  [[nodiscard]] DriverSettings with_defect(const std::string& defect) const {
    DriverSettings settings;
    settings.library = TACTUS_DRIVER_WITH_DEFECTS;
    settings.config = defect + ":" + file_;
    settings.priority = 0;
    return settings;
  }
  [[nodiscard]] std::function<void(const std::string&)> record_end() {
    return [this](const std::string& text) {
      const std::lock_guard lock{mutex_};
      end_ += text;
    };
  }
  /// Runs cycles of 1 ms with this force until the condition holds. Returns false if it does not within a time limit.
  static bool runs_until(DriverProcess& device, double force, const std::function<bool(const DeviceState&)>& holds) {
    const std::int64_t until_ns = monotonic_ns() + kMaxNs;
    for (std::int64_t due_ns = monotonic_ns(); due_ns < until_ns; due_ns += kMs) {
      realtime::sleep_until(due_ns);
      const DeviceState state = device.read(monotonic_ns());
      device.write({0, 0, force});
      if (holds(state)) return true;
    }
    return false;
  }
  /// The driver received the force: it returns positions of 1 mm for each N.
  static std::function<bool(const DeviceState&)> has_force(double force) {
    return [force](const DeviceState& state) { return std::abs(state.position.z() - 0.001 * force) < 1e-9; };
  }
  [[nodiscard]] std::vector<Write> writes() const {
    std::vector<Write> all;
    std::ifstream lines{file_};
    for (Write write; lines >> write.time_ns >> write.force;) all.push_back(write);
    return all;
  }
  [[nodiscard]] std::string written_text() const {
    std::stringstream text;
    text << std::ifstream{file_}.rdbuf();
    return text.str();
  }
  /// Waits until the condition holds, which depends on a file or a report. Returns false if it does not within a time
  /// limit.
  static bool wait_until(const std::function<bool()>& holds) {
    for (const std::int64_t until_ns = monotonic_ns() + kMaxNs; !holds();
         std::this_thread::sleep_for(std::chrono::milliseconds{5}))  // a file notifies nobody
      if (monotonic_ns() > until_ns) return false;
    return true;
  }
  /// Starts a process with a servo that commands 1 N. Returns when the driver has received this force.
  [[nodiscard]] pid_t start_servo() const {
    const pid_t servo = ::fork();
    if (servo == 0) {  // without gtest, which would report twice
      ::prctl(PR_SET_PDEATHSIG, SIGKILL);
      DriverProcess device{with_defect("none"), [](const std::string&) {}};
      (void)runs_until(device, 1, [](const DeviceState&) { return false; });
      ::_exit(0);
    }
    EXPECT_TRUE(wait_until([&] { return written_text().find(" 1\n") != std::string::npos; }));
    return servo;
  }
  /// Kills the process with the servo, and waits until the driver has closed the device.
  void kill_servo(pid_t servo) const {
    ::kill(servo, SIGKILL);
    EXPECT_EQ(::waitpid(servo, nullptr, 0), servo);
    EXPECT_TRUE(wait_until([&] { return written_text().find("closed") != std::string::npos; }));
    EXPECT_THAT(written_text(), testing::EndsWith(" 0\nclosed\n"));
  }
  /// Commands the force that shows the defect, until the device has failed.
  [[nodiscard]] bool fails(DriverProcess& device) {
    return runs_until(device, 3, [&](const DeviceState&) { return device.health() == DeviceHealth::kFailed; });
  }
  /// Waits for the report of an end, and returns it.
  [[nodiscard]] std::string wait_for_end() const {
    (void)wait_until([&] { return !reported_end().empty(); });
    return reported_end();
  }
  [[nodiscard]] std::string reported_end() const {
    const std::lock_guard lock{mutex_};
    return end_;
  }

  test_support::TemporaryFolder folder_;
  std::string file_ = (folder_.path() / "writes").string();

 private:
  mutable std::mutex mutex_;
  std::string end_;
};

std::string error_of(const DriverSettings& settings) {
  try {
    const DriverProcess device{settings, [](const std::string&) {}};
  } catch (const haptics::DeviceError& error) {
    return error.what();
  }
  return "";
}

TEST_F(DriverProcessTest, TheForceOnTheExampleDeviceCarriesItsWeight) {
  DriverSettings settings;
  settings.library = TACTUS_EXAMPLE_WEIGHT;
  settings.config = "0.21";
  DriverProcess device{settings, record_end()};
  EXPECT_EQ(device.name(), "weight in oil");
  EXPECT_EQ(device.spec().max_force, 5);
  double force = 0;
  int steady = 0;
  const std::int64_t until_ns = monotonic_ns() + kMaxNs;
  for (std::int64_t due_ns = monotonic_ns(); due_ns < until_ns && steady < 200; due_ns += kMs) {
    realtime::sleep_until(due_ns);
    const DeviceState state = device.read(monotonic_ns());
    EXPECT_GE(state.round_trip, 0.00015);
    EXPECT_LT(state.round_trip, 0.001);
    force = 1000 * std::max(0.0, 0.2 - state.position.z());
    device.write({0, 0, force});
    steady = std::abs(force - 0.981) < 1e-3 ? steady + 1 : 0;
  }
  EXPECT_EQ(steady, 200) << "the last force was " << force << " N";
  EXPECT_EQ(device.health(), DeviceHealth::kReady);
  EXPECT_EQ(reported_end(), "");
}

TEST_F(DriverProcessTest, AnOpenErrorNamesTheReasonOfTheDriver) {
  DriverSettings settings;
  settings.library = "/nowhere/driver.so";
  EXPECT_THAT(error_of(settings), HasSubstr("/nowhere/driver.so: cannot open shared object file"));
  settings.library = TACTUS_DRIVER_WITH_DEFECTS;
  settings.config = "none";
  EXPECT_EQ(error_of(settings), "device device with a defect, config 'none': found 'none', expected DEFECT:FILE");
  EXPECT_THAT(error_of(with_defect("killed while it opens")),
              AllOf(HasSubstr("device driver " TACTUS_DRIVER_WITH_DEFECTS), HasSubstr("was killed by SIGKILL")));
}

TEST_F(DriverProcessTest, RefusedCommandsAreReported) {
  DriverProcess device{with_defect("none"), record_end()};
  // A report of slow calls may come first.
  ASSERT_TRUE(runs_until(device, 1000, [&](const DeviceState&) {
    return reported_end().find("device device with a defect: its process refused ") != std::string::npos;
  }));
  EXPECT_THAT(reported_end(), HasSubstr(" commands above the limits of the device"));
}

TEST_F(DriverProcessTest, TheForceIsZeroTenMsAfterTheLastCommand) {
  DriverProcess device{with_defect("none"), record_end()};
  ASSERT_TRUE(runs_until(device, 1, has_force(1)));
  const std::int64_t last_ns = monotonic_ns();
  const auto is_zero_again = [&] {
    const std::vector<Write> all = writes();
    return !all.empty() && all.back().force == 0;
  };
  while (!is_zero_again() && monotonic_ns() < last_ns + kMaxNs)
    std::this_thread::sleep_for(std::chrono::milliseconds{5});  // a file notifies nobody
  const std::vector<Write> all = writes();
  ASSERT_GE(all.size(), 2u);
  ASSERT_EQ(all.back().force, 0);
  const auto last = std::find_if(all.rbegin(), all.rend(), [](const Write& write) { return write.force != 0; });
  ASSERT_NE(last, all.rend());
  const Write& before = *last;
  EXPECT_EQ(before.force, 1);
  const double silence = static_cast<double>(last.base()->time_ns - before.time_ns) * 1e-9;
  EXPECT_GE(silence, 0.005) << "s";  // 10 ms after the start of the cycle
  EXPECT_LT(silence, 1) << "s, beside other tests; scripts/bench driver has a bound";
}

TEST_F(DriverProcessTest, AnOldCommandIsNotObeyed) {
  DriverProcess device{with_defect("none"), record_end()};
  const std::size_t before = writes().size();
  (void)device.read(monotonic_ns() - 11 * kMs);  // the cycle began then
  device.write({0, 0, 2});
  const std::int64_t until_ns = monotonic_ns() + kMaxNs;
  while (writes().size() < before + 20 && monotonic_ns() < until_ns)
    std::this_thread::sleep_for(std::chrono::milliseconds{5});  // a file notifies nobody
  const std::vector<Write> all = writes();
  EXPECT_GE(all.size(), before + 20) << "zero forces";
  EXPECT_TRUE(std::all_of(all.begin(), all.end(), [](const Write& write) { return write.force == 0; }));
}

TEST_F(DriverProcessTest, TheEndWritesZeroForceAndClosesTheDevice) {
  {
    DriverProcess device{with_defect("none"), record_end()};
    ASSERT_TRUE(runs_until(device, 1, has_force(1)));
  }
  EXPECT_THAT(written_text(), testing::EndsWith(" 0\nclosed\n"));
  EXPECT_EQ(reported_end(), "");
}

TEST_F(DriverProcessTest, ADriverThatIsKilledHasFailed) {
  DriverProcess device{with_defect("killed"), record_end()};
  EXPECT_TRUE(fails(device));
  EXPECT_THAT(wait_for_end(),
              AllOf(HasSubstr("device device with a defect: the process of its driver was killed by SIGKILL"),
                    HasSubstr("it gets no force until the HRTC starts again")));
}

TEST_F(DriverProcessTest, ADriverThatExitsHasFailed) {
  DriverProcess device{with_defect("exits"), record_end()};
  EXPECT_TRUE(fails(device));
  EXPECT_THAT(wait_for_end(), HasSubstr("the process of its driver has ended"));
}

TEST_F(DriverProcessTest, ADriverThatHangsIsEnded) {
  DriverProcess device{with_defect("hangs"), record_end()};
  EXPECT_TRUE(fails(device));
  EXPECT_THAT(wait_for_end(), HasSubstr("a call of the driver did not return within 0.5 s"));
}

TEST_F(DriverProcessTest, AFailureThatTheDriverReportsIsPermanent) {
  DriverProcess device{with_defect("fails"), record_end()};
  EXPECT_TRUE(fails(device));
  EXPECT_TRUE(runs_until(device, 0, [](const DeviceState&) { return true; }));
  EXPECT_EQ(device.health(), DeviceHealth::kFailed);
  EXPECT_EQ(reported_end(), "") << "its process runs";
}

TEST_F(DriverProcessTest, ANumberThatIsNotPlausibleMakesThePositionNotFinite) {  // the force renderer latches a fault
  for (const char* defect : {"far", "without orientation"}) {
    DriverProcess device{with_defect(defect), record_end()};
    EXPECT_TRUE(device.read(monotonic_ns()).position.allFinite());
    EXPECT_TRUE(runs_until(device, 3, [](const DeviceState& state) { return !state.position.allFinite(); })) << defect;
  }
}

TEST_F(DriverProcessTest, ATimeInTheFutureDoesNotKeepAPoseNew) {
  DriverProcess device{with_defect("from the future"), record_end()};
  ASSERT_TRUE(runs_until(device, 3, has_force(3)));
  EXPECT_TRUE(runs_until(device, 3, [](const DeviceState& state) {
    return monotonic_ns() - state.time_ns > 200 * kMs;
  })) << "the driver returns the same pose, so it grows old";
  EXPECT_EQ(device.health(), DeviceHealth::kReady);
}

TEST_F(DriverProcessTest, ADriverWithTimesOfAnotherClockHasFailed) {
  DriverProcess device{with_defect("wall clock"), record_end()};
  EXPECT_TRUE(fails(device));
  EXPECT_THAT(wait_for_end(), AllOf(HasSubstr("the process of its driver has failed: read gave a pose from "),
                                    HasSubstr(" s in the future, expected the time of the measurement on")));
  EXPECT_THAT(written_text(), testing::EndsWith(" 0\nclosed\n"));
}

TEST_F(DriverProcessTest, SlowCallsOfADriverLowerTheStiffnessAndAreReported) {
  DriverSettings settings = with_defect("slow");  // 3 ms for a read, 5 ms for a write
  settings.period_ns = 5 * kMs;
  DriverProcess device{settings, record_end()};
  EXPECT_TRUE(runs_until(device, 0, [](const DeviceState& state) { return state.round_trip > 0.0055; })) << "s";
  EXPECT_TRUE(runs_until(device, 0, [this](const DeviceState&) { return !reported_end().empty(); }));
  EXPECT_THAT(reported_end(), AllOf(HasSubstr("device device with a defect: a read and a write of its driver take "),
                                    HasSubstr(" ms, expected less than a cycle, 5 ms")));
}

TEST_F(DriverProcessTest, AStopThatIsPressedBetweenTwoReadsOfTheServoIsReported) {
  DriverProcess device{with_defect("taps"), record_end()};
  ASSERT_TRUE(runs_until(device, 3, has_force(3)));
  // The servo is late: the driver sets the force to zero, and its user presses and releases the button.
  ASSERT_TRUE(wait_until([&] { return written_text().find("tapped") != std::string::npos; }));
  std::this_thread::sleep_for(std::chrono::milliseconds{20});  // many periods of the driver, which notifies nobody
  EXPECT_EQ(device.read(monotonic_ns()).buttons, haptics::kStopButton);
  EXPECT_TRUE(runs_until(device, 0, [](const DeviceState& state) { return state.buttons == 0; }));
}

TEST_F(DriverProcessTest, TheForceGrowsFromZeroAfterATimeout) {
  DriverProcess device{with_defect("none"), record_end()};
  ASSERT_TRUE(runs_until(device, 2, has_force(2)));
  std::this_thread::sleep_for(std::chrono::milliseconds{100});  // no commands
  std::vector<double> forces;
  ASSERT_TRUE(runs_until(device, 2, [&](const DeviceState& state) {
    forces.push_back(state.position.z() * 1000);
    return has_force(2)(state);
  }));
  EXPECT_EQ(forces.front(), 0) << "N, after the timeout";
  double change = 0;
  for (std::size_t i = 1; i < forces.size(); ++i) change = std::max(change, forces[i] - forces[i - 1]);
  EXPECT_LT(change, 1) << "N in a cycle; the machine may be busy for some cycles";
}

TEST_F(DriverProcessTest, AKilledHrtcLeavesNoForce) { kill_servo(start_servo()); }

TEST_F(DriverProcessTest, ASuspendedServoLeavesNoForce) {
  const pid_t servo = start_servo();
  ::kill(servo, SIGSTOP);
  int status = 0;
  EXPECT_EQ(::waitpid(servo, &status, WUNTRACED), servo);
  EXPECT_TRUE(WIFSTOPPED(status));
  const std::int64_t stopped_ns = monotonic_ns();
  constexpr std::ptrdiff_t kZeroWrites = 20;                   // in a row, so that no command of the servo is left
  const auto first_zero = [](const std::vector<Write>& all) {  // after the last other force
    return std::find_if(all.rbegin(), all.rend(), [](const Write& write) { return write.force != 0; }).base();
  };
  EXPECT_TRUE(wait_until([&] {
    const std::vector<Write> all = writes();
    return all.end() - first_zero(all) >= kZeroWrites && (all.end() - kZeroWrites)->time_ns > stopped_ns;
  })) << "the force is not zero";
  const std::vector<Write> all = writes();
  const auto zero = first_zero(all);
  if (zero != all.end()) {
    EXPECT_LT(static_cast<double>(zero->time_ns - stopped_ns) * 1e-9, 1)
        << "s, beside other tests; scripts/bench driver has a bound";
  }
  EXPECT_EQ(::kill(servo, SIGCONT), 0);
  EXPECT_TRUE(wait_until([&] { return writes().back().force == 1; })) << "the servo continues";
  kill_servo(servo);
}

TEST_F(DriverProcessTest, ADriverThatDamagesTheSharedMemoryDoesNotEndTheHrtc) {
  DriverProcess device{with_defect("damages"), record_end()};
  int cycles = 0;
  EXPECT_TRUE(runs_until(device, 3, [&](const DeviceState& state) {
    EXPECT_LE(state.time_ns, monotonic_ns());
    EXPECT_TRUE(!state.position.allFinite() || state.position.norm() < 1e10);
    return ++cycles == 500;
  }));
  std::ifstream lines{file_};
  int forces = 0;
  for (std::string time, force; lines >> time >> force; ++forces)
    EXPECT_LE(std::abs(std::strtod(force.c_str(), nullptr)), 5) << "N, the limit of the device; found " << force;
  EXPECT_GT(forces, 0);
}

/// A device that counts the forces of its writes.
class CountingDevice final : public haptics::Device {
 public:
  [[nodiscard]] const haptics::DeviceSpec& spec() const noexcept override { return spec_; }
  [[nodiscard]] DeviceState read(std::int64_t now_ns) noexcept override {
    DeviceState state;
    state.time_ns = now_ns;
    return state;
  }
  void write(const Vec3d& force) noexcept override { write_wrench(force, Vec3d::Zero()); }
  void write_wrench(const Vec3d& force, const Vec3d& torque) noexcept override {
    const bool is_within = force.norm() <= spec_.max_force && torque.norm() <= spec_.max_torque;
    if (!is_within) ++excessive;
    if (is_within && !force.isZero(0)) ++within;
  }
  [[nodiscard]] DeviceHealth health() const noexcept override { return DeviceHealth::kReady; }

  std::atomic<int> within{0}, excessive{0};  // forces that are not zero, by the limits of `spec`

 private:
  haptics::DeviceSpec spec_;
};

TEST(DriverLoop, ACommandAboveTheLimitsOfTheDeviceBecomesZeroForce) {  // damaged memory may contain any command
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  const auto link = std::make_unique<DriverLink>();
  link->period_ns = kMs;
  CountingDevice device;
  DriverLoop loop{device, *link};
  loop.begin();
  std::thread thread{[&] { loop.run(); }};
  MailboxWriter<DriverCommand> commands{link->commands};
  const auto command = [&](const DriverCommand& wanted) {
    DriverCommand next = wanted;
    next.cycle_ns = monotonic_ns();
    commands.post(next);
    std::this_thread::sleep_for(std::chrono::milliseconds{1});  // a cycle of the HRTC
  };
  MailboxReader<DriverState> states{link->states};
  DriverState newest;
  const auto refused = [&] {
    (void)states.take(newest);
    return newest.refused;
  };
  for (const DriverCommand& wrong :
       {DriverCommand{{0, 0, 1e301}, {}, 0}, DriverCommand{{kNan, 0, 0}, {}, 0}, DriverCommand{{6, 8, 1}, {}, 0},
        DriverCommand{{1, 0, 0}, {0, 0, 0.1}, 0}, DriverCommand{{1, 0, 0}, {kNan, 0, 0}, 0}}) {
    const std::uint32_t before = refused();
    const std::int64_t until_ns = monotonic_ns() + 20'000 * kMs;
    for (int cycle = 0; cycle < 20 || (refused() == before && monotonic_ns() < until_ns); ++cycle) command(wrong);
    EXPECT_GT(refused(), before);
  }
  EXPECT_EQ(device.within.load(), 0);
  const std::int64_t until_ns = monotonic_ns() + 20'000 * kMs;
  while (device.within == 0 && monotonic_ns() < until_ns) command({{6, 8, 0}, {}, 0});
  link->is_ending = 1;
  thread.join();
  EXPECT_GT(device.within.load(), 0) << "a force of exactly the limit acts";
  EXPECT_EQ(device.excessive.load(), 0);
}

}  // namespace
}  // namespace tactus::hrtc_service
