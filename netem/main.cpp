// tactus-link: joins two namespaces by an emulated link, and runs programs in them.
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <iostream>
#include <optional>
#include <string>
#include <vector>

#include "netem/pair.hpp"

namespace tactus::netem {
namespace {

using Command = std::vector<std::string>;

constexpr int kWrongInput = 2;
constexpr int kInterrupted = 130;

constexpr char kExamples[] = R"(
Examples:
  tactus-link list
  tactus-link run --profile P4 -- tactus-host --session lab organ.spm -- tactus-hrtc --session lab
  tactus-link run --profile P0:delay=10:loss=1:rate=100 -- iperf3 -s -1 -- iperf3 -c 10.77.0.1 -u
  tactus-link up --profile P7          (until Ctrl-C; prints how to enter)

COMMAND_A runs in namespace a (10.77.0.1), COMMAND_B in namespace b (10.77.0.2). When B ends, A gets SIGINT, after 2 s
SIGTERM and after 4 s SIGKILL.

Exit status of run: that of B, or that of A if A fails first; 127 if a command cannot be started, 2 wrong input or
missing rights, 130 interrupted.)";

struct Options {
  std::string profile = "P0";
  std::uint64_t seed = 1;

  [[nodiscard]] LinkSettings settings() const {
    LinkSettings link = parse_link(profile);
    link.seed = seed;
    return link;
  }
};

void add_options(CLI::App& app, Options& options) {
  app.add_option("--profile", options.profile, "Named link (see `tactus-link list`); settings after colons change it")
      ->capture_default_str();
  app.add_option("--seed", options.seed, "Seed of delays and losses")->capture_default_str();
}

void print_list() {
  for (const NamedLink& link : kNamedLinks)
    std::printf("%-5s %-52s %s\n", link.name, link.description, describe(link.each_direction).c_str());
  std::printf(
      "\nP0a to P8a: as P0 to P8, with 70 %% of the round trip's delay and jitter from a to b.\n"
      "Settings after colons change a link in both directions, for example\n"
      "P0:delay=10:jitter=2:reorder:loss=1:burst=0.01/0.25:repeat=1:rate=100:queue=300000\n"
      "Units: delay and jitter in ms, loss in %% of the frames outside bursts, rate in Mbit/s, queue in bytes.\n"
      "repeat: %% of the frames that arrive twice.\n"
      "burst: probability per frame that a burst of losses begins / that it ends.\n"
      "reorder: each frame has an independent delay and may overtake others.\n");
}

void print_start(const LinkedPair& pair, const LinkSettings& link) {
  std::fprintf(stderr, "link %s: a to b %s; b to a %s; seed %llu\n", link.name.c_str(), describe(link.a_to_b).c_str(),
               describe(link.b_to_a).c_str(), static_cast<unsigned long long>(link.seed));
  if (!pair.realtime())
    std::fprintf(
        stderr,
        "relay: no real-time priority, so delays are less exact; allow rtprio 80 (limits.conf) or run as root\n");
}

void print_end(const LinkedPair& pair, const LinkSettings& link) {
  if (link.medium == Medium::kVeth) return;
  const RelayFigures figures = pair.figures();
  for (const auto& [name, direction] : {std::pair{"a to b", figures.a_to_b}, {"b to a", figures.b_to_a}}) {
    std::fprintf(stderr, "%s: %llu frames, %llu lost, %llu repeated, %llu dropped by a full queue\n", name,
                 static_cast<unsigned long long>(direction.arrived), static_cast<unsigned long long>(direction.lost),
                 static_cast<unsigned long long>(direction.repeated),
                 static_cast<unsigned long long>(direction.dropped));
  }
  if (figures.overflowed > 0)
    std::fprintf(stderr, "relay: dropped %llu frames, because %zu were in transit; limit the rate of the link\n",
                 static_cast<unsigned long long>(figures.overflowed), Relay::kMaxFrames);
  std::fprintf(stderr, "lateness of departures: p50 %.0f, p99 %.0f, max %.0f us\n", figures.late_p50_us,
               figures.late_p99_us, figures.late_max_us);
}

/// The signals that this program waits for; they are blocked in all its threads.
sigset_t watched_signals() {
  sigset_t set;
  sigemptyset(&set);
  for (const int signal : {SIGINT, SIGTERM, SIGHUP, SIGCHLD}) sigaddset(&set, signal);
  return set;
}

/// Returns the exit code of an ended child, or nothing while it runs. The child keeps its id until it is waited for.
std::optional<int> exit_code(pid_t pid) {
  siginfo_t info{};
  if (::waitid(P_PID, static_cast<id_t>(pid), &info, WEXITED | WNOHANG | WNOWAIT) != 0 || info.si_pid != pid)
    return std::nullopt;
  return info.si_code == CLD_EXITED ? info.si_status : 128 + info.si_status;
}

int run(const Options& options, const Command& first, const Command& second) {
  const LinkSettings link = options.settings();
  const LinkedPair pair{link};
  print_start(pair, link);
  const std::array<pid_t, 2> pids{pair.start(Side::kA, first), pair.start(Side::kB, second)};
  std::array<std::optional<int>, 2> ended;  // exit codes
  std::optional<int> result;
  int half_seconds = 0;  // since SIGINT
  const sigset_t signals = watched_signals();
  const auto send_signal = [&](int signal) {
    for (std::size_t i = 0; i < 2; ++i)
      if (!ended[i]) ::kill(-pids[i], signal);
  };
  while (!ended[0] || !ended[1]) {
    const timespec half_second{0, 500'000'000};
    const int signal = ::sigtimedwait(&signals, nullptr, &half_second);
    for (std::size_t i = 0; i < 2; ++i)
      if (!ended[i]) ended[i] = exit_code(pids[i]);
    if (!result) {
      if (signal == SIGINT || signal == SIGTERM || signal == SIGHUP)
        result = kInterrupted;
      else if (ended[1])
        result = ended[1];
      else if (ended[0] && *ended[0] != 0)
        result = ended[0];
      if (result) send_signal(SIGINT);
    } else if (signal < 0) {
      if (++half_seconds == 4) send_signal(SIGTERM);
      if (half_seconds == 8) send_signal(SIGKILL);
    }
  }
  for (const pid_t pid : pids) {
    ::kill(-pid, SIGKILL);  // ends processes that the commands started and did not end
    ::waitpid(pid, nullptr, 0);
  }
  print_end(pair, link);
  return *result;
}

int up(const Options& options) {
  const LinkSettings link = options.settings();
  const LinkedPair pair{link};
  print_start(pair, link);
  for (const Side side : {Side::kA, Side::kB})
    std::printf("%s: nsenter --net=/run/netns/%s COMMAND\n", LinkedPair::address(side), pair.name(side).c_str());
  std::fflush(stdout);
  sigset_t signals = watched_signals();
  sigdelset(&signals, SIGCHLD);
  int signal = 0;
  ::sigwait(&signals, &signal);
  print_end(pair, link);
  return 0;
}

/// Returns the command after each `--`, and reduces `argc` to the arguments before the first.
std::vector<Command> split_commands(int& argc, char** argv) {
  std::vector<Command> commands;
  int own = argc;
  for (int i = 1; i < argc; ++i) {
    if (std::string{"--"} == argv[i]) {
      if (own == argc) own = i;
      commands.emplace_back();
    } else if (!commands.empty()) {
      commands.back().emplace_back(argv[i]);
    }
  }
  argc = own;
  return commands;
}

}  // namespace
}  // namespace tactus::netem

int main(int argc, char** argv) {
  using namespace tactus::netem;
  const std::vector<Command> commands = split_commands(argc, argv);
  Options options;
  CLI::App app{"Emulates a network link between two namespaces of this machine: delay, jitter, loss, rate.",
               "tactus-link"};
  app.footer(kExamples);
  app.require_subcommand(1);
  CLI::App* const list = app.add_subcommand("list", "Print the named links");
  CLI::App* const run_command =
      app.add_subcommand("run", "Run two commands, one in each namespace: -- COMMAND_A... -- COMMAND_B...");
  CLI::App* const up_command = app.add_subcommand("up", "Keep the link up until Ctrl-C");
  for (CLI::App* const command : {run_command, up_command}) add_options(*command, options);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : kWrongInput;
  }
  const sigset_t signals = watched_signals();
  sigprocmask(SIG_BLOCK, &signals, nullptr);
  try {
    if (*list) {
      print_list();
      return 0;
    }
    if (*up_command) {
      if (!commands.empty()) throw LinkError("up takes no command; found '--', expected none (use run)");
      return up(options);
    }
    if (commands.size() != 2 || commands[0].empty() || commands[1].empty())
      throw LinkError("found " + std::to_string(commands.size()) + (commands.size() == 1 ? " command" : " commands") +
                      ", expected two: tactus-link run [OPTION...] -- COMMAND_A... -- COMMAND_B...");
    return run(options, commands[0], commands[1]);
  } catch (const std::exception& error) {
    std::cerr << "tactus-link: " << error.what() << '\n';
    return kWrongInput;
  }
}
