/// Helpers around Fast DDS for the sources of wire/. Only wire/ and its tests include this header.
#pragma once

#include <algorithm>
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
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "wire/discovery.hpp"
#include "wire/flow.hpp"
#include "wire/library.hpp"
#include "wire/participants.hpp"
#include "wire/security.hpp"
#include "wire/server_watch.hpp"

namespace tactus::wire {

/// Makes a generated type safe for untrusted samples and for several endpoints in several threads.
///
/// No exception leaves the decoder. The key is computed on the stack instead of in a buffer that all endpoints share.
///
/// A topic of class probe and the roster have one DDS instance each, whatever the key in the sample. Fast DDS 2.9.1
/// frees no instance while its writer lives. So with one instance for each key, readers would refuse the samples of new
/// users and programs as soon as there had been `max_instances`, or as soon as one program had written so many keys.
/// These topics need no instances, because their history stores nothing: a reader takes each sample in the thread that
/// received it.
template <class Support>
class Guarded : public LibraryType<Support> {
 public:
  using Type = typename Support::type;

  explicit Guarded(bool has_one_instance) : has_one_instance_{has_one_instance} {}

  bool decode(rtps::SerializedPayload_t& payload, void* sample) override {
    try {
      return this->decode_generated(payload, sample);
    } catch (...) {  // Fast CDR throws for a boolean that is neither 0 nor 1, std::vector for a size that is too large
      return false;
    }
  }

  [[nodiscard]] Key compute(const void* sample) const override {
    if (has_one_instance_) return {1};  // a handle of zeros is invalid
    return key_of(*static_cast<const Type*>(sample));
  }

 private:
  bool has_one_instance_;
};

/// False for a chunk, which has a stream instead of an origin (session/messages.hpp).
template <class Sample>
inline constexpr bool kHasOrigin = !std::is_same_v<Sample, session::BulkChunk>;

/// Returns what a sample states about its author. The sample must outlive the claim.
template <class Sample>
[[nodiscard]] Claim claim_of(const Sample& sample) {
  Claim claim;
  if constexpr (kHasOrigin<Sample>) claim.participant = sample.origin.participant;
  if constexpr (requires { sample.user_id; }) claim.user = sample.user_id;
  if constexpr (requires { sample.object_id; }) claim.object = sample.object_id;
  if constexpr (std::is_same_v<Sample, session::RosterEntry>) claim.entry = &sample, claim.name = &sample.name;
  if constexpr (std::is_same_v<Sample, session::CatalogueEntry>) claim.name = &sample.host;
  return claim;
}

struct Participants::Impl {
  SessionAddress address;
  DiscoveryLocators locators;  ///< of address.discovery
  std::uint64_t session_id = 0;
  std::uint64_t participant_id = 0;
  bool probe_realtime = false;
  Flow flow;
  std::unique_ptr<Security> security;    ///< null: the session has no keys
  std::unique_ptr<ServerWatch> servers;  ///< the listener of the session participant
  std::array<dds::DomainParticipant*, kTrafficClasses> participants{};
  std::map<std::string, dds::DataWriterQos> writer_qos;  ///< by profile, as TopicSpec::profile
  std::map<std::string, dds::DataReaderQos> reader_qos;
  std::mutex topics_mutex;  ///< held by `topic()`

  [[nodiscard]] dds::DomainParticipant& participant(TrafficClass traffic) const {
    return *participants[static_cast<std::size_t>(traffic)];
  }
  /// Returns the topic, and creates it with `type` for the first endpoint. Throws WireError.
  dds::Topic& topic(const char* name, TrafficClass traffic, dds::TypeSupport type);
  /// Returns whether a sample with this claim counts. Without keys, all samples count.
  [[nodiscard]] bool is_author(const dds::SampleInfo& sample, const Claim& claim, const char* topic) const noexcept;
  /// Reports that a participant sends more than the rate of a topic: in the log, and with keys in the audit log.
  void report_excess(const GuidPrefix& participant, const char* topic) const noexcept;
  /// See Members::report_invalid.
  void report_invalid(const GuidPrefix& participant, const char* topic, const char* reason) const noexcept;
  /// See Members::ids_of. Empty without keys.
  [[nodiscard]] std::vector<std::uint64_t> authors_of(const dds::SampleInfo& sample) const;
  /// Returns `<session>/<part>`, or `<session>` if `part` is empty. Throws WireError if `part` has a wildcard.
  [[nodiscard]] std::string partition(const std::string& part) const;

  ~Impl();
};

/// Counts the matched remote endpoints, except those of the same participant.
class MatchCount {
 public:
  void change(const rtps::InstanceHandle_t& other, int by, const dds::DomainParticipant& own) {
    rtps::GUID_t guid;
    rtps::iHandle2GUID(guid, other);
    if (guid.guidPrefix != own.guid().guidPrefix) count_ += by;
  }
  [[nodiscard]] int get() const noexcept { return count_.load(); }

 private:
  std::atomic<int> count_{0};
};

[[nodiscard]] inline GuidPrefix prefix_of(const rtps::GUID_t& guid) {
  GuidPrefix prefix;
  std::copy(std::begin(guid.guidPrefix.value), std::end(guid.guidPrefix.value), prefix.begin());
  return prefix;
}

/// Passes a text to the log sink, once for each text. Without a log sink, prints it to the standard error.
void report(const std::string& text, session::Severity severity = session::Severity::kWarning);

/// Reports that an endpoint of this program and one of another do not match. `own`, `other`: reader or writer.
void report_mismatch(const char* own, const char* other, const std::string& topic, dds::QosPolicyId_t policy);

/// Captures the log messages of Fast DDS while it exists; the sink then receives none. Only one may exist at a time.
class LogCapture {
 public:
  LogCapture();
  ~LogCapture();
  /// Returns and removes the messages captured so far, separated by "; ".
  [[nodiscard]] std::string take();
};

}  // namespace tactus::wire
