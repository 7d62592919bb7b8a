/// Asking for memory before it is needed.
#pragma once

namespace tactus::spm {

/// Asks for the cache line with `address` and does not wait for it. Realtime.
///
/// The empty statement takes no instruction, but counts as an effect: g++ 12 takes a function that does nothing but
/// prefetch for one without effect, and leaves calls of it out.
inline void prefetch(const void* address) noexcept {
  __builtin_prefetch(address);
  asm volatile("");
}

}  // namespace tactus::spm
