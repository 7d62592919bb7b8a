/// Vectors of float or double as vector types of the compiler, and the choice of the instruction set at run time.
///
/// A kernel is written once, in a file `x_kernel.inc`, which includes simd_lanes.inc. A source file includes the kernel
/// once for each instruction set, each time in another namespace and between a TACTUS_TARGET macro and
/// TACTUS_TARGET_END. Compilers translate vector types to instructions before they inline functions, so the helpers in
/// simd_lanes.inc must be compiled for each instruction set too. Lanes do not interact, and compilers make no fused
/// multiply-add (-ffp-contract=off), so every variant gives the same bits. Tests compare the variants.
#pragma once

#include <cstdint>
#include <cstring>

// Vectors are only passed between inlined functions, so the calling convention does not matter.
#pragma GCC diagnostic ignored "-Wpsabi"

#define TACTUS_ALWAYS_INLINE inline __attribute__((always_inline))

#ifdef __x86_64__
#define TACTUS_HAS_TARGETS 1
#ifdef __clang__
#define TACTUS_TARGET_AVX2 _Pragma("clang attribute push(__attribute__((target(\"avx2\"))), apply_to = function)")
#define TACTUS_TARGET_AVX512 \
  _Pragma("clang attribute push(__attribute__((target(\"avx512f,avx512vl,avx512dq\"))), apply_to = function)")
#define TACTUS_TARGET_END _Pragma("clang attribute pop")
#else
#define TACTUS_TARGET_AVX2 _Pragma("GCC push_options") _Pragma("GCC target(\"avx2\")")
#define TACTUS_TARGET_AVX512 _Pragma("GCC push_options") _Pragma("GCC target(\"avx512f,avx512vl,avx512dq\")")
#define TACTUS_TARGET_END _Pragma("GCC pop_options")
#endif
#endif

namespace tactus::spm {

using Float8 = float __attribute__((vector_size(32)));
using Int8 = std::int32_t __attribute__((vector_size(32)));
enum class Simd : std::uint8_t { kBase, kAvx2, kAvx512 };

/// Returns the best instruction set of the processor.
[[nodiscard]] inline Simd best_simd() noexcept {
#ifdef TACTUS_HAS_TARGETS
  __builtin_cpu_init();
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512dq"))
    return Simd::kAvx512;
  if (__builtin_cpu_supports("avx2")) return Simd::kAvx2;
#endif
  return Simd::kBase;
}

}  // namespace tactus::spm
