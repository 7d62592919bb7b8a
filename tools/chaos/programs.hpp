/// Finds the programs of a session on this machine, and suspends, kills and starts them.
#pragma once

#include <sys/types.h>

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

namespace tactus::chaos {

/// Who starts a program again after it was killed.
enum class Restart : std::uint8_t {
  kNobody,
  kItsSupervisor,  ///< of a gateway: its HRTC; of a service: systemd
  kChaos           ///< this program, with the command, folder, environment and output of the killed one
};

struct Program {
  pid_t pid = 0;
  std::uint64_t started = 0;  ///< start of the process in clock ticks; identifies it together with `pid`
  std::string label;          ///< such as "host museum"; unique
  Restart restart = Restart::kNobody;
  bool has_driver = false;  ///< an HRTC with the device of a vendor, which a person may hold
};

/// Returns the hosts, HRTCs, gateways, simulations, viewers and bridges of a session, by label. Compares the options
/// --session and --domain of all processes in /proc. Does not list the programs of other users unless it runs as root.
/// `may_start`: whether hosts and HRTCs may be killed, because this program starts them again. It starts no program of a
/// container or of another user.
[[nodiscard]] std::vector<Program> programs_of(const std::string& session, int domain, bool may_start);

/// Memory and descriptors of a process.
struct Resources {
  double resident_mb = 0;
  std::size_t descriptors = 0;
};
/// Returns nothing if the program has ended.
[[nodiscard]] std::optional<Resources> resources_of(const Program& program);
/// As resources_of(). If the program has more than `descriptors`, waits until it has not, at most `limit`: it may be
/// writing a file. Returns the reading with the fewest descriptors.
[[nodiscard]] std::optional<Resources> settled_resources_of(const Program& program, std::size_t descriptors,
                                                            std::chrono::milliseconds limit);
/// Returns the time since the start of the program, s.
[[nodiscard]] double age_of(const Program& program);

/// Thrown if a program ended before its fault.
class ProgramEnded : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Thrown if a program was killed for a fault, but does not run again.
class NotRestarted : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Suspends a program until `resume` or the destructor. A child process resumes it after `seconds` even if this process
/// is killed.
class Suspension {
 public:
  /// Throws ProgramEnded, and std::runtime_error if the program belongs to another user.
  Suspension(const Program& program, double seconds);
  ~Suspension();
  Suspension(const Suspension&) = delete;
  Suspension& operator=(const Suspension&) = delete;

 private:
  class Process;
  void end_child() const noexcept;

  std::unique_ptr<Process> process_;
  pid_t child_;
};

/// Kills a program, and starts it again if its `restart` is kChaos. The new process outlives this one.
/// Throws ProgramEnded, NotRestarted, and another std::runtime_error if the program cannot be killed.
void kill_and_restart(const Program& program);

}  // namespace tactus::chaos
