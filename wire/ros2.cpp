#include "wire/ros2.hpp"

#include <mutex>
#include <utility>

#include "wire/dds.hpp"
#include "wire/discovery.hpp"
#include "wire/profile_elements.hpp"

namespace tactus::wire {
namespace {

constexpr std::size_t kMaxDiscovered = 1024;

std::string dds_topic(const std::string& topic) { return "rt" + topic; }

/// Creates the topic of one endpoint.
dds::Topic& create_topic(dds::DomainParticipant& participant, const std::string& topic, const RosType& type) {
  if (participant.find_type(type.name).empty())
    dds::TypeSupport{new EncodedType{type.name}}.register_type(&participant);
  dds::Topic* const made = participant.create_topic(dds_topic(topic), type.name, dds::TOPIC_QOS_DEFAULT);
  if (made == nullptr) throw WireError("topic " + topic + ": DDS refuses it with type " + type.name);
  return *made;
}

/// USER_DATA of an endpoint.
std::vector<rtps::octet> user_data(const RosType& type) {
  const std::string text = std::string{"typehash="} + type.hash + ";";
  return {text.begin(), text.end()};
}

}  // namespace

struct RosDomain::Impl {
  ~Impl() {
    if (participant == nullptr) return;
    participant->set_listener(nullptr);
    if (publisher != nullptr) participant->delete_publisher(publisher);
    if (subscriber != nullptr) participant->delete_subscriber(subscriber);
    dds::DomainParticipantFactory::get_instance()->delete_participant(participant);
  }

  std::filesystem::path file;
  std::mutex mutex;
  std::vector<Discovered> discovered;  // guarded by `mutex`
  WriterDiscoveryListener listener{[this](const char* topic, const char* type) {
    const std::lock_guard lock{mutex};
    if (discovered.size() < kMaxDiscovered) discovered.push_back({topic, type});
  }};
  dds::DomainParticipant* participant = nullptr;
  dds::Publisher* publisher = nullptr;
  dds::Subscriber* subscriber = nullptr;
};

RosDomain::RosDomain(int domain, const std::filesystem::path& qos) : impl_{std::make_unique<Impl>()} {
  impl_->file = qos / "ros2.xml";
  const std::string file = impl_->file.string();
  std::error_code error;
  if (!std::filesystem::is_regular_file(impl_->file, error))
    throw WireError(file + ": no such file; expected the profiles of ROS topics");
  LogCapture log;
  ignore_environment();
  auto* const factory = dds::DomainParticipantFactory::get_instance();
  dds::DomainParticipantQos participant_qos;
  tinyxml2::XMLDocument document;
  if (document.LoadFile(file.c_str()) != tinyxml2::XML_SUCCESS) throw WireError(file + ": " + document.ErrorStr());
  if (!add_profiles(document) ||
      !succeeded(factory->get_participant_qos_from_profile("ros2_participant", participant_qos)))
    throw WireError(file + ": expected valid profiles, one of them participant 'ros2_participant': " + log.take());
  disable_type_propagation(participant_qos);
  impl_->participant = factory->create_participant(static_cast<dds::DomainId_t>(domain), participant_qos,
                                                   &impl_->listener, dds::StatusMask::none());
  if (impl_->participant != nullptr) {
    impl_->publisher = impl_->participant->create_publisher(dds::PUBLISHER_QOS_DEFAULT);
    impl_->subscriber = impl_->participant->create_subscriber(dds::SUBSCRIBER_QOS_DEFAULT);
  }
  if (impl_->publisher == nullptr || impl_->subscriber == nullptr)
    throw WireError("cannot join ROS domain " + std::to_string(domain) + " with profile 'ros2_participant' of " + file +
                    ": " + log.take());
}

RosDomain::~RosDomain() = default;

std::vector<RosDomain::Discovered> RosDomain::take_discovered() {
  const std::lock_guard lock{impl_->mutex};
  return std::exchange(impl_->discovered, {});
}

struct RosWriter::Impl {
  Impl(RosDomain::Impl& in, const std::string& name, const RosType& type, const std::string& profile)
      : domain{in}, topic{create_topic(*in.participant, name, type)} {
    dds::DataWriterQos qos;
    if (succeeded(domain.publisher->get_datawriter_qos_from_profile(profile, qos))) {
      qos.user_data().data_vec(user_data(type));
      writer = domain.publisher->create_datawriter(&topic, qos);
    }
    if (writer != nullptr) return;
    domain.participant->delete_topic(&topic);
    throw WireError("topic " + name + ": DDS refuses a writer with profile '" + profile + "' of " +
                    domain.file.string());
  }
  ~Impl() {
    std::size_t dropped = 0;
    writer->clear_history(&dropped);  // first, as in endpoints.cpp
    domain.publisher->delete_datawriter(writer);
    domain.participant->delete_topic(&topic);
  }

  RosDomain::Impl& domain;
  dds::Topic& topic;
  dds::DataWriter* writer = nullptr;
  std::vector<std::uint8_t> sample;  // a member, to reuse its memory
};

RosWriter::RosWriter(RosDomain& domain, const std::string& topic, const RosType& type, const std::string& profile)
    : impl_{std::make_unique<Impl>(domain.impl(), topic, type, profile)} {}
RosWriter::~RosWriter() = default;
RosWriter::RosWriter(RosWriter&&) noexcept = default;
RosWriter& RosWriter::operator=(RosWriter&&) noexcept = default;

bool RosWriter::send(std::span<const std::uint8_t> message) {
  impl_->sample.assign(message.begin(), message.end());
  return succeeded(impl_->writer->write(&impl_->sample));
}

int RosWriter::matches() const {
  dds::PublicationMatchedStatus status;
  return succeeded(impl_->writer->get_publication_matched_status(status)) ? status.total_count : 0;
}

int RosWriter::matched() const {
  dds::PublicationMatchedStatus status;
  return succeeded(impl_->writer->get_publication_matched_status(status)) ? status.current_count : 0;
}

struct RosReader::Impl {
  Impl(RosDomain::Impl& in, const std::string& name, const RosType& type, const std::string& profile)
      : domain{in}, topic{create_topic(*in.participant, name, type)} {
    dds::DataReaderQos qos;
    if (succeeded(domain.subscriber->get_datareader_qos_from_profile(profile, qos))) {
      qos.user_data().data_vec(user_data(type));
      reader = domain.subscriber->create_datareader(&topic, qos);
    }
    if (reader != nullptr) return;
    domain.participant->delete_topic(&topic);
    throw WireError("topic " + name + ": DDS refuses a reader with profile '" + profile + "' of " +
                    domain.file.string());
  }
  ~Impl() {
    domain.subscriber->delete_datareader(reader);
    domain.participant->delete_topic(&topic);
  }

  RosDomain::Impl& domain;
  dds::Topic& topic;
  dds::DataReader* reader = nullptr;
};

RosReader::RosReader(RosDomain& domain, const std::string& topic, const RosType& type, const std::string& profile)
    : impl_{std::make_unique<Impl>(domain.impl(), topic, type, profile)} {}
RosReader::~RosReader() = default;
RosReader::RosReader(RosReader&&) noexcept = default;
RosReader& RosReader::operator=(RosReader&&) noexcept = default;

bool RosReader::take(std::vector<std::uint8_t>& message) {
  bool any = false;
  std::vector<std::uint8_t> sample;
  dds::SampleInfo info;
  while (succeeded(impl_->reader->take_next_sample(&sample, &info))) {
    if (!info.valid_data) continue;
    message = std::move(sample);
    any = true;
  }
  return any;
}

int RosReader::matched() const {
  dds::SubscriptionMatchedStatus status;
  return succeeded(impl_->reader->get_subscription_matched_status(status)) ? status.current_count : 0;
}

}  // namespace tactus::wire
