/// Identifies the code that computes forces.
#pragma once

namespace tactus::hrtc_service {

/// Returns a digest of all sources of this module and of the modules that it links, of the compiler, its version and
/// its options, and of the version of Eigen. With the same digest, the same inputs give the same forces to the bit.
[[nodiscard]] const char* build_id() noexcept;

}  // namespace tactus::hrtc_service
