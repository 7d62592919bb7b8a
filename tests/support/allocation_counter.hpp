/// Counts the allocations and releases of memory by the calling thread: malloc, free and all functions that call them.
///
/// Link allocation_counter.cpp into the test. Do not use it in sanitizer builds, which have an allocator of their own.
#pragma once

#include <cstdint>

namespace tactus::test_support {

/// Counts from its construction to its destruction. A thread may have only one counter at a time.
class AllocationCounter {
 public:
  AllocationCounter() noexcept;
  ~AllocationCounter();
  AllocationCounter(const AllocationCounter&) = delete;
  AllocationCounter& operator=(const AllocationCounter&) = delete;
  /// Number of calls that allocated or released memory since the construction.
  [[nodiscard]] std::uint64_t count() const noexcept;
};

}  // namespace tactus::test_support
