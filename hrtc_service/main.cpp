#include <spdlog/spdlog.h>
#include <sys/prctl.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <fstream>
#include <iostream>
#include <memory>
#include <stdexcept>
#include <stop_token>
#include <thread>

#include "event_log/event_log.hpp"
#include "hrtc_service/gateway_service.hpp"
#include "hrtc_service/program/opened_devices.hpp"
#include "hrtc_service/program/options.hpp"
#include "hrtc_service/servo/servo_runner.hpp"
#include "hrtc_service/servo/shared_block.hpp"
#include "realtime/child_process.hpp"
#include "realtime/process.hpp"
#include "session/printable.hpp"
#include "wire/participants.hpp"

namespace {

using namespace tactus;

/// Runs servo and gateway in this process.
int run_both(const hrtc_service::HrtcOptions& options) {
  // A signal that arrives before the first cycle is obeyed in that cycle.
  (void)realtime::emergency_stop_signals();
  (void)realtime::save_signals();
  prctl(PR_SET_NAME, "tactus-hrtc");  // by which `tactus control stop --local` finds it
  const std::atomic<bool>& stop = realtime::stop_signal();
  if (!options.warning.empty()) event_log::write(session::Severity::kWarning, options.warning);
  const hrtc_service::OpenedDevices devices{options};
  hrtc_service::ServoOptions servo_options = devices.servo_options(options);
  servo_options.servo.watches_gateway = false;
  const hrtc_service::SharedBlock block = hrtc_service::SharedBlock::create(!options.log.empty());
  hrtc_service::ServoRunner servo{servo_options, block.link(), block.log()};
  servo.on_event = event_log::write;
  hrtc_service::GatewayService gateway{options, block.link(), block.log(), servo_options.servo.cycle.tool};
  servo.start();
  bool is_saved = true;
  // As the supervisor does between two processes. It polls, because nothing notifies of a flag in the block.
  std::jthread end{[&](const std::stop_token& token) {
    while (!token.stop_requested() && block.link().ended() < 0)
      std::this_thread::sleep_for(std::chrono::milliseconds{5});
    is_saved = servo.stop();
    block.link().set_servo_ended();
  }};
  const int status = gateway.run(stop);
  end.request_stop();
  end.join();
  return is_saved ? status : std::max(status, 1);
}

/// Runs the gateway of a servo in the process that has started this one.
int run_gateway(const hrtc_service::HrtcOptions& options) {
  const std::atomic<bool>& stop = realtime::stop_signal();
  const hrtc_service::SharedBlock block = hrtc_service::SharedBlock::open(options.link);
  // The library that reads packets of the network runs in this process, and the servo is another one of the same user.
  if (!realtime::forbid_debugging_others())
    event_log::write(session::Severity::kWarning, "the kernel has no Landlock; see docs/explanation/threats.md");
  realtime::follow_parent(block.servo());
  // If memory is short, the system should end this process, also if the servo has far more memory: this adds the most
  // that the memory of a process can count.
  std::ofstream{"/proc/self/oom_score_adj"} << 1000;
  try {
    const std::unique_ptr<const spm::MeshProbe> tool = hrtc_service::load_tool(options.tool);
    return hrtc_service::GatewayService{options, block.link(), block.log(), tool.get()}.run(stop);
  } catch (const std::exception& error) {
    if (block.link().heartbeats() == 0) throw;
    event_log::write(session::Severity::kError, error.what());
    return hrtc_service::kStartAgain;
  }
}

}  // namespace

int main(int argc, char** argv) {
  const auto [options, exit_status] = hrtc_service::read_options(argc, argv);
  if (!options) return exit_status;
  event_log::begin(options->one_process ? "tactus-hrtc" : "tactus-gateway");
  wire::set_log_sink(event_log::write);
  try {
    if (!options->one_process && options->link < 0)
      throw std::runtime_error("tactus-gateway is a part of tactus-hrtc, which starts it");
    return options->one_process ? run_both(*options) : run_gateway(*options);
  } catch (const std::exception& error) {
    std::cerr << "tactus-hrtc: " << session::printable(error.what()) << '\n';
    return 2;
  }
}
