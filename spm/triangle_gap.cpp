#include "spm/triangle_gap.hpp"

namespace tactus::spm {
namespace {

namespace base {
constexpr int kDoubles = 2;
#include "spm/triangle_gap_kernel.inc"
}  // namespace base
#ifdef TACTUS_HAS_TARGETS
TACTUS_TARGET_AVX2
namespace avx2 {
constexpr int kDoubles = 4;
#include "spm/triangle_gap_kernel.inc"  // NOLINT(readability-duplicate-include): for each instruction set
}  // namespace avx2
TACTUS_TARGET_END
#endif

}  // namespace

void gaps(const TriangleLanes& object, const TriangleLanes& probe, TriangleGaps& out, Simd simd) noexcept {
#ifdef TACTUS_HAS_TARGETS
  if (simd != Simd::kBase) return avx2::gaps(object, probe, out);
#endif
  static_cast<void>(simd);
  base::gaps(object, probe, out);
}

}  // namespace tactus::spm
