#include "tools/chaos/plan.hpp"

#include <algorithm>
#include <cstdio>

namespace tactus::chaos {
namespace {

// Limits of the durations, s. The shortest are below the time after which a silent program is late (0.25 s), the
// longest above that after which it is gone (0.5 s).
constexpr double kMinPause = 0.5, kMinSuspension = 0.1, kMaxSuspension = 3, kMinCut = 0.1, kMaxCut = 3, kMinLoss = 1,
                 kMaxLoss = 5;
constexpr int kMinPercent = 1, kMaxPercent = 30;

bool is_of_network(FaultKind kind) { return kind == FaultKind::kLoss || kind == FaultKind::kCut; }

}  // namespace

const char* name(FaultKind kind) noexcept {
  switch (kind) {
    case FaultKind::kSuspend:
      return "suspend";
    case FaultKind::kKill:
      return "kill";
    case FaultKind::kLoss:
      return "loss";
    case FaultKind::kCut:
      return "cut";
  }
  return "";
}

std::string text(const Fault& fault) {
  char line[160];
  switch (fault.kind) {
    case FaultKind::kSuspend:
      std::snprintf(line, sizeof line, "suspend %.100s for %.1f s", fault.program.c_str(), fault.seconds);
      break;
    case FaultKind::kKill:
      std::snprintf(line, sizeof line, "kill %.100s", fault.program.c_str());
      break;
    case FaultKind::kLoss:
      std::snprintf(line, sizeof line, "loss of %d %% of the packets for %.1f s", fault.percent, fault.seconds);
      break;
    case FaultKind::kCut:
      std::snprintf(line, sizeof line, "cut of the network for %.1f s", fault.seconds);
      break;
  }
  return line;
}

bool applies(FaultKind kind, const Program& program) {
  return kind == FaultKind::kSuspend || (kind == FaultKind::kKill && program.restart != Restart::kNobody);
}

Plan::Plan(std::uint64_t seed, std::vector<FaultKind> kinds, double max_pause)
    : random_{seed}, kinds_{std::move(kinds)}, max_pause_{max_pause} {}

/// Computed here, because std::uniform_real_distribution may differ between libraries.
double Plan::between(double low, double high) {
  return low + (high - low) * static_cast<double>(random_() >> 11) * 0x1p-53;
}

Fault Plan::next(const std::vector<Program>& programs) {
  std::vector<FaultKind> possible;
  for (const FaultKind kind : kinds_) {
    const auto possible_for = [kind](const Program& program) { return applies(kind, program); };
    if (is_of_network(kind) || std::any_of(programs.begin(), programs.end(), possible_for)) possible.push_back(kind);
  }
  if (possible.empty()) throw NoPossibleFault("no program of the session on this machine can have such a fault");
  Fault fault;
  fault.kind = possible[random_() % possible.size()];
  fault.pause = between(std::min(kMinPause, max_pause_), max_pause_);
  if (!is_of_network(fault.kind)) {
    std::vector<std::string> labels;
    for (const Program& program : programs)
      if (applies(fault.kind, program)) labels.push_back(program.label);
    fault.program = labels[random_() % labels.size()];
  }
  switch (fault.kind) {
    case FaultKind::kSuspend:
      fault.seconds = between(kMinSuspension, kMaxSuspension);
      break;
    case FaultKind::kKill:
      break;
    case FaultKind::kLoss:
      fault.seconds = between(kMinLoss, kMaxLoss);
      fault.percent = kMinPercent + static_cast<int>(random_() % (kMaxPercent - kMinPercent + 1));
      break;
    case FaultKind::kCut:
      fault.seconds = between(kMinCut, kMaxCut);
      break;
  }
  return fault;
}

}  // namespace tactus::chaos
