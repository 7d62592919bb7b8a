#include "tests/support/allocation_counter.hpp"

#include <cerrno>
#include <cstddef>

// The allocation functions of glibc under their internal names. The functions below replace the public functions, so
// that calls from libraries are counted too.
extern "C" {
void* __libc_malloc(std::size_t size);
void* __libc_calloc(std::size_t count, std::size_t size);
void* __libc_realloc(void* old, std::size_t size);
void* __libc_memalign(std::size_t alignment, std::size_t size);
void __libc_free(void* old);
}

namespace {

thread_local bool counting = false;
thread_local std::uint64_t call_count = 0;

void count_call() noexcept {
  if (counting) ++call_count;
}

}  // namespace

extern "C" {
void* malloc(std::size_t size) {
  count_call();
  return __libc_malloc(size);
}
void* calloc(std::size_t count, std::size_t size) {
  count_call();
  return __libc_calloc(count, size);
}
void* realloc(void* old, std::size_t size) {
  count_call();
  return __libc_realloc(old, size);
}
void* memalign(std::size_t alignment, std::size_t size) {
  count_call();
  return __libc_memalign(alignment, size);
}
void* aligned_alloc(std::size_t alignment, std::size_t size) {
  count_call();
  return __libc_memalign(alignment, size);
}
int posix_memalign(void** out, std::size_t alignment, std::size_t size) {
  count_call();
  *out = __libc_memalign(alignment, size);
  return *out == nullptr ? ENOMEM : 0;
}
void free(void* old) {
  if (old != nullptr) count_call();
  __libc_free(old);
}
}

namespace tactus::test_support {

AllocationCounter::AllocationCounter() noexcept {
  call_count = 0;
  counting = true;
}
AllocationCounter::~AllocationCounter() { counting = false; }
std::uint64_t AllocationCounter::count() const noexcept { return call_count; }

}  // namespace tactus::test_support
