// tactus: runs the program of a command, for example `tactus-host` of the same directory for `tactus host`.
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "tactus/commit.hpp"

namespace {

constexpr int kWrongInput = 2;

struct Command {
  std::string_view name;     // one or two words
  std::string_view program;  // file in the same directory; empty for the demo, which is a script
  std::string_view purpose;
};
constexpr std::array kCommands{
    Command{"mesh", "tactus-mesh", "build, inspect, verify, generate and audit models"},
    Command{"host", "tactus-host", "serve models to a session (VE host)"},
    Command{"hrtc", "tactus-hrtc", "run haptic devices in a session (HRTC)"},
    Command{"sim study", "tactus-study", "run a study: links, scenarios and seeds, compared with ground truth"},
    Command{"sim", "tactus-sim", "run simulated users of a scenario, and report the session"},
    Command{"scenario", "tactus-scenario", "print a built-in scenario, to edit and run it"},
    Command{"judge", "tactus-judge", "compare a session's report and audits with their bounds"},
    Command{"view", "tactus-view", "show a session as a page in a browser of this machine"},
    Command{"ros2", "tactus-ros2", "publish a session in a ROS 2 domain, and move users to target poses from there"},
    Command{"top", "tactus-top", "show users, HRTCs, hosts, rates and faults of a session in the terminal"},
    Command{"watch", "tactus-watch", "print the samples of a topic of a session"},
    Command{"control", "tactus-control", "send an emergency stop, reset, mode or end to a session"},
    Command{"chaos", "tactus-chaos", "cause faults in a running session of this machine, and check that it recovers"},
    Command{"keys", "tactus-keys", "make, list and revoke the keys of a secured session"},
    Command{"record", "tactus-record", "record every topic of a session in an MCAP file"},
    Command{"replay", "tactus-replay", "recompute the forces of a flight recording and compare them to the bit"},
    Command{"latency", "tactus-latency", "measure latency, jitter and loss of a session's topics, and of a network"},
    Command{"doctor", "tactus-doctor", "check whether this machine is fit for a session, and print remedies"},
    Command{"link", "tactus-link", "emulate a network link between two namespaces of this machine"},
    Command{"demo", "", "run a complete session on this machine"},
};

void print_help(std::FILE* out) {
  std::fputs("Usage: tactus COMMAND [OPTION...]\n\n", out);
  for (const Command& c : kCommands) std::fprintf(out, "  %-11s%s\n", c.name.data(), c.purpose.data());
  std::fputs(
      "\nEach command has --help. tactus --version prints the version. Examples:\n"
      "  tactus mesh generate organ --faces 500000 --seed 1 organ.ply\n"
      "  tactus mesh build organ.ply organ.spm --size 0.2\n"
      "  tactus host --session lab --name host-a --domain 40 organ.spm\n"
      "  tactus hrtc --session lab --name hrtc-1 --domain 40\n"
      "  tactus demo --model bunny.obj\n"
      "\nExit status: 0 done, 1 a check failed or a bound was missed, 2 wrong input, 130 interrupted.\n",
      out);
}

std::filesystem::path path_of(const Command& command) {
  const std::filesystem::path folder = std::filesystem::read_symlink("/proc/self/exe").parent_path();
  if (!command.program.empty()) return folder / command.program;
  // In the build tree, the demo builds all programs first.
  if (folder == TACTUS_BUILD_DIR "/bin") return TACTUS_SCRIPTS "/demo";
  return folder.parent_path() / "share/tactus/tactus-demo";
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) {
    print_help(stderr);
    return kWrongInput;
  }
  const std::string_view first_word{argv[1]};
  if (first_word == "--help" || first_word == "-h") {
    print_help(stdout);
    return 0;
  }
  if (first_word == "--version") {
    std::puts("tactus " TACTUS_VERSION ", commit " TACTUS_COMMIT);
    return 0;
  }
  const std::string two_words = std::string{first_word} + " " + (argc > 2 ? argv[2] : "");
  for (const Command& command : kCommands) {
    const int words = command.name == two_words ? 2 : 1;
    if (words == 1 && command.name != first_word) continue;
    const std::string program = path_of(command).string();
    std::vector<char*> arguments(argv + words, argv + argc + 1);  // with the null that ends argv
    std::string name = "tactus " + std::string{command.name};
    arguments[0] = name.data();
    execv(program.c_str(), arguments.data());
    std::fprintf(stderr, "tactus: cannot start '%s': %s", program.c_str(), std::strerror(errno));
    if (errno == ENOENT && program.starts_with(TACTUS_BUILD_DIR "/bin/tactus-"))
      std::fprintf(stderr, "; build it with: ninja -C %s tactus-%s", TACTUS_BUILD_DIR,
                   program.substr(sizeof(TACTUS_BUILD_DIR "/bin/tactus-") - 1).c_str());
    std::fputs("\n", stderr);
    return kWrongInput;
  }
  std::fprintf(stderr, "tactus: no command '%s'; expected ", argv[1]);
  for (const Command& command : kCommands)
    std::fprintf(stderr, "%s%s", &command == &kCommands[0] ? "" : ", ", command.name.data());
  std::fputs("\n", stderr);
  return kWrongInput;
}
