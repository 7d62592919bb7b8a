/// Frees the messages in which secured participants have sent their session keys. Only wire/ includes this header.
///
/// Fast DDS before 2.14.1 stores all of them until the participant ends: some 100 KB for each other participant that
/// ever joined. Source: pull request 4673 of Fast DDS, which mends this in its later versions; there this class does
/// nothing.
#pragma once

#include <mutex>
#include <vector>

#include "wire/library.hpp"

namespace tactus::wire {

/// Threads: any.
class SentKeys {
 public:
  /// From now on, `free_acknowledged` also frees messages of this participant.
  void add(const dds::DomainParticipant& participant);
  /// Frees the messages that all receivers have acknowledged. Do not call it in a callback of the library, which could
  /// still use a message that it is sending.
  void free_acknowledged();
  /// Forgets all participants. Call it before the first of them is deleted.
  void clear();

 private:
  std::mutex mutex_;
  std::vector<rtps::GUID_t> writers_;
};

}  // namespace tactus::wire
