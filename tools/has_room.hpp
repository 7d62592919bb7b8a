/// Limits what a tool stores of the samples of a session. O(log size), any thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>

namespace tactus::tools {

inline constexpr std::size_t kMaxEntries = 4096;  // of a map whose keys come from the network

/// Returns whether an entry with this key exists or may be added. Samples from the network must not fill the memory.
template <class Value>
[[nodiscard]] bool has_room(const std::map<std::uint64_t, Value>& all, std::uint64_t key) {
  return all.size() < kMaxEntries || all.count(key) != 0;
}

}  // namespace tactus::tools
