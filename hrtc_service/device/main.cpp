/// tactus-device: runs the driver of one device for tactus-hrtc, which starts it.
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
#include "realtime/process.hpp"
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

/// Ends this process if a call of the driver does not return within half a second. The system then closes the device.
/// Counts only the time in which this process runs. Polls, so that the loop has no work for it.
void end_if_it_hangs(const std::stop_token& token, const DriverLoop& loop, DriverLink& link) {
  constexpr std::chrono::milliseconds kPoll{50};
  std::uint32_t steps = loop.steps();
  for (int unchanged = 0; unchanged < 10 && !token.stop_requested(); ++unchanged) {
    std::this_thread::sleep_for(kPoll);
    if (std::exchange(steps, loop.steps()) != steps) unchanged = 0;
  }
  if (token.stop_requested()) return;
  set_text(link.error, "a call of the driver did not return within 0.5 s");
  _exit(1);
}

int run(DriverLink& link, int priority, const char* library, const char* config) {
  const std::atomic<bool>& stop = realtime::stop_signal();
  realtime::follow_parent(link.hrtc);
  haptics::PluginDevice device{library, config};
  set_text(link.name, device.name());
  link.spec = device.spec();
  // The HRTC reports at its start whether the system grants both.
  (void)realtime::lock_memory();
  (void)realtime::enter_realtime("device", priority);
  DriverLoop loop{device, link};
  loop.begin();
  link.is_open.store(1, std::memory_order_release);
  const std::jthread watcher{[&](const std::stop_token& token) { end_if_it_hangs(token, loop, link); }};
  loop.run(stop);
  return 0;
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
