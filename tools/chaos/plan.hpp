/// Chooses the faults of a run. The same seed and programs give the same faults.
#pragma once

#include <cstdint>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "tools/chaos/programs.hpp"

namespace tactus::chaos {

enum class FaultKind : std::uint8_t {
  kSuspend,  ///< a program does not run for a time (SIGSTOP, SIGCONT)
  kKill,     ///< a program is killed (SIGKILL), and starts again
  kLoss,     ///< this machine drops a share of the packets that arrive for the session
  kCut       ///< this machine drops all of them
};
inline constexpr std::size_t kFaultKinds = 4;
/// Name on the command line and in reports.
[[nodiscard]] const char* name(FaultKind kind) noexcept;

struct Fault {
  FaultKind kind = FaultKind::kSuspend;
  std::string program;  ///< Program::label of the affected program; empty for faults of the network
  double pause = 0;     ///< time before the fault, s
  double seconds = 0;   ///< duration, s; 0 for kKill
  int percent = 0;      ///< lost packets, of kLoss
};
/// Describes the fault, for example "suspend host museum for 1.3 s".
[[nodiscard]] std::string text(const Fault& fault);

/// Whether this kind of fault is possible for a program: only programs that something starts again are killed.
[[nodiscard]] bool applies(FaultKind kind, const Program& program);

/// Thrown if no program can have a fault of the plan.
class NoPossibleFault : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

class Plan {
 public:
  /// `kinds` must not be empty. `max_pause`: s.
  Plan(std::uint64_t seed, std::vector<FaultKind> kinds, double max_pause);
  /// Chooses the next fault among those that are possible for `programs`. Throws NoPossibleFault.
  [[nodiscard]] Fault next(const std::vector<Program>& programs);

 private:
  [[nodiscard]] double between(double low, double high);

  std::mt19937_64 random_;
  std::vector<FaultKind> kinds_;
  double max_pause_;
};

}  // namespace tactus::chaos
