#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <iostream>
#include <string>
#include <system_error>
#include <vector>

#include "hrtc_service/program/log.hpp"
#include "hrtc_service/program/opened_devices.hpp"
#include "hrtc_service/program/options.hpp"
#include "hrtc_service/servo/servo_runner.hpp"
#include "hrtc_service/servo/shared_block.hpp"
#include "hrtc_service/supervisor/supervisor.hpp"
#include "realtime/process.hpp"

namespace {

using namespace tactus;

int run(const hrtc_service::HrtcOptions& options, const std::vector<std::string>& arguments) {
  const std::atomic<bool>& stop = realtime::stop_signal();
  signal(SIGCHLD, SIG_DFL);  // a parent that ignores it would hide the end of the gateway
  const hrtc_service::OpenedDevices devices{options};
  const hrtc_service::SharedBlock block = hrtc_service::SharedBlock::create(!options.log.empty());
  hrtc_service::GatewayProcess gateway{arguments, block.descriptor()};
  hrtc_service::ServoRunner servo{devices.servo_options(options), block.link(), block.log()};
  servo.on_event = hrtc_service::log_event;
  servo.start();
  bool is_saved = true;
  hrtc_service::Supervisor supervisor{gateway, block.link(), stop, [&] { is_saved = servo.stop(); },
                                      hrtc_service::log_event};
  const int status = supervisor.run();
  return is_saved ? status : std::max(status, 1);
}

}  // namespace

int main(int argc, char** argv) {
  const auto [options, exit_status] = hrtc_service::read_options(argc, argv);
  if (!options) return exit_status;
  try {
    if (options->one_process) {
      execv(hrtc_service::gateway_program().c_str(), argv);
      throw std::system_error{errno, std::generic_category(), hrtc_service::gateway_program()};
    }
    hrtc_service::begin_log("tactus-hrtc");
    if (!options->warning.empty()) hrtc_service::log_event(session::Severity::kWarning, options->warning);
    return run(*options, {argv + 1, argv + argc});
  } catch (const std::exception& error) {
    std::cerr << "tactus-hrtc: " << error.what() << '\n';
    return 2;
  }
}
