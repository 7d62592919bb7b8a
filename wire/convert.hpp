/// Converts between the structs of session/messages.hpp and the types that are generated from idl/tactus.idl.
/// Only wire/ and its tests include this header.
#pragma once

#if __has_include(<tactusPubSubTypes.hpp>)  // generated for Fast DDS 3 (wire/library.hpp)
#include <tactus.hpp>
#include <tactusCdrAux.hpp>
#include <tactusPubSubTypes.hpp>
#else
#include <tactus.h>
#include <tactusPubSubTypes.h>
#endif

#include "session/messages.hpp"

namespace tactus::wire {

/// The generated type of a sample, and its DDS type support.
template <class Sample>
struct IdlOf;

#define TACTUS_WIRE_TYPE(NAME, IDL_NAME)                     \
  template <>                                                \
  struct IdlOf<session::NAME> {                              \
    using Type = idl::IDL_NAME;                              \
    using Support = idl::IDL_NAME##PubSubType;               \
  };                                                         \
  void to_idl(const session::NAME& from, idl::IDL_NAME& to); \
  void from_idl(const idl::IDL_NAME& from, session::NAME& to)

// `to_idl` expects a sample without invalid fields. `from_idl` accepts any sample, and an enumerator out of range stays
// out of range; the caller checks the result by `invalid_field`. Both overwrite every field.
TACTUS_WIRE_TYPE(RosterEntry, RosterEntry);
TACTUS_WIRE_TYPE(CatalogueEntry, CatalogueEntry);
TACTUS_WIRE_TYPE(Demand, Demand);
TACTUS_WIRE_TYPE(Metrics, Metrics);
TACTUS_WIRE_TYPE(ShownRegions, ShownRegions);
TACTUS_WIRE_TYPE(Control, Control);
TACTUS_WIRE_TYPE(ForceReset, ForceReset);
TACTUS_WIRE_TYPE(SessionEnd, SessionEnd);
TACTUS_WIRE_TYPE(BulkChunk, BulkChunk);
TACTUS_WIRE_TYPE(EmergencyStop, EmergencyStop);
TACTUS_WIRE_TYPE(Intent, Intent);
TACTUS_WIRE_TYPE(ProbeState, ProbeState);
TACTUS_WIRE_TYPE(DevicePose, DevicePose);
TACTUS_WIRE_TYPE(DeviceCommand, DeviceCommand);
TACTUS_WIRE_TYPE(ObjectPose, ObjectPose);
TACTUS_WIRE_TYPE(ObjectClaim, ObjectClaim);
TACTUS_WIRE_TYPE(ObjectGrant, ObjectGrant);
TACTUS_WIRE_TYPE(ObjectCopy, ObjectCopy);
TACTUS_WIRE_TYPE(ClockSample, ClockSample);
#undef TACTUS_WIRE_TYPE

template <class IdlType>
void origin_to_idl(const session::Origin& from, IdlType& to) {
  to.participant(from.participant);
  to.stamp().session(from.session);
  to.stamp().incarnation(from.incarnation);
  to.stamp().time_ns(from.time_ns);
}

template <class IdlType>
[[nodiscard]] session::Origin origin_from_idl(const IdlType& from) {
  return {from.stamp().session(), from.participant(), from.stamp().incarnation(), from.stamp().time_ns()};
}

[[nodiscard]] idl::PoseValue pose_to_idl(const session::Pose& from);
[[nodiscard]] session::Pose pose_from_idl(const idl::PoseValue& from);

/// Converts an enumeration of 32 bits to one of 8. A larger value becomes 255, which no enumeration uses.
template <class Enum, class IdlEnum>
[[nodiscard]] Enum enum_from_idl(IdlEnum from) {
  const auto value = static_cast<std::uint32_t>(from);
  return static_cast<Enum>(value > 0xff ? 0xff : value);
}

}  // namespace tactus::wire
