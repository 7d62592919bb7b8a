/// What the sources of wire/ share about Fast DDS. Never included outside wire/ and its tests.
#pragma once

#include <fastcdr/Cdr.h>
#include <fastcdr/FastBuffer.h>

#include <array>
#include <atomic>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/DataWriterListener.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/Topic.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <functional>
#include <map>
#include <mutex>
#include <string>

#include "wire/direct.hpp"
#include "wire/flow.hpp"
#include "wire/links.hpp"

namespace tactus::wire {

namespace dds = eprosima::fastdds::dds;

/// Decodings that failed in this thread. Fast DDS drops such a sample silently; a Reader compares before and after.
inline thread_local std::uint64_t decode_failures = 0;

/// A generated type made safe for what the network may bring, and for several ends in several threads: no exception
/// leaves the decoder, and the key is computed on the stack instead of in a buffer that all ends share.
template <class Support>
class Guarded : public Support {
 public:
  using Type = typename Support::type;

  bool deserialize(eprosima::fastrtps::rtps::SerializedPayload_t* payload, void* data) override {
    try {
      if (Support::deserialize(payload, data)) return true;
    } catch (...) {  // Fast CDR throws for a boolean that is neither 0 nor 1, vectors for absurd sizes
    }
    ++decode_failures;
    return false;
  }

  bool getKey(void* data, eprosima::fastrtps::rtps::InstanceHandle_t* handle, bool) override {
    if (!this->m_isGetKeyDefined) return false;
    std::array<char, 16> key{};  // every key of tactus.idl fits: no digest is needed
    eprosima::fastcdr::FastBuffer buffer{key.data(), key.size()};
    eprosima::fastcdr::Cdr cdr{buffer, eprosima::fastcdr::Cdr::BIG_ENDIANNESS};
    static_cast<Type*>(data)->serializeKey(cdr);
    for (std::size_t i = 0; i < key.size(); ++i) handle->value[i] = static_cast<std::uint8_t>(key[i]);
    return true;
  }
};

struct Links::Impl {
  SessionAddress address;
  std::uint64_t session_id = 0;
  std::uint64_t participant_id = 0;
  bool probe_realtime = false;
  Flow flow;
  std::shared_ptr<DirectPath>
      direct;  ///< of class probe; null where it has other ways than UDP or no participant of its own
  std::array<dds::DomainParticipant*, kTrafficClasses> participants{};
  std::map<std::string, dds::DataWriterQos> writer_qos;  ///< by profile, as TopicSpec::profile
  std::map<std::string, dds::DataReaderQos> reader_qos;
  std::mutex topics_mutex;  ///< for `topic`

  [[nodiscard]] dds::DomainParticipant& participant(TrafficClass traffic) const {
    return *participants[static_cast<std::size_t>(traffic)];
  }
  /// Null for ends whose samples the library keeps, orders or repeats, and for classes that have none.
  template <class Qos>
  [[nodiscard]] DirectPath* direct_for(TrafficClass traffic, const Qos& qos) const {
    const bool not_kept = qos.reliability().kind == dds::BEST_EFFORT_RELIABILITY_QOS &&
                          qos.durability().kind == dds::VOLATILE_DURABILITY_QOS;
    return traffic == TrafficClass::kProbe && not_kept ? direct.get() : nullptr;
  }
  /// The topic, made with `type` when this is its first end. Throws WireError.
  dds::Topic& topic(const char* name, TrafficClass traffic, dds::TypeSupport type);
  /// `<session>` or `<session>/<part>`. Throws WireError for a part that could match others.
  [[nodiscard]] std::string partition(const std::string& part) const;

  ~Impl();
};

inline eprosima::fastrtps::rtps::GUID_t guid_of(const eprosima::fastrtps::rtps::InstanceHandle_t& handle) {
  eprosima::fastrtps::rtps::GUID_t guid;
  eprosima::fastrtps::rtps::iHandle2GUID(guid, handle);
  return guid;
}

/// Counts the ends found on the other side, without those of the same participant.
class MatchCount {
 public:
  void change(const eprosima::fastrtps::rtps::InstanceHandle_t& other, int by, const dds::DomainParticipant& own) {
    if (guid_of(other).guidPrefix != own.guid().guidPrefix) count_ += by;
  }
  [[nodiscard]] int get() const noexcept { return count_.load(); }

 private:
  std::atomic<int> count_{0};
};

/// Collects what Fast DDS logs between construction and `take`, instead of handing it to the sink. One at a time.
class LogCapture {
 public:
  LogCapture();
  ~LogCapture();
  /// What was logged so far, one message after another, separated by "; ".
  [[nodiscard]] std::string take();
};

}  // namespace tactus::wire
