#include <CLI/CLI.hpp>
#include <cstdlib>
#include <exception>

#include "event_log/event_log.hpp"
#include "host_service/host.hpp"
#include "host_service/model_store.hpp"
#include "realtime/process.hpp"
#include "wire/address/command_line.hpp"
#include "wire/address/finite_range.hpp"

namespace {

constexpr char kExamples[] = R"(
Examples:
  tactus-host --session lab --name host-a organ.spm
  tactus-host --session lab --name host-b --at 0.5 0 0 terrain.ply
  tactus-host --session lab --name host-c --config lab.yaml

lab.yaml:
  objects:
    - name: organ
      model: organ.ply
      position: [0, 0, 0.1]
      rpy_degrees: [0, 0, 90]
      size: 0.2
      material: {stiffness: 800, damping: 2, static_friction: 0.3, dynamic_friction: 0.2}
    - model: crate.spm
      body: {mass: 0.8, friction: 0.6}
  ground: 0

Other model files than .spm are built first; the cache directory stores the result by the file's content.
Exit status: 0 the session or a signal ended the program, 2 wrong input, or another program has this name.)";

}  // namespace

int main(int argc, char** argv) {
  using namespace tactus;
  host_service::HostOptions options;
  options.address.session = "tactus";
  options.address.participant = "host";
  options.cache = host_service::default_cache_directory();
  options.raise_priority = true;
  std::filesystem::path config;
  std::vector<std::filesystem::path> models;
  std::vector<double> at{0, 0, 0};

  CLI::App app{"VE host: serves models to a session, region by region.", "tactus-host"};
  app.footer(kExamples);
  wire::add_address_options(app, options.address, "host");
  app.add_option("--config", config, "YAML file that names objects with model, pose, scale, material and body");
  app.add_option("--cache", options.cache, "Directory that stores built models")->capture_default_str();
  app.add_option("--at", at, "Position of the first MODEL, m; the next ones follow along x")
      ->expected(3)
      ->allow_extra_args(false)  // a MODEL may follow
      ->check(wire::finite_number())
      ->capture_default_str();
  app.add_option("MODEL", models, ".spm files, or model files to build; served under their file names");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  std::copy(at.begin(), at.end(), options.at.begin());

  event_log::begin("tactus-host");
  wire::set_log_sink(event_log::write);
  const std::atomic<bool>& stop = realtime::stop_signal();
  try {
    if (!config.empty()) options.objects = host_service::read_config(config);
    for (const std::filesystem::path& model : models) {
      options.objects.push_back(host_service::object_from_model(model));
    }
    host_service::Host host{std::move(options), event_log::write, stop};
    return host.run();
  } catch (const host_service::Stopped&) {
    event_log::write(session::Severity::kInfo,
                     "stopped by a signal before all models were open; no partly built model is left");
    std::_Exit(0);  // a thread may still read a model, so no global may be destroyed
  } catch (const std::exception& error) {
    event_log::write(session::Severity::kError, error.what());
    return 2;
  }
}
