#include "client_sim/scenario.hpp"

namespace tactus::client_sim {

std::uint32_t ordinal_of(const std::string& reference) {
  if (reference.size() < 2 || reference.size() > 5 || reference[0] != '#') return 0;
  std::uint32_t ordinal = 0;
  for (std::size_t i = 1; i < reference.size(); ++i) {
    if (reference[i] < '0' || reference[i] > '9') return 0;
    ordinal = ordinal * 10 + static_cast<std::uint32_t>(reference[i] - '0');
  }
  return ordinal;
}

}  // namespace tactus::client_sim
