/// Touches the memory of a ring before the haptic thread uses it.
#pragma once

#include <memory>

namespace tactus::hrtc_service {

/// Fills and empties a ring, so that the haptic thread causes no page fault in its memory.
template <class Ring>
void touch_memory(Ring& ring) {
  const auto blank = std::make_unique<typename Ring::value_type>();
  while (ring.push(*blank)) {
  }
  ring.consume_all([](const auto&) {});
}

}  // namespace tactus::hrtc_service
