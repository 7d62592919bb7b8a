/// tactus-device: runs the driver of one device for tactus-hrtc, which starts it.
#include <signal.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <iostream>
#include <new>
#include <stdexcept>
#include <stop_token>
#include <string>
#include <thread>
#include <utility>

#include "haptics/plugin_device.hpp"
#include "hrtc_service/device/driver_loop.hpp"
#include "realtime/child_process.hpp"
#include "realtime/realtime.hpp"
#include "realtime/shared_memory.hpp"

namespace {

using namespace tactus;
using hrtc_service::DriverLink;
using hrtc_service::DriverLoop;

template <std::size_t kSize>
void set_text(std::array<char, kSize>& characters, const std::string& text) {
  std::strncpy(characters.data(), text.c_str(), kSize - 1);
}

/// Returns what is wrong with the times of the driver's poses, or an empty text.
std::string time_error(const haptics::PluginDevice& device) {
  const std::int64_t ahead_ns = device.ahead_ns();
  if (ahead_ns == 0) return "";
  return "read gave a pose from " + std::to_string(static_cast<double>(ahead_ns) * 1e-9) +
         " s in the future, expected the time of the measurement on CLOCK_MONOTONIC";
}

/// Ends this process if a call of the driver does not return within half a second. The system then closes the device.
/// Counts only the time in which this process runs. Ends the loop if tactus-hrtc has ended, or if poses have wrong
/// times. Polls, so that the loop has no work for it.
void watch(const std::stop_token& token, const haptics::PluginDevice& device, const DriverLoop& loop, DriverLink& link,
           pid_t hrtc) {
  constexpr std::chrono::milliseconds kPoll{50};
  std::uint32_t steps = loop.steps();
  for (int unchanged = 0; unchanged < 10 && !token.stop_requested(); ++unchanged) {
    std::this_thread::sleep_for(kPoll);
    if (getppid() != hrtc) link.is_ending = 1;
    if (const std::string error = time_error(device); !error.empty() && link.is_ending == 0) {
      set_text(link.error, error);
      link.is_ending = 1;
    }
    if (std::exchange(steps, loop.steps()) != steps) unchanged = 0;
  }
  if (token.stop_requested()) return;
  set_text(link.error, "a call of the driver did not return within 0.5 s");
  _exit(1);
}

/// A signal to all processes of a terminal or a service would end or suspend this one before tactus-hrtc has commanded
/// zero force. tactus-hrtc ends it.
void ignore_signals() {
  for (const int number : {SIGTERM, SIGHUP, SIGQUIT, SIGPIPE, SIGTSTP, SIGTTIN, SIGTTOU}) signal(number, SIG_IGN);
}

int run(DriverLink& link, int priority, const char* library, const char* config) {
  const pid_t hrtc = link.hrtc;
  ignore_signals();
  realtime::follow_parent(hrtc);
  haptics::PluginDevice device{library, config};
  set_text(link.name, device.name());
  link.spec = device.spec();
  DriverLoop loop{device, link};
  loop.begin();
  if (const std::string error = time_error(device); !error.empty())
    throw haptics::DeviceError("device " + device.name() + ": " + error);
  const std::jthread watcher{[&](const std::stop_token& token) { watch(token, device, loop, link, hrtc); }};
  if (priority > 0) {  // the HRTC reports at its start whether the system grants both
    (void)realtime::lock_memory();
    (void)realtime::enter_realtime("device", priority);
  }
  link.is_open.store(1, std::memory_order_release);
  loop.run();
  return device.ahead_ns() == 0 ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
  DriverLink* link = nullptr;
  try {
    if (argc != 4) throw std::runtime_error("tactus-device is a part of tactus-hrtc, which starts it");
    const realtime::SharedMemory memory =
        realtime::SharedMemory::open(realtime::ChildProcess::kSharedMemory, sizeof(DriverLink));
    link = std::launder(reinterpret_cast<DriverLink*>(memory.data()));
    if (link->layout != DriverLink::kLayout || memory.bytes() != sizeof(DriverLink)) {
      throw std::runtime_error(
          "tactus-device is of another version than the tactus-hrtc that has started it, perhaps after an upgrade");
    }
    try {
      return run(*link, std::atoi(argv[1]), argv[2], argv[3]);
    } catch (const std::exception& error) {
      set_text(link->error, error.what());
      return 2;
    }
  } catch (const std::exception& error) {
    std::cerr << "tactus-device: " << error.what() << '\n';
    return 2;
  }
}
