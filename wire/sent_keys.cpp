#include "wire/sent_keys.hpp"

#include <fastdds/dds/domain/DomainParticipant.hpp>

#ifndef TACTUS_FAST_DDS_3
#include <fastdds/rtps/history/WriterHistory.h>
#include <fastdds/rtps/writer/RTPSWriter.h>
#include <fastdds/rtps/writer/WriterListener.h>

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

/// Removes a message from the history of its writer once all readers have acknowledged it. The library calls the
/// function under the lock of the writer.
class SentKeysListener final : public rtps::WriterListener {
 public:
  void onWriterChangeReceivedByAll(rtps::RTPSWriter* writer, rtps::CacheChange_t* change) override {
    (void)(writer->*Access::history())->remove_change(change);
  }

 private:
  struct Access : rtps::RTPSWriter {
    static rtps::WriterHistory* rtps::RTPSWriter::*history() noexcept { return &Access::mp_history; }
  };
};

}  // namespace

void free_sent_keys(const dds::DomainParticipant& participant) {
  static SentKeysListener listener;
  rtps::GUID_t guid = participant.guid();
  guid.entityId = ENTITYID_P2P_BUILTIN_PARTICIPANT_VOLATILE_MESSAGE_SECURE_WRITER;  // of DDS Security 1.1
  if (rtps::RTPSWriter* const writer = rtps::RTPSDomainImpl::find_local_writer(guid)) writer->set_listener(&listener);
}

}  // namespace tactus::wire

#else

namespace tactus::wire {

void free_sent_keys(const dds::DomainParticipant&) {}

}  // namespace tactus::wire

#endif
