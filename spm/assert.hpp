/// Checks for errors of the program itself. A failed check prints a message and aborts. TACTUS_ASSERT is allowed in the
/// haptic thread and disabled by NDEBUG. TACTUS_CHECK is always enabled and not allowed in the haptic thread.
#pragma once

#include <cstdio>
#include <cstdlib>

namespace tactus::spm {

[[noreturn]] inline void fail_check(const char* condition, const char* file, int line) noexcept {
  std::fprintf(stderr, "%s:%d: internal check failed: %s\n", file, line, condition);
  std::abort();
}

}  // namespace tactus::spm

#define TACTUS_CHECK(condition) \
  ((condition) ? static_cast<void>(0) : ::tactus::spm::fail_check(#condition, __FILE__, __LINE__))
#ifdef NDEBUG
#define TACTUS_ASSERT(condition) static_cast<void>(0)
#else
#define TACTUS_ASSERT(condition) TACTUS_CHECK(condition)
#endif
