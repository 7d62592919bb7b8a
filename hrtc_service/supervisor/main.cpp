#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <iostream>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "event_log/event_log.hpp"
#include "hrtc_service/program/opened_devices.hpp"
#include "hrtc_service/program/options.hpp"
#include "hrtc_service/servo/servo_runner.hpp"
#include "hrtc_service/servo/shared_block.hpp"
#include "hrtc_service/supervisor/supervisor.hpp"
#include "realtime/child_process.hpp"
#include "realtime/process.hpp"
#include "session/printable.hpp"

namespace {

using namespace tactus;

int run(const hrtc_service::HrtcOptions& options, const std::vector<std::string>& arguments) {
  // A signal that arrives before the first cycle is obeyed in that cycle.
  (void)realtime::emergency_stop_signals();
  (void)realtime::save_signals();
  const std::atomic<bool>& stop = realtime::stop_signal();
  const hrtc_service::OpenedDevices devices{options};
  const hrtc_service::SharedBlock block = hrtc_service::SharedBlock::create(!options.log.empty());
  std::vector<std::string> command{realtime::helper_program("tactus-gateway")};
  command.insert(command.end(), arguments.begin(), arguments.end());
  command.insert(command.end(), {"--link", std::to_string(realtime::ChildProcess::kSharedMemory)});
  realtime::ChildProcess gateway{std::move(command), block.memory().descriptor()};
  hrtc_service::ServoRunner servo{devices.servo_options(options), block.link(), block.log()};
  servo.on_event = event_log::write;
  servo.start();
  bool is_saved = true;
  hrtc_service::Supervisor supervisor{gateway, block.link(), stop, [&] { is_saved = servo.stop(); }, event_log::write};
  const int status = supervisor.run();
  return is_saved ? status : std::max(status, 1);
}

}  // namespace

int main(int argc, char** argv) {
  realtime::delay_user_signals();  // also until the program of --one-process can handle them
  const auto [options, exit_status] = hrtc_service::read_options(argc, argv);
  if (!options) return exit_status;
  try {
    if (options->one_process) {
      const std::string gateway = realtime::helper_program("tactus-gateway");
      execv(gateway.c_str(), argv);
      throw std::system_error{errno, std::generic_category(), gateway};
    }
    event_log::begin("tactus-hrtc");
    if (!options->warning.empty()) event_log::write(session::Severity::kWarning, options->warning);
    return run(*options, {argv + 1, argv + argc});
  } catch (const std::exception& error) {
    std::cerr << "tactus-hrtc: " << session::printable(error.what()) << '\n';
    return 2;
  }
}
