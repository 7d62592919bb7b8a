/// Validates samples before sending and after decoding: bounds, finite numbers, unit quaternions, existing enumerators,
/// and ids that match their names. Uses no DDS.
#pragma once

#include <string>

#include "session/messages.hpp"

namespace tactus::session {

/// Whether a text may be the name of a program or a user: 1 to 63 bytes without control characters and * ? [ ] \. The
/// name becomes a DDS partition, and a pattern would match others.
[[nodiscard]] bool is_partition(const std::string& name) noexcept;

/// Returns the first invalid field of a sample and the expected value, as static text; nullptr if the sample is valid.
/// O(size), no allocation. Thread: any.
[[nodiscard]] const char* invalid_field(const RosterEntry& sample) noexcept;
[[nodiscard]] const char* invalid_field(const CatalogueEntry& sample) noexcept;
/// Checks the metres per file unit of a model.
[[nodiscard]] const char* invalid_scale(double scale, const spm::ModelSummary& summary) noexcept;
[[nodiscard]] const char* invalid_field(const Demand& sample) noexcept;
[[nodiscard]] const char* invalid_field(const Metrics& sample) noexcept;
[[nodiscard]] const char* invalid_field(const ShownRegions& sample) noexcept;
[[nodiscard]] const char* invalid_field(const Control& sample) noexcept;
[[nodiscard]] const char* invalid_field(const ForceReset& sample) noexcept;
[[nodiscard]] const char* invalid_field(const SessionEnd& sample) noexcept;
[[nodiscard]] const char* invalid_field(const BulkChunk& sample) noexcept;
[[nodiscard]] const char* invalid_field(const EmergencyStop& sample) noexcept;
[[nodiscard]] const char* invalid_field(const Intent& sample) noexcept;
[[nodiscard]] const char* invalid_field(const ProbeState& sample) noexcept;
[[nodiscard]] const char* invalid_field(const DevicePose& sample) noexcept;
[[nodiscard]] const char* invalid_field(const DeviceCommand& sample) noexcept;
[[nodiscard]] const char* invalid_field(const ObjectPose& sample) noexcept;
[[nodiscard]] const char* invalid_field(const ObjectClaim& sample) noexcept;
[[nodiscard]] const char* invalid_field(const ObjectGrant& sample) noexcept;
[[nodiscard]] const char* invalid_field(const ObjectCopy& sample) noexcept;
[[nodiscard]] const char* invalid_field(const ClockSample& sample) noexcept;

// Parts of samples.
[[nodiscard]] const char* invalid_field(const Pose& pose) noexcept;
[[nodiscard]] const char* invalid_field(const Material& material) noexcept;
[[nodiscard]] const char* invalid_field(const Body& body) noexcept;

}  // namespace tactus::session
