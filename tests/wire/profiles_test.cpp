#include "wire/profiles.hpp"

#include <gtest/gtest.h>

#include "support.hpp"
#include "wire/profile_elements.hpp"

namespace tactus::wire::test {
namespace {

/// Compares our profiles with those that Fast DDS reads from the same files.
class ProfilesTest : public testing::Test {
 protected:
  ProfilesTest() {
    for (const char* name : kClassNames) {
      tinyxml2::XMLDocument document;
      document.LoadFile((participants_.address().qos / (std::string{name} + ".xml")).c_str());
      EXPECT_TRUE(add_profiles(document)) << name;
    }
  }
  static dds::DomainParticipantFactory& factory() { return *dds::DomainParticipantFactory::get_instance(); }

  Participants participants_{address(unique_session("profiles"), "x")};
};

TEST_F(ProfilesTest, ProfilesOfEveryTopicEqualThoseThatFastDdsReads) {
  topics::for_each([&](const auto& topic) {
    dds::DomainParticipant& participant = participants_.impl().participant(topic.traffic);
    const std::string name = topic.profile;
    dds::DataWriterQos writer;
    dds::DataReaderQos reader;
    dds::Publisher* const publisher = participant.create_publisher(dds::PUBLISHER_QOS_DEFAULT);
    dds::Subscriber* const subscriber = participant.create_subscriber(dds::SUBSCRIBER_QOS_DEFAULT);
    EXPECT_TRUE(succeeded(publisher->get_datawriter_qos_from_profile(name + "_writer", writer)));
    EXPECT_TRUE(succeeded(subscriber->get_datareader_qos_from_profile(name + "_reader", reader)));
    EXPECT_TRUE(participants_.impl().writer_qos.at(name) == writer) << name;
    EXPECT_TRUE(participants_.impl().reader_qos.at(name) == reader) << name;
    participant.delete_publisher(publisher);
    participant.delete_subscriber(subscriber);
  });
}

TEST_F(ProfilesTest, ProfilesOfParticipantsHaveTheDiscoveryTimesThatFastDdsReads) {
  for (std::size_t index = 0; index < kTrafficClasses; ++index) {
    dds::DomainParticipantQos from_library;
    ASSERT_TRUE(succeeded(
        factory().get_participant_qos_from_profile(std::string{kClassNames[index]} + "_participant", from_library)));
    const auto& expected = from_library.wire_protocol().builtin.discovery_config;
    const auto& found = participants_.impl().participants[index]->get_qos().wire_protocol().builtin.discovery_config;
    EXPECT_TRUE(found.leaseDuration == expected.leaseDuration);
    EXPECT_TRUE(found.leaseDuration_announcementperiod == expected.leaseDuration_announcementperiod);
    EXPECT_TRUE(found.discoveryServer_client_syncperiod == expected.discoveryServer_client_syncperiod);
    EXPECT_TRUE(found.initial_announcements.period == expected.initial_announcements.period);
  }
}

}  // namespace
}  // namespace tactus::wire::test
