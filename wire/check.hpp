/// Validation of samples before sending and after decoding: bounds, finite numbers, unit quaternions, existing
/// enumerators, ids that match their names. No DDS here.
#pragma once

#include "session/messages.hpp"

namespace tactus::wire {

/// The first fault of a sample, as static text with the field and the expected value; nullptr if it is valid. O(size),
/// no allocation. Thread: any.
[[nodiscard]] const char* fault(const session::RosterEntry& sample) noexcept;
[[nodiscard]] const char* fault(const session::CatalogueEntry& sample) noexcept;
[[nodiscard]] const char* fault(const session::Demand& sample) noexcept;
[[nodiscard]] const char* fault(const session::Metrics& sample) noexcept;
[[nodiscard]] const char* fault(const session::Control& sample) noexcept;
[[nodiscard]] const char* fault(const session::ForceReset& sample) noexcept;
[[nodiscard]] const char* fault(const session::SessionEnd& sample) noexcept;
[[nodiscard]] const char* fault(const session::BulkChunk& sample) noexcept;
[[nodiscard]] const char* fault(const session::EmergencyStop& sample) noexcept;
[[nodiscard]] const char* fault(const session::Intent& sample) noexcept;
[[nodiscard]] const char* fault(const session::ProbeState& sample) noexcept;
[[nodiscard]] const char* fault(const session::DevicePose& sample) noexcept;
[[nodiscard]] const char* fault(const session::DeviceCommand& sample) noexcept;
[[nodiscard]] const char* fault(const session::ObjectPose& sample) noexcept;
[[nodiscard]] const char* fault(const session::ObjectClaim& sample) noexcept;
[[nodiscard]] const char* fault(const session::ObjectGrant& sample) noexcept;
[[nodiscard]] const char* fault(const session::ObjectCopy& sample) noexcept;
[[nodiscard]] const char* fault(const session::ClockSample& sample) noexcept;

}  // namespace tactus::wire
