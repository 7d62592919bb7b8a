#include "session/status_names.hpp"

#include <array>

#include "session/messages.hpp"

namespace tactus::session {

std::vector<std::string> status_names(std::uint32_t status) {
  // By bit.
  constexpr std::array kNames{"kInContact",         "kExact",    "kStalePose",   "kForceSaturated", "kForceRamped",
                              "kContactsTruncated", "kPoolFull", "kBudgetSpent", "kFault",          "kSurfaceMoved",
                              "kStiffnessCut",      "kHolding",  "kHoldRefused", "kTargetsDropped"};
  static_assert(kTargetsDropped == 1u << (kNames.size() - 1), "each bit has a name");
  if ((status & kFault) != 0) status &= ~std::uint32_t{kFaultReason};
  std::vector<std::string> names;
  for (std::uint32_t bit = 0; bit < 32; ++bit)
    if ((status >> bit & 1u) != 0) names.push_back(bit < kNames.size() ? kNames[bit] : "bit " + std::to_string(bit));
  return names;
}

}  // namespace tactus::session
