#include "spm/hash_multiplier.hpp"

#include <random>

namespace tactus::spm {

std::uint64_t hash_multiplier() {
  static const std::uint64_t multiplier = 0x9e3779b9ull << 32 | std::random_device{}() | 1;
  return multiplier;
}

}  // namespace tactus::spm
