#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <atomic>
#include <iostream>
#include <map>

#include "haptics/plugin_device.hpp"
#include "haptics/replay_device.hpp"
#include "hrtc_service/hrtc.hpp"
#include "realtime/process.hpp"
#include "spm/directory.hpp"
#include "spm/offline/generate.hpp"
#include "spm/offline/import.hpp"
#include "wire/address/command_line.hpp"

namespace {

constexpr char kExamples[] = R"(
Examples:
  tactus-hrtc --session lab --name desk1
  tactus-hrtc --session lab --name desk2 --pool 30000 --log desk2.log --snapshot shots
  tactus-hrtc --session lab --name desk3 --replay alice=poses.csv
  tactus-hrtc --session lab --name desk4 --device bob=./mydevice.so,/dev/ttyACM0
  tactus-hrtc --session lab --name desk5 --tool stylus

SIGUSR1 saves the flight recording. SIGUSR2 is an emergency stop of the session.
Exit status: 0 ended by the session or a signal, 1 no host found or an output file failed, 2 wrong input or a name in use.)";

/// Returns the text before and after the first `=`. Throws CLI::ValidationError if one of them is empty.
std::pair<std::string, std::string> parts_of(const std::string& text, const char* option, const char* expected) {
  const std::size_t equals = text.find('=');
  if (equals == std::string::npos || equals == 0 || equals + 1 == text.size())
    throw CLI::ValidationError(option, "found " + text + ", expected " + expected);
  return {text.substr(0, equals), text.substr(equals + 1)};
}

/// Opens a device by its driver. `text`: "FILE" or "FILE,CONFIG".
std::unique_ptr<tactus::haptics::Device> open_plugin(const std::string& text) {
  const std::size_t comma = text.find(',');
  const std::string config = comma == std::string::npos ? "" : text.substr(comma + 1);
  auto device = std::make_unique<tactus::haptics::PluginDevice>(text.substr(0, comma), config);
  spdlog::info("device {}", device->name());
  return device;
}

/// Loads a mesh file, or the built-in mesh of that name.
std::unique_ptr<const tactus::spm::MeshProbe> open_tool(const std::string& name) {
  using namespace tactus::spm;
  constexpr double kMaxRadius = 1;  // m; a larger mesh probably has another unit
  const offline::TriangleMesh mesh = name == "stylus" ? offline::stylus() : offline::import_mesh(name);
  auto tool = std::make_unique<const MeshProbe>(mesh.positions, mesh.faces);
  if (tool->radius() > kMaxRadius)
    throw std::runtime_error("--tool " + name + ": found a vertex at " + std::to_string(tool->radius()) +
                             " from the origin, expected metres, at most " + std::to_string(kMaxRadius));
  return tool;
}

}  // namespace

int main(int argc, char** argv) {
  using namespace tactus;
  hrtc_service::HrtcOptions options;
  options.address.session = "tactus";
  options.address.participant = "hrtc";
  options.flight.folder = std::filesystem::temp_directory_path() / ("tactus-flight-" + std::to_string(geteuid()));
  options.save_requests = &realtime::save_signals();
  options.core.servo.emergency_stop_signals = &realtime::emergency_stop_signals();
  constexpr std::uint32_t kMinSlots = 256;
  constexpr double kToolDeadline = 400;  // us; a cycle with a tool may take more than 200 us
  std::uint32_t slots = 1u << 16;
  std::uint32_t cache_blocks = 0;
  std::uint64_t memory_bytes = 0;
  double rate = 1000, deadline_us = 250, radius_mm = 3, frame_scale = 1;
  std::vector<double> frame_offset{0, 0, 0};
  std::vector<std::string> replays, plugins;
  double max_force = options.core.servo.cycle.force.max_force;
  double max_torque = options.core.servo.cycle.force.max_torque;
  std::string tool;

  std::vector<std::pair<std::string, std::string>> local;  // replays, then plug-ins

  CLI::App app{"Haptic real-time controller: refines near contact, finds collisions, renders forces at 1 kHz.",
               "tactus-hrtc"};
  app.footer(kExamples);
  wire::add_address_options(app, options.address, "HRTC");
  CLI::Option* pool =
      app.add_option("--pool", slots,
                     "Slots for the records of all objects; 64 Ki slots with their compressed cache take 38 MiB")
          ->capture_default_str()
          ->check(CLI::Range(kMinSlots, spm::kMaxSlots));
  CLI::Option* cache =
      app.add_option("--compressed-cache", cache_blocks,
                     "Blocks of 20 bytes for compressed records; a record takes one or two (default: 6 for each slot)")
          ->check(CLI::Range(1u, spm::kMaxSlots));
  CLI::Option* memory = app.add_option("--memory", memory_bytes,
                                       "Memory for all models and the flight recorder, instead of --pool: 16MiB, 1GiB")
                            ->transform(CLI::AsSizeValue(false))
                            ->excludes(pool)
                            ->excludes(cache);
  std::map<std::string, spm::Strategy> strategies;
  for (std::size_t i = 0; i < spm::kStrategyNames.size(); ++i)
    strategies[spm::kStrategyNames[i]] = static_cast<spm::Strategy>(i);
  app.add_option("--prediction", options.core.gateway.loader.strategy,
                 "Strategy that predicts the regions that a tip will touch")
      ->transform(CLI::CheckedTransformer(strategies, CLI::ignore_case)
                      .description("{neighbours,linear,polynomial,distance,mixture}"))
      ->default_str("mixture");
  app.add_option("--targets", options.core.servo.cycle.targets,
                 "Maximum number of refined regions of an object; less urgent regions remain coarse")
      ->capture_default_str()
      ->check(CLI::Range(1u, hrtc_service::CycleSettings::kMaxTargets));
  app.add_option("--users", options.max_users, "Maximum number of probes")
      ->capture_default_str()
      ->check(CLI::Range(1u, hrtc_service::kMaxProbes));
  app.add_option("--rate", rate, "Cycles per second")->capture_default_str()->check(CLI::Range(100.0, 10000.0));
  const CLI::Option* deadline =
      app.add_option("--deadline", deadline_us,
                     "Maximum time of a cycle's own work, us; limits refinement (default with --tool: 400)")
          ->capture_default_str()
          ->check(CLI::Range(20.0, 10000.0));
  app.add_option("--priority", options.haptic.priority, "SCHED_FIFO priority of the haptic thread; 0: none")
      ->capture_default_str()
      ->check(CLI::Range(0, 98));
  app.add_option("--tip-radius", radius_mm, "Radius of every tip, mm")
      ->capture_default_str()
      ->check(CLI::Range(0.1, 100.0));
  app.add_option("--max-force", max_force, "Maximum force, N")->capture_default_str()->check(CLI::Range(0.1, 100.0));
  app.add_option(
      "--tool", tool,
      "Tool of every user, with six degrees of freedom, instead of a sphere: 'stylus', or a mesh file in metres "
      "with its origin at the device's tip");
  app.add_option("--max-torque", max_torque, "Maximum torque, N m")
      ->capture_default_str()
      ->check(CLI::Range(0.001, 10.0));
  app.add_option("--replay", replays, "USER=FILE: adds a user whose device replays the lines time_s,x,y,z of a file");
  app.add_option("--device", plugins,
                 "USER=DRIVER[,CONFIG]: adds a user with a device at this machine; DRIVER is its shared library "
                 "(docs/how-to/own-device.md)");
  app.add_option("--device-scale", frame_scale, "World metres per device metre, for devices at this machine")
      ->capture_default_str()
      ->check(CLI::Range(1e-3, 1e3));
  app.add_option("--device-offset", frame_offset, "Origin of the devices at this machine in the world, m")->expected(3);
  app.add_option("--log", options.log, "Contact log, for tactus-mesh audit");
  app.add_option("--snapshot", options.snapshot, "Directory for PLY files of the active mesh during contact");
  app.add_option("--flight-recorder", options.flight.seconds,
                 "Time of the newest cycles in memory, s; written to a file for tactus replay after a fault, an "
                 "emergency stop or "
                 "SIGUSR1; 0: no recorder")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 3600.0));
  app.add_option("--flight-folder", options.flight.folder, "Folder for the files of the flight recorder")
      ->capture_default_str();
  app.add_option("--flight-file", options.flight.file, "File for the flight recording at the end of the program");
  app.add_option("--wait-host", options.host_patience,
                 "Time to wait for a first host before the program ends, s; 0: no limit");
  app.add_option("--state-rate", options.state_rate, "Maximum rate of probe states, Hz")
      ->capture_default_str()
      ->check(CLI::Range(1.0, 10000.0));
  app.add_flag("--coding,!--no-coding", options.uses_deadband,
               "Send deadband-coded states to the session (default), or with --no-coding every probe state");
  app.add_flag("--reference-timer", options.reference_timer,
               "Also measure a thread of the same priority that only waits");
  try {
    app.parse(argc, argv);
    for (const std::string& replay : replays) local.push_back(parts_of(replay, "--replay", "USER=FILE"));
    for (const std::string& plugin : plugins) local.push_back(parts_of(plugin, "--device", "USER=DRIVER[,CONFIG]"));
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }

  options.core.pool = spm::PoolSettings::for_slots(slots);
  if (cache->count() > 0) options.core.pool.compressed_blocks = cache_blocks;
  if (memory->count() > 0) {
    const bool is_recorder_requested = options.flight.seconds > 0;
    const std::uint64_t recorder =
        hrtc_service::limit_flight(options.flight, memory_bytes, 1 / rate, options.max_users);
    if (is_recorder_requested && recorder == 0) {
      std::cerr << "tactus-hrtc: --memory: an eighth of " << memory_bytes
                << " bytes does not hold a second of flight recording for " << options.max_users
                << " probes, so nothing is recorded; fewer --users need less memory\n";
    }
    const spm::MemoryShares shares = spm::memory_shares(memory_bytes - recorder);
    options.core.gateway.loader.directory_bytes = shares.directories;
    options.core.pool = shares.pool;
    if (options.core.pool.slots < kMinSlots) {
      std::cerr << "tactus-hrtc: --memory: found " << memory_bytes << " bytes, which hold " << options.core.pool.slots
                << " slots, expected room for " << kMinSlots << "\n";
      return 2;
    }
    slots = options.core.pool.slots;
  }
  options.core.servo.cycle.period = options.haptic.period = 1 / rate;
  options.core.servo.cycle.radius = radius_mm * 1e-3;
  options.core.servo.cycle.force.max_force = max_force;
  options.core.servo.cycle.force.max_torque = max_torque;
  if (!tool.empty() && deadline->count() == 0) deadline_us = kToolDeadline;
  options.haptic.deadline_ns = static_cast<std::int64_t>(deadline_us * 1e3);
  options.haptic.frame = haptics::DeviceFrame{
      Eigen::Quaterniond::Identity(), {frame_offset[0], frame_offset[1], frame_offset[2]}, frame_scale};
  options.core.servo.snapshot_nodes = options.snapshot.empty() ? 0 : options.core.pool.tree_nodes;
  options.address.probe_priority = options.haptic.priority > 10 ? options.haptic.priority - 10 : 0;

  spdlog::set_default_logger(spdlog::stderr_color_mt("tactus-hrtc"));
  spdlog::set_pattern("%H:%M:%S.%e %n %^%l%$ %v");
  wire::set_log_sink([](const std::string& text) { spdlog::warn("dds: {}", text); });
  const std::atomic<bool>& stop = realtime::stop_signal();
  try {
    for (const auto& [user, device] : local) {
      const bool replayed = options.local_users.size() < replays.size();
      options.local_users.push_back(
          {user, replayed ? std::make_unique<haptics::ReplayDevice>(device) : open_plugin(device)});
    }
    if (!tool.empty()) {
      options.tool = open_tool(tool);
      options.core.servo.cycle.tool = options.tool.get();
      spdlog::info("tool {}: {} triangles, {:.1f} mm from the tip at most", tool, options.tool->triangles(),
                   options.tool->radius() * 1e3);
    }
    hrtc_service::Hrtc hrtc{std::move(options)};
    return hrtc.run(stop);
  } catch (const std::exception& error) {
    std::cerr << "tactus-hrtc: " << error.what() << '\n';
    return 2;
  }
}
