#include <gmock/gmock.h>
#include <netinet/in.h>
#include <netinet/ip.h>
#include <sched.h>
#include <sys/socket.h>

#include <filesystem>
#include <fstream>
#include <string>

#include "support.hpp"
#include "tests/support/temporary_folder.hpp"
#include "wire/footprint.hpp"
#include "wire/incarnation.hpp"

namespace tactus::wire::test {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

/// The error message of joining; empty when it succeeds.
std::string refusal(const SessionAddress& a) {
  try {
    const Participants participants{a};
  } catch (const WireError& e) {
    return e.what();
  }
  return {};
}

SessionAddress fresh(const std::string& tag) { return address(unique_session(tag), "p"); }

/// A copy of the project's qos directory, for tests to damage.
class SpoiltQos : public testing::Test {
 protected:
  SpoiltQos() {
    fs::copy(default_qos_directory(), directory_, fs::copy_options::recursive);
    address_.qos = directory_;
  }
  ~SpoiltQos() override { fs::remove_all(directory_); }

  void replace(const std::string& file, const std::string& from, const std::string& to) {
    std::ifstream in{directory_ / file};
    std::string text{std::istreambuf_iterator<char>{in}, {}};
    const auto at = text.find(from);
    ASSERT_NE(at, std::string::npos) << file << " has no " << from;
    text.replace(at, from.size(), to);
    std::ofstream{directory_ / file} << text;
  }

  const fs::path directory_ = fs::temp_directory_path() / unique_session("qos");
  SessionAddress address_ = fresh("spoilt");
};

TEST(Address, OutsideTheDomainsIsRefused) {
  for (const int domain : {-1, 0, 98, 232, 1 << 20}) {
    auto a = fresh("domain");
    a.domain = domain;
    EXPECT_THAT(refusal(a), testing::AllOf(HasSubstr(std::to_string(domain)), HasSubstr("expected 1 to 97")));
  }
}

TEST(Address, AtTheLimitsOfTheDomainsIsAccepted) {
  for (const int domain : {kMinDomain, kMaxDomain}) {
    auto a = fresh("domain");
    a.domain = domain;
    EXPECT_EQ(refusal(a), "");
  }
}

TEST(Address, WithANameThatCouldMatchOthersIsRefused) {
  for (const std::string& name : {std::string{}, std::string{"*"}, std::string{"a?"}, std::string{"[ab]"},
                                  std::string{"a/b"}, std::string{"a\nb"}, std::string(64, 'x')}) {
    EXPECT_THAT(refusal(address(name, "p")), HasSubstr("session name")) << name;
    EXPECT_THAT(refusal(address("s", name)), HasSubstr("participant name")) << name;
  }
}

TEST(Address, StampsItsSamples) {
  auto a = fresh("stamp");
  a.incarnation = 42;
  const Participants participants{a};
  const auto first = participants.origin(), second = participants.origin();
  EXPECT_EQ(first.session, ses::id_of(a.session));
  EXPECT_EQ(first.participant, ses::id_of("p"));
  EXPECT_EQ(first.incarnation, 42u);
  EXPECT_GE(second.time_ns, first.time_ns);
}

TEST(Address, WithoutAnIncarnationGetsALargerOneEachTime) {
  const Participants first{fresh("incarnation")};
  const Participants second{fresh("incarnation")};
  EXPECT_GT(second.origin().incarnation, first.origin().incarnation);
}

TEST(Incarnation, GrowsWhenTheClockIsSetBack) {
  const test_support::TemporaryFolder folder;
  const std::filesystem::path file = folder.path() / "state" / "incarnation";
  EXPECT_EQ(next_incarnation(file, 1'700'000'000'000'000'000), 1'700'000'000'000'000'000u);
  EXPECT_EQ(next_incarnation(file, 30'000'000'000), 1'700'000'000'000'000'001u) << "1970";
  EXPECT_EQ(next_incarnation(file, 1'800'000'000'000'000'000), 1'800'000'000'000'000'000u);
}

TEST(Incarnation, IsTheClockTimeWithoutAUsableFile) {
  const test_support::TemporaryFolder folder;
  EXPECT_EQ(next_incarnation({}, 7), 7u);
  EXPECT_EQ(next_incarnation(folder.path(), 7), 7u) << "a folder is no file";
  std::ofstream{folder.path() / "broken"} << "no number, and longer than one";
  EXPECT_EQ(next_incarnation(folder.path() / "broken", 7), 7u);
  EXPECT_EQ(next_incarnation(folder.path() / "broken", 5), 8u);
}

TEST(Endpoints, RefuseAPartitionThatCouldMatchOthers) {
  Participants participants{fresh("partition")};
  EXPECT_THROW(Writer<ses::Intent>(participants, topics::kIntent, {user_partition("*")}), WireError);
  EXPECT_THROW(Reader<ses::Intent>(participants, topics::kIntent, [](ses::Intent&&) {}, {user_partition("a?")}),
               WireError);
}

template <class Sample>
bool make_both(Participants& participants, const TopicSpec<Sample>& topic) {
  EXPECT_NO_THROW(Writer<Sample>(participants, topic)) << topic.name;
  EXPECT_NO_THROW(Reader<Sample>(participants, topic, [](Sample&&) {})) << topic.name;
  return !testing::Test::HasFailure();
}

TEST(Profiles, OfEveryTopicMakeAWriterAndAReader) {
  Participants participants{fresh("profiles")};
  int made = 0;
  topics::for_each([&](const auto& topic) { made += make_both(participants, topic) ? 1 : 0; });
  EXPECT_EQ(made, 20);
}

TEST(Footprint, CoversTheSocketsOfAProgram) {
  const Footprint max = read_footprint(default_qos_directory());
  EXPECT_EQ(max.message, 1472) << "one Ethernet frame";
  EXPECT_GE(max.receive_buffer, 1 << 20);
  EXPECT_GE(max.send_buffer, 1 << 20);

  const Participants participants{fresh("footprint")};
  std::ifstream file{"/proc/net/udp"};
  const std::string sockets{std::istreambuf_iterator<char>{file}, {}};
  for (int traffic = 0; traffic < kTrafficClasses; ++traffic) {
    char port[8];
    std::snprintf(port, sizeof port, ":%04X ", static_cast<unsigned>(discovery_port(test_domain() + traffic)));
    EXPECT_THAT(sockets, HasSubstr(port));
  }
}

TEST_F(SpoiltQos, WithoutATransportHasNoFootprint) {
  replace("bulk.xml", "<receiveBufferSize>", "<receiveBufferSighs>");
  EXPECT_THROW((void)read_footprint(directory_), WireError);
}

TEST(Environment, DoesNotMakeAProgramAClientOfADiscoveryServer) {
  setenv("ROS_DISCOVERY_SERVER", "127.0.0.1:9", 1);
  const std::string session = unique_session("environment");
  Participants one{address(session, "one")}, two{address(session, "two")};
  const Writer<ses::Metrics> writer{one, topics::kMetrics};
  const Reader<ses::Metrics> reader{two, topics::kMetrics, [](ses::Metrics&&) {}};
  EXPECT_TRUE(eventually([&] { return writer.matched() == 1 && reader.matched() == 1; }));
}

TEST(ProbeSockets, HaveTheMarksOfFlowYaml) {
  const auto marked = [] {
    int n = 0;
    for (const auto& entry : fs::directory_iterator("/proc/self/fd")) {
      const int fd = std::stoi(entry.path().filename().string());
      int tos = 0, priority = 0;
      socklen_t size = sizeof tos;
      if (getsockopt(fd, IPPROTO_IP, IP_TOS, &tos, &size) != 0) continue;
      size = sizeof priority;
      getsockopt(fd, SOL_SOCKET, SO_PRIORITY, &priority, &size);
      n += tos == 184 && priority == 6 ? 1 : 0;
    }
    return n;
  };
  const int before = marked();
  const Participants participants{fresh("marks")};
  EXPECT_GT(marked(), before);
}

TEST(ProbeThreads, ReportWhetherTheyGotTheirPriority) {
  auto a = fresh("priority");
  EXPECT_FALSE(Participants{a}.probe_is_realtime());
  sched_param fifo{};
  fifo.sched_priority = 1;
  sched_param plain{};
  const bool allowed = sched_setscheduler(0, SCHED_FIFO, &fifo) == 0;
  if (allowed) {
    ASSERT_EQ(sched_setscheduler(0, SCHED_OTHER, &plain), 0);
  }
  a.probe_priority = 1;
  EXPECT_EQ(Participants{a}.probe_is_realtime(), allowed);
  EXPECT_EQ(sched_getscheduler(0), SCHED_OTHER);
}

TEST_F(SpoiltQos, UnspoiltIsAccepted) { EXPECT_EQ(refusal(address_), ""); }

TEST_F(SpoiltQos, MissingDirectoryIsNamed) {
  address_.qos = directory_ / "nowhere";
  EXPECT_THAT(refusal(address_), testing::AllOf(HasSubstr("nowhere"), HasSubstr("does not exist")));
}

TEST_F(SpoiltQos, MissingFileIsNamed) {
  for (const char* file : {"session.xml", "probe.xml", "bulk.xml", "flow.yaml"}) {
    fs::rename(directory_ / file, directory_ / "away");
    EXPECT_THAT(refusal(address_), HasSubstr((directory_ / file).string()));
    fs::rename(directory_ / "away", directory_ / file);
  }
}

TEST_F(SpoiltQos, MissingProfileIsNamedWithFileAndTopic) {
  replace("probe.xml", "\"probe_state_reader\"", "\"probe_state_rider\"");
  EXPECT_THAT(refusal(address_),
              testing::AllOf(HasSubstr("probe.xml"), HasSubstr("probe_state_reader"), HasSubstr("tactus_probe_state")));
}

TEST_F(SpoiltQos, MissingParticipantProfileIsNamed) {
  replace("bulk.xml", "\"bulk_participant\"", "\"bulky\"");
  EXPECT_THAT(refusal(address_), testing::AllOf(HasSubstr("bulk.xml"), HasSubstr("bulk_participant")));
}

TEST_F(SpoiltQos, BrokenFileIsNamedWithTheReason) {
  replace("session.xml", "<kind>TRANSIENT_LOCAL</kind>", "<kind>FOREVER</kind>");
  EXPECT_THAT(refusal(address_),
              testing::AllOf(HasSubstr("session.xml"), HasSubstr("'roster_writer'"), HasSubstr("kind")));
}

TEST_F(SpoiltQos, CutFileIsNamed) {
  fs::resize_file(directory_ / "bulk.xml", fs::file_size(directory_ / "bulk.xml") / 2);
  EXPECT_THAT(refusal(address_), testing::AllOf(HasSubstr("bulk.xml"), HasSubstr("Line number")));
}

TEST_F(SpoiltQos, UnknownElementIsRefused) {
  replace("session.xml", "<ownership>", "<hardship/><ownership>");
  EXPECT_THAT(refusal(address_),
              testing::AllOf(HasSubstr("session.xml"), HasSubstr("'roster_writer'"), HasSubstr("hardship")));
}

TEST_F(SpoiltQos, FlowKeysAndValuesAreChecked) {
  replace("flow.yaml", "tos: 184", "tos: 256");
  EXPECT_THAT(refusal(address_), testing::AllOf(HasSubstr("sockets.probe.tos"), HasSubstr("256"), HasSubstr("255")));
  replace("flow.yaml", "tos: 256", "tosh: 1");
  EXPECT_THAT(refusal(address_), testing::AllOf(HasSubstr("flow.yaml"), HasSubstr("tosh")));
  replace("flow.yaml", ", priority: 6", "");
  replace("flow.yaml", "tosh: 1", "tos: 184");
  EXPECT_THAT(refusal(address_), testing::AllOf(HasSubstr("sockets.probe"), HasSubstr("priority")));
  replace("flow.yaml", "sockets:", "sockets: [");
  EXPECT_THAT(refusal(address_), HasSubstr("flow.yaml"));
}

TEST_F(SpoiltQos, AChangeOfAProfileTakesEffectInTheSameProcess) {
  EXPECT_EQ(refusal(address_), "");
  fs::remove(directory_ / "bulk.xml");
  EXPECT_NE(refusal(address_), "");
}

}  // namespace
}  // namespace tactus::wire::test
