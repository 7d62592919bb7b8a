// tactus-top: shows users, HRTCs, hosts, rates and faults of a session on one screen of a terminal.
#include <poll.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <csignal>
#include <iostream>
#include <optional>
#include <variant>

#include "realtime/standard_output.hpp"
#include "session/printable.hpp"
#include "tools/top/overview.hpp"
#include "wire/address/command_line.hpp"
#include "wire/address/finite_range.hpp"
#include "wire/endpoints.hpp"
#include "wire/inbox.hpp"

namespace {

using namespace tactus;
using realtime::monotonic_ns;

constexpr char kExamples[] = R"(
Examples:
  tactus-top --session lab --domain 40
  tactus-top --session lab --domain 40 --once

Ages are times since the newest roster entry; of a user, since the pose of the newest probe state. A participant is late
after 250 ms without an entry, and gone after 500 ms. Users with deadband coding have 25 to 210 states a second. If the
output is no terminal, the program appends each screen as plain text. It only reads, and does not appear in the roster.
Exit status: 0 ended by the key q, or --once has printed the screen; 1 --once found no participant within --patience, or
the output could not be written; 2 wrong input; 130 interrupted.)";

constexpr std::chrono::milliseconds kPollPeriod{50};
constexpr double kDefaultInterval = 0.5;      // s
constexpr double kDefaultOnceInterval = 2.5;  // s; each host and HRTC publishes its metrics at least twice in this time

struct Options {
  wire::SessionAddress address;
  double interval = 0;  // s; 0: the default
  double patience = 5;  // s
  bool once = false;
};

using AnySample = std::variant<session::RosterEntry, session::CatalogueEntry, session::Metrics, session::ProbeState,
                               session::EmergencyStop>;

/// Joins a session as a reader, and applies the received samples to an overview.
class Observer {
 public:
  explicit Observer(const wire::SessionAddress& address)
      : participants_{address},
        overview_{participants_.origin(), "session " + address.session + ", domain " + std::to_string(address.domain),
                  monotonic_ns(), address.plain ? "NOT SECURED (--plain)" : ""} {}

  [[nodiscard]] top::Overview& overview() { return overview_; }
  /// Waits, at most kPollPeriod, and applies the samples that have arrived.
  void receive() {
    for (const auto& arrived : inbox_.take(kPollPeriod))
      std::visit([&](const auto& sample) { overview_.on_sample(sample, arrived.at_ns); }, arrived.sample);
  }

 private:
  template <class Sample>
  wire::Reader<Sample> reader(const wire::TopicSpec<Sample>& topic) {
    return {participants_, topic, [this](Sample&& sample) { inbox_.put(std::move(sample)); }};
  }

  wire::Participants participants_;
  top::Overview overview_;
  wire::Inbox<AnySample> inbox_{1u << 14};
  // The readers are the last members, so that they are destroyed first: their callbacks use the inbox.
  wire::Reader<session::RosterEntry> roster_ = reader(wire::topics::kRoster);
  wire::Reader<session::CatalogueEntry> catalogue_ = reader(wire::topics::kCatalogue);
  wire::Reader<session::Metrics> metrics_ = reader(wire::topics::kMetrics);
  wire::Reader<session::ProbeState> states_ = reader(wire::topics::kProbeState);
  wire::Reader<session::EmergencyStop> stops_ = reader(wire::topics::kStop);
};

/// The terminal of the standard output, if it is one. While this object lives, the keyboard needs no Enter.
class Terminal {
 public:
  Terminal() : is_terminal_{isatty(STDOUT_FILENO) == 1} {
    if (!is_terminal_ || isatty(STDIN_FILENO) != 1 || tcgetattr(STDIN_FILENO, &before_) != 0) return;
    termios keys = before_;
    keys.c_lflag &= ~static_cast<tcflag_t>(ICANON | ECHO);
    has_keys_ = tcsetattr(STDIN_FILENO, TCSANOW, &keys) == 0;
  }
  ~Terminal() {
    if (has_keys_) tcsetattr(STDIN_FILENO, TCSANOW, &before_);
    if (has_shown_) std::cout << '\n' << std::flush;  // the prompt of the shell stands below the last screen
  }
  Terminal(const Terminal&) = delete;
  Terminal& operator=(const Terminal&) = delete;

  [[nodiscard]] bool is_terminal() const { return is_terminal_; }
  /// Returns whether the key q was pressed.
  [[nodiscard]] bool quit_pressed() const {
    pollfd input{STDIN_FILENO, POLLIN, 0};
    char key = 0;
    while (has_keys_ && poll(&input, 1, 0) == 1 && read(STDIN_FILENO, &key, 1) == 1)
      if (key == 'q') return true;
    return false;
  }
  /// Replaces the screen; if the output is no terminal, appends to it.
  void show(const std::vector<top::Line>& lines) {
    if (!is_terminal_) {
      std::cout << (has_written_ ? "\n" : "") << top::plain(lines) << std::flush;
    } else {
      winsize size{};
      const bool known = ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0 && size.ws_row > 0;
      std::cout << (has_shown_ ? "" : "\x1b[2J")  // the first screen erases what was there
                << top::ansi(known ? top::fitted(lines, size.ws_col, size.ws_row) : lines) << std::flush;
      has_shown_ = true;
    }
    has_written_ = true;
  }

 private:
  const bool is_terminal_;
  bool has_keys_ = false;
  bool has_shown_ = false;    // a screen with escape sequences
  bool has_written_ = false;  // any screen
  termios before_{};
};

/// Receives samples until `end_ns`. Returns false if a signal or the key q ends the program first.
bool receive_until(std::int64_t end_ns, Observer& observer, const Terminal& terminal,
                   const std::atomic<bool>& cancelled) {
  while (monotonic_ns() < end_ns) {
    observer.receive();
    if (cancelled || terminal.quit_pressed()) return false;
  }
  return true;
}

int show_once(const Options& options, const std::atomic<bool>& cancelled) {
  Observer observer{options.address};
  const std::int64_t patience_ns = monotonic_ns() + static_cast<std::int64_t>(options.patience * 1e9);
  while (!observer.overview().has_participants()) {
    observer.receive();
    if (cancelled) return 130;
    if (monotonic_ns() < patience_ns) continue;
    std::cerr << "tactus-top: found no participant in session " << options.address.session << ", domain "
              << options.address.domain << ", within " << options.patience << " s\n";
    return 1;
  }
  const double interval = options.interval > 0 ? options.interval : kDefaultOnceInterval;
  const std::int64_t end_ns = monotonic_ns() + static_cast<std::int64_t>(interval * 1e9);
  while (monotonic_ns() < end_ns && !cancelled) observer.receive();
  if (cancelled) return 130;
  std::cout << top::plain(observer.overview().screen(monotonic_ns())) << std::flush;
  return std::cout ? 0 : realtime::failed_output_status("tactus-top", errno);
}

int show_repeatedly(const Options& options, const std::atomic<bool>& cancelled) {
  Observer observer{options.address};
  Terminal terminal;
  const auto period_ns = static_cast<std::int64_t>((options.interval > 0 ? options.interval : kDefaultInterval) * 1e9);
  std::int64_t next_ns = monotonic_ns();
  do {
    terminal.show(observer.overview().screen(monotonic_ns()));
    if (!std::cout) return realtime::failed_output_status("tactus-top", errno);
    next_ns = std::max(next_ns + period_ns, monotonic_ns());
  } while (receive_until(next_ns, observer, terminal, cancelled));
  return cancelled ? 130 : 0;
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  options.address.session = "tactus";
  options.address.participant = "top-" + std::to_string(getpid());
  options.address.naming = wire::Naming::kInstance;
  options.address.only_reads_bulk = true;
  CLI::App app{"Shows users, HRTCs, hosts, rates and faults of a session.", "tactus-top"};
  app.footer(kExamples);
  wire::add_address_options(app, options.address, "program");
  app.add_option("--interval", options.interval, "Seconds between two screens; default 0.5, with --once 2.5")
      ->check(wire::finite_range(0.1, 3600.0));
  app.add_flag("--once", options.once, "Print one screen as plain text after one interval, then end");
  app.add_option("--patience", options.patience, "With --once: seconds to wait for the first participant")
      ->capture_default_str()
      ->check(wire::finite_range(0.1, 3600.0));
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  const std::atomic<bool>& cancelled = realtime::stop_signal();
  std::signal(SIGPIPE, SIG_IGN);  // a failed write ends the program, which then leaves the session
  try {
    return options.once ? show_once(options, cancelled) : show_repeatedly(options, cancelled);
  } catch (const std::exception& error) {
    std::cerr << "tactus-top: " << session::printable(error.what()) << '\n';
    return 2;
  }
}
