#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <net/if.h>
#include <netinet/in.h>
#include <netinet/ip.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <set>
#include <string>
#include <thread>

#include "realtime/process.hpp"
#include "support.hpp"
#include "tests/support/temporary_folder.hpp"
#include "wire/footprint.hpp"
#include "wire/incarnation.hpp"
#include "wire/transport/local_addresses.hpp"

namespace tactus::wire::test {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

/// The error message of a participant that joins at `address`; empty if it can join.
std::string join_error(const SessionAddress& address) {
  try {
    const Participants participants{address};
  } catch (const WireError& e) {
    return e.what();
  }
  return {};
}

SessionAddress unique_address(const std::string& tag) { return address(unique_session(tag), "p"); }

/// A copy of the directory qos/ that a test damages.
class DamagedQos : public testing::Test {
 protected:
  DamagedQos() {
    fs::copy(default_qos_directory(), directory_, fs::copy_options::recursive);
    address_.qos = directory_;
  }
  ~DamagedQos() override { fs::remove_all(directory_); }

  void replace(const std::string& file, const std::string& from, const std::string& to) {
    std::ifstream in{directory_ / file};
    std::string text{std::istreambuf_iterator<char>{in}, {}};
    const auto at = text.find(from);
    ASSERT_NE(at, std::string::npos) << file << " has no " << from;
    text.replace(at, from.size(), to);
    std::ofstream{directory_ / file} << text;
  }

  const fs::path directory_ = fs::temp_directory_path() / unique_session("qos");
  SessionAddress address_ = unique_address("damaged");
};

TEST(Address, WithADomainOutOfRangeIsRefused) {
  for (const int domain : {-1, 0, 99, 232, 1 << 20}) {
    SessionAddress tested = unique_address("domain");
    tested.domain = domain;
    EXPECT_THAT(join_error(tested), testing::AllOf(HasSubstr(std::to_string(domain)), HasSubstr("expected 1 to 98")));
  }
}

TEST(Address, HasTheLargestDomainWhosePortsAreBelowTheEphemeralPorts) {
  constexpr int kFirstEphemeralPort = 32768;
  const auto end_of_ports = [](int domain) { return discovery_port(domain + kTrafficClasses); };
  EXPECT_LE(end_of_ports(kMaxDomain), kFirstEphemeralPort);
  EXPECT_GT(end_of_ports(kMaxDomain + 1), kFirstEphemeralPort);
}

TEST(Address, WithTheFirstOrLastDomainIsAccepted) {
  for (const int domain : {kMinDomain, kMaxDomain}) {
    SessionAddress tested = unique_address("domain");
    tested.domain = domain;
    EXPECT_EQ(join_error(tested), "");
  }
}

TEST(Address, WithANameThatCouldMatchOthersIsRefused) {
  for (const std::string& name :
       {std::string{}, std::string{"*"}, std::string{"a?"}, std::string{"[ab]"}, std::string{"a/b"},
        std::string{"a\nb"}, std::string{"a\xc2\x9b"}, std::string(64, 'x')}) {
    EXPECT_THAT(join_error(address(name, "p")), HasSubstr("session name")) << name;
    EXPECT_THAT(join_error(address("s", name)), HasSubstr("participant name")) << name;
  }
}

TEST(Address, IsInTheOriginOfSamples) {
  SessionAddress tested = unique_address("stamp");
  tested.incarnation = 42;
  const Participants participants{tested};
  const auto first = participants.origin(), second = participants.origin();
  EXPECT_EQ(first.session, ses::id_of(tested.session));
  EXPECT_EQ(first.participant, ses::id_of("p"));
  EXPECT_EQ(first.incarnation, 42u);
  EXPECT_GE(second.time_ns, first.time_ns);
}

TEST(Address, WithoutAnIncarnationReceivesALargerOneEachTime) {
  const Participants first{unique_address("incarnation")};
  const Participants second{unique_address("incarnation")};
  EXPECT_GT(second.origin().incarnation, first.origin().incarnation);
}

TEST(Incarnation, GrowsWhenTheClockIsSetBack) {
  const test_support::TemporaryFolder folder;
  const std::filesystem::path file = folder.path() / "state" / "incarnation";
  EXPECT_EQ(next_incarnation(file, 1'700'000'000'000'000'000), 1'700'000'000'000'000'000u);
  EXPECT_EQ(next_incarnation(file, 30'000'000'000), 1'700'000'000'000'000'001u) << "with a clock that is back in 1970";
  EXPECT_EQ(next_incarnation(file, 1'800'000'000'000'000'000), 1'800'000'000'000'000'000u);
}

TEST(Incarnation, IsTheClockTimeWithoutAUsableFile) {
  const test_support::TemporaryFolder folder;
  EXPECT_EQ(next_incarnation({}, 7), 7u);
  EXPECT_EQ(next_incarnation(folder.path(), 7), 7u) << "with a folder in place of the file";
  std::ofstream{folder.path() / "broken"} << "not a number, and longer than a number";
  EXPECT_EQ(next_incarnation(folder.path() / "broken", 7), 7u);
  EXPECT_EQ(next_incarnation(folder.path() / "broken", 5), 8u);
}

TEST(Endpoints, RefuseAPartitionThatCouldMatchOthers) {
  Participants participants{unique_address("partition")};
  EXPECT_THROW(Writer<ses::Intent>(participants, topics::kIntent, {user_partition("*")}), WireError);
  EXPECT_THROW(Writer<ses::Intent>(participants, topics::kIntent, {user_partition("a\nb")}), WireError);
  EXPECT_THROW(Reader<ses::Intent>(participants, topics::kIntent, [](ses::Intent&&) {}, {user_partition("a?")}),
               WireError);
}

template <class Sample>
bool can_create_endpoints(Participants& participants, const TopicSpec<Sample>& topic) {
  EXPECT_NO_THROW(Writer<Sample>(participants, topic)) << topic.name;
  EXPECT_NO_THROW(Reader<Sample>(participants, topic, [](Sample&&) {})) << topic.name;
  return !testing::Test::HasFailure();
}

TEST(Profiles, OfEveryTopicMakeAWriterAndAReader) {
  Participants participants{unique_address("profiles")};
  int made = 0;
  topics::for_each([&](const auto& topic) { made += can_create_endpoints(participants, topic) ? 1 : 0; });
  EXPECT_EQ(made, 21);
}

/// UDP ports of the sockets of this process, without ephemeral ones.
std::set<int> open_ports() {
  std::set<int> ports;
  for (const auto& entry : fs::directory_iterator("/proc/self/fd")) {
    sockaddr_in at{};
    socklen_t size = sizeof at;
    const int fd = std::stoi(entry.path().filename().string());
    if (getsockname(fd, reinterpret_cast<sockaddr*>(&at), &size) != 0 || at.sin_family != AF_INET) continue;
    if (const int port = ntohs(at.sin_port); port != 0 && port < discovery_port(kMaxDomain + kTrafficClasses))
      ports.insert(port);
  }
  return ports;
}

TEST(Footprint, CoversTheSocketsOfAProgram) {
  const Footprint footprint = read_footprint(default_qos_directory());
  EXPECT_EQ(footprint.message, 1472) << "one Ethernet frame";
  EXPECT_GE(footprint.receive_buffer, 1 << 20);
  EXPECT_GE(footprint.send_buffer, 1 << 20);

  const Participants participants{unique_address("footprint")};
  const std::set<int> ports = open_ports();
  for (int traffic = 0; traffic < kTrafficClasses; ++traffic)
    EXPECT_THAT(ports, testing::Contains(discovery_port(test_domain() + traffic)));
}

TEST_F(DamagedQos, WithABrokenTransportHasNoFootprint) {
  replace("bulk.xml", "<receiveBufferSize>", "<unknownElement>");
  replace("bulk.xml", "</receiveBufferSize>", "</unknownElement>");
  try {
    (void)read_footprint(directory_);
    FAIL() << "expected an error";
  } catch (const WireError& error) {
    EXPECT_THAT(error.what(),
                HasSubstr("bulk.xml: no number of bytes in <receiveBufferSize> of its transport_descriptor"));
  }
}

TEST_F(DamagedQos, ThatIsNotXmlHasNoFootprint) {
  replace("bulk.xml", "</receiveBufferSize>", "");
  try {
    (void)read_footprint(directory_);
    FAIL() << "expected an error";
  } catch (const WireError& error) {
    EXPECT_THAT(error.what(), HasSubstr("bulk.xml: is not readable XML: "));
    EXPECT_THAT(error.what(), HasSubstr("receiveBufferSize"));
  }
}

TEST(Environment, DoesNotMakeAProgramAClientOfADiscoveryServer) {
  setenv("ROS_DISCOVERY_SERVER", "127.0.0.1:9", 1);
  const std::string session = unique_session("environment");
  Participants one{address(session, "one")}, two{address(session, "two")};
  const Writer<ses::Metrics> writer{one, topics::kMetrics};
  const Reader<ses::Metrics> reader{two, topics::kMetrics, [](ses::Metrics&&) {}};
  EXPECT_TRUE(eventually([&] { return writer.matched() == 1 && reader.matched() == 1; }));
}

/// Returns 0 if two programs find each other although a file of variables names a discovery server.
int status_with_a_file_of_variables() {
  const test_support::TemporaryFolder folder;
  const fs::path file = folder.path() / "environment.json";
  std::ofstream{file} << R"({"ROS_DISCOVERY_SERVER": "127.0.0.1:9"})";
  setenv("FASTDDS_ENVIRONMENT_FILE", file.c_str(), 1);
  const std::string session = unique_session("environment");
  Participants one{address(session, "one")}, two{address(session, "two")};
  const Writer<ses::Metrics> writer{one, topics::kMetrics};
  const Reader<ses::Metrics> reader{two, topics::kMetrics, [](ses::Metrics&&) {}};
  return eventually([&] { return writer.matched() == 1 && reader.matched() == 1; }) ? 0 : 1;
}

// In a process of its own, because Fast DDS reads the name of the file once.
TEST(EnvironmentDeathTest, OfAFileDoesNotMakeAProgramAClientOfADiscoveryServer) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_EXIT(std::_Exit(status_with_a_file_of_variables()), testing::ExitedWithCode(0), "");
}

TEST(Environment, LosesTheVariablesOfTheLibraryWhenAProgramJoins) {
  for (const char* name : kIgnoredVariables) setenv(name, "", 1);
  const Participants participants{unique_address("variables")};
  for (const char* name : kIgnoredVariables) EXPECT_EQ(getenv(name), nullptr) << name;
}

TEST(ProbeSockets, HaveTheTosAndPriorityOfFlowYaml) {
  const auto count_marked = [] {
    int marked = 0;
    for (const auto& entry : fs::directory_iterator("/proc/self/fd")) {
      const int fd = std::stoi(entry.path().filename().string());
      int tos = 0, priority = 0;
      socklen_t size = sizeof tos;
      if (getsockopt(fd, IPPROTO_IP, IP_TOS, &tos, &size) != 0) continue;
      size = sizeof priority;
      getsockopt(fd, SOL_SOCKET, SO_PRIORITY, &priority, &size);
      marked += tos == 184 && priority == 6 ? 1 : 0;
    }
    return marked;
  };
  const int before = count_marked();
  const Participants participants{unique_address("marks")};
  EXPECT_GT(count_marked(), before);
}

TEST(Ports, OfAProgramThatJoinsAgainAndAgainStayThoseOfItsDomains) {
  const std::set<int> before = open_ports();
  for (int i = 0; i < 42; ++i) {  // 126 participants, each with two ports
    const Participants participants{unique_address("again")};
    std::set<int> used;
    for (const int port : open_ports())
      if (before.count(port) == 0) used.insert((port - discovery_port(test_domain())) % 250);
    ASSERT_THAT(used, testing::Each(testing::Lt(100))) << "after " << i << " joins";
  }
}

/// A socket at a port that it does not share with other programs.
class PrivatePort {
 public:
  explicit PrivatePort(int port) {
    sockaddr_in at{};
    at.sin_family = AF_INET;
    at.sin_port = htons(static_cast<std::uint16_t>(port));
    EXPECT_EQ(bind(socket_, reinterpret_cast<const sockaddr*>(&at), sizeof at), 0);
  }
  ~PrivatePort() { close(socket_); }
  PrivatePort(const PrivatePort&) = delete;
  PrivatePort& operator=(const PrivatePort&) = delete;

 private:
  const int socket_ = socket(AF_INET, SOCK_DGRAM, 0);
};

TEST(Ports, OfDiscoveryThatAnotherProgramDoesNotShareAreNamed) {
  SessionAddress tested = unique_address("taken");
  tested.domain = 97;  // sessions of other tests end at domain 96
  const PrivatePort taken{discovery_port(tested.domain + 2)};
  EXPECT_THAT(join_error(tested),
              testing::AllOf(HasSubstr("domain 99"), HasSubstr("UDP 32150"), HasSubstr("--domain")));
  tested.discovery.peers = {"127.0.0.1"};
  EXPECT_EQ(join_error(tested), "");
}

/// Replaces the IPv4 address of the loopback interface in the network namespace of the calling thread.
void set_loopback_address(const char* address) {
  ifreq request{};
  std::strcpy(request.ifr_name, "lo");
  sockaddr_in at{};
  at.sin_family = AF_INET;
  ASSERT_EQ(inet_pton(AF_INET, address, &at.sin_addr), 1);
  std::memcpy(&request.ifr_addr, &at, sizeof at);
  const int fd = socket(AF_INET, SOCK_DGRAM, 0);
  EXPECT_EQ(ioctl(fd, SIOCSIFADDR, &request), 0);
  close(fd);
}

TEST(LocalAddresses, ThatAMachineHasLostAreForgotten) {
  const auto locator = [](const char* address) {
    rtps::Locator_t made;
    EXPECT_EQ(inet_pton(AF_INET, address, made.address + 12), 1);
    return made;
  };
  bool has_namespace = false;
  std::thread{[&] {
    has_namespace = unshare(CLONE_NEWNET) == 0;  // of this thread only
    if (!has_namespace) return;
    set_loopback_address("10.99.0.1");
    LocalAddresses local;
    const std::int64_t now_ns = realtime::monotonic_ns();
    EXPECT_TRUE(local.contains(locator("10.99.0.1"), now_ns));
    set_loopback_address("10.99.0.2");
    EXPECT_FALSE(local.contains(locator("10.99.0.1"), now_ns + 6'000'000'000));
    EXPECT_TRUE(local.contains(locator("10.99.0.2"), now_ns + 6'000'000'000));
    EXPECT_TRUE(local.contains(locator("127.0.0.1"), now_ns));
  }}.join();
  if (!has_namespace) GTEST_SKIP() << "no network namespace, which needs root";
}

TEST(ProbeThreads, ReportWhetherTheirPriorityIsGranted) {
  SessionAddress tested = unique_address("priority");
  EXPECT_FALSE(Participants{tested}.probe_is_realtime());
  sched_param fifo{};
  fifo.sched_priority = 1;
  sched_param normal{};
  const bool allowed = sched_setscheduler(0, SCHED_FIFO, &fifo) == 0;
  if (allowed) {
    ASSERT_EQ(sched_setscheduler(0, SCHED_OTHER, &normal), 0);
  }
  tested.probe_priority = 1;
  EXPECT_EQ(Participants{tested}.probe_is_realtime(), allowed);
  EXPECT_EQ(sched_getscheduler(0), SCHED_OTHER);
}

TEST_F(DamagedQos, WithoutDamageIsAccepted) { EXPECT_EQ(join_error(address_), ""); }

TEST_F(DamagedQos, AMissingDirectoryIsNamed) {
  address_.qos = directory_ / "nowhere";
  EXPECT_THAT(join_error(address_), testing::AllOf(HasSubstr("nowhere"), HasSubstr("does not exist")));
}

TEST_F(DamagedQos, AMissingFileIsNamed) {
  for (const char* file : {"session.xml", "probe.xml", "bulk.xml", "flow.yaml"}) {
    fs::rename(directory_ / file, directory_ / "moved");
    EXPECT_THAT(join_error(address_), HasSubstr((directory_ / file).string()));
    fs::rename(directory_ / "moved", directory_ / file);
  }
}

TEST_F(DamagedQos, AMissingProfileIsNamedWithFileAndTopic) {
  replace("probe.xml", "\"probe_state_reader\"", "\"another_reader\"");
  EXPECT_THAT(join_error(address_),
              testing::AllOf(HasSubstr("probe.xml"), HasSubstr("probe_state_reader"), HasSubstr("tactus_probe_state")));
}

TEST_F(DamagedQos, AMissingParticipantProfileIsNamed) {
  replace("bulk.xml", "\"bulk_participant\"", "\"another_participant\"");
  EXPECT_THAT(join_error(address_), testing::AllOf(HasSubstr("bulk.xml"), HasSubstr("bulk_participant")));
}

TEST_F(DamagedQos, ABrokenFileIsNamedWithTheReason) {
  replace("session.xml", "<kind>TRANSIENT_LOCAL</kind>", "<kind>FOREVER</kind>");
  EXPECT_THAT(join_error(address_),
              testing::AllOf(HasSubstr("session.xml"), HasSubstr("'roster_writer'"), HasSubstr("kind")));
}

TEST_F(DamagedQos, ATruncatedFileIsNamed) {
  fs::resize_file(directory_ / "bulk.xml", fs::file_size(directory_ / "bulk.xml") / 2);
  EXPECT_THAT(join_error(address_), testing::AllOf(HasSubstr("bulk.xml"), HasSubstr("Line number")));
}

TEST_F(DamagedQos, AnUnknownElementIsRefused) {
  replace("session.xml", "<ownership>", "<unknownElement/><ownership>");
  EXPECT_THAT(join_error(address_),
              testing::AllOf(HasSubstr("session.xml"), HasSubstr("'roster_writer'"), HasSubstr("unknownElement")));
}

TEST_F(DamagedQos, FlowKeysAndValuesAreChecked) {
  replace("flow.yaml", "tos: 184", "tos: 256");
  EXPECT_THAT(join_error(address_), testing::AllOf(HasSubstr("sockets.probe.tos"), HasSubstr("256"), HasSubstr("255")));
  replace("flow.yaml", "tos: 256", "colour: 1");
  EXPECT_THAT(join_error(address_), testing::AllOf(HasSubstr("flow.yaml"), HasSubstr("colour")));
  replace("flow.yaml", ", priority: 6", "");
  replace("flow.yaml", "colour: 1", "tos: 184");
  EXPECT_THAT(join_error(address_), testing::AllOf(HasSubstr("sockets.probe"), HasSubstr("priority")));
  replace("flow.yaml", "sockets:", "sockets: [");
  EXPECT_THAT(join_error(address_), HasSubstr("flow.yaml"));
}

TEST_F(DamagedQos, AReaderThatRequestsMoreThanAWriterOffersIsReported) {
  std::ifstream in{directory_ / "probe.xml"};
  std::string text{std::istreambuf_iterator<char>{in}, {}};
  const std::string offered = "BEST_EFFORT";
  text.replace(text.find(offered, text.find("\"probe_state_reader\"")), offered.size(), "RELIABLE");
  std::ofstream{directory_ / "probe.xml"} << text;
  std::mutex mutex;
  std::string reported;
  set_log_sink([&](ses::Severity, const std::string& message) {
    const std::lock_guard lock{mutex};
    reported += message;
  });
  Participants reading{address_}, writing{address(address_.session, "q")};
  const Reader<ses::ProbeState> reader{reading, topics::kProbeState, [](ses::ProbeState&&) {}};
  const Writer<ses::ProbeState> writer{writing, topics::kProbeState};
  EXPECT_TRUE(eventually([&] {
    const std::lock_guard lock{mutex};
    return reported.find("the reader of topic tactus_probe_state") != std::string::npos &&
           reported.find("the writer of topic tactus_probe_state") != std::string::npos &&
           reported.find("reliability") != std::string::npos;
  })) << reported;
  set_log_sink(nullptr);
}

/// A program that sends control samples.
struct ControlProgram {
  ControlProgram(const std::string& session, const std::string& name) : participants{address(session, name)} {}
  Participants participants;
  Inbox<ses::Control> inbox;
  Writer<ses::Control> writer{participants, topics::kControl};
  Reader<ses::Control> reader{participants, topics::kControl, inbox.callback()};
};

TEST_F(DamagedQos, AProgramBeyondTheLimitOfParticipantsIsNotFound) {
  constexpr int kOthers = 3;  // with the program itself, the limit of 4
  for (const char* file : {"session.xml", "probe.xml", "bulk.xml"})
    replace(file, "<total_participants><initial>16</initial><maximum>256</maximum>",
            "<total_participants><initial>4</initial><maximum>4</maximum>");
  Participants limited{address_};
  Inbox<ses::Control> inbox;
  const Reader<ses::Control> reader{limited, topics::kControl, inbox.callback()};
  std::vector<std::unique_ptr<ControlProgram>> others;
  for (int i = 0; i < kOthers; ++i) {
    others.push_back(std::make_unique<ControlProgram>(address_.session, "p" + std::to_string(i)));
    ASSERT_TRUE(eventually([&] { return reader.matched() == i + 1; })) << i;
  }

  ControlProgram further{address_.session, "further"};
  auto sample = full_sample<ses::Control>(further.participants);
  ASSERT_EQ(further.writer.send(sample), SendStatus::kSent);
  for (const auto& other : others)
    EXPECT_TRUE(other->inbox.next()) << "the others find it: " << other->participants.address().participant;
  EXPECT_FALSE(inbox.next(1s)) << "two announcements";
  EXPECT_EQ(reader.matched(), kOthers);
  sample = full_sample<ses::Control>(others.front()->participants);
  ASSERT_EQ(others.front()->writer.send(sample), SendStatus::kSent);
  const auto received = inbox.next();
  ASSERT_TRUE(received) << "the limit affects no other program";
  EXPECT_EQ(received->origin.participant, ses::id_of("p0"));

  // The library does not read the announcements of `further` again, because they have the number of the first one.
  others.pop_back();
  ASSERT_TRUE(eventually([&] { return reader.matched() == kOthers - 1; }));
  ControlProgram next{address_.session, "next"};
  ASSERT_EQ(next.writer.send(full_sample<ses::Control>(next.participants)), SendStatus::kSent);
  const auto late = inbox.next();
  ASSERT_TRUE(late) << "a place is free";
  EXPECT_EQ(late->origin.participant, ses::id_of("next"));
}

TEST_F(DamagedQos, AChangedFileTakesEffectInTheSameProcess) {
  EXPECT_EQ(join_error(address_), "");
  fs::remove(directory_ / "bulk.xml");
  EXPECT_NE(join_error(address_), "");
}

}  // namespace
}  // namespace tactus::wire::test
