#include "bench/bench_main.hpp"

#include <cstdio>
#include <string_view>

namespace tactus::bench {
namespace {

/// Returns the command line that repeats the run, without --json.
std::string command_of(const App& app, int argc, char** argv) {
  std::string command = app.get_name();
  for (int i = 1; i < argc; ++i) {
    const std::string_view argument{argv[i]};
    if (argument == "--json")
      ++i;
    else if (argument.rfind("--json=", 0) != 0)
      command += " " + std::string{argument};
  }
  return command;
}

}  // namespace

int bench_main(App& app, int argc, char** argv, const std::function<Report()>& run) {
  try {
    app.parse(argc, argv);
    return run().finish(app.bench, command_of(app, argc, argv), app.json);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  } catch (const Interrupted&) {
    return 130;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s: %s\n", app.get_name().c_str(), error.what());
    return 2;
  }
}

}  // namespace tactus::bench
