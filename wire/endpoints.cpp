#include "wire/endpoints.hpp"

#include <array>
#include <cstdio>
#include <type_traits>
#include <utility>

#include "keys/documents.hpp"
#include "session/check.hpp"
#include "wire/convert.hpp"
#include "wire/dds.hpp"
#include "wire/sample_filter.hpp"

namespace tactus::wire {
namespace {

template <class Sample>
dds::Topic& topic_of(Participants& participants, const TopicSpec<Sample>& spec) {
  return participants.impl().topic(
      spec.name, spec.traffic, dds::TypeSupport{new Guarded<typename IdlOf<Sample>::Support>{has_one_instance(spec)}});
}

template <class Qos, class Default>
Qos with_partition(const Participants::Impl& participants, const std::string& part, const Default& from) {
  Qos qos = from;
  qos.partition().push_back(participants.partition(part).c_str());
  return qos;
}

constexpr char kUserPart[] = "u/";

/// Returns the name of the user whose samples are in this partition; empty if it is not that of a user.
std::string user_of(const std::string& partition) {
  const std::string part = kUserPart;
  return partition.compare(0, part.size(), part) == 0 ? partition.substr(part.size()) : "";
}

std::uint64_t user_id_of(const std::string& partition) {
  const std::string user = user_of(partition);
  return user.empty() ? 0 : session::id_of(user);
}

/// What to do if the keys of a program do not permit to write a topic.
std::string remedy_for(const char* topic) {
  const std::vector<keys::Role> roles = keys::writers_of(topic);
  return roles.size() == 1 ? "make keys with tactus keys add-" + std::string{name_of(roles.front())}
                           : "tactus keys --help names the command for the keys of each program";
}

}  // namespace

std::string user_partition(const std::string& user) { return kUserPart + user; }
std::string hrtc_partition(const std::string& hrtc) { return "h/" + hrtc; }
std::string group_partition(std::uint64_t group) {
  std::array<char, 24> text{};
  std::snprintf(text.data(), text.size(), "g/%016llx", static_cast<unsigned long long>(group));
  return text.data();
}

// claim_of finds these fields by their names.
static_assert(requires(session::ProbeState s, session::DevicePose d, session::DeviceCommand c, session::Intent i) {
  s.user_id, d.user_id, c.user_id, i.user_id;
});
static_assert(requires(session::CatalogueEntry e, session::ObjectPose p, session::ObjectGrant g) {
  e.object_id, p.object_id, g.object_id;
});

template <class Sample>
struct Writer<Sample>::Impl final : dds::DataWriterListener {
  Impl(Participants& in, const TopicSpec<Sample>& spec, const EndpointOptions& options)
      : participants{in}, participant{in.impl().participant(spec.traffic)} {
    if (!in.may_write(spec.name))
      throw WireError(std::string{"topic "} + spec.name + ": the keys of " + in.impl().security->who() +
                      " do not permit to write it; " + remedy_for(spec.name));
    if (const std::string user = user_of(options.partition); !user.empty()) in.expect_permitted(user);
    const auto qos = with_partition<dds::PublisherQos>(in.impl(), options.partition, dds::PUBLISHER_QOS_DEFAULT);
    publisher = participant.create_publisher(qos);
    if (publisher == nullptr) throw WireError(std::string{"topic "} + spec.name + ": DDS cannot create a publisher");
    writer = publisher->create_datawriter(&topic_of(in, spec), in.impl().writer_qos.at(spec.profile), this);
    if (writer == nullptr) {
      participant.delete_publisher(publisher);
      throw WireError(std::string{"topic "} + spec.name + ": DDS refuses a writer with profile '" + spec.profile +
                      "_writer'");
    }
  }
  ~Impl() override {
    writer->set_listener(nullptr);
    // Empties the history first: Fast DDS 2.9.1 frees it without its lock, and a heartbeat would then loop forever.
    std::size_t dropped = 0;
    writer->clear_history(&dropped);
    publisher->delete_datawriter(writer);
    participant.delete_publisher(publisher);
  }

  void on_offered_incompatible_qos(dds::DataWriter* own, const dds::OfferedIncompatibleQosStatus& status) override {
    report_mismatch("writer", "reader", own->get_topic()->get_name(), status.last_policy_id);
  }

  void on_publication_matched(dds::DataWriter*, const dds::PublicationMatchedStatus& status) override {
    matches.change(status.last_subscription_handle, status.current_count_change, participant);
  }

  Participants& participants;
  dds::DomainParticipant& participant;
  dds::Publisher* publisher = nullptr;
  dds::DataWriter* writer = nullptr;
  typename IdlOf<Sample>::Type encoded;  // a member, to reuse its buffers
  MatchCount matches;
  const char* invalid_reason = "";
};

template <class Sample>
Writer<Sample>::Writer(Participants& participants, const TopicSpec<Sample>& topic, const EndpointOptions& options)
    : impl_{std::make_unique<Impl>(participants, topic, options)} {}
template <class Sample>
Writer<Sample>::~Writer() = default;
template <class Sample>
Writer<Sample>::Writer(Writer&&) noexcept = default;
template <class Sample>
Writer<Sample>& Writer<Sample>::operator=(Writer&&) noexcept = default;

template <class Sample>
SendStatus Writer<Sample>::send(const Sample& sample) noexcept try {
  const Participants::Impl& participants = impl_->participants.impl();
  const char* wrong = invalid_field(sample);
  if constexpr (kHasOrigin<Sample>) {
    if (wrong == nullptr && (sample.origin.session != participants.session_id ||
                             sample.origin.participant != participants.participant_id)) {
      wrong = "origin: expected session and participant of this program";
    }
  }
  if (wrong != nullptr) {
    impl_->invalid_reason = wrong;
    return SendStatus::kInvalid;
  }
  to_idl(sample, impl_->encoded);
  if constexpr (std::is_same_v<Sample, session::RosterEntry>)
    if (participants.security) impl_->encoded.revoked_made_s(participants.security->members().list_made());
  return succeeded(impl_->writer->write(&impl_->encoded)) ? SendStatus::kSent : SendStatus::kBlocked;
} catch (...) {  // out of memory
  return SendStatus::kBlocked;
}

template <class Sample>
int Writer<Sample>::matched() const noexcept {
  return impl_->matches.get();
}

template <class Sample>
const char* Writer<Sample>::invalid_reason() const noexcept {
  return impl_->invalid_reason;
}

template <class Sample>
bool Writer<Sample>::wait_acknowledged(std::chrono::milliseconds limit) noexcept {
  const auto ms = limit.count();
  const LibraryDuration wait{static_cast<std::int32_t>(ms / 1000), static_cast<std::uint32_t>(ms % 1000) * 1000000u};
  return succeeded(impl_->writer->wait_for_acknowledgments(wait));
}

template <class Sample>
struct Reader<Sample>::Impl final : dds::DataReaderListener {
  Impl(Participants& in, const TopicSpec<Sample>& spec, OnSample callback, const EndpointOptions& options)
      : participant{in.impl().participant(spec.traffic)},
        filter{in.impl(), spec, user_id_of(options.partition)},
        on_sample{std::move(callback)} {
    const auto qos = with_partition<dds::SubscriberQos>(in.impl(), options.partition, dds::SUBSCRIBER_QOS_DEFAULT);
    subscriber = participant.create_subscriber(qos);
    if (subscriber == nullptr) throw WireError(std::string{"topic "} + spec.name + ": DDS cannot create a subscriber");
    reader = subscriber->create_datareader(&topic_of(in, spec), in.impl().reader_qos.at(spec.profile), this);
    if (reader == nullptr) {
      participant.delete_subscriber(subscriber);
      throw WireError(std::string{"topic "} + spec.name + ": DDS refuses a reader with profile '" + spec.profile +
                      "_reader'");
    }
  }
  ~Impl() override {
    reader->set_listener(nullptr);
    {
      const std::lock_guard<std::mutex> lock{mutex};  // waits for a running callback
      closed = true;                                  // and stops one that is about to run
    }
    subscriber->delete_datareader(reader);
    participant.delete_subscriber(subscriber);
  }

  void on_data_available(dds::DataReader* from) override {
    const std::lock_guard<std::mutex> lock{mutex};  // DDS has separate threads for unicast and multicast
    if (closed) return;
    dds::SampleInfo info;
    while (succeeded(from->take_next_sample(&encoded, &info)))
      if (info.valid_data) take(info);
  }

  void take(const dds::SampleInfo& info) {
    switch (filter.check(encoded, info, sample)) {
      case Verdict::kAccepted:
        ++received;
        return on_sample(std::move(sample));
      case Verdict::kOwn:
        return;
      case Verdict::kExcess:
        ++excess;
        return;
      case Verdict::kForeign:
        ++foreign;
        return;
      case Verdict::kInvalid:
        ++invalid;
        invalid_reason = filter.invalid_reason();
        return;
      case Verdict::kRefused:
        ++refused;
        return;
    }
  }

  void on_requested_incompatible_qos(dds::DataReader* own, const dds::RequestedIncompatibleQosStatus& status) override {
    report_mismatch("reader", "writer", own->get_topicdescription()->get_name(), status.last_policy_id);
  }

  void on_subscription_matched(dds::DataReader*, const dds::SubscriptionMatchedStatus& status) override {
    matches.change(status.last_publication_handle, status.current_count_change, participant);
  }

  void on_sample_lost(dds::DataReader*, const dds::SampleLostStatus& status) override {
    lost += static_cast<std::uint64_t>(status.total_count_change);
  }

  dds::DomainParticipant& participant;
  SampleFilter<Sample> filter;
  OnSample on_sample;
  dds::Subscriber* subscriber = nullptr;
  dds::DataReader* reader = nullptr;
  std::mutex mutex;  // for `closed`, `filter`, `encoded`, `sample`
  bool closed = false;
  typename IdlOf<Sample>::Type encoded;
  Sample sample{};
  MatchCount matches;
  std::atomic<std::uint64_t> received{0}, invalid{0}, foreign{0}, refused{0}, excess{0}, lost{0};
  std::atomic<const char*> invalid_reason{""};
};

template <class Sample>
Reader<Sample>::Reader(Participants& participants, const TopicSpec<Sample>& topic, OnSample on_sample,
                       const EndpointOptions& options)
    : impl_{std::make_unique<Impl>(participants, topic, std::move(on_sample), options)} {}
template <class Sample>
Reader<Sample>::~Reader() = default;
template <class Sample>
Reader<Sample>::Reader(Reader&&) noexcept = default;
template <class Sample>
Reader<Sample>& Reader<Sample>::operator=(Reader&&) noexcept = default;

template <class Sample>
int Reader<Sample>::matched() const noexcept {
  return impl_->matches.get();
}

template <class Sample>
ReaderCounts Reader<Sample>::counts() const noexcept {
  return {impl_->received, impl_->invalid, impl_->foreign, impl_->refused, impl_->excess, impl_->lost};
}

template <class Sample>
const char* Reader<Sample>::invalid_reason() const noexcept {
  return impl_->invalid_reason;
}

#define TACTUS_WIRE_ENDPOINTS(SAMPLE)     \
  template class Writer<session::SAMPLE>; \
  template class Reader<session::SAMPLE>
TACTUS_WIRE_ENDPOINTS(RosterEntry);
TACTUS_WIRE_ENDPOINTS(CatalogueEntry);
TACTUS_WIRE_ENDPOINTS(Demand);
TACTUS_WIRE_ENDPOINTS(Metrics);
TACTUS_WIRE_ENDPOINTS(ShownRegions);
TACTUS_WIRE_ENDPOINTS(Control);
TACTUS_WIRE_ENDPOINTS(ForceReset);
TACTUS_WIRE_ENDPOINTS(SessionEnd);
TACTUS_WIRE_ENDPOINTS(BulkChunk);
TACTUS_WIRE_ENDPOINTS(EmergencyStop);
TACTUS_WIRE_ENDPOINTS(Intent);
TACTUS_WIRE_ENDPOINTS(ProbeState);
TACTUS_WIRE_ENDPOINTS(DevicePose);
TACTUS_WIRE_ENDPOINTS(DeviceCommand);
TACTUS_WIRE_ENDPOINTS(ObjectPose);
TACTUS_WIRE_ENDPOINTS(ObjectClaim);
TACTUS_WIRE_ENDPOINTS(ObjectGrant);
TACTUS_WIRE_ENDPOINTS(ObjectCopy);
TACTUS_WIRE_ENDPOINTS(ClockSample);
#undef TACTUS_WIRE_ENDPOINTS

}  // namespace tactus::wire
