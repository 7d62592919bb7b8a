/// Of which code the forces are.
#pragma once

namespace tactus::hrtc_service {

/// A digest of the sources that make forces, with the compiler, its version and its options: where it is the same, the
/// same inputs give the same forces to the bit.
[[nodiscard]] const char* build_id() noexcept;

}  // namespace tactus::hrtc_service
