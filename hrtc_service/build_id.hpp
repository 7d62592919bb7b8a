/// Identifies the code that computes forces.
#pragma once

namespace tactus::hrtc_service {

/// Returns a digest of the sources that compute forces, the compiler, its version and its options. With the same
/// digest, the same inputs give the same forces to the bit.
[[nodiscard]] const char* build_id() noexcept;

}  // namespace tactus::hrtc_service
