/// Counts every allocation of the calling thread while it lives: operator new, malloc and their kin.
///
/// Link no_alloc.cpp into the test. Not for sanitizer builds, which bring an allocator of their own.
#pragma once

#include <cstdint>

namespace tactus::test_support {

class NoAlloc {
 public:
  NoAlloc() noexcept;
  ~NoAlloc();
  NoAlloc(const NoAlloc&) = delete;
  NoAlloc& operator=(const NoAlloc&) = delete;
  /// Allocations and releases since the construction.
  [[nodiscard]] std::uint64_t count() const noexcept;
};

}  // namespace tactus::test_support
