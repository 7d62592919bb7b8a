#include "spm/lanes.hpp"

#include <algorithm>
#include <limits>
#include <utility>

#ifdef TACTUS_HAS_TARGETS
#include <immintrin.h>
#endif

namespace tactus::spm::lanes {
namespace {

namespace base {
constexpr int kDoubles = 2;
#include "spm/lanes_kernel.inc"
}  // namespace base
#ifdef TACTUS_HAS_TARGETS
TACTUS_TARGET_AVX2
namespace avx2 {
constexpr int kDoubles = 4;
#include "spm/lanes_kernel.inc"  // NOLINT(readability-duplicate-include): for each instruction set
}  // namespace avx2
TACTUS_TARGET_END
TACTUS_TARGET_AVX512
namespace avx512 {
constexpr int kDoubles = 8;
// One instruction; g++ 12 generates four.
#define TACTUS_WIDENED(floats) _mm512_maskz_cvtps_pd(0xff, _mm256_loadu_ps(floats))
#include "spm/lanes_kernel.inc"  // NOLINT(readability-duplicate-include): for each instruction set
#undef TACTUS_WIDENED
}  // namespace avx512
TACTUS_TARGET_END
#endif

}  // namespace

const Kernels& kernels(Simd simd) noexcept {
#ifdef TACTUS_HAS_TARGETS
  if (simd == Simd::kAvx512) return avx512::kKernels;
  if (simd == Simd::kAvx2) return avx2::kKernels;
#endif
  static_cast<void>(simd);
  return base::kKernels;
}

const Kernels kBestKernels = kernels(best_simd());

}  // namespace tactus::spm::lanes
