/// Whether this build has a sanitizer, which delays the reuse of freed memory and makes system calls of its own.
#pragma once

namespace tactus::test_support {

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
inline constexpr bool kSanitized = true;
#else
inline constexpr bool kSanitized = false;
#endif

}  // namespace tactus::test_support
