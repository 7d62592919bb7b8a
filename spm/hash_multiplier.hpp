/// The multiplier of hash tables whose keys come from another program.
#pragma once

#include <cstdint>

namespace tactus::spm {

/// Returns an odd number that is random for each process, so that nobody can choose keys that fall into few buckets.
/// Its upper half is that of the golden ratio, so consecutive keys fall into buckets far from each other. Any thread.
/// The first call is not realtime.
[[nodiscard]] std::uint64_t hash_multiplier();

}  // namespace tactus::spm
