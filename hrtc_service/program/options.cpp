#include "hrtc_service/program/options.hpp"

#include <unistd.h>

#include <CLI/CLI.hpp>
#include <map>
#include <utility>
#include <vector>

#include "session/check.hpp"
#include "session/printable.hpp"
#include "spm/directory.hpp"
#include "wire/address/command_line.hpp"
#include "wire/address/finite_range.hpp"

namespace tactus::hrtc_service {
namespace {

constexpr char kExamples[] = R"(
Examples:
  tactus-hrtc --session lab --name desk1
  tactus-hrtc --session lab --name desk2 --pool 30000 --log desk2.log --snapshot shots
  tactus-hrtc --session lab --name desk3 --replay alice=poses.csv
  tactus-hrtc --session lab --name desk4 --device bob=./mydevice.so,/dev/ttyACM0
  tactus-hrtc --session lab --name desk5 --tool stylus

The haptic thread runs in this process. It starts the gateway, tactus-gateway, which exchanges samples with the session,
and starts it again if it is killed. For each --device it starts tactus-device, which runs the driver. SIGUSR1 saves the flight recording. SIGUSR2 is an emergency stop of the session.
Exit status: 0 ended by the session or a signal, 1 no host found or an output file failed, 2 wrong input or a name in use.)";

/// Returns the text before and after the first `=`. Throws CLI::ValidationError if one of them is empty.
std::pair<std::string, std::string> parts_of(const std::string& text, const char* option, const char* expected) {
  const std::size_t equals = text.find('=');
  if (equals == std::string::npos || equals == 0 || equals + 1 == text.size())
    throw CLI::ValidationError(option, "found " + text + ", expected " + expected);
  return {text.substr(0, equals), text.substr(equals + 1)};
}

/// Values of the command line that determine other settings.
struct Arguments {
  std::uint32_t slots = 1u << 16;
  std::uint32_t cache_blocks = 0;
  std::uint64_t memory_bytes = 0;
  double rate = 1000, radius_mm = 3, frame_scale = 1;
  std::optional<double> deadline_us;
  std::vector<double> frame_offset{0, 0, 0};
  std::vector<std::string> replays, drivers;
  CLI::Option *cache = nullptr, *memory = nullptr;
};

constexpr std::uint32_t kMinSlots = 256;
/// Default deadline divided by the period of the cycles; a cycle of 1 ms with a tool may take more than 200 us.
constexpr double kTipDeadline = 0.25, kToolDeadline = 0.4;

void add_memory_options(CLI::App& app, Arguments& given) {
  CLI::Option* pool =
      app.add_option("--pool", given.slots,
                     "Slots for the records of all objects; 64 Ki slots with their compressed cache take 38 MiB")
          ->capture_default_str()
          ->check(CLI::Range(kMinSlots, spm::kMaxSlots));
  given.cache =
      app.add_option("--compressed-cache", given.cache_blocks,
                     "Blocks of 20 bytes for compressed records; a record takes one or two (default: 6 for each slot)")
          ->check(CLI::Range(1u, spm::kMaxCompressedBlocks));
  given.memory = app.add_option("--memory", given.memory_bytes,
                                "Memory for all models and the flight recorder, instead of --pool: 16MiB, 1GiB")
                     ->transform(CLI::AsSizeValue(false))
                     ->excludes(pool)
                     ->excludes(given.cache);
}

void add_cycle_options(CLI::App& app, Arguments& given, HrtcOptions& options) {
  std::map<std::string, spm::Strategy> strategies;
  for (std::size_t i = 0; i < spm::kStrategyNames.size(); ++i)
    strategies[spm::kStrategyNames[i]] = static_cast<spm::Strategy>(i);
  app.add_option("--prediction", options.prediction, "Strategy that predicts the regions that a tip will touch")
      ->transform(CLI::CheckedTransformer(strategies, CLI::ignore_case)
                      .description("{neighbours,linear,polynomial,distance,mixture}"))
      ->default_str("mixture");
  app.add_option("--targets", options.servo.cycle.targets,
                 "Maximum number of refined regions of an object; less urgent regions remain coarse")
      ->capture_default_str()
      ->check(CLI::Range(1u, CycleSettings::kMaxTargets));
  app.add_option("--users", options.max_users, "Maximum number of probes")
      ->capture_default_str()
      ->check(CLI::Range(1u, kMaxProbes));
  app.add_option("--rate", given.rate, "Cycles per second")
      ->capture_default_str()
      ->check(wire::finite_range(100.0, 10000.0));
  app.add_option("--deadline", given.deadline_us,
                 "Maximum time of a cycle's own work, us; limits refinement (default: 25 % of the period of the "
                 "cycles, with --tool 40 %)")
      ->check(wire::finite_range(20.0, 10000.0));
  app.add_option("--priority", options.haptic.priority,
                 "SCHED_FIFO priority of the haptic thread and of drivers; 0: none")
      ->capture_default_str()
      ->check(CLI::Range(0, 98));
}

void add_force_options(CLI::App& app, Arguments& given, HrtcOptions& options) {
  haptics::ForceSettings& force = options.servo.cycle.force;
  app.add_option("--tip-radius", given.radius_mm, "Radius of every tip, mm")
      ->capture_default_str()
      ->check(wire::finite_range(0.1, 100.0));
  app.add_option("--max-force", force.max_force, "Maximum force, N")
      ->capture_default_str()
      ->check(wire::finite_range(0.1, 100.0));
  app.add_option(
      "--tool", options.tool,
      "Tool of every user, with six degrees of freedom, instead of a sphere: 'stylus', or a mesh file in metres "
      "with its origin at the device's tip");
  app.add_option("--max-torque", force.max_torque, "Maximum torque, N m")
      ->capture_default_str()
      ->check(wire::finite_range(0.001, 10.0));
  app.add_option("--gateway-patience", options.servo.gateway_patience,
                 "Time for which fixed objects can be touched while the gateway does not run, s")
      ->capture_default_str()
      ->check(wire::finite_range(0.0, 3600.0));
}

void add_device_options(CLI::App& app, Arguments& given) {
  app.add_option("--replay", given.replays,
                 "USER=FILE: adds a user whose device replays the lines time_s,x,y,z of a file");
  app.add_option("--device", given.drivers,
                 "USER=DRIVER[,CONFIG]: adds a user with a device at this machine; DRIVER is its shared library "
                 "(docs/how-to/own-device.md)");
  app.add_option("--device-scale", given.frame_scale, "World metres per device metre, for devices at this machine")
      ->capture_default_str()
      ->check(wire::finite_range(1e-3, 1e3));
  app.add_option("--device-offset", given.frame_offset, "Origin of the devices at this machine in the world, m")
      ->expected(3)
      ->check(wire::finite_number());
}

void add_file_options(CLI::App& app, HrtcOptions& options) {
  app.add_option("--log", options.log, "Contact log, for tactus-mesh audit");
  app.add_option("--snapshot", options.snapshot, "Directory for PLY files of the active mesh during contact");
  app.add_option("--flight-recorder", options.flight.seconds,
                 "Time of the newest cycles in memory, s; written to a file for tactus replay after a fault, an "
                 "emergency stop or SIGUSR1; 0: no recorder")
      ->capture_default_str()
      ->check(wire::finite_range(0.0, 3600.0));
  app.add_option("--flight-folder", options.flight.folder, "Folder for the files of the flight recorder")
      ->capture_default_str();
  app.add_option("--flight-file", options.flight.file, "File for the flight recording at the end of the program");
}

void add_session_options(CLI::App& app, HrtcOptions& options) {
  app.add_option("--wait-host", options.host_patience,
                 "Time to wait for a first host before the program ends, s; 0: no limit")
      ->check(wire::finite_non_negative());
  app.add_option("--state-rate", options.state_rate, "Maximum rate of probe states, Hz")
      ->capture_default_str()
      ->check(wire::finite_range(1.0, 10000.0));
  app.add_flag("--coding,!--no-coding", options.uses_deadband,
               "Send deadband-coded states to the session (default), or with --no-coding every probe state");
  app.add_flag("--reference-timer", options.reference_timer,
               "Also measure a thread of the same priority that only waits");
  app.add_flag("--one-process", options.one_process,
               "Run the haptic thread and the gateway in one process, for a debugger");
  app.add_option("--link", options.link)->group("");  // of tactus-hrtc for tactus-gateway; not in the help
}

/// Sets the sizes of the memory. Throws CLI::ValidationError if --memory is too small.
void set_memory(const Arguments& given, HrtcOptions& options) {
  options.pool = spm::PoolSettings::for_slots(given.slots);
  if (given.cache->count() > 0) options.pool.compressed_blocks = given.cache_blocks;
  if (given.memory->count() == 0) return;
  const bool is_recorder_requested = options.flight.seconds > 0;
  const std::uint64_t recorder = limit_flight(options.flight, given.memory_bytes, 1 / given.rate, options.max_users);
  if (is_recorder_requested && recorder == 0) {
    options.warning = "--memory: an eighth of " + std::to_string(given.memory_bytes) +
                      " bytes does not hold a second of flight recording for " + std::to_string(options.max_users) +
                      " probes, so nothing is recorded; fewer --users need less memory";
  }
  const spm::MemoryShares shares = spm::memory_shares(given.memory_bytes - recorder);
  options.directory_bytes = shares.directories;
  options.pool = shares.pool;
  if (options.pool.slots < kMinSlots)
    throw CLI::ValidationError("--memory", "found " + std::to_string(given.memory_bytes) + " bytes, which hold " +
                                               std::to_string(options.pool.slots) + " slots, expected room for " +
                                               std::to_string(kMinSlots));
}

/// An HRTC with another name would send no roster entries, so that no program could stop it.
void check_user(const std::string& user, const char* option) {
  if (!session::is_partition(user))
    throw CLI::ValidationError(option, "found user '" + session::printable(user) +
                                           "', expected 1 to 63 bytes without control characters and * ? [ ] \\");
}

void set_users(const Arguments& given, HrtcOptions& options) {
  for (const std::string& replay : given.replays) {
    const auto [user, file] = parts_of(replay, "--replay", "USER=FILE");
    check_user(user, "--replay");
    options.local_users.push_back({user, file, true});
  }
  for (const std::string& driver : given.drivers) {
    const auto [user, device] = parts_of(driver, "--device", "USER=DRIVER[,CONFIG]");
    check_user(user, "--device");
    options.local_users.push_back({user, device, false});
  }
}

}  // namespace

ReadOptions read_options(int argc, char** argv) {
  HrtcOptions options;
  Arguments given;
  options.address.session = "tactus";
  options.address.participant = "hrtc";
  options.flight.folder = std::filesystem::temp_directory_path() / ("tactus-flight-" + std::to_string(geteuid()));
  CLI::App app{"Haptic real-time controller: refines near contact, finds collisions, renders forces at 1 kHz.",
               "tactus-hrtc"};
  app.footer(kExamples);
  wire::add_address_options(app, options.address, "HRTC");
  add_memory_options(app, given);
  add_cycle_options(app, given, options);
  add_force_options(app, given, options);
  add_device_options(app, given);
  add_file_options(app, options);
  add_session_options(app, options);
  try {
    app.parse(argc, argv);
    set_users(given, options);
    set_memory(given, options);
  } catch (const CLI::ParseError& error) {
    return {std::nullopt, app.exit(error) == 0 ? 0 : 2};
  }
  options.servo.cycle.period = options.haptic.period = 1 / given.rate;
  options.servo.cycle.radius = given.radius_mm * 1e-3;
  const double default_us = (options.tool.empty() ? kTipDeadline : kToolDeadline) * 1e6 / given.rate;
  options.haptic.deadline_ns = static_cast<std::int64_t>(given.deadline_us.value_or(default_us) * 1e3);
  const std::vector<double>& offset = given.frame_offset;
  options.haptic.frame =
      haptics::DeviceFrame{Eigen::Quaterniond::Identity(), {offset[0], offset[1], offset[2]}, given.frame_scale};
  options.servo.snapshot_nodes = options.snapshot.empty() ? 0 : options.pool.tree_nodes;
  options.address.probe_priority = options.haptic.priority > 10 ? options.haptic.priority - 10 : 0;
  return {std::move(options), 0};
}

}  // namespace tactus::hrtc_service
