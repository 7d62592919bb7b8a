#include "tests/support/no_alloc.hpp"

#include <cerrno>
#include <cstddef>

// glibc's own entries; ours below take the public names, so that a library's calls are seen as well.
extern "C" {
void* __libc_malloc(std::size_t size);
void* __libc_calloc(std::size_t count, std::size_t size);
void* __libc_realloc(void* old, std::size_t size);
void* __libc_memalign(std::size_t alignment, std::size_t size);
void __libc_free(void* old);
}

namespace {

thread_local bool watching = false;
thread_local std::uint64_t calls = 0;

void note() noexcept {
  if (watching) ++calls;
}

}  // namespace

extern "C" {
void* malloc(std::size_t size) {
  note();
  return __libc_malloc(size);
}
void* calloc(std::size_t count, std::size_t size) {
  note();
  return __libc_calloc(count, size);
}
void* realloc(void* old, std::size_t size) {
  note();
  return __libc_realloc(old, size);
}
void* memalign(std::size_t alignment, std::size_t size) {
  note();
  return __libc_memalign(alignment, size);
}
void* aligned_alloc(std::size_t alignment, std::size_t size) {
  note();
  return __libc_memalign(alignment, size);
}
int posix_memalign(void** out, std::size_t alignment, std::size_t size) {
  note();
  *out = __libc_memalign(alignment, size);
  return *out == nullptr ? ENOMEM : 0;
}
void free(void* old) {
  if (old != nullptr) note();
  __libc_free(old);
}
}

namespace tactus::test_support {

NoAlloc::NoAlloc() noexcept {
  calls = 0;
  watching = true;
}
NoAlloc::~NoAlloc() { watching = false; }
std::uint64_t NoAlloc::count() const noexcept { return calls; }

}  // namespace tactus::test_support
