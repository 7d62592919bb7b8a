#include <CLI/CLI.hpp>
#include <iostream>

#include "viewer/viewer.hpp"
#include "wire/command_line.hpp"
#include "wire/process.hpp"

namespace {

constexpr char kExamples[] = R"(
Examples:
  tactus view --session lab
  tactus view --session lab --domain 40 --port 8091 --memory 256MiB

Open the printed address in a browser of this machine. `scripts/page` builds the page.
Exit status: 0 ended by a signal, 2 wrong input, no page, or the port or the name is taken.)";

}  // namespace

int main(int argc, char** argv) {
  using namespace tactus;
  viewer::ViewerOptions options;
  options.address.session = "tactus";
  options.address.participant = "view";
  options.server.folder = TACTUS_PAGE;
  std::uint64_t memory = 64u << 20;

  CLI::App app{"Viewer: shows the objects, users and figures of a session as a page in a browser.", "tactus-view"};
  app.footer(kExamples);
  wire::add_address_options(app, options.address, "viewer");
  app.add_option("--port", options.server.port, "Port of the page, at 127.0.0.1; 0: any free port")
      ->capture_default_str();
  app.add_option("--page", options.server.folder, "Folder of the page")->capture_default_str();
  app.add_option("--memory", memory, "Memory of the pool, for the shown meshes of all objects: 64MiB, 1GiB")
      ->transform(CLI::AsSizeValue(false))
      ->default_str("64MiB");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  const std::atomic<bool>& stop = wire::stop_signal();
  try {
    constexpr std::uint32_t kMinSlots = 1000;
    options.pool = spm::PoolSettings::for_bytes(memory);
    if (options.pool.slots < kMinSlots) {
      std::cerr << "tactus-view: --memory: found " << memory << " bytes, which hold " << options.pool.slots
                << " slots of the pool, expected at least " << kMinSlots << "\n";
      return 2;
    }
    options.log = [](const std::string& text) { std::cerr << "tactus-view: " << text << '\n'; };
    viewer::Viewer viewer{std::move(options)};
    std::cout << "http://localhost:" << viewer.port() << "/" << std::endl;
    return viewer.run(stop);
  } catch (const std::exception& error) {
    std::cerr << "tactus-view: " << error.what() << '\n';
    return 2;
  }
}
