// tactus-control: one word to everyone in a session, the emergency stop first of all.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <iostream>
#include <mutex>
#include <optional>
#include <set>
#include <thread>

#include "wire/command_line.hpp"
#include "wire/ends.hpp"
#include "wire/process.hpp"

namespace {

using namespace tactus;
using Clock = std::chrono::steady_clock;

constexpr char kExamples[] = R"(
Examples:
  tactus-control stop --session lab --domain 40 --reason "needle bent"
  tactus-control reset --session lab --domain 40
  tactus-control mode "collaborate ann,bob" --session lab --domain 40

A stop takes every force in the session to zero at once; they stay off until a reset, which starts them softly.
Exit status: 0 told, 1 nobody, or for stop and reset no HRTC, has confirmed it, 2 wrong input, 130 interrupted.)";

/// Later readers are told too while the program is there: after the first, who else there is has been found in this.
constexpr auto kOthers = std::chrono::milliseconds{1500};

struct Word {
  session::ControlKind kind = session::ControlKind::kEmergencyStop;
  std::string text;
};

/// The HRTCs that beat meanwhile.
class Controllers {
 public:
  explicit Controllers(wire::Links& links)
      : reader_{links, wire::topics::kRoster, [this](session::RosterEntry&& entry) {
                  if (entry.role != session::Role::kHrtc || entry.leaving) return;
                  const std::lock_guard lock{mutex_};
                  names_.insert(entry.name);
                }} {}
  [[nodiscard]] std::set<std::string> names() const {
    const std::lock_guard lock{mutex_};
    return names_;
  }

 private:
  mutable std::mutex mutex_;
  std::set<std::string> names_;
  wire::Reader<session::RosterEntry> reader_;
};

int tell(const wire::SessionAddress& address, const Word& word, double patience, const std::atomic<bool>& stop) {
  wire::Links links{address};
  const Controllers controllers{links};
  wire::Writer<session::Control> out{links, wire::topics::kControl};
  // Kept by the writer for all whom it finds later: so it is out before anybody is known.
  if (out.send({links.origin(), 1, word.kind, word.text}) != wire::SendStatus::kSent)
    throw std::runtime_error(std::string{"the sample was not sent: "} + out.last_fault());
  const auto end = Clock::now() + std::chrono::duration<double>{patience};
  std::optional<Clock::time_point> found;
  int told = 0;  // at most: an end makes them leave
  while (!stop && Clock::now() < end && (!found || Clock::now() - *found < kOthers)) {
    told = std::max(told, out.matched());
    if (!found && told > 0) found = Clock::now();
    // Discovery tells of nothing that could be waited for.
    std::this_thread::sleep_for(std::chrono::milliseconds{10});
  }
  if (stop) return 130;
  if (!found) {
    std::cerr << "tactus-control: nobody was found in session " << address.session << ", domain " << address.domain
              << ", within " << patience << " s\n";
    return 1;
  }
  const bool all = out.wait_acknowledged(std::chrono::seconds{1});
  const std::set<std::string> hrtcs = controllers.names();
  std::cout << "told " << told << " programs" << (all ? "" : ", not all of which have confirmed it") << "; HRTCs:";
  for (const std::string& name : hrtcs) std::cout << ' ' << name;
  std::cout << (hrtcs.empty() ? " none\n" : "\n");
  const bool forces = word.kind == session::ControlKind::kEmergencyStop || word.kind == session::ControlKind::kReset;
  return all && !(forces && hrtcs.empty()) ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
  wire::SessionAddress address;
  address.participant = "control-" + std::to_string(getpid());
  double patience = 5;
  Word word;
  CLI::App app{"Tells everyone in a session: emergency stop, reset, mode, end.", "tactus-control"};
  app.footer(kExamples);
  app.require_subcommand(1);
  app.fallthrough();
  wire::add_address_options(app, address, "program");
  app.add_option("--patience", patience, "Seconds to look for somebody")
      ->capture_default_str()
      ->check(CLI::Range(0.1, 3600.0));
  const auto add = [&](const char* name, const char* purpose, session::ControlKind kind) {
    CLI::App* const sub = app.add_subcommand(name, purpose);
    sub->callback([&word, kind] { word.kind = kind; });
    return sub;
  };
  const auto with_reason = [&](CLI::App* sub) {
    sub->add_option("--reason", word.text, "For the logs and reports of all")
        ->check([](const std::string& text) -> std::string {
          return text.size() <= session::kMaxText ? ""
                                                  : "expected at most " + std::to_string(session::kMaxText) + " bytes";
        });
  };
  with_reason(
      add("stop", "Emergency stop: every force to zero, at once, until a reset", session::ControlKind::kEmergencyStop));
  with_reason(add("reset", "End the faults, of an emergency stop or of devices; forces start softly",
                  session::ControlKind::kReset));
  with_reason(add("end", "End the session: its programs write their reports and leave", session::ControlKind::kEnd));
  add("mode", "Session mode of all or of some users", session::ControlKind::kMode)
      ->add_option("MODE", word.text,
                   "As tactus-sim --mode takes it: auto, or collaborate or large-scale, for everyone or followed by "
                   "USER,USER...")
      ->required();
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  try {
    return tell(address, word, patience, wire::stop_signal());
  } catch (const std::exception& error) {
    std::cerr << "tactus-control: " << error.what() << '\n';
    return 2;
  }
}
