/// One interface for the two supported versions of Fast DDS: 2.9 (Debian 12) and 3.1 (Debian 13). Only wire/ and its
/// tests include this header. The differences between the versions are here, except the names of the generated headers
/// (convert.hpp), the names in XML profiles (profile_elements.cpp), classes that the headers of Fast DDS do not declare
/// (sent_keys.cpp, session_keys.cpp), and the CMake packages and the generator (cmake/TactusIdl.cmake). Source:
/// UPGRADING.md of Fast DDS 3.
#pragma once

#if __has_include(<fastdds/rtps/transport/NetworkBuffer.hpp>)
#define TACTUS_FAST_DDS_3
#include <fastdds/config.hpp>
#include <fastdds/dds/builtin/topic/ParticipantBuiltinTopicData.hpp>
#include <fastdds/dds/core/ReturnCode.hpp>
#include <fastdds/dds/core/Time_t.hpp>
#include <fastdds/rtps/attributes/RTPSParticipantAttributes.hpp>
#include <fastdds/rtps/builtin/data/PublicationBuiltinTopicData.hpp>
#include <fastdds/rtps/common/Guid.hpp>
#include <fastdds/rtps/common/Locator.hpp>
#include <fastdds/rtps/common/LocatorList.hpp>
#include <fastdds/rtps/common/SerializedPayload.hpp>
#include <fastdds/rtps/participant/ParticipantDiscoveryInfo.hpp>
#include <fastdds/rtps/transport/ChainingTransport.hpp>
#include <fastdds/rtps/transport/ChainingTransportDescriptor.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.hpp>
#include <fastdds/rtps/writer/WriterDiscoveryStatus.hpp>
#include <fastdds/utils/IPLocator.hpp>
#else
#include <fastdds/rtps/attributes/ServerAttributes.h>
#include <fastdds/rtps/common/Guid.h>
#include <fastdds/rtps/common/Locator.h>
#include <fastdds/rtps/common/SerializedPayload.h>
#include <fastdds/rtps/participant/ParticipantDiscoveryInfo.h>
#include <fastdds/rtps/transport/ChainingTransport.h>
#include <fastdds/rtps/transport/ChainingTransportDescriptor.h>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastdds/rtps/writer/WriterDiscoveryInfo.h>
#include <fastrtps/config.h>
#include <fastrtps/utils/IPLocator.h>

#include <fastdds/rtps/common/LocatorList.hpp>
#endif

#include <fastcdr/Cdr.h>
#include <fastcdr/FastBuffer.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <fastdds/dds/domain/DomainParticipantListener.hpp>
#include <fastdds/dds/domain/qos/DomainParticipantQos.hpp>
#include <fastdds/dds/publisher/qos/DataWriterQos.hpp>
#include <fastdds/dds/subscriber/qos/DataReaderQos.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <functional>
#include <utility>
#include <vector>

namespace tactus::wire {

namespace dds = eprosima::fastdds::dds;
namespace transport = eprosima::fastdds::rtps;

// ---- names ----

#ifdef TACTUS_FAST_DDS_3
namespace rtps = eprosima::fastdds::rtps;
using LibraryDuration = dds::Duration_t;
inline constexpr const char* kLibraryVersion = FASTDDS_VERSION_STR;
#else
namespace rtps = eprosima::fastrtps::rtps;
using LibraryDuration = eprosima::fastrtps::Duration_t;
inline constexpr const char* kLibraryVersion = FASTRTPS_VERSION_STR;
#endif

/// Returns whether a call of the library succeeded. Writing a sample returns true in version 2.9, and the code 0 in 3.1.
#ifdef TACTUS_FAST_DDS_3
[[nodiscard]] inline bool succeeded(dds::ReturnCode_t code) { return code == dds::RETCODE_OK; }
#else
[[nodiscard]] inline bool succeeded(const eprosima::fastrtps::types::ReturnCode_t& code) {
  return code == eprosima::fastrtps::types::ReturnCode_t::RETCODE_OK;
}
[[nodiscard]] inline bool succeeded(bool is_written) { return is_written; }
#endif

// ---- types ----

/// The key of a sample in big-endian CDR. Every key of tactus.idl has at most 16 bytes, so DDS does not replace it by a
/// hash.
using Key = std::array<char, 16>;
template <class Type>
[[nodiscard]] Key key_of(const Type& sample) {
  using eprosima::fastcdr::Cdr;
  Key key{};
  eprosima::fastcdr::FastBuffer buffer{key.data(), key.size()};
#ifdef TACTUS_FAST_DDS_3
  Cdr cdr{buffer, Cdr::BIG_ENDIANNESS, eprosima::fastcdr::CdrVersion::XCDRv1};
  serialize_key(cdr, sample);  // in the namespace of Cdr
#else
  Cdr cdr{buffer, Cdr::BIG_ENDIANNESS};
  sample.serializeKey(cdr);
#endif
  return key;
}

/// Returns whether samples of a type have a key.
[[nodiscard]] inline bool has_key(const dds::TopicDataType& type) {
#ifdef TACTUS_FAST_DDS_3
  return type.is_compute_key_provided;
#else
  return type.m_isGetKeyDefined;
#endif
}

/// Whether the sample that the library decoded last in this thread was valid. The library drops a sample that a type
/// cannot deserialize, and does not name its author. So LibraryType::deserialize always returns true.
inline thread_local bool is_last_sample_decoded = false;

/// A generated type with the virtual functions of both versions under the same names.
template <class Support>
class LibraryType : public Support {
 public:
  /// Decodes a sample; false if it is invalid. Must not throw.
  virtual bool decode(rtps::SerializedPayload_t& payload, void* sample) = 0;
  /// Computes the key of a decoded sample, for a type that has one.
  [[nodiscard]] virtual Key compute(const void* sample) const = 0;

#ifdef TACTUS_FAST_DDS_3
  bool deserialize(rtps::SerializedPayload_t& payload, void* sample) final {
    is_last_sample_decoded = decode(payload, sample);
    return true;
  }
  bool compute_key(const void* const sample, rtps::InstanceHandle_t& handle, bool) final { return set(handle, sample); }
  /// Sets a key also for a sample that cannot be decoded, as version 2.9 does, so that a reader takes the sample.
  bool compute_key(rtps::SerializedPayload_t& payload, rtps::InstanceHandle_t& handle, bool) final {
    void* const sample = this->create_data();
    (void)decode(payload, sample);
    const bool is_set = set(handle, sample);
    this->delete_data(sample);
    return is_set;
  }

 protected:
  bool decode_generated(rtps::SerializedPayload_t& payload, void* sample) {
    return Support::deserialize(payload, sample);
  }
#else
  bool deserialize(rtps::SerializedPayload_t* payload, void* sample) final {
    is_last_sample_decoded = decode(*payload, sample);
    return true;
  }
  bool getKey(void* sample, rtps::InstanceHandle_t* handle, bool) final { return set(*handle, sample); }

 protected:
  bool decode_generated(rtps::SerializedPayload_t& payload, void* sample) {
    return Support::deserialize(&payload, sample);
  }
#endif

 private:
  bool set(rtps::InstanceHandle_t& handle, const void* sample) const {
    if (!has_key(*this)) return false;
    const Key key = compute(sample);
    for (std::size_t i = 0; i < key.size(); ++i) handle.value[i] = static_cast<std::uint8_t>(key[i]);
    return true;
  }
};

/// Encodes a sample as a Writer does.
template <class Support>
[[nodiscard]] bool encode(Support& type, typename Support::type& sample, rtps::SerializedPayload_t& payload) {
#ifdef TACTUS_FAST_DDS_3
  return type.serialize(&sample, payload, dds::XCDR_DATA_REPRESENTATION);
#else
  return type.serialize(&sample, &payload);
#endif
}

/// A type that is only read, with samples of class `Sample` instead of the generated one.
template <class Base, class Sample>
class ReadOnlyType : public Base {
 public:
  using Base::Base;
#ifdef TACTUS_FAST_DDS_3
  bool serialize(const void* const, rtps::SerializedPayload_t&, dds::DataRepresentationId_t) override { return false; }
  void* create_data() override { return new Sample; }
  void delete_data(void* sample) override { delete static_cast<Sample*>(sample); }
#else
  bool serialize(void*, rtps::SerializedPayload_t*) override { return false; }
  void* createData() override { return new Sample; }
  void deleteData(void* sample) override { delete static_cast<Sample*>(sample); }
#endif
};

/// A type without key whose samples are encoded messages: a std::vector<std::uint8_t> with the encapsulation header.
class EncodedType final : public dds::TopicDataType {
 public:
  using Bytes = std::vector<std::uint8_t>;
  /// Size of the memory that a history allocates for a sample; a history that cannot grow refuses larger ones.
  static constexpr std::uint32_t kExpectedBytes = 1024;

#ifdef TACTUS_FAST_DDS_3
  explicit EncodedType(const char* name) {
    set_name(name);
    max_serialized_type_size = kExpectedBytes;
  }
  bool serialize(const void* const sample, rtps::SerializedPayload_t& payload, dds::DataRepresentationId_t) override {
    return copy(*static_cast<const Bytes*>(sample), payload);
  }
  bool deserialize(rtps::SerializedPayload_t& payload, void* sample) override { return copy(payload, sample); }
  std::uint32_t calculate_serialized_size(const void* const sample, dds::DataRepresentationId_t) override {
    return static_cast<std::uint32_t>(static_cast<const Bytes*>(sample)->size());
  }
  void* create_data() override { return new Bytes; }
  void delete_data(void* sample) override { delete static_cast<Bytes*>(sample); }
  bool compute_key(const void* const, rtps::InstanceHandle_t&, bool) override { return false; }
  bool compute_key(rtps::SerializedPayload_t&, rtps::InstanceHandle_t&, bool) override { return false; }
#else
  explicit EncodedType(const char* name) {
    setName(name);
    m_typeSize = kExpectedBytes;
    // Without these, version 2.9 searches for a description of the type.
    auto_fill_type_object(false);
    auto_fill_type_information(false);
  }
  bool serialize(void* sample, rtps::SerializedPayload_t* payload) override {
    return copy(*static_cast<const Bytes*>(sample), *payload);
  }
  bool deserialize(rtps::SerializedPayload_t* payload, void* sample) override { return copy(*payload, sample); }
  std::function<std::uint32_t()> getSerializedSizeProvider(void* sample) override {
    return [sample] { return static_cast<std::uint32_t>(static_cast<const Bytes*>(sample)->size()); };
  }
  void* createData() override { return new Bytes; }
  void deleteData(void* sample) override { delete static_cast<Bytes*>(sample); }
  bool getKey(void*, rtps::InstanceHandle_t*, bool) override { return false; }
#endif

 private:
  static bool copy(const Bytes& from, rtps::SerializedPayload_t& to) {
    if (from.size() > to.max_size) return false;
    std::copy(from.begin(), from.end(), to.data);
    to.length = static_cast<std::uint32_t>(from.size());
    to.encapsulation = CDR_LE;
    return true;
  }
  static bool copy(const rtps::SerializedPayload_t& from, void* to) {
    static_cast<Bytes*>(to)->assign(from.data, from.data + from.length);
    return true;
  }
};

// ---- discovery ----

/// Calls `on_writer` with topic and type of each discovered writer, in a thread of the library.
class WriterDiscoveryListener final : public dds::DomainParticipantListener {
 public:
  using OnWriter = std::function<void(const char* topic, const char* type)>;
  explicit WriterDiscoveryListener(OnWriter on_writer) : on_writer_{std::move(on_writer)} {}

#ifdef TACTUS_FAST_DDS_3
  void on_data_writer_discovery(dds::DomainParticipant*, rtps::WriterDiscoveryStatus status,
                                const dds::PublicationBuiltinTopicData& writer, bool&) override {
    if (status == rtps::WriterDiscoveryStatus::DISCOVERED_WRITER)
      on_writer_(writer.topic_name.c_str(), writer.type_name.c_str());
  }
#else
  void on_publisher_discovery(dds::DomainParticipant*, rtps::WriterDiscoveryInfo&& writer) override {
    if (writer.status == rtps::WriterDiscoveryInfo::DISCOVERED_WRITER)
      on_writer_(writer.info.topicName().c_str(), writer.info.typeName().c_str());
  }
#endif

 private:
  OnWriter on_writer_;
};

/// Reports the participants that appear, change and end. The functions are called under locks of the library.
class ParticipantListener : public dds::DomainParticipantListener {
 public:
#ifdef TACTUS_FAST_DDS_3
  void on_participant_discovery(dds::DomainParticipant*, rtps::ParticipantDiscoveryStatus status,
                                const dds::ParticipantBuiltinTopicData& found, bool& should_be_ignored) final {
    using Status = rtps::ParticipantDiscoveryStatus;
    should_be_ignored = false;
    notify(found.guid, found.metatraffic_locators,
           status == Status::REMOVED_PARTICIPANT || status == Status::DROPPED_PARTICIPANT);
  }
#else
  void on_participant_discovery(dds::DomainParticipant*, rtps::ParticipantDiscoveryInfo&& found) final {
    using Status = rtps::ParticipantDiscoveryInfo;
    notify(found.info.m_guid, found.info.metatraffic_locators,
           found.status == Status::REMOVED_PARTICIPANT || found.status == Status::DROPPED_PARTICIPANT);
  }
#endif

 private:
  /// `addresses`: where the participant receives discovery.
  virtual void on_present(const rtps::GUID_t& participant, const std::vector<rtps::Locator_t>& addresses) = 0;
  virtual void on_gone(const rtps::GUID_t& participant) = 0;

  template <class Locators>
  void notify(const rtps::GUID_t& participant, const Locators& locators, bool is_gone) {
    if (is_gone) return on_gone(participant);
    on_present(participant, {locators.unicast.begin(), locators.unicast.end()});
  }
};

// ---- QoS ----

#ifdef TACTUS_FAST_DDS_3
inline LibraryDuration& initial_heartbeat_delay(dds::DataWriterQos& qos) {
  return qos.reliable_writer_qos().times.initial_heartbeat_delay;
}
inline LibraryDuration& heartbeat_period(dds::DataWriterQos& qos) {
  return qos.reliable_writer_qos().times.heartbeat_period;
}
inline LibraryDuration& nack_response_delay(dds::DataWriterQos& qos) {
  return qos.reliable_writer_qos().times.nack_response_delay;
}
inline LibraryDuration& initial_acknack_delay(dds::DataReaderQos& qos) {
  return qos.reliable_reader_qos().times.initial_acknack_delay;
}
inline LibraryDuration& heartbeat_response_delay(dds::DataReaderQos& qos) {
  return qos.reliable_reader_qos().times.heartbeat_response_delay;
}
#else
inline LibraryDuration& initial_heartbeat_delay(dds::DataWriterQos& qos) {
  return qos.reliable_writer_qos().times.initialHeartbeatDelay;
}
inline LibraryDuration& heartbeat_period(dds::DataWriterQos& qos) {
  return qos.reliable_writer_qos().times.heartbeatPeriod;
}
inline LibraryDuration& nack_response_delay(dds::DataWriterQos& qos) {
  return qos.reliable_writer_qos().times.nackResponseDelay;
}
inline LibraryDuration& initial_acknack_delay(dds::DataReaderQos& qos) {
  return qos.reliable_reader_qos().times.initialAcknackDelay;
}
inline LibraryDuration& heartbeat_response_delay(dds::DataReaderQos& qos) {
  return qos.reliable_reader_qos().times.heartbeatResponseDelay;
}
#endif

/// Makes a participant the client of the discovery server at `server`. `number`: index of the server in the list of
/// the participant, below 256 in version 2.9, which identifies servers by it. Returns false if it is too large.
[[nodiscard]] inline bool add_discovery_server(dds::DomainParticipantQos& qos, const rtps::Locator_t& server,
                                               [[maybe_unused]] int number) {
  auto& config = qos.wire_protocol().builtin.discovery_config;
#ifdef TACTUS_FAST_DDS_3
  config.m_DiscoveryServers.push_back(server);
  config.discoveryProtocol = rtps::DiscoveryProtocol::CLIENT;
#else
  transport::RemoteServerAttributes remote;
  remote.metatrafficUnicastLocatorList.push_back(server);
  if (!transport::get_server_client_default_guidPrefix(number, remote.guidPrefix)) return false;
  config.m_DiscoveryServers.push_back(remote);
  config.discoveryProtocol = rtps::DiscoveryProtocol_t::CLIENT;
#endif
  return true;
}

/// The discovery servers of which `qos` makes a client.
[[nodiscard]] inline std::vector<rtps::Locator_t> discovery_servers(const dds::DomainParticipantQos& qos) {
  std::vector<rtps::Locator_t> servers;
  for (const auto& server : qos.wire_protocol().builtin.discovery_config.m_DiscoveryServers)
#ifdef TACTUS_FAST_DDS_3
    servers.push_back(server);
#else
    servers.push_back(*server.metatrafficUnicastLocatorList.begin());
#endif
  return servers;
}

/// Version 3.1 sends descriptions of all types by default. Both sides of a session have the IDL, so none is needed.
inline void disable_type_propagation([[maybe_unused]] dds::DomainParticipantQos& qos) {
#ifdef TACTUS_FAST_DDS_3
  qos.properties().properties().emplace_back("fastdds.type_propagation", "disabled");
#endif
}

// ---- transport ----

/// A chaining transport that gets each sent message in one buffer. Version 3.1 passes a list of buffers.
class WholeMessageTransport : public transport::ChainingTransport {
 public:
  using ChainingTransport::ChainingTransport;
  using Time = std::chrono::steady_clock::time_point;
  using Lower = rtps::SenderResource;
  using Receivers = rtps::LocatorsIterator;

  /// Sends a message of the participant; `pass_on` sends it by the transport below.
  virtual bool send_whole(Lower& lower, const rtps::octet* message, std::uint32_t size, Receivers& first,
                          Receivers& last, const Time& until) = 0;

#ifdef TACTUS_FAST_DDS_3
  bool send(Lower* lower, const std::vector<rtps::NetworkBuffer>& buffers, std::uint32_t size, Receivers* first,
            Receivers* last, const Time& until) final {
    thread_local std::vector<rtps::octet> message;
    message.clear();
    for (const rtps::NetworkBuffer& buffer : buffers) {
      const auto* const bytes = static_cast<const rtps::octet*>(buffer.buffer);
      message.insert(message.end(), bytes, bytes + buffer.size);
    }
    return send_whole(*lower, message.data(), size, *first, *last, until);
  }

 protected:
  static bool pass_on(Lower& lower, const rtps::octet* message, std::uint32_t size, Receivers& first, Receivers& last,
                      const Time& until) {
    thread_local std::vector<rtps::NetworkBuffer> buffers;
    buffers.assign(1, {message, size});
    return lower.send(buffers, size, &first, &last, until);
  }
#else
  bool send(Lower* lower, const rtps::octet* message, std::uint32_t size, Receivers* first, Receivers* last,
            const Time& until) final {
    return send_whole(*lower, message, size, *first, *last, until);
  }

 protected:
  static bool pass_on(Lower& lower, const rtps::octet* message, std::uint32_t size, Receivers& first, Receivers& last,
                      const Time& until) {
    return lower.send(message, size, &first, &last, until);
  }
#endif
};

}  // namespace tactus::wire
