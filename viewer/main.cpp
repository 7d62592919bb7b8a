#include <unistd.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <filesystem>
#include <iostream>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>

#include "event_log/event_log.hpp"
#include "realtime/process.hpp"
#include "session/printable.hpp"
#include "spm/offline/generate.hpp"
#include "spm/offline/import.hpp"
#include "viewer/tokens.hpp"
#include "viewer/viewer.hpp"
#include "wire/address/command_line.hpp"

namespace {

constexpr char kExamples[] = R"(
Examples:
  tactus view --session lab
  tactus view --session lab --domain 40 --port 8091 --memory 256MiB
  tactus view --session lab --listen 192.168.1.20 --tokens ~/.config/tactus-tokens
  tactus view --recording lab.mcap
  tactus view --demo

Open the printed address in a browser. In the sources, scripts/page builds the page. Only browsers of this machine can reach it,
unless --listen names another address. Then two addresses are printed: pages of the first can touch and stop forces,
pages of the second only show the session. With --recording the page shows a recording
of `tactus record` instead of a session, and can neither touch nor stop. With --demo the page needs no session: it runs
one itself.
Exit status: 0 ended by a signal, 2 wrong input, no page, or the port or the name is taken.)";

/// Returns the folder of a page: beside an installed program, otherwise the one that scripts/page builds.
std::filesystem::path page_folder(const char* installed, const char* built) {
  std::error_code error;
  const auto program = std::filesystem::read_symlink("/proc/self/exe", error);
  const auto beside = program.parent_path().parent_path() / "share/tactus" / installed;
  return std::filesystem::is_directory(beside, error) ? beside : std::filesystem::path{built};
}

/// Serves the page "Touch it now", which has a session of its own.
int serve_demo(tactus::viewer::ServerSettings server, const std::atomic<bool>& stop) {
  using namespace tactus;
  const viewer::ViewerCore no_session{{}, {"view", "demo", spm::PoolSettings::for_slots(1)}, realtime::monotonic_ns()};
  viewer::PageServer pages{server, no_session};
  std::cout << "http://localhost:" << pages.port() << "/" << std::endl;
  while (!stop) {
    pages.poll(realtime::monotonic_ns());
    std::this_thread::sleep_for(std::chrono::milliseconds{2});  // `poll` never waits
  }
  return 0;
}

/// Returns a mesh file, or the built-in mesh of that name, for ServerSettings::tool.
std::string tool_json(const std::string& name) {
  const auto mesh = name == "stylus" ? tactus::spm::offline::stylus() : tactus::spm::offline::import_mesh(name);
  return nlohmann::json{{"positions", mesh.positions}, {"faces", mesh.faces}}.dump();
}

/// Prints the addresses of the page. A browser sends the part after # to no server; the page sends it as its token.
void print_addresses(const tactus::viewer::ServerSettings& server, std::uint16_t port) {
  std::string host = server.address;
  if (host == "0.0.0.0" || host == "::") host = tactus::viewer::host_name();
  if (host.find(':') != std::string::npos) host = "[" + host + "]";
  if (host == "127.0.0.1") host = "localhost";
  const std::string address = "http://" + host + ":" + std::to_string(port) + "/";
  if (server.control_token.empty())
    std::cout << address << std::endl;
  else
    std::cout << address << '#' << server.control_token << "  to touch and to stop forces\n"
              << address << '#' << server.observer_token << "  to watch" << std::endl;
}

}  // namespace

int main(int argc, char** argv) {
  using namespace tactus;
  viewer::ViewerOptions options;
  options.address.session = "tactus";
  options.address.participant = "view";
  options.faces = viewer::ViewerSettings{}.faces;
  bool is_demo = false;
  std::filesystem::path token_file, recording;
  std::string tool;
  std::uint64_t memory = 64u << 20;

  CLI::App app{"Viewer: shows the objects, users and figures of a session as a page in a browser.", "tactus-view"};
  app.footer(kExamples);
  wire::add_address_options(app, options.address, "viewer");
  app.add_option("--listen", options.server.address, "Address of this machine at which the page is served")
      ->capture_default_str();
  app.add_option("--tokens", token_file,
                 "File that keeps the tokens of --listen, so that a restart keeps the addresses")
      ->type_name("FILE")
      ->needs("--listen");
  app.add_option("--port", options.server.port, "Port of the page; 0: any free port")->capture_default_str();
  app.add_option("--page", options.server.folder, "Folder of the page; default: that of scripts/page");
  app.add_option("--tool", tool, "Shape of every probe, as in `tactus hrtc --tool`: stylus, or a mesh file in metres")
      ->type_name("FILE");
  app.add_option("--recording", recording, "Show this recording of `tactus record` instead of a session")
      ->type_name("FILE")
      ->excludes("--session");
  app.add_flag("--demo", is_demo, "Serve the page \"Touch it now\", which runs a session in the browser")
      ->excludes("--session")
      ->excludes("--recording")
      ->excludes("--listen");
  app.add_option("--memory", memory, "Memory of the pool, for the shown meshes of all objects: 64MiB, 1GiB")
      ->transform(CLI::AsSizeValue(false))
      ->default_str("64MiB");
  app.add_option("--faces", options.faces, "Max number of faces that are added where nobody touches, for the screen")
      ->check(CLI::Range(0u, 1'000'000u))
      ->capture_default_str();
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  const std::atomic<bool>& stop = realtime::stop_signal();
  (void)nice(10);  // a picture may be late; a force may not
  if (options.server.folder.empty())
    options.server.folder = is_demo ? page_folder("touch", TACTUS_TOUCH_PAGE) : page_folder("view", TACTUS_PAGE);
  try {
    if (is_demo) return serve_demo(options.server, stop);
    constexpr std::uint32_t kMinSlots = 1000;
    options.pool = spm::PoolSettings::for_bytes(memory);
    if (options.pool.slots < kMinSlots) {
      std::cerr << "tactus-view: --memory: found " << memory << " bytes, which hold " << options.pool.slots
                << " slots of the pool, expected at least " << kMinSlots << "\n";
      return 2;
    }
    if (!tool.empty()) options.server.tool = tool_json(tool);
    options.server.is_plain = options.address.plain;
    event_log::begin("tactus-view");
    wire::set_log_sink(event_log::write);
    options.log = [](const std::string& text) { event_log::write(session::Severity::kInfo, text); };
    if (!viewer::is_loopback(options.server.address)) {
      const viewer::Tokens tokens = token_file.empty() ? viewer::make_tokens() : viewer::kept_tokens(token_file);
      options.server.control_token = tokens.control;
      options.server.observer_token = tokens.observer;
    }
    const viewer::ServerSettings server = options.server;
    if (!recording.empty())
      return viewer::play(
          {recording, options.pool, options.faces, server, options.log},
          [&](std::uint16_t port) { print_addresses(server, port); }, stop);
    viewer::Viewer viewer{std::move(options)};
    print_addresses(server, viewer.port());
    return viewer.run(stop);
  } catch (const std::exception& error) {
    std::cerr << "tactus-view: " << session::printable(error.what()) << '\n';
    return 2;
  }
}
