/// Tests the driver of mice and gamepads through a named pipe, because test machines have neither device.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <linux/input.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdarg>
#include <map>
#include <optional>
#include <vector>

#include "haptics/plugin_device.hpp"
#include "tests/support/constants.hpp"
#include "tests/support/temporary_folder.hpp"

namespace {

/// State of the input device that a pipe represents: the pressed keys, and the values of the absolute axes.
struct InputState {
  std::vector<unsigned> keys;
  std::map<unsigned, int> axes;
};
std::optional<InputState> input_state;  // none: the device does not report its state

}  // namespace

/// Answers the requests of the driver for the state of the device, because a pipe has none.
extern "C" int ioctl(int fd, unsigned long request, ...) noexcept {
  std::va_list arguments;
  va_start(arguments, request);
  void* const argument = va_arg(arguments, void*);
  va_end(arguments);
  if (_IOC_TYPE(request) != 'E') return static_cast<int>(syscall(SYS_ioctl, fd, request, argument));
  if (input_state && _IOC_NR(request) == _IOC_NR(EVIOCGKEY(0))) {
    for (const unsigned key : input_state->keys)
      static_cast<unsigned char*>(argument)[key / 8] |= static_cast<unsigned char>(1u << key % 8);
    return 0;
  }
  for (const auto& [code, value] : input_state ? input_state->axes : std::map<unsigned, int>{}) {
    if (request != EVIOCGABS(code)) continue;
    *static_cast<input_absinfo*>(argument) = {value, -32767, 32767, 0, 0, 0};
    return 0;
  }
  errno = ENOTTY;
  return -1;
}

namespace tactus::haptics {
namespace {

class Evdev : public testing::Test {
 protected:
  Evdev() {
    EXPECT_EQ(mkfifo(pipe_.c_str(), 0600), 0);
    pipe_fd_ = open(pipe_.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC);
  }
  ~Evdev() override {
    close(pipe_fd_);
    input_state.reset();
  }

  /// Reads the device in `cycles` cycles, the first at `from_ms`, and returns the last state. The tip follows the mouse
  /// at 0.5 m/s.
  static DeviceState read_cycles(PluginDevice& device, int cycles, int from_ms = 1) {
    DeviceState state;
    for (int ms = from_ms; ms < from_ms + cycles; ++ms) state = device.read(ms * kMs);
    return state;
  }

  void send(unsigned type, unsigned code, int value) const {
    input_event event{};
    event.type = static_cast<std::uint16_t>(type);
    event.code = static_cast<std::uint16_t>(code);
    event.value = value;
    ASSERT_EQ(write(pipe_fd_, &event, sizeof event), static_cast<ssize_t>(sizeof event));
  }

  test_support::TemporaryFolder folder_;
  std::string pipe_ = (folder_.path() / "events").string();
  int pipe_fd_ = -1;
};

std::string evdev_open_error(const std::string& config) {
  try {
    const PluginDevice device{TACTUS_EVDEV, config};
  } catch (const DeviceError& error) {
    return error.what();
  }
  return "";
}

TEST_F(Evdev, AMouseMovesTheTipByItsCounts) {
  PluginDevice mouse{TACTUS_EVDEV, "mouse:" + pipe_};
  (void)mouse.read(kMs);
  send(EV_REL, REL_X, 30);
  send(EV_REL, REL_Y, 20);
  send(EV_REL, REL_WHEEL, -2);
  send(EV_KEY, BTN_LEFT, 1);
  send(EV_SYN, SYN_REPORT, 0);
  EXPECT_NEAR(mouse.read(2 * kMs).position.x(), 0.5e-3, 1e-12) << "the tip does not jump";
  const DeviceState state = read_cycles(mouse, 8, 3);
  EXPECT_LT((state.position - Vec3d(0.003, -0.002, -0.004)).norm(), 1e-12);
  EXPECT_EQ(state.buttons, kClutchButton);
  EXPECT_EQ(state.time_ns, 10 * kMs);
  EXPECT_EQ(mouse.read(11 * kMs).time_ns, 11 * kMs) << "a device at rest does not age";
  send(EV_KEY, BTN_LEFT, 0);
  send(EV_KEY, BTN_RIGHT, 1);
  EXPECT_EQ(mouse.read(12 * kMs).buttons, kGrabButton);
  send(EV_KEY, BTN_RIGHT, 0);
  send(EV_KEY, BTN_EXTRA, 1);
  EXPECT_EQ(mouse.read(13 * kMs).buttons, kStopButton);
  send(EV_KEY, BTN_EXTRA, 0);
  EXPECT_EQ(mouse.read(14 * kMs).buttons, 0u);
  send(EV_KEY, BTN_EXTRA, 1);
  send(EV_KEY, BTN_EXTRA, 0);
  EXPECT_EQ(mouse.read(15 * kMs).buttons, kStopButton) << "a press between two cycles";
  EXPECT_EQ(mouse.read(16 * kMs).buttons, 0u);
}

TEST_F(Evdev, TheTipStaysInsideItsWorkspace) {
  PluginDevice mouse{TACTUS_EVDEV, "mouse:" + pipe_};
  send(EV_REL, REL_X, 1'000'000);
  EXPECT_EQ(read_cycles(mouse, 450).position.x(), 0.2);
  send(EV_REL, REL_X, -1);
  EXPECT_NEAR(read_cycles(mouse, 2, 451).position.x(), 0.2 - 1e-4, 1e-12);
}

TEST_F(Evdev, ADeflectedStickMovesTheTip) {
  PluginDevice gamepad{TACTUS_EVDEV, "gamepad:" + pipe_};
  (void)gamepad.read(kMs);
  send(EV_ABS, ABS_X, 32767);
  send(EV_ABS, ABS_Y, 1000);  // inside the dead zone
  DeviceState state;
  for (int ms = 2; ms <= 101; ++ms) state = gamepad.read(ms * kMs);
  EXPECT_NEAR(state.position.x(), 0.015, 1e-9);
  EXPECT_EQ(state.position.y(), 0);
  send(EV_ABS, ABS_X, 0);
  for (int ms = 102; ms <= 201; ++ms) state = gamepad.read(ms * kMs);
  EXPECT_NEAR(state.position.x(), 0.015, 1e-9);
}

TEST_F(Evdev, ManyEventsOfOneCycleAreReadWithinTheNextCycles) {
  PluginDevice mouse{TACTUS_EVDEV, "mouse:" + pipe_};
  for (int i = 0; i < 500; ++i) send(EV_REL, REL_X, 1);
  EXPECT_NEAR(read_cycles(mouse, 120).position.x(), 0.05, 1e-12);
}

/// Sends what the kernel sends after its queue overflowed: the rest of one packet is missing.
TEST_F(Evdev, ButtonsReleasedInAQueueOverflowAreReleased) {
  PluginDevice mouse{TACTUS_EVDEV, "mouse:" + pipe_};
  send(EV_KEY, BTN_LEFT, 1);
  send(EV_SYN, SYN_REPORT, 0);
  ASSERT_EQ(mouse.read(kMs).buttons, kClutchButton);
  input_state = InputState{{BTN_RIGHT}, {}};
  send(EV_SYN, SYN_DROPPED, 0);
  send(EV_KEY, BTN_LEFT, 1);
  send(EV_SYN, SYN_REPORT, 0);
  EXPECT_EQ(mouse.read(2 * kMs).buttons, kGrabButton);
  send(EV_KEY, BTN_LEFT, 1);
  EXPECT_EQ(mouse.read(3 * kMs).buttons, kClutchButton | kGrabButton);
}

TEST_F(Evdev, AStickReleasedInAQueueOverflowStopsTheTip) {
  PluginDevice gamepad{TACTUS_EVDEV, "gamepad:" + pipe_};
  (void)gamepad.read(kMs);
  send(EV_ABS, ABS_X, 32767);
  const double before = read_cycles(gamepad, 100, 2).position.x();
  ASSERT_GT(before, 0.01);
  input_state = InputState{{}, {{ABS_X, 0}, {ABS_Y, -32767}, {ABS_RY, 0}}};
  send(EV_SYN, SYN_DROPPED, 0);
  send(EV_ABS, ABS_X, 32767);
  send(EV_SYN, SYN_REPORT, 0);
  const DeviceState state = read_cycles(gamepad, 100, 102);
  EXPECT_NEAR(state.position.x(), before, 1e-3);
  EXPECT_NEAR(state.position.y(), 0.015, 1e-3) << "the other stick was deflected during the overflow";
}

TEST_F(Evdev, AnOverflowOfADeviceThatDoesNotReportItsStateReleasesAll) {
  PluginDevice gamepad{TACTUS_EVDEV, "gamepad:" + pipe_};
  (void)gamepad.read(kMs);
  send(EV_KEY, BTN_EAST, 1);
  send(EV_ABS, ABS_X, 32767);
  const DeviceState before = read_cycles(gamepad, 100, 2);
  ASSERT_EQ(before.buttons, kGrabButton);
  send(EV_SYN, SYN_DROPPED, 0);
  send(EV_SYN, SYN_REPORT, 0);
  const DeviceState state = read_cycles(gamepad, 100, 102);
  EXPECT_EQ(state.buttons, 0u);
  EXPECT_NEAR(state.position.x(), before.position.x(), 1e-3);
}

TEST_F(Evdev, AStickDeflectedAndAButtonPressedBeforeTheStartAreUsed) {
  input_state = InputState{{BTN_SOUTH}, {{ABS_X, 32767}, {ABS_Y, 0}, {ABS_RY, 0}}};
  PluginDevice gamepad{TACTUS_EVDEV, "gamepad:" + pipe_};
  const DeviceState state = read_cycles(gamepad, 101);
  EXPECT_EQ(state.buttons, kClutchButton);
  EXPECT_NEAR(state.position.x(), 0.015, 1e-9);
}

TEST_F(Evdev, AForceWithoutRumbleSupportIsNotAFailure) {
  PluginDevice gamepad{TACTUS_EVDEV, "gamepad:" + pipe_};
  (void)gamepad.read(kMs);
  gamepad.write({3, 0, 0});
  EXPECT_EQ(gamepad.health(), DeviceHealth::kReady);
}

TEST_F(Evdev, AnOpenErrorStatesTheFoundAndTheExpectedConfiguration) {
  EXPECT_THAT(evdev_open_error("joystick:/dev/input/js0"), testing::HasSubstr("expected mouse:FILE or gamepad:FILE"));
  EXPECT_THAT(evdev_open_error(""), testing::HasSubstr("expected mouse:FILE or gamepad:FILE"));
  EXPECT_THAT(evdev_open_error("mouse:/nowhere/event0"),
              testing::HasSubstr("cannot open /nowhere/event0: No such file"));
}

}  // namespace
}  // namespace tactus::haptics
