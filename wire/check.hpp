/// Validates samples before sending and after decoding: bounds, finite numbers, unit quaternions, existing enumerators,
/// and ids that match their names. Uses no DDS.
#pragma once

#include "session/messages.hpp"

namespace tactus::wire {

/// Returns the first invalid field of a sample and the expected value, as static text; nullptr if the sample is valid.
/// O(size), no allocation. Thread: any.
[[nodiscard]] const char* invalid_field(const session::RosterEntry& sample) noexcept;
[[nodiscard]] const char* invalid_field(const session::CatalogueEntry& sample) noexcept;
[[nodiscard]] const char* invalid_field(const session::Demand& sample) noexcept;
[[nodiscard]] const char* invalid_field(const session::Metrics& sample) noexcept;
[[nodiscard]] const char* invalid_field(const session::ShownRegions& sample) noexcept;
[[nodiscard]] const char* invalid_field(const session::Control& sample) noexcept;
[[nodiscard]] const char* invalid_field(const session::ForceReset& sample) noexcept;
[[nodiscard]] const char* invalid_field(const session::SessionEnd& sample) noexcept;
[[nodiscard]] const char* invalid_field(const session::BulkChunk& sample) noexcept;
[[nodiscard]] const char* invalid_field(const session::EmergencyStop& sample) noexcept;
[[nodiscard]] const char* invalid_field(const session::Intent& sample) noexcept;
[[nodiscard]] const char* invalid_field(const session::ProbeState& sample) noexcept;
[[nodiscard]] const char* invalid_field(const session::DevicePose& sample) noexcept;
[[nodiscard]] const char* invalid_field(const session::DeviceCommand& sample) noexcept;
[[nodiscard]] const char* invalid_field(const session::ObjectPose& sample) noexcept;
[[nodiscard]] const char* invalid_field(const session::ObjectClaim& sample) noexcept;
[[nodiscard]] const char* invalid_field(const session::ObjectGrant& sample) noexcept;
[[nodiscard]] const char* invalid_field(const session::ObjectCopy& sample) noexcept;
[[nodiscard]] const char* invalid_field(const session::ClockSample& sample) noexcept;

}  // namespace tactus::wire
