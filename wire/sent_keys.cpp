#include "wire/sent_keys.hpp"

#include <fastdds/dds/domain/DomainParticipant.hpp>

#ifndef TACTUS_FAST_DDS_3
#include <fastdds/rtps/history/WriterHistory.h>
#include <fastdds/rtps/writer/RTPSWriter.h>

#include <algorithm>
#include <iterator>

namespace eprosima::fastrtps::rtps {

/// A class of the library that its headers do not declare. The library exports this function.
class RTPSDomainImpl {
 public:
  /// Returns a writer of this process, null if there is none.
  static RTPSWriter* find_local_writer(const GUID_t& writer_guid);
};

}  // namespace eprosima::fastrtps::rtps

namespace tactus::wire {
namespace {

struct Access : rtps::RTPSWriter {
  static rtps::WriterHistory* rtps::RTPSWriter::*history() noexcept { return &Access::mp_history; }
};

void free_acknowledged_of(rtps::RTPSWriter& writer) {
  const std::lock_guard lock{writer.getMutex()};
  rtps::WriterHistory& history = *(writer.*Access::history());
  std::vector<rtps::CacheChange_t*> acknowledged;
  std::copy_if(history.changesBegin(), history.changesEnd(), std::back_inserter(acknowledged),
               [&](const rtps::CacheChange_t* change) { return writer.is_acked_by_all(change); });
  for (rtps::CacheChange_t* const change : acknowledged) (void)history.remove_change(change);
}

}  // namespace

void SentKeys::add(const dds::DomainParticipant& participant) {
  rtps::GUID_t guid = participant.guid();
  guid.entityId = ENTITYID_P2P_BUILTIN_PARTICIPANT_VOLATILE_MESSAGE_SECURE_WRITER;  // of DDS Security 1.1
  const std::lock_guard lock{mutex_};
  writers_.push_back(guid);
}

void SentKeys::free_acknowledged() {
  const std::lock_guard lock{mutex_};
  for (const rtps::GUID_t& guid : writers_)
    if (rtps::RTPSWriter* const writer = rtps::RTPSDomainImpl::find_local_writer(guid)) free_acknowledged_of(*writer);
}

void SentKeys::clear() {
  const std::lock_guard lock{mutex_};
  writers_.clear();
}

}  // namespace tactus::wire

#else

namespace tactus::wire {

void SentKeys::add(const dds::DomainParticipant&) {}
void SentKeys::free_acknowledged() {}
void SentKeys::clear() {}

}  // namespace tactus::wire

#endif
