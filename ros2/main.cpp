// tactus-ros2: publishes a session in a ROS 2 domain, and moves users to target poses from there.
#include <CLI/CLI.hpp>
#include <iostream>
#include <string>

#include "event_log/event_log.hpp"
#include "realtime/process.hpp"
#include "ros2/bridge.hpp"
#include "session/printable.hpp"
#include "wire/address/command_line.hpp"
#include "wire/address/finite_range.hpp"
#include "wire/ros2.hpp"

namespace {

constexpr char kExamples[] = R"(
Examples:
  tactus ros2 --session lab --domain 40 --ros-domain 0
  tactus ros2 --session lab --domain 40 --rate 1000 --read-only
  ros2 topic echo /tactus/ann/wrench

Publishes /tactus/USER/wrench, pose, proxy and twist of each user, /tf with the poses of objects, and /tactus/markers
with their meshes. A publisher of /tactus/USER/target_pose brings a user, whose hand follows the poses. Needs no ROS.
Exit status: 0 ended by a signal, 2 wrong input, or the name is taken.)";

}  // namespace

int main(int argc, char** argv) {
  using namespace tactus;
  ros2::BridgeOptions options;
  options.address.session = "tactus";
  options.address.participant = "ros2";
  std::uint64_t memory = 64u << 20;
  bool is_read_only = false;

  CLI::App app{"Publishes a session in a ROS 2 domain, and moves users to target poses from there.", "tactus-ros2"};
  app.footer(kExamples);
  wire::add_address_options(app, options.address, "program");
  app.add_option("--ros-domain", options.domain, "Domain of ROS")
      ->envname("ROS_DOMAIN_ID")
      ->check(CLI::Range(0, wire::kMaxRosDomain))
      ->capture_default_str();
  app.add_option("--rate", options.rate, "Messages a second on each topic of a user, 1 to 1000")
      ->check(wire::finite_range(1.0, 1000.0))
      ->capture_default_str();
  app.add_option("--frame", options.frame, "Name of the world frame in ROS")->capture_default_str();
  app.add_flag("--read-only", is_read_only, "Ignore target poses");
  app.add_option("--hrtc", options.hrtc, "HRTC of the users from ROS; default: the one with the fewest users")
      ->excludes("--read-only");
  app.add_option("--memory", memory, "Memory of the pool, for the meshes of all objects: 64MiB, 1GiB")
      ->transform(CLI::AsSizeValue(false))
      ->default_str("64MiB");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  const std::atomic<bool>& stop = realtime::stop_signal();
  try {
    constexpr std::uint32_t kMinSlots = 1000;
    options.pool = spm::PoolSettings::for_bytes(memory);
    if (options.pool.slots < kMinSlots) {
      std::cerr << "tactus-ros2: --memory: found " << memory << " bytes, which hold " << options.pool.slots
                << " slots of the pool, expected at least " << kMinSlots << "\n";
      return 2;
    }
    options.takes_targets = !is_read_only;
    event_log::begin("tactus-ros2");
    wire::set_log_sink(event_log::write);
    options.log = [](const std::string& text) { event_log::write(session::Severity::kInfo, text); };
    const std::string text =
        "session " + options.address.session + " is published in ROS domain " + std::to_string(options.domain);
    ros2::Bridge bridge{std::move(options)};
    std::cout << text << std::endl;
    return bridge.run(stop);
  } catch (const std::exception& error) {
    std::cerr << "tactus-ros2: " << session::printable(error.what()) << '\n';
    return 2;
  }
}
