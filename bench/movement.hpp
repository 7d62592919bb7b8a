/// Simulates a scripted user on a model. Benchmarks of deadband coding use the resulting probe states.
///
/// Operator, hand, loader and cycle are those of the programs, in one thread and in virtual time. The hand trembles,
/// and its device measures positions in steps. The same seed gives the same states.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "session/messages.hpp"
#include "spm/model.hpp"

namespace tactus::bench {

struct Movement {
  const char* name;
  const char* script;  ///< script of a user in scenario YAML; it is repeated
};
/// Returns tapping, following a surface at 5 and at 15 cm/s, holding still on the surface, and moving in the air.
[[nodiscard]] const std::vector<Movement>& movements();

/// Returns one probe state per millisecond, for `seconds` after the first contact. Session time begins at 0 and the
/// sequence number at 1. `scale` is metres for each unit of `model`. Throws std::runtime_error if the hand touches
/// nothing within 20 s.
[[nodiscard]] std::vector<session::ProbeState> simulate(const spm::Model& model, double scale, const Movement& movement,
                                                        double seconds, std::uint32_t seed);

}  // namespace tactus::bench
