/// Frees the messages in which a secured participant has sent its session keys. Only wire/ includes this header.
///
/// Fast DDS before 2.14.1 stores all of them until the participant ends: some 100 KB for each other participant that
/// ever joined. Source: pull request 4673 of Fast DDS, which mends this in its later versions.
#pragma once

#include "wire/library.hpp"

namespace tactus::wire {

/// From now on, frees each such message once all its receivers have it. Does nothing in versions that do so themselves.
/// Call it before the participant receives anything.
void free_sent_keys(const dds::DomainParticipant& participant);

}  // namespace tactus::wire
