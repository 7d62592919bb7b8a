/// Hands that move over a model as scripted users do, cycle by cycle: what a coder of probe states has to code.
///
/// The real operator, hand, loader and cycle, in one thread and in virtual time; the hand trembles and its device
/// measures in steps. The same seed gives the same states.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "session/messages.hpp"
#include "spm/model.hpp"

namespace tactus::bench {

struct Movement {
  const char* name;
  const char* script;  ///< of a scenario's user, repeated
};
/// Tapping, following a surface slowly and fast, holding still on it, moving in the air.
[[nodiscard]] const std::vector<Movement>& movements();

/// One state a millisecond for `seconds` from the first contact on (from the start when there is none): session time
/// from 0, sequence from 1. `model` in file units, `scale` metres each. Throws std::runtime_error when nothing is
/// touched that should be.
[[nodiscard]] std::vector<session::ProbeState> record(const spm::Model& model, double scale, const Movement& movement,
                                                      double seconds, std::uint32_t seed);

}  // namespace tactus::bench
