/// Prefetches memory into the CPU cache.
#pragma once

namespace tactus::spm {

/// Starts to load the cache line with `address` and does not wait for it. Realtime.
///
/// The empty asm statement generates no instruction but counts as a side effect. Without it, g++ 12 removes calls of
/// functions that only prefetch.
inline void prefetch(const void* address) noexcept {
  __builtin_prefetch(address);
  asm volatile("");
}

}  // namespace tactus::spm
